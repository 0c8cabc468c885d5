"""The next experiment: the bobs, release, δ and duration that give the most information."""
