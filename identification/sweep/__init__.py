"""Sweeps: one run of a cradle at every point of a grid, in memory that does not grow with it.

from identification.sweep import Grid, sweep
swept = sweep(Grid({"beta": betas, "delta": deltas}, Cradle(bobs=2), Release(angle=0.228)), out="folder")
swept["lambda"], swept.failures()
"""

from identification.sweep.engine import sweep
from identification.sweep.grid import Axis, Grid
from identification.sweep.quantities import QUANTITIES, Quantity
from identification.sweep.sweep_result import SweepResult

__all__ = ["QUANTITIES", "Axis", "Grid", "Quantity", "SweepResult", "sweep"]
