"""k_f, and the stiffness of a contact, fitted to speeds and durations by eq. 1."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares
from scipy.special import chdtrc

from cradle_env.cradle import Cradle
from identification.apparatus.impacts.chain import MOST, dissipation, duration, passed_on
from identification.apparatus.impacts.data import Durations, Passed
from identification.storage.files import ExperimentError

#: Rows that a table without standard deviations needs: its own scatter is taken instead.
_LEAST_ROWS = 4
_STEP = 1e-4
#: Probability below which residuals larger than the stated errors are no chance.
_IMPROBABLE = 0.01

#: Speed of the last bob over that of the first, by number of bobs and A.
Chain = Callable[[int, np.ndarray], np.ndarray]


@dataclass(frozen=True, eq=False)
class Fit:
    """What speeds and durations say.

    names: of "k_f" [N s/m^(3/2)], "k_el" [N/m^(3/2)] and "exponent" (A grows with v to its power), those that were
    free; values, covariance: likewise; residuals: over their standard deviations, by table; widened: by which factor
    the stated errors were too small, 1 where chance explains it.
    """

    names: tuple[str, ...]
    values: np.ndarray
    covariance: np.ndarray
    residuals: tuple[np.ndarray, ...]
    spreads: tuple[np.ndarray, ...]
    widened: float
    squares: float

    def of(self, name: str) -> tuple[float, float]:
        """(value, standard deviation)."""
        k = self.names.index(name)
        return float(self.values[k]), float(np.sqrt(self.covariance[k, k]))


def fit(
    passed: Sequence[Passed],
    durations: Sequence[Durations],
    cradle: Cradle,
    free: Sequence[str],
    chain: Chain = passed_on,
) -> Fit:
    """Least squares with errors in both axes: a speed's own error counts as its slope times that of the quantity."""
    start = {"k_f": cradle.k_f, "k_el": cradle.k_el, "exponent": 0.2}
    scale = np.array([start[name] for name in free])
    speeds = np.concatenate([*(one.before for one in passed), *(one.speed for one in durations)])
    middle = float(np.exp(np.mean(np.log(speeds))))

    def models(unit: np.ndarray) -> list[np.ndarray]:
        of = start | dict(zip(free, unit * scale, strict=True))

        def A(v: np.ndarray) -> np.ndarray:
            base = dissipation(of["k_f"], of["k_el"], cradle.mass, v)
            return base * (v / middle) ** (of["exponent"] - 0.2)

        time = (0.5 * cradle.mass / of["k_el"]) ** 0.4
        return [
            *(one.before * chain(one.bobs, A(one.before)) for one in passed),
            *(time * one.speed**-0.2 * duration(A(one.speed)) for one in durations),
        ]

    seen = [*(one.after for one in passed), *(one.duration for one in durations)]

    def residual(unit: np.ndarray, spreads: Sequence[np.ndarray]) -> np.ndarray:
        made = models(unit)
        return np.concatenate([(y - f) / s for y, f, s in zip(seen, made, spreads, strict=True)])

    unit, spreads = np.ones(len(free)), [np.ones(len(y)) * float(np.mean(y)) for y in seen]
    found = None
    for _ in range(3):  # the spreads depend a little on the model
        found = least_squares(
            residual, unit, args=(spreads,), bounds=(1e-3, 1e3), diff_step=_STEP, x_scale=1.0, xtol=1e-10
        )
        unit = found.x
        spreads = _spreads(passed, durations, models(unit), seen, len(free))
    residuals = residual(unit, spreads)
    jacobian = np.column_stack([
        (residual(unit + step, spreads) - residual(unit - step, spreads)) / (2.0 * _STEP)
        for step in _STEP * np.eye(len(free))
    ])  # fmt: skip
    squares, freedom = float(residuals @ residuals), len(residuals) - len(free)
    too_large = freedom > 0 and chdtrc(freedom, squares) < _IMPROBABLE
    widened = float(np.sqrt(squares / freedom)) if too_large else 1.0
    covariance = np.linalg.pinv(jacobian.T @ jacobian) * widened**2 * np.outer(scale, scale)
    A = dissipation(float((unit * scale)[0]), cradle.k_el, cradle.mass, speeds)
    if A.max() > 0.98 * MOST:
        raise ExperimentError(
            f"k_f would be above {unit[0] * scale[0]:.3g} N s/m^(3/2), where e is below 0.35: no bobs of steel; check"
            " the units of the speeds, and the mass"
        )
    parts = tuple(np.split(residuals, np.cumsum([len(y) for y in seen])[:-1]))
    return Fit(tuple(free), unit * scale, covariance, parts, tuple(spreads), widened, squares)


def _spreads(
    passed: Sequence[Passed],
    durations: Sequence[Durations],
    made: Sequence[np.ndarray],
    seen: Sequence[np.ndarray],
    free: int,
) -> list[np.ndarray]:
    """Standard deviation of each row about the model, from the stated ones of both axes; else the table's scatter."""
    own = [
        *((one.file, one.after_sd, one.before_sd, f / one.before) for one, f in zip(passed, made, strict=False)),
        *(
            (one.file, one.duration_sd, one.speed_sd, 0.2 * f / one.speed)
            for one, f in zip(durations, made[len(passed) :], strict=True)
        ),
    ]
    spreads = []
    for (file, sd, speed_sd, slope), f, y in zip(own, made, seen, strict=True):
        if np.isnan(sd).any():
            if len(y) < _LEAST_ROWS + free:
                raise ExperimentError(
                    f"{file}: {len(y)} rows without standard deviations; state them in columns as v1_sd [m/s], or"
                    f" measure at least {_LEAST_ROWS + free} impacts, whose scatter tells"
                )
            share = float(np.sqrt(np.mean((y - f) ** 2 / f**2) * len(y) / (len(y) - free)))
            spreads.append(share * f)
        else:
            spreads.append(np.hypot(sd, slope * np.nan_to_num(speed_sd)))
    return spreads
