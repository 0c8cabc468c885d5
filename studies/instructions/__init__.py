"""How many machine instructions the kernel takes."""
