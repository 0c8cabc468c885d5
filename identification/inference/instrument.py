"""How an instrument sees the bobs: when it looks, over how long it averages, and what it then shows."""

from __future__ import annotations

import functools
import math
from dataclasses import dataclass

import numpy as np

from cradle_env.cradle import Cradle


@dataclass(frozen=True, eq=False)
class Instrument:
    """What turns the motion of a cradle into readings, by the measurement effects of its model.

    quantity: "theta", or "x" for horizontal displacements from the bobs' rest positions.

    A reading averages over K instants (K = 1 without any blur): sample the motion at `instants(times)`, in any
    order and as often as they occur, and give what it is there, in their order, to `readings`.
    """

    cradle: Cradle
    quantity: str = "theta"

    @functools.cached_property
    def exposure(self) -> tuple[np.ndarray, np.ndarray]:
        """Offsets [s] from the time of a reading, and weights, of the instants that it averages; both (K,)."""
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
        """How fast the file's clock runs over the true one."""
        rates = (
            effect.clock(self.cradle.effects.get(effect.name, {}))
            for effect in self.cradle.composition
            if effect.clock is not None
        )
        return math.prod(rates)

    def instants(self, times: np.ndarray) -> np.ndarray:
        """When to sample the motion [s], (T K,), for readings at times (T,) by the file's clock: those of each reading
        in turn. Both count from the same instant.

        They are in order of time unless exposures overlap, and may begin before the first reading.
        """
        offsets, _ = self.exposure
        true = times / self.clock if self.clock != 1.0 else times
        return true if len(offsets) == 1 else (np.asarray(true)[:, None] + offsets).ravel()

    def readings(
        self, theta: np.ndarray, r: np.ndarray | None = None, rest: tuple[np.ndarray, np.ndarray] | None = None
    ) -> np.ndarray:
        """Readings (..., T, N) [rad or m] of a motion theta [rad] and r [m], (..., T K, N), at `instants`.

        r and rest serve x only. rest: theta and r of the bobs in equilibrium, (..., N), from where x is counted; the
        vertical where omitted, though for δ < 0 bobs lean. Angles are averaged before their scale changes them; x is
        the average of what the changed angles give. May return `theta` itself.
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
