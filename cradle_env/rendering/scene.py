"""What a picture of a cradle shows, as numbers."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from cradle_env.kernel_records import records
from cradle_env.release import InitialState
from cradle_env.synchronization import newton_exponent
from cradle_env.trajectory import Trajectory

#: An impact shows for this long, fading [s].
FADE = 0.1
#: Steepest lift [rad] that a picture holds.
_LIFT = 1.5


@dataclass(frozen=True)
class Scene:
    """All that a picture of a cradle shows, SI; z points upwards from the pivots' height.

    time [s]; pivots, x, z (N,): x of the pivots, centres of the bobs [m]; radius [m] of a bob; load (N,): tension of
    the strings over that at rest, 0 where slack; contact (N − 1,): impact speed of each pair that has just met [m/s],
    0 for the others; sigma_times [s], sigma (M,): σ so far; newton_exponent: λ [1/s], nan while unknown; delta: δ,
    one number or one per gap; duration [s] of the whole, the axis of σ; extent: half width and depth below the pivots
    [m] that the picture holds. The last two stay the same from frame to frame, and so does the view.
    """

    time: float
    pivots: np.ndarray
    x: np.ndarray
    z: np.ndarray
    radius: float
    load: np.ndarray
    contact: np.ndarray
    sigma_times: np.ndarray
    sigma: np.ndarray
    newton_exponent: float
    delta: float | np.ndarray
    duration: float
    extent: tuple[float, float]
    title: str = ""

    def readings(self) -> dict[str, str]:
        """What is written beside the picture: values by symbol, a dash where there is none."""
        gaps = np.ravel(self.delta)
        ends = [f"{gap:+.4f}" if gap else "0" for gap in sorted({gaps.min(), gaps.max()})] if gaps.size else []
        sigma = self.sigma[-1] if len(self.sigma) else np.nan
        readings = {
            "δ": " … ".join(ends),
            "t": f"{self.time:.2f} s",
            "σ": f"{sigma:.3f}" if np.isfinite(sigma) else "",
            "λ": f"{self.newton_exponent:.3f} s⁻¹" if np.isfinite(self.newton_exponent) else "",
        }
        return {symbol: value.replace("-", "−") or "–" for symbol, value in readings.items()}


def extent(cradle: Cradle) -> tuple[float, float]:
    """Half width and depth below the pivots [m] that hold every bob, lifted by ±1.5 rad, its strings stretched."""
    # At the bottom of a swing from the horizontal strings carry three times the weight; for a moment, twice that.
    length = cradle.length * (1.0 + 6.0 * cradle.beta**2 * cradle.has("radial_elasticity"))
    reach = length * (1.0 if cradle.has("large_angle") else _LIFT)
    return float(np.abs(cradle.pivots).max() + reach + cradle.radius), length + cradle.radius


def loads(run: Trajectory) -> np.ndarray:
    """Tension of the strings over that at rest, (T, N), with the memory they have of their loading; 1 if they are
    rigid."""
    if not run.cradle.has("radial_elasticity"):
        return np.ones_like(run.r)
    bobs = records(run.cradle)[1]
    unstretched = bobs["string"] + bobs["creep"] * np.log1p(run.t)[:, None]
    stretch = np.maximum(np.hypot(run.r, bobs["half_spacing"]) - unstretched, 0.0)
    line = bobs["kappa"] * stretch * bobs["grip"] / (bobs["mass"] * run.cradle.gravity)  # as at the first loading
    loads = line.copy()
    ratio = run.release.tension_ratio if isinstance(run.release, InitialState) else None
    if run.cradle.has("string_hysteresis"):
        loads[0] *= 1.0 if ratio is None else ratio
        for k in range(1, len(line)):
            # Loading adds what the line adds; unloading goes as the square of the stretch, and so of the line.
            share = np.divide(line[k], line[k - 1], out=np.zeros_like(line[k]), where=line[k - 1] > 0.0)
            rise = line[k] - line[k - 1]
            loads[k] = np.where(rise > 0.0, loads[k - 1] + rise, loads[k - 1] * share**2)
    return loads


def contact(impacts: np.ndarray, bobs: int, time: float, fade: float = FADE) -> np.ndarray:
    """Speed [m/s] of the impacts (see `IMPACT`) of each pair up to `time`, fading over `fade` [s]; shape (N − 1,)."""
    left = 1.0 - (time - impacts["time"]) / fade
    recent = (left > 0.0) & (left <= 1.0)
    speed = np.zeros(bobs - 1)
    np.maximum.at(speed, impacts["pair"][recent] - 1, impacts["speed"][recent] * left[recent])
    return speed


def scenes(run: Trajectory, fps: float = 30.0, speed: float = 1.0) -> Iterator[Scene]:
    """The scenes of a run for a film of `fps` frames a second, `speed` times as fast as life."""
    check_range("fps", fps, "1/s", 0.0, above=True)
    check_range("speed", speed, "", 0.0, above=True)
    cradle, t, sigma = run.cradle, run.t, run.sigma()
    times = np.arange(t[0], t[-1] + 1e-9, speed / fps)
    of_run = (run.x(), run.theta, run.r, loads(run))
    x, theta, r, tensions = (np.array([np.interp(times, t, bob) for bob in column.T]).T for column in of_run)
    z = -r * np.cos(theta) if cradle.has("large_angle") else -r
    held = extent(cradle)
    for k, time in enumerate(times):
        past = np.searchsorted(t, time, side="right")
        yield Scene(
            time=float(time),
            pivots=cradle.pivots,
            x=x[k],
            z=z[k],
            radius=cradle.radius,
            load=tensions[k],
            contact=contact(run.impacts, cradle.bobs, time, FADE * speed),
            sigma_times=t[:past],
            sigma=sigma[:past],
            newton_exponent=float(newton_exponent(t[:past], sigma[:past])),
            delta=cradle.gaps,
            duration=float(t[-1]),
            extent=held,
            title="Newton's cradle",
        )
