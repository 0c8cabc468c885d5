"""Tries to break the program: `python -m studies.fuzz`, or `make fuzz`."""
