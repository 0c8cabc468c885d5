"""A run as an xarray Dataset and as a pandas DataFrame."""

from __future__ import annotations

from typing import TYPE_CHECKING, Any

import numpy as np

if TYPE_CHECKING:
    import pandas
    import xarray

    from cradle_env.trajectory import Trajectory

#: Unit and meaning of what a run holds of each bob.
_MOTION = {
    "theta": ("rad", "angle of the bob from the vertical"),
    "r": ("m", "distance of the bob from the pivot"),
    "theta_dot": ("rad/s", "angular velocity"),
    "r_dot": ("m/s", "velocity along the string"),
}
#: Unit and meaning of what a run holds of each impact.
_IMPACTS = {
    "time": ("s", "instant of the impact"),
    "pair": ("1", "i: bobs i and i + 1"),
    "speed": ("m/s", "approach speed"),
    "loss": ("J", "energy taken by the impact"),
}


def dataset(run: Trajectory) -> xarray.Dataset:
    """The run as a Dataset, see `Trajectory.to_xarray`."""
    import xarray

    variables: dict[str, Any] = {
        name: (("time", "bob"), getattr(run, name), {"units": unit, "long_name": meaning})
        for name, (unit, meaning) in _MOTION.items()
    }
    variables["sigma"] = ("time", sigma_or_nan(run), {"units": "1", "long_name": "synchronization σ"})
    for name, (unit, meaning) in _IMPACTS.items():
        attributes = {"units": unit, "long_name": meaning}
        variables[f"impact_{name}"] = ("impact", run.impacts[name], attributes)
    coordinates: dict[str, Any] = {
        "time": ("time", run.t, {"units": "s", "long_name": "time since the release"}),
        "bob": np.arange(1, run.cradle.bobs + 1),
    }
    return xarray.Dataset(variables, coordinates, {"cradle": repr(run.cradle), "release": repr(run.release)})


def dataframe(run: Trajectory) -> pandas.DataFrame:
    """The run as a DataFrame, see `Trajectory.to_dataframe`."""
    import pandas

    columns = {
        f"{name}_{bob + 1} [{unit}]": getattr(run, name)[:, bob]
        for name, (unit, _) in _MOTION.items()
        for bob in range(run.cradle.bobs)
    }
    columns["sigma"] = sigma_or_nan(run)
    return pandas.DataFrame(columns, index=pandas.Index(run.t, name="t [s]"))


def sigma_or_nan(run: Trajectory) -> np.ndarray:
    """σ(t), shape (T,); nan where the samples do not allow it, being too few or not evenly spaced."""
    try:
        return run.sigma()
    except ValueError:
        return np.full(len(run.t), np.nan)
