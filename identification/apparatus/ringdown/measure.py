"""Measure the damping of groups of bobs that swing together, from their ring-downs."""

from __future__ import annotations

import dataclasses
import itertools
import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.effects import effect
from cradle_env.errors import check_range
from identification.apparatus.measurement import Measurement, Value
from identification.apparatus.ringdown.group_law import GroupLaw, group_law
from identification.apparatus.ringdown.motion import TERMS, Fit, fit
from identification.apparatus.ringdown.swings import Swing, read_swings
from identification.experiment.constraint import Constraint
from identification.number_format import format_number
from identification.progress import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Sets of damping terms that are compared, each in addition to the linear drag b; the simplest first.
STRUCTURES = tuple(itertools.chain.from_iterable(itertools.combinations(TERMS, k) for k in range(len(TERMS) + 1)))
_WORDS = {"quadratic_drag": "quadratic drag c2", "pivot_friction": "Coulomb friction τ_c"}
#: Values disagree if the probability of their scatter is below this.
_IMPROBABLE = 0.01
#: Largest RMS residual over the noise of successive readings without a warning about the model.
_MISFIT = 1.2


@dataclass(frozen=True, eq=False)
class Recorded:
    """One ring-down, fitted with the chosen terms on elastic strings, and on rigid strings (`rigid`)."""

    fit: Fit
    rigid: Fit


@dataclass(frozen=True, eq=False)
class RingdownMeasurement(Measurement):
    """Damping of groups of n bobs that swing together; see `measure_ringdown`.

    Parameters
    ----------
    recordings : tuple of Recorded
        The recordings with their fits.
    groups : mapping of int to (float, float)
        b_n and its standard deviation [kg/s], by n.
    law : GroupLaw, optional
        The law of b_n; None for one group.
    evidence : mapping of str to float
        BIC of each set of terms less the smallest, by its terms joined with "+"; "" is b alone.
    fullest : tuple of Fit
        Fits of the recordings with all terms.
    """

    kind: ClassVar[str] = "ringdown"
    caption: ClassVar[str] = (
        "Top left: amplitude of each recording and of its model. Top right: residuals over the noise. Bottom left:"
        " equivalent linear drag of each window of three swings, against the amplitude; b alone gives a"
        " horizontal line, quadratic drag a rising one, Coulomb friction a falling one. Bottom right: b of n bobs that"
        " swing together with 95 % intervals, and the law of group_drag with its 95 % band."
    )

    recordings: tuple[Recorded, ...]
    groups: Mapping[int, tuple[float, float]]
    law: GroupLaw | None
    evidence: Mapping[str, float]
    fullest: tuple[Fit, ...]

    @property
    def terms(self) -> tuple[str, ...]:
        """Effects that the data require in addition to b, by name."""
        return self.recordings[0].fit.terms

    def figure(self) -> Figure:
        """Plot amplitudes, residuals, damping against amplitude, and b against n."""
        from identification.apparatus.ringdown.figure import ringdown_figure

        return ringdown_figure(self)

    def details(self) -> dict[str, Any]:
        """Return the recordings, the comparison of models, and lines for an experiment.toml."""
        return {
            "terms": list(self.terms),
            "bic_over_best": dict(self.evidence),
            "recordings": [
                {
                    "file": one.fit.swing.file,
                    "bobs": one.fit.swing.bobs,
                    **{name: dict(zip(("median", "sd"), one.fit.of(name), strict=True)) for name in self._names()},
                    "b_without_hysteresis": one.rigid.of("b")[0],
                    "noise_rad": one.fit.swing.noise,
                    "residual_rad": float(np.std(one.fit.residual)),
                    "correlated_readings": one.fit.inflation,
                }
                for one in self.recordings
            ],
            "law_p": None if self.law is None else self.law.p,
            "experiment_toml": self.experiment_toml(),
        }

    def constraint(self) -> Constraint:
        """b_n of each group, c2 and τ_c, by fits with all terms.

        A model without quadratic drag and Coulomb friction then has the b of a fit without them, and a model with them
        is not told more than the recordings tell. Errors are increased if recordings scatter by more.
        """
        groups, terms = [f"b_{n}" for n in self.groups], STRUCTURES[-1]
        names = [*groups, *terms]
        information, weighted, squares = np.zeros((len(names), len(names))), np.zeros(len(names)), 0.0
        for one in self.fullest:
            rows = [one.names.index(name) for name in ("b", *terms)]
            places = [names.index(f"b_{one.swing.bobs}"), *range(len(groups), len(names))]
            found, precision = one.parameters[rows], np.linalg.inv(one.covariance[np.ix_(rows, rows)])
            information[np.ix_(places, places)] += precision
            weighted[places] += precision @ found
            squares += float(found @ precision @ found)
        covariance = np.linalg.inv(information)
        mean = covariance @ weighted
        free = len(self.fullest) * (1 + len(terms)) - len(names)
        wider = max(1.0, (squares - float(mean @ weighted)) / free) if free else 1.0
        quantities = (*groups, *(f"{name}.{TERMS[name]}" for name in terms))
        mass = self.recordings[0].fit.swing.cradle.mass
        return Constraint("ringdown", quantities, mean, wider * covariance, {"mass": mass})

    def _names(self) -> tuple[str, ...]:
        return "b", *self.terms

    def experiment_toml(self) -> str:
        """Format lines for an experiment.toml: [cradle] b, and the effects with their values."""
        smallest = min(self.groups)
        b = self.groups[smallest][0] if self.law is None else self.law.b
        effects = {name: {TERMS[name]: self.values[TERMS[name]].median} for name in self.terms}
        if self.law is not None and self.law.slope > 0.0:
            effects["group_drag"] = {"slope": self.law.slope, "range": 0.005}
        lines = ["[cradle]", f"b = {b:.6g}"]
        if effects:
            lines += ["[model]", f"effects = {json.dumps([*effects])}", "[model.parameters]"]
            for name, values in effects.items():
                lines.append(f"{name} = {{ {', '.join(f'{key} = {value:.6g}' for key, value in values.items())} }}")
        return "\n".join([*lines, ""])


