"""κ of a string, and what eq. 4 says of it and what it does not, from force-displacement curves."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from identification.apparatus.measurement import Measurement, Value
from identification.apparatus.string.curve import Curve, read_curves
from identification.apparatus.string.cycles import Cycle, cycles_of, loss_share
from identification.apparatus.string.fit import Fit, fit, selected
from identification.experiment.constraint import Constraint
from identification.number_format import Rounding, format_number, unit_plain
from identification.progress import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Of each term: symbol, meaning, unit, and what it says of a string or a machine that has it.
_TERMS = {
    "exponent": ("p", "exponent of unloading, T = T_max (s/s_max)^p; 2 in eq. 4", "1", "Unloading is not quadratic"),
    "curvature": ("c", "growth of the slope of loading with the stretch", "1/m", "Loading is not linear"),
    "rate": ("ρ", "growth of κ by a factor e in speed, as a share of κ", "1", "Loading stiffens with speed"),
    "force": ("p_F", "growth of p by a factor e in the largest force", "1", "Unloading depends on the largest force"),
    "creep": ("q", "growth of the slack with ln(1 + t/1 s)", "m", "The string creeps, as string_creep has it"),
    "backlash": ("B", "how far the machine turns back before the string notices", "m", "The machine has play"),
}
#: RMS residual of eq. 4 over the noise from which on it is said to miss something.
_MISFIT = 1.1


@dataclass(frozen=True, eq=False)
class StringMeasurement(Measurement):
    """κ and the terms beside eq. 4; see `measure_string`.

    chosen: the fit with the terms that the data ask for; plain: eq. 4 alone, with the play of the machine where that
    is asked for; cycles: each by itself.
    """

    kind: ClassVar[str] = "string"
    caption: ClassVar[str] = (
        "Top left: force against displacement, data (dots), the law that the data ask for (lines), and eq. 4 (grey)."
        " Top right: unloading, T/T_max against s/s_max, with the parabola of eq. 4. Bottom left: residuals of eq. 4"
        " over the noise, loading and unloading. Bottom right: loading stiffness of each cycle by itself, 95 %"
        " intervals, and κ with its band."
    )

    chosen: Fit
    plain: Fit
    cycles: tuple[Cycle, ...]

    def figure(self) -> Figure:
        """Curves, unloading, what eq. 4 leaves, and the stiffness of each cycle."""
        from identification.apparatus.string.figure import string_figure

        return string_figure(self)

    def details(self) -> dict[str, Any]:
        """The terms that the data ask for, the cycles, and lines for an experiment.toml."""
        return {
            "terms": list(self.chosen.terms),
            "residual_over_noise": {"chosen": _rms(self.chosen), "eq. 4": _rms(self.plain)},
            "noise_N": {curve.file: curve.noise for curve in self.chosen.curves},
            "cycles": [
                {
                    "file": cycle.file,
                    "number": cycle.number,
                    "largest_force_N": cycle.force,
                    "rate_m_per_s": cycle.rate,
                    "stiffness_N_per_m": dict(zip(("median", "sd"), cycle.stiffness, strict=True)),
                    "work_J": dict(zip(("median", "sd"), cycle.work, strict=True)),
                    "loss_J": dict(zip(("median", "sd"), cycle.loss, strict=True)),
                    "full": cycle.full,
                }
                for cycle in self.cycles
            ],
            "experiment_toml": self.experiment_toml(),
        }

    def constraint(self) -> Constraint:
        """κ, and the rate of creep where the string creeps in time."""
        terms = ["kappa", *(["creep"] if self._creeps else [])]
        rows = [self.chosen.names.index(name) for name in terms]
        names = tuple({"creep": "string_creep.rate"}.get(name, name) for name in terms)
        return Constraint("string", names, self.chosen.values[rows], self.chosen.covariance[np.ix_(rows, rows)])

    @property
    def _creeps(self) -> bool:
        return "creep" in self.chosen.terms and all(curve.time is not None for curve in self.chosen.curves)

    def experiment_toml(self) -> str:
        """Lines for an experiment.toml: [cradle] kappa, and string_creep where the string creeps."""
        kappa = self.values["kappa"]
        lines = ["[cradle]", f"kappa = {kappa.median:.6g}"]
        if self._creeps:
            rate = self.values["creep"].median
            lines += ["[model]", 'effects = ["string_creep"]', "[model.parameters]"]
            lines.append(f"string_creep = {{ rate = {rate:.6g} }}")
        lines += ["[infer]", f"kappa = {{ mean = {kappa.median:.6g}, sd = {kappa.sd:.2g} }}"]
        return "\n".join([*lines, ""])


def measure_string(
    curves: Sequence[str | Path], *, progress: Progress = lambda *_: None
) -> StringMeasurement:  # fmt: skip
    """Measure the stiffness and the hysteresis of a string from cycles of force against displacement.

    Parameters
    ----------
    curves : sequence of path
        CSV files of one string, with columns displacement and force, and t where the speed matters. Each begins with
        the string slack or just straight, and unloaded.
    progress : callable, optional
        Called with a stage, the part that is done, and words.

    Returns
    -------
    StringMeasurement

    Raises
    ------
    ValueError
        One line, for curves that cannot be used.
    """
    progress("read", 0.0, f"{len(curves)} curves")
    read, inputs = read_curves(curves)
    progress("fit", 0.1, f"{sum(len(curve.force) for curve in read)} readings")
    chosen, telling = selected(read)
    plain = fit(read, [name for name in chosen.terms if name == "backlash"])
    play = chosen.of("backlash") if "backlash" in chosen.terms else (0.0, 0.0)
    cycles = tuple(cycle for k, curve in enumerate(read) for cycle in cycles_of(curve, _zero(chosen, k), play))
    values = {"kappa": Value.normal("κ", "loading stiffness of the string", "N/m", *chosen.of("kappa"))}
    for name, one in telling.items():
        symbol, meaning, unit, _ = _TERMS[name]
        mean, sd = one.of(name)
        low = 0.0 if name == "backlash" else -np.inf
        values[name] = Value.normal(symbol, meaning, unit, mean + (2.0 if name == "exponent" else 0.0), sd, low)
    share = loss_share(list(cycles))
    if share is not None:
        meaning = "share of the work of loading that a full cycle takes; 1/3 in eq. 4"
        values["loss"] = Value.normal("w", meaning, "1", *share)
    return StringMeasurement(
        values, _findings(chosen, plain, values), _warnings(read, chosen), inputs, 0, chosen, plain, cycles
    )


def _zero(one: Fit, curve: int) -> tuple[float, float]:
    name = f"zero {curve}"
    return one.of(name) if name in one.names else (0.0, 0.0)


def _rms(one: Fit) -> float:
    return float(np.sqrt(one.squares / one.count))


def _findings(chosen: Fit, plain: Fit, values: Mapping[str, Value]) -> tuple[str, ...]:
    beyond = [name for name in chosen.terms if name != "backlash"]
    findings = []
    if not beyond:
        findings.append("Eq. 4 describes the string: linear loading, and unloading along a parabola.")
    else:
        rms = _rms(plain)
        force = rms * float(np.mean([curve.noise for curve in plain.curves]))
        findings.append(
            f"Eq. 4 does not say all: it leaves residuals of {format_number(force, 2)} N RMS, {format_number(rms, 2)} ×"
            f" the noise, the largest {_largest(plain)}."
        )
    if "exponent" in values and "exponent" not in chosen.terms:
        findings.append(f"The exponent of unloading, free, comes out as {_shown(values['exponent'])}: quadratic.")
    for name in chosen.terms:
        symbol, meaning, _, said = _TERMS[name]
        findings.append(f"{said}: {symbol} = {_shown(values[name])} ({meaning}).")
    absent = [name for name in values if name in _TERMS and name not in (*chosen.terms, "exponent")]
    if absent:
        limits = ", ".join(f"{_TERMS[name][0]} ({name}) = {_shown(values[name])}" for name in absent)
        findings.append(f"The data ask for no more: {limits}.")
    if "loss" in values:
        findings.append(f"A full cycle takes {_shown(values['loss'])} of the work of loading; by eq. 4 it takes 1/3.")
    return tuple(findings)


def _shown(value: Value) -> str:
    rounding = Rounding.of(value.median, value.sd)
    unit = unit_plain(value.unit, rounding.exponent)
    text = f"{rounding.text(value.median)} ± {rounding.text(value.sd)}"
    return f"({text}) {unit}" if unit else text


def _largest(plain: Fit) -> str:
    """Where eq. 4 is furthest off, on average over a tenth of a leg, in words."""
    worst = (0.0, "")
    for curve, model in zip(plain.curves, plain.models, strict=True):
        for leg in curve.legs:
            rows = slice(leg.first, leg.last)
            x, left = curve.displacement[rows], (curve.force - model)[rows]
            part = np.minimum((10 * (x - x.min()) / max(np.ptp(x), 1e-12)).astype(int), 9)
            for tenth in range(10):
                if (part == tenth).sum() > 2:
                    mean = float(left[part == tenth].mean())
                    where = f"in {'loading' if leg.loading else 'unloading'} at {10 * tenth + 5} % of the travel"
                    worst = max(worst, (abs(mean), f"{where}, {format_number(mean, 2)} N"))
    return worst[1]


def _warnings(curves: Sequence[Curve], chosen: Fit) -> tuple[str, ...]:
    warnings = []
    if _rms(chosen) > _MISFIT:
        warnings.append(
            f"The residuals are {format_number(_rms(chosen), 2)} × the noise of successive readings even with all terms"
            " that the data ask for; the intervals are too narrow for that."
        )
    without = [curve.file for curve in curves if not curve.slack]
    if without:
        warnings.append(
            f"{', '.join(without)}: no reading with a slack string; the force is taken to read 0 there. Begin each"
            " curve a little before the string is straight."
        )
    if all(leg.loading for curve in curves for leg in curve.legs):
        warnings.append("No curve unloads the string; nothing is said of its hysteresis.")
    return tuple(warnings)
