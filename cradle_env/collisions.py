"""The law of a pair impact: e(v), contact times, and α and n of the power law that comes nearest."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from cradle_env.cradle import Cradle


def write_law(record: np.ndarray, cradle: Cradle) -> None:
    """Writes the law of a cradle's impacts into the record that the kernels read, (1,) of CRADLE."""
    from cradle_env.mechanics import layout as p

    record["k_el"], record["k_f"], record["restitution"] = cradle.k_el, cradle.k_f, cradle.restitution
    record["alpha"], record["exponent"] = cradle.power_law or (0.0, 0.0)
    record["law"] = p.KUWABARA_KONO if cradle.power_law is None else p.POWER_LAW
    if not cradle.has("velocity_dependent_restitution"):
        record["law"] = p.CONSTANT


def _curve(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """(e, contact time [s]) of two bobs at each speed [m/s]; (len(speeds), 2)."""
    from cradle_env.mechanics import layout, restitution

    record, bobs = np.zeros(1, layout.CRADLE), np.zeros(cradle.bobs, layout.BOB)
    write_law(record, cradle)
    for effect in cradle.composition:
        if effect.acts_on in ("bob", "contact") and effect.apply is not None:
            effect.apply(record, bobs, cradle.effects.get(effect.name, {}))
    speeds = np.atleast_1d(np.ascontiguousarray(speeds, dtype=float))
    if not (np.isfinite(speeds) & (speeds > 0.0)).all():
        raise ValueError("impact speeds must be finite and greater than 0 m/s")
    curve = np.empty((len(speeds), 2))
    inertia = cradle.mass + bobs["added_mass"][0]
    restitution.curve(record[0], restitution.universal_curves(), 0.5 * inertia, speeds, curve)
    # Of a cradle whose contacts are instantaneous it is the time by eq. 1.
    curve[:, 1] *= record["contact_scale"][0] or 1.0
    return curve


def restitution_curve(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """e of two bobs that meet at normal speeds v > 0 [m/s]; the shape of `speeds` (eq. 1, or the cradle's law)."""
    return _curve(cradle, np.ravel(speeds))[:, 0].reshape(np.shape(speeds))


def contact_times(cradle: Cradle, speeds: np.ndarray) -> np.ndarray:
    """How long [s] two bobs touch that meet at normal speeds v > 0 [m/s]; the shape of `speeds` (eq. 1)."""
    return _curve(cradle, np.ravel(speeds))[:, 1].reshape(np.shape(speeds))


def fit_power_law(cradle: Cradle, slowest: float, fastest: float) -> tuple[float, float]:
    """(α, n) of e = 1 − α vⁿ, least squares over speeds from slowest to fastest [m/s]."""
    from scipy.optimize import curve_fit

    if cradle.k_f == 0.0:
        return 0.0, 0.0
    v = np.linspace(slowest, fastest, 200)
    (alpha, n), _ = curve_fit(lambda v, alpha, n: 1.0 - alpha * v**n, v, restitution_curve(cradle, v), p0=(0.03, 0.2))
    return float(alpha), float(n)
