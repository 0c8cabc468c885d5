"""How often a calibration ends in the right mode."""
