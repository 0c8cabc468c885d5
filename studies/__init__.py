"""Research programs beside the tests: each with its last results."""
