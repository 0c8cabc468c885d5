"""Experiments: measured runs of a cradle and what is known about them, and the files that hold them."""
