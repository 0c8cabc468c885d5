"""What a figure of the reproduction is: tables computed from the equations, drawn, and the claims they bear on."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.release import Release
from identification.sweep import Grid, Quantity, SweepResult, sweep

if TYPE_CHECKING:
    import matplotlib.figure

    from identification.inference.posterior import Posterior

#: Columns by their labels with units, each (rows,); the tables of a figure by their names.
Table = Mapping[str, np.ndarray]
Tables = Mapping[str, Table]

HOLDS, HOLDS_IF, FAILS = "holds", "holds if", "does not hold"
#: Source of a claim that the paper does not make.
BEYOND = "beyond"
#: The release of the standard set, γ = 0.00868 [rad].
ANGLE = 0.228
#: Numbers of bobs of every sweep.
BOBS = (2, 3, 5)
STANDARD_RELEASE = Release(angle=ANGLE)
#: Samples of θ per second in sweeps [1/s]. λ differs from that at 240/s by less than a relative 2e-4.
SAMPLE_RATE = 120.0


@dataclass(frozen=True)
class Claim:
    """A statement and its verdict.

    source: the section of the paper that states it, or BEYOND; verdict: HOLDS, HOLDS_IF (with a `condition`) or FAILS;
    evidence: the numbers that decide, in words.
    """

    statement: str
    source: str
    verdict: str
    evidence: str
    condition: str = ""

    @classmethod
    def judge(
        cls, statement: str, source: str, holds: bool, evidence: str, condition: str = "", otherwise: bool = False
    ) -> Claim:
        """Choose HOLDS if `holds`, else HOLDS_IF the condition if the weaker reading `otherwise` holds, else FAILS."""
        verdict = HOLDS if holds else HOLDS_IF if otherwise else FAILS
        return cls(statement, source, verdict, evidence, condition if verdict == HOLDS_IF else "")


@dataclass(frozen=True)
class Study:
    """The settings that all figures share.

    values: number of values of each parameter in a sweep; workers: threads; scratch: folder for unfinished sweeps;
    posterior: returns the posterior whose uncertainty the bands show; report(fraction, text): shows the progress of a
    figure; tables: of the figures that this one needs.
    """

    values: int
    workers: int | None
    scratch: Path
    posterior: Callable[[], Posterior]
    report: Callable[[float | None, str], None] = lambda *_: None
    tables: Mapping[str, Tables] = field(default_factory=dict)

    def sweep(
        self,
        name: str,
        axes: Mapping[str, Any],
        cradle: Cradle,
        release: Release = STANDARD_RELEASE,
        quantities: Sequence[str | Quantity] = ("lambda",),
        times: np.ndarray | None = None,
    ) -> SweepResult:
        """Run a sweep over 60 s; an interrupted sweep of this name is resumed."""

        def report(_: str, fraction: float | None, text: str = "") -> None:
            self.report(fraction, f"{name}: {text}")

        return sweep(
            Grid(axes, cradle, release), quantities, sample_rate=SAMPLE_RATE, times=times, out=self.scratch / name,
            workers=self.workers, progress=report,
        )  # fmt: skip


@dataclass(frozen=True)
class Figure:
    """A figure: functions that compute its tables, draw it and judge its claims.

    needs: names of the figures whose tables `data` reads from the study; calibrated: whether it reads the posterior.
    """

    name: str
    title: str
    data: Callable[[Study], Tables]
    draw: Callable[[Tables], matplotlib.figure.Figure]
    claims: Callable[[Tables], Sequence[Claim]] = lambda _: ()
    needs: tuple[str, ...] = ()
    calibrated: bool = False
