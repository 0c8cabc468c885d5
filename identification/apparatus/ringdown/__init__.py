"""Ring-down: groups of bobs that swing together, and the drag on each."""
