"""Convert posteriors for ArviZ: to InferenceData up to ArviZ 0.23, to an xarray DataTree from 1.0."""

from __future__ import annotations

import warnings
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from identification.inference.posterior_file import DIMENSIONS, attributes, variables
from identification.inference.samples import Samples


@contextmanager
def without_arviz_notice() -> Iterator[None]:
    """Ignore the FutureWarning by which ArviZ 0.23 announces version 1.0 when it is imported; both versions work."""
    with warnings.catch_warnings():
        warnings.filterwarnings("ignore", r"\s*ArviZ is undergoing a major refactor", FutureWarning)
        yield


def inference_data(samples: Samples) -> Any:
    """Convert samples to groups, variables and attributes as in posterior.nc; see `Posterior.to_inference_data`."""
    import xarray

    with without_arviz_notice():
        import arviz

    datasets = {}
    for group, known in variables(samples).items():
        E, S = samples.chain.shape[0], samples.chain.shape[1] * samples.chain.shape[2]
        coordinates = dict(zip(DIMENSIONS, (np.arange(E), np.arange(S)), strict=True))
        arrays = {name: (DIMENSIONS, values, {"units": unit}) for name, (values, unit) in known.items()}
        datasets[group] = xarray.Dataset(arrays, coordinates, attributes(samples) if group == "posterior" else None)
    if "InferenceData" in vars(arviz):  # getattr would cause a warning of ArviZ 1.0
        return arviz.InferenceData(**datasets)
    return xarray.DataTree.from_dict(datasets)
