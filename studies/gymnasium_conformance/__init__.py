"""Gymnasium's own tests of environments, vectors and wrappers, run on the cradles."""
