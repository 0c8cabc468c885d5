"""Reference integrators of the tests, independent of the package."""
