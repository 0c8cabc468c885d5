"""The law of a pair impact as numbers: e(v), contact times, and α and n of the power law that comes nearest."""

from __future__ import annotations

import numpy as np


def pair_impacts(law: np.ndarray, inertia: float, speeds: np.ndarray) -> np.ndarray:
    """(e, contact time [s]) of two bobs that meet at each normal speed [m/s]; (len(speeds), 2).

    law: the record (1,) of CRADLE that the kernels read, its contact part filled; inertia [kg]: of one bob.
    Raises ValueError for speeds that are not finite and above 0 m/s.
    """
    from cradle_env.mechanics import restitution

    speeds = np.atleast_1d(np.ascontiguousarray(speeds, dtype=float))
    if not (np.isfinite(speeds) & (speeds > 0.0)).all():
        raise ValueError("impact speeds must be finite and greater than 0 m/s")
    curve = np.empty((len(speeds), 2))
    restitution.curve(law[0], restitution.universal_curves(), 0.5 * inertia, speeds, curve)
    # Of a cradle whose contacts are instantaneous it is the time by eq. 1.
    curve[:, 1] *= law["contact_scale"][0] or 1.0
    return curve


def fit_power_law(law: np.ndarray, inertia: float, slowest: float, fastest: float) -> tuple[float, float]:
    """(α, n) of e = 1 − α vⁿ, least squares over speeds from slowest to fastest [m/s]; see `pair_impacts`."""
    from scipy.optimize import curve_fit

    v = np.linspace(slowest, fastest, 200)
    e = pair_impacts(law, inertia, v)[:, 0]
    (alpha, n), _ = curve_fit(lambda v, alpha, n: 1.0 - alpha * v**n, v, e, p0=(0.03, 0.2))
    return float(alpha), float(n)
