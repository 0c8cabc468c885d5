"""How often the intervals of measurements hold the truth."""
