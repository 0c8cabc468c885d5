"""Impacts: speeds before and after, contact durations, and the dissipation k_f behind them."""