def measure_ringdown(
    recordings: Sequence[str | Path],
    cradle: Cradle | None = None,
    *,
    bobs: Sequence[int] | None = None,
    fit_from: float | None = None,
    fit_to: float | None = None,
    progress: Progress = lambda *_: None,
) -> RingdownMeasurement:
    """Measure the damping of bobs that swing together, without the losses by hysteresis of the strings.

    Parameters
    ----------
    recordings : sequence of path
        Tables of angles or displacements as `cradle new` reads them, or experiment.toml files whose runs are all read.
    cradle : Cradle, optional
        Mass, lengths and κ for CSV files; an experiment.toml states its own. The default cradle if omitted. The
        measured b is proportional to the mass.
    bobs : sequence of int, optional
        Number of bobs that swing together in each CSV file; its number of columns if omitted.
    fit_from, fit_to : float, optional
        Part of each recording that is used [s].
    progress : callable, optional
        Called with (stage, fraction done, text).

    Returns
    -------
    RingdownMeasurement

    Raises
    ------
    ValueError
        If recordings cannot be used; the message is one line.
    """
    assumed = cradle is None and any(Path(path).suffix != ".toml" for path in recordings)
    for count in bobs or ():
        check_range("bobs", count, "", 1, 200)
    swings, remarks, inputs = read_swings(recordings, cradle or Cradle(), bobs, fit_from, fit_to)
    structures, total = {}, len(swings) * (len(STRUCTURES) + 1)
    done = itertools.count()

    def fitted(swing: Swing, terms: tuple[str, ...], near: Fit | None) -> Fit:
        progress("fit", next(done) / total, f"{swing.file}, {' and '.join(('b', *terms))}")
        return fit(swing, terms, near)

    for terms in STRUCTURES:
        nearest = structures.get(terms[:-1], [None] * len(swings))
        structures[terms] = [fitted(swing, terms, near) for swing, near in zip(swings, nearest, strict=True)]
    bic = _bic(structures)
    terms = min(bic, key=bic.__getitem__)
    made = []
    for chosen in structures[terms]:
        plain = dataclasses.replace(chosen.swing, cradle=chosen.swing.cradle.replace(model="pendulum"))
        made.append(Recorded(chosen, fitted(plain, terms, None)))
    groups = _groups(made)
    law = group_law(groups)
    evidence = {"+".join(names): value - bic[terms] for names, value in bic.items()}
    values = _values(made, groups, law, terms)
    warnings = _warnings(made, law, assumed)
    findings = (*_findings(made, groups, law, terms, evidence), *remarks)
    fullest = tuple(structures[STRUCTURES[-1]])
    return RingdownMeasurement(values, findings, warnings, inputs, 0, tuple(made), groups, law, evidence, fullest)


def _bic(structures: Mapping[tuple[str, ...], Sequence[Fit]]) -> dict[tuple[str, ...], float]:
    """Compute the BIC of each set of terms over all recordings.

    Correlated residuals are replaced by their effective number; its inflation is that of the model with all terms.
    """
    fullest = [one.inflation for one in structures[STRUCTURES[-1]]]
    return {
        terms: float(
            sum(
                len(one.model) / inflation * np.log(one.rss / len(one.model))
                + len(one.parameters) * np.log(len(one.model) / inflation)
                for one, inflation in zip(fits, fullest, strict=True)
            )
        )
        for terms, fits in structures.items()
    }


