"""Benchmarks, and the peers they are run against."""
