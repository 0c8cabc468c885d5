"""How a run of a cradle begins: bobs lifted and let go, or any other state."""

from __future__ import annotations

import dataclasses
import math
from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from cradle_env import display
from cradle_env.cradle import Cradle
from cradle_env.errors import check_range, one_line
from cradle_env.pickling import reduce_to_fields


@dataclass(frozen=True)
class Release:
    """Bobs lifted and let go at rest at t = 0.

    Lifted neighbours that overlap by less than a quarter of their radius, or because δ < 0, are spread until they
    touch.

    Parameters
    ----------
    angle : float, optional
        Angle [rad], −π to π, positive towards the last bob, of the `bobs` bobs nearest the last one.
    bobs : int
        How many bobs are lifted to `angle`.
    angles : mapping of int to float, optional
        Angle [rad] of each lifted bob by its number, 1 to N, instead of `angle`.
    start : {"unstretched", "hanging"}
        Distance r of the lifted bobs from their pivots: r0, as in the paper, or their hanging length.

    Raises
    ------
    ValueError
        For both or neither of angle and angles, and for values out of bounds.

    Examples
    --------
    >>> from cradle_env import Cradle
    >>> Release(angle=0.2, bobs=2).angles_of(Cradle(bobs=4)).tolist()
    [nan, nan, 0.2, 0.2]
    >>> Release(angles={1: -0.2, 4: 0.2}).angles_of(Cradle(bobs=4)).tolist()
    [-0.2, nan, nan, 0.2]
    """

    angle: float | None = None
    bobs: int = 1
    angles: Mapping[int, float] | None = None
    start: str = "unstretched"

    def __post_init__(self) -> None:
        if (self.angle is None) == (self.angles is None):
            raise ValueError("a release needs either angle (with bobs) or angles {bob: angle}")
        if self.start not in ("unstretched", "hanging"):
            raise ValueError(f"start is {one_line(self.start)}; it must be 'unstretched' or 'hanging'")
        if self.angle is not None:
            object.__setattr__(self, "angle", check_range("release angle", self.angle, "rad", -math.pi, math.pi))
            bobs = check_range("release bobs", self.bobs, "", 1, 200)
            if bobs != int(bobs):
                raise ValueError(f"release bobs is {one_line(self.bobs)}; it must be a whole number, at least 1")
            object.__setattr__(self, "bobs", int(bobs))
        else:
            if self.bobs != 1:
                raise ValueError(f"release bobs is {one_line(self.bobs)}; angles names the bobs, so leave it out")
            if not isinstance(self.angles, Mapping) or not self.angles:
                raise ValueError(f"angles is {one_line(self.angles)}; give {{bob: angle}} for at least one bob")
            angles = {}
            for i, angle in self.angles.items():
                bob = check_range("release bob", i, "")
                if bob != int(bob):
                    raise ValueError(f"release bob is {one_line(i)}; it must be a whole number")
                angles[int(bob)] = check_range(f"release angle of bob {i}", angle, "rad", -math.pi, math.pi)
            object.__setattr__(self, "angles", MappingProxyType(angles))

    def __reduce__(self):
        return reduce_to_fields(self)

    def angles_of(self, cradle: Cradle) -> np.ndarray:
        """Release angle of each bob [rad], nan for those that hang; shape (N,)."""
        angles = np.full(cradle.bobs, np.nan)
        if self.angles is None:
            if self.bobs > cradle.bobs:
                raise ValueError(f"release lifts {self.bobs} bobs; the cradle has {cradle.bobs}")
            angles[cradle.bobs - self.bobs :] = self.angle
        else:
            for bob, angle in self.angles.items():
                if not 1 <= bob <= cradle.bobs:
                    raise ValueError(f"release names bob {bob}; the cradle has bobs 1 to {cradle.bobs}")
                angles[bob - 1] = angle
        steepest = np.nanmax(np.abs(angles))
        if cradle.has("radial_elasticity") and steepest > 1.5:
            raise ValueError(
                f"release angle is {steepest:g} rad; on strings it must be at most 1.5 rad"
                " (beyond, the strings go slack); use model 'pendulum' for rigid rods"
            )
        return angles

    def lead(self, cradle: Cradle) -> tuple[int, float]:
        """(index of the lifted end bob, its release angle [rad]): θ_n and θ0 of σ."""
        angles = self.angles_of(cradle)
        lifted = np.flatnonzero(~np.isnan(angles) & (angles != 0.0))
        if len(lifted) == 0:
            return cradle.bobs - 1, 0.0
        end = int(lifted[-1] if np.isfinite(angles[-1]) or not np.isfinite(angles[0]) else lifted[0])
        return end, float(abs(angles[end]))

    def lifted_to(self, angle: float, cradle: Cradle) -> Release:
        """The same bobs at other angles: the lead angle as asked [rad], the rest of `angles` in proportion."""
        if self.angles is None:
            return dataclasses.replace(self, angle=angle)
        lead = self.lead(cradle)[1]
        if lead == 0.0:
            raise ValueError("release angles are all 0 rad; no other angle is in proportion to them, so state all anew")
        return dataclasses.replace(self, angles={bob: own / lead * angle for bob, own in self.angles.items()})

    def check_synchronizes(self, cradle: Cradle) -> None:
        """ValueError where bobs let go like this have nothing to synchronize with: σ and λ would mean nothing."""
        angles, bobs = np.nan_to_num(self.angles_of(cradle)), cradle.bobs
        if bobs == 1:
            raise ValueError("one bob has nothing to synchronize with; take 2 bobs or more")
        if not angles.any():
            raise ValueError("release angle is 0 rad; σ and λ are relative to it, so lift a bob")
        if np.ptp(angles) == 0.0:
            raise ValueError(f"all {bobs} bobs are lifted alike and have nothing to synchronize with; lift fewer")

    def gamma(self, cradle: Cradle) -> float:
        """γ = θ0²/6."""
        return self.lead(cradle)[1] ** 2 / 6.0

    def __repr__(self) -> str:
        return display.summary_line("Release", display.changed_fields(self))

    def _repr_html_(self) -> str:
        if self.angles is None:
            rows = [("angle", display.value_text(self.angle), "rad"), ("bobs", str(self.bobs), "")]
        else:
            rows = [(f"angle of bob {bob}", display.value_text(angle), "rad") for bob, angle in self.angles.items()]
        return display.table("Release", [*rows, ("start", self.start, "")])


@dataclass(frozen=True)
class InitialState:
    """Any state from which a run can begin, at t = 0; bobs that overlap a little are spread as those of a `Release`.

    Parameters
    ----------
    theta, theta_dot : ndarray, shape (N,)
        Angle [rad] and its rate [rad/s] of each bob.
    r, r_dot : ndarray, shape (N,), optional
        Distance from the pivots' line [m] and its rate [m/s]. Default: the hanging length, and 0.
    tension_ratio : ndarray, shape (N,), optional
        Tension of a string over that of a new one at the same stretch, the memory of its loading (eq. 4); at most 1,
        the default.

    Examples
    --------
    >>> import numpy as np
    >>> from cradle_env import Cradle, simulate
    >>> state = InitialState(theta=np.array([0.0, 0.1]), theta_dot=np.zeros(2))
    >>> simulate(Cradle(bobs=2), state, duration=0.1).theta[0].round(6).tolist()
    [0.0, 0.1]
    """

    theta: np.ndarray
    theta_dot: np.ndarray
    r: np.ndarray | None = None
    r_dot: np.ndarray | None = None
    tension_ratio: np.ndarray | None = None
