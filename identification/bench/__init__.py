"""Benchmarks of speed, accuracy and diagnosis, and the SciPy integrator that they compare with."""
