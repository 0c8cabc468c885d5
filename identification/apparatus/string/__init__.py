"""Strings: force against displacement, the stiffness of loading, and what unloading takes."""
