"""What every instrument gives: values with their uncertainty, a picture, and what there is to say of them."""

from __future__ import annotations

import math
from abc import ABC, abstractmethod
from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cradle_env import __version__
from identification.experiment.constraint import FORMAT, Constraint

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Probabilities of the ends of the central 68 % and 95 % intervals.
_ENDS = (0.16, 0.84, 0.025, 0.975)


@dataclass(frozen=True)
class Value:
    """A measured quantity: median, standard deviation, and central 68 % and 95 % intervals, in its unit.

    symbol: as pictures and pages show it, such as "b_2"; meaning: in a few words.
    """

    symbol: str
    meaning: str
    unit: str
    median: float
    sd: float
    ci68: tuple[float, float]
    ci95: tuple[float, float]

    @classmethod
    def normal(cls, symbol: str, meaning: str, unit: str, mean: float, sd: float, low: float = -math.inf) -> Value:
        """Of a normal distribution, cut off at `low`, below which the quantity cannot be."""
        from scipy.stats import norm, truncnorm

        if math.isinf(low) or mean - low > 6.0 * sd:
            spread, quantiles = sd, mean + sd * norm.ppf((0.5, *_ENDS))
        else:
            cut = truncnorm((low - mean) / sd, math.inf, loc=mean, scale=sd)
            spread, quantiles = float(cut.std()), cut.ppf((0.5, *_ENDS))
        return cls._of(symbol, meaning, unit, spread, quantiles)

    @classmethod
    def of_samples(cls, symbol: str, meaning: str, unit: str, samples: np.ndarray) -> Value:
        """Of draws of its distribution."""
        return cls._of(symbol, meaning, unit, float(np.std(samples)), np.quantile(samples, (0.5, *_ENDS)))

    @classmethod
    def _of(cls, symbol: str, meaning: str, unit: str, sd: float, quantiles: np.ndarray) -> Value:
        median, low68, high68, low95, high95 = map(float, quantiles)
        return cls(symbol, meaning, unit, median, float(sd), (low68, high68), (low95, high95))

    def content(self) -> dict[str, Any]:
        """As JSON files have it."""
        return {
            "meaning": self.meaning,
            "unit": self.unit,
            "median": self.median,
            "sd": self.sd,
            "ci68": list(self.ci68),
            "ci95": list(self.ci95),
        }


@dataclass(frozen=True, eq=False)
class Measurement(ABC):
    """What one kind of instrument has found.

    values: by name; findings: what the data say, a sentence each; warnings: what to be careful about, likewise;
    inputs: SHA-256 over the files that were read; seed: of all random numbers.
    """

    #: The name after `cradle measure`.
    kind: ClassVar[str]
    #: What the picture shows.
    caption: ClassVar[str]

    values: Mapping[str, Value]
    findings: tuple[str, ...]
    warnings: tuple[str, ...]
    inputs: str
    seed: int

    @abstractmethod
    def figure(self) -> Figure:
        """The picture that shows whether it worked."""

    @abstractmethod
    def details(self) -> dict[str, Any]:
        """What measurement.json holds beside the values, for this kind alone."""

    def constraint(self) -> Constraint | None:
        """What it says of the cradle's parameters, for `calibrate`; None for nothing."""
        return None

    def files(self) -> Mapping[str, str | bytes | Path]:
        """Files to write beside measurement.json, picture and report, by name; a Path is a file to be moved there."""
        return {}

    def content(self) -> dict[str, Any]:
        """The content of measurement.json."""
        constraint = self.constraint()
        return {
            "format": FORMAT,
            "version": __version__,
            "seed": self.seed,
            "inputs": self.inputs,
            "kind": self.kind,
            "values": {name: value.content() for name, value in self.values.items()},
            "findings": list(self.findings),
            "warnings": list(self.warnings),
            "constraint": None if constraint is None else constraint.content(),
            "details": self.details(),
        }
