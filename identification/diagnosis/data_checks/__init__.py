"""Checks of the data themselves, before the diagnosis looks for a missing effect."""