def _mean(found: Sequence[tuple[float, float]]) -> tuple[float, float]:
    """Weighted mean and its standard deviation, which is increased if the values scatter more than their errors."""
    values, spreads = np.array(found).T
    weights = 1.0 / spreads**2
    mean = float(np.sum(weights * values) / np.sum(weights))
    squares = float(np.sum(weights * (values - mean) ** 2))
    wider = max(1.0, squares / max(len(values) - 1, 1))
    return mean, float(np.sqrt(wider / np.sum(weights)))


def _groups(made: Sequence[Recorded]) -> dict[int, tuple[float, float]]:
    sizes = sorted({one.fit.swing.bobs for one in made})
    return {n: _mean([one.fit.of("b") for one in made if one.fit.swing.bobs == n]) for n in sizes}


def _values(
    made: Sequence[Recorded],
    groups: Mapping[int, tuple[float, float]],
    law: GroupLaw | None,
    terms: Sequence[str],
) -> dict[str, Value]:
    values = {}
    for n, (b, sd) in groups.items():
        meaning = (
            "linear drag on a bob that swings alone"
            if n == 1
            else f"linear drag on each of {n} bobs that swing together"
        )
        values[f"b_{n}"] = Value.normal(f"b_{n}", meaning, "kg/s", b, sd, 0.0)
    for name in terms:
        parameter = effect(name).parameters[0]
        mean, sd = _mean([one.fit.of(name) for one in made])
        values[parameter.key] = Value.normal(parameter.symbol, parameter.meaning, parameter.unit, mean, sd, 0.0)
    if law is not None:
        b_sd, slope_sd = np.sqrt(np.diag(law.covariance))
        values["b"] = Value.normal(
            "b", "linear drag on a bob without neighbours, by the law of b_n", "kg/s", law.b, b_sd, 0.0
        )
        values["slope"] = Value.normal(
            "s_b", "relative increase of b by a touching neighbour", "1", law.slope, slope_sd
        )
    return values


def _findings(
    made: Sequence[Recorded],
    groups: Mapping[int, tuple[float, float]],
    law: GroupLaw | None,
    terms: Sequence[str],
    evidence: Mapping[str, float],
) -> tuple[str, ...]:
    if terms:
        first = f"In addition to the linear drag b, the data require {' and '.join(_WORDS[name] for name in terms)}."
    else:
        first = "A linear drag b describes the damping; the data require no quadratic drag and no Coulomb friction."
    others = "; ".join(
        f"b{''.join(f' + {TERMS[name]}' for name in key.split('+') if key)}: {format_number(value)}"
        for key, value in evidence.items()
    )
    findings = [first, f"BIC over that of the best model: {others}. A difference of 10 is decisive."]
    ratios = [one.rigid.of("b")[0] / max(one.fit.of("b")[0], 1e-12) for one in made]
    if made[0].fit.swing.cradle.has("string_hysteresis"):
        share = 100.0 * (float(np.mean(ratios)) - 1.0)
        findings.append(
            f"A fit with rigid strings gives a b that differs by {format_number(share, 2)} %, since it includes the"
            " losses by hysteresis of the strings. The values above do not include them."
        )
    if law is not None:
        b_sd, slope_sd = np.sqrt(np.diag(law.covariance))
        findings.append(
            f"b_n = b (1 + slope · 2 (n − 1)/n) with b = {format_number(law.b)} ± {format_number(b_sd, 2)} kg/s and"
            f" slope = {format_number(law.slope)} ± {format_number(slope_sd, 2)}: the effect group_drag."
        )
    return tuple(findings)


def _warnings(made: Sequence[Recorded], law: GroupLaw | None, assumed: bool) -> tuple[str, ...]:
    warnings = []
    if assumed:
        cradle = made[0].fit.swing.cradle
        warnings.append(
            f"No cradle is stated: mass {cradle.mass:g} kg, length {cradle.length:g} m and κ {cradle.kappa:.4g} N/m are"
            " assumed. The measured b is proportional to the mass."
        )
    for one in made:
        misfit = float(np.std(one.fit.residual)) / one.fit.swing.noise
        if misfit > _MISFIT:
            warnings.append(
                f"{one.fit.swing.file}: the residuals are {format_number(misfit, 2)} × the noise of successive"
                " readings; the model is incomplete, so the intervals are too narrow."
            )
    if law is not None and law.p < _IMPROBABLE:
        warnings.append(
            f"b_n does not follow the law of group_drag (p = {format_number(law.p, 2)}); its intervals are widened"
            " accordingly."
        )
    if law is not None and law.slope < 0.0:
        warnings.append("b falls with the number of bobs; group_drag can only increase it, so it is left out.")
    return tuple(warnings)
