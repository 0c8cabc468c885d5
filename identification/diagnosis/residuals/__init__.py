"""Tests of the residuals: when, for which bob and in which phase the model departs from the data."""
