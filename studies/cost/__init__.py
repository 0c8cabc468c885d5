"""What runs cost, against their size."""
