"""Mean, spread and central intervals of samples."""

from __future__ import annotations

from typing import Any

import numpy as np


def statistics(samples: np.ndarray) -> dict[str, Any]:
    """Compute mean, sd, median and central 68 and 95 % intervals of the finite samples; None if there are none.

    >>> statistics(np.array([1.0, 2.0, 3.0, np.nan]))["median"]
    2.0
    """
    finite = samples[np.isfinite(samples)]
    if len(finite) == 0:
        return {"mean": None, "sd": None, "median": None, "ci68": [None, None], "ci95": [None, None]}
    q = np.quantile(finite, (0.025, 0.16, 0.5, 0.84, 0.975))
    return {
        "mean": float(finite.mean()),
        "sd": float(finite.std(ddof=1)) if len(finite) > 1 else 0.0,
        "median": float(q[2]),
        "ci68": [float(q[1]), float(q[3])],
        "ci95": [float(q[0]), float(q[4])],
    }
