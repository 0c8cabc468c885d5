"""Inference: from an experiment to the mode and the posterior of its unknowns."""
