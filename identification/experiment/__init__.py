"""Experiments: measured runs of a cradle, what is known about them, and the files that hold them."""
