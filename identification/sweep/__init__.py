"""Sweeps: simulate a cradle at every point of a grid. Memory does not grow with the number of points.

Examples
--------
>>> from cradle_env import Cradle, Release
>>> from identification.sweep import Grid, sweep
>>> grid = Grid({"delta": [-0.01, 0.0, 0.01]}, Cradle(bobs=2), Release(angle=0.228))
>>> swept = sweep(grid, ("lambda",))
>>> swept["lambda"].shape, swept.failures()
((3,), {})
"""

from identification.sweep.engine import sweep
from identification.sweep.grid import Axis, Grid
from identification.sweep.quantities import QUANTITIES, Quantity
from identification.sweep.sweep_result import SweepResult

__all__ = ["QUANTITIES", "Axis", "Grid", "Quantity", "SweepResult", "sweep"]
