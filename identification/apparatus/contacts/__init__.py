"""Contact resistance: which bobs touch, when and for how long."""
