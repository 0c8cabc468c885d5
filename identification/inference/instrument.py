"""The instrument: when it reads the motion, over what time it averages, and what it shows."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from cradle_env.cradle import Cradle


@dataclass(frozen=True, eq=False)
class Instrument:
    """An instrument that turns the motion of a cradle into readings, by the measurement effects of its model.

    A reading averages over K instants; K = 1 without exposure blur. To compute readings, simulate the motion at
    `instants(times)` and pass it, in the same order, to `readings`.

    Parameters
    ----------
    cradle : Cradle
        The cradle with the measurement effects.
    quantity : {"theta", "x"}
        Angles [rad], or horizontal displacements from the rest positions [m].

    Examples
    --------
    >>> blurred = Instrument(Cradle(bobs=2, effects={"exposure_blur": {"duration": 0.01}}))
    >>> instants = blurred.instants(np.array([0.5]))
    >>> len(instants), round(float(instants.mean()), 6)
    (10, 0.5)
    """

    cradle: Cradle
    quantity: str = "theta"

    @functools.cached_property
    def exposure(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets [s] from the time of a reading, and weights, of the instants that it averages; each (K,)."""
        offsets, weights = np.zeros(1), np.ones(1)
        for effect in self.cradle.composition:
            if effect.acts_on == "measurement" and effect.instants is not None:
                more, shares = effect.instants(self.cradle.effects.get(effect.name, {}))
                if np.any(more):
                    offsets = (offsets[:, None] + more).ravel()
                    weights = (weights[:, None] * shares).ravel()
        return offsets, weights

    @functools.cached_property
    def clock(self) -> float:
        """Rate of the file's clock over that of a true clock."""
        rates = (
            effect.clock(self.cradle.effects.get(effect.name, {}))
            for effect in self.cradle.composition
            if effect.clock is not None
        )
        return math.prod(rates)

    def instants(self, times: np.ndarray) -> np.ndarray:
        """True times [s], (T K,), at which to simulate the motion for readings at times (T,) of the file's clock.

        Both clocks have the same zero. The K instants of each reading follow each other. They ascend unless exposures
        overlap, and may begin before the first reading.
        """
        offsets, _ = self.exposure
        true = times / self.clock if self.clock != 1.0 else times
        return true if len(offsets) == 1 else (np.asarray(true)[:, None] + offsets).ravel()

    def readings(
        self, theta: np.ndarray, r: np.ndarray | None = None, rest: tuple[np.ndarray, np.ndarray] | None = None
    ) -> np.ndarray:
        """Compute readings from the motion at `instants`.

        Angles are averaged and then changed by offset and scale. For x, the angles are changed first and the
        displacements averaged.

        Parameters
        ----------
        theta : ndarray of shape (..., T K, N)
            Angles [rad].
        r : ndarray of shape (..., T K, N), optional
            Lengths [m]; needed for x only.
        rest : (ndarray, ndarray), optional
            theta [rad] and r [m] of the bobs in equilibrium, each (..., N), the origin of x. If omitted, the origin is
            below the pivot, which is wrong for δ < 0, where bobs lean.

        Returns
        -------
        ndarray of shape (..., T, N)
            [rad or m]; it may be `theta` itself.
        """
        if self.quantity == "theta":
            return self._scaled(self._averaged(theta))
        if r is None:
            raise ValueError("readings of x need r beside theta")
        rest_theta, rest_r = (np.zeros(1), np.full(1, self.cradle.length)) if rest is None else rest
        at_rest = self._position(rest_theta[..., None, :], rest_r[..., None, :])
        return self._averaged(self._position(theta, r)) - at_rest

    def _scaled(self, theta: np.ndarray) -> np.ndarray:
        for effect in self.cradle.composition:
            if effect.acts_on == "measurement" and effect.reading is not None:
                theta = effect.reading(self.cradle.effects.get(effect.name, {}), theta)
        return theta

    def _position(self, theta: np.ndarray, r: np.ndarray) -> np.ndarray:
        theta = self._scaled(theta)
        return r * (np.sin(theta) if self.cradle.has("large_angle") else theta)

    def _averaged(self, seen: np.ndarray) -> np.ndarray:
        _, weights = self.exposure
        if len(weights) == 1:
            return seen
        *batch, instants, bobs = seen.shape
        parts = seen.reshape(*batch, instants // len(weights), len(weights), bobs)
        return weights @ parts
