"""The next experiment: which release, spacing and duration would tell the models apart."""
