"""Learned laws: a smooth force or impact law for what no effect of the catalogue explains."""
