"""k_f from the speeds before and after impacts, and from contact durations."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cradle_env.constitutive import restitution_curve
from cradle_env.cradle import Cradle
from identification.apparatus.impacts.chain import passed_on_apart
from identification.apparatus.impacts.data import Durations, Passed, read_impacts
from identification.apparatus.impacts.durations import duration_constraint
from identification.apparatus.impacts.fit import Fit, fit
from identification.apparatus.measurement import Measurement, Value
from identification.experiment.constraint import Constraint, quantity_of
from identification.number_format import format_number
from identification.progress import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Range of speeds, as a factor, from which on data tell how A grows with speed.
_WIDE = 2.0
#: Speeds of e(v) among the values [m/s].
_SPEEDS = (0.1, 0.5, 1.0)
#: Values of k_f, in standard deviations from the middle, between which α and n are interpolated; and draws.
_NODES, _DRAWS = np.linspace(-4.0, 4.0, 17), 4000
#: Standard deviations from which on two values disagree.
_DISAGREE = 3.0


@dataclass(frozen=True, eq=False)
class ImpactsMeasurement(Measurement):
    """k_f, e(v), and the stiffness of a contact; see `measure_impacts`.

    passed, durations: the data; chosen: the joint fit; cradle: with the measured k_f and the stated stiffness, or the
    measured one where both were fitted.
    """

    kind: ClassVar[str] = "impacts"
    caption: ClassVar[str] = (
        "Top left: speed of the last bob after over that of the first before the impact, with 95 % errors of both, and"
        " eq. 1 at the measured k_f, with its 95 % band. Top right: contact durations of two bobs, likewise; dashed:"
        " without dissipation. Bottom left: e(v) with its 95 % band, and the power law that comes nearest. Bottom"
        " right: residuals over their standard deviations."
    )

    passed: tuple[Passed, ...]
    durations: tuple[Durations, ...]
    chosen: Fit
    cradle: Cradle

    def figure(self) -> Figure:
        """Speeds, durations, e(v) and residuals."""
        from identification.apparatus.impacts.figure import impacts_figure

        return impacts_figure(self)

    def details(self) -> dict[str, Any]:
        """The tables that were fitted, and lines for an experiment.toml."""
        return {
            "free": list(self.chosen.names),
            "chi2": self.chosen.squares,
            "errors_widened_by": self.chosen.widened,
            "impacts": [
                {
                    "file": one.file,
                    "bobs": one.bobs,
                    "rows": len(one.before),
                    "v_before": one.before,
                    "v_after": one.after,
                }
                for one in self.passed
            ],
            "durations": [
                {"file": one.file, "rows": len(one.speed), "speed": one.speed, "duration_s": one.duration}
                for one in self.durations
            ],
            "experiment_toml": self.experiment_toml(),
        }

    def constraint(self) -> Constraint:
        """What speeds and durations tell of k_f and k_el: A, with durations the time scale too; or a duration alone."""
        if not self.passed:
            speeds = np.concatenate([one.speed for one in self.durations])
            return duration_constraint("impacts", self.cradle, self.chosen.of("k_f")[1], speeds)
        names = ("impact_dissipation", "contact_time_scale")[: len(self.chosen.names)]
        # Of ln A and ln T by ln k_f and ln k_el.
        powers = np.array([[1.0, -0.6], [0.0, -0.4]])[: len(names), : len(names)]
        mean = np.array([quantity_of(self.cradle, name) for name in names])
        slopes = mean[:, None] * powers / self.chosen.values
        return Constraint("impacts", names, mean, slopes @ self.chosen.covariance @ slopes.T)

    def experiment_toml(self) -> str:
        """Lines for an experiment.toml: [cradle] k_f, and its prior."""
        k_f = self.values["k_f"]
        lines = ["[cradle]", f"k_f = {k_f.median:.6g}", "[infer]"]
        return "\n".join([*lines, f"k_f = {{ mean = {k_f.median:.6g}, sd = {k_f.sd:.2g} }}", ""])


def measure_impacts(
    files: Sequence[str | Path],
    cradle: Cradle | None = None,
    *,
    seed: int = 0,
    progress: Progress = lambda *_: None,
) -> ImpactsMeasurement:
    """Measure k_f from what impacts pass on to the last bob of a line, and from contact durations.

    Parameters
    ----------
    files : sequence of path
        Tables with columns v1 and v3 (the first of three bobs before, the third after; v2 of two, v4 of four), or v and
        duration (of two bobs), each with `_sd` columns where standard deviations are known; or recordings of bobs, of
        which one at the end is let go.
    cradle : Cradle, optional
        Mass, radius, E and ν, and, for recordings, the strings and b. The default cradle where omitted.
    seed : int
        Of the draws behind the intervals of α and n.
    progress : callable, optional
        Called with a stage, the part that is done, and words.

    Returns
    -------
    ImpactsMeasurement
        Where both speeds and durations are given, k_el is measured too.

    Raises
    ------
    ValueError
        One line, for files that cannot be used.
    """
    assumed, cradle = cradle is None, cradle or Cradle()
    progress("read", 0.0, f"{len(files)} files")
    passed, durations, remarks, inputs = read_impacts(files, cradle)
    free = ("k_f", "k_el") if passed and durations else ("k_f",)
    progress("fit", 0.2, f"{sum(len(x.before) for x in passed) + sum(len(x.speed) for x in durations)} impacts")
    chosen = fit(passed, durations, cradle, free)
    values = _values(chosen, cradle, np.random.default_rng(seed))
    findings = [f"k_f = {format_number(values['k_f'].median)} ± {format_number(values['k_f'].sd, 2)} N s/m^(3/2)."]
    warnings = []
    speeds = np.concatenate([one.before for one in passed]) if passed else np.ones(1)
    if passed and speeds.max() > _WIDE * speeds.min() and len(speeds) > 5:
        mean, sd = fit(passed, (), cradle, ("k_f", "exponent")).of("exponent")
        values["exponent"] = Value.normal("q", "A grows with speed as v^q; 1/5 in eq. 1", "1", mean, sd)
        agrees = abs(mean - 0.2) < _DISAGREE * sd
        findings.append(
            f"The loss grows with speed as v^q with q = {format_number(mean, 2)} ± {format_number(sd, 1)}; eq. 1 has"
            f" 1/5, which {'agrees' if agrees else 'does not agree'}."
        )
        if not agrees:
            warnings.append("Eq. 1 does not describe how the loss grows with speed; k_f is one for these speeds alone.")
    if any(one.bobs > 2 for one in passed):
        apart = fit(passed, durations, cradle, free, passed_on_apart).of("k_f")[0]
        findings.append(
            "Bobs at rest are taken to touch. Were they apart, even by a micrometre, k_f would be"
            f" {format_number(apart)}."
        )
    findings += _stiffness_words(chosen, cradle)
    warnings += _warnings(chosen, cradle, passed, assumed)
    known = cradle.replace(k_f=values["k_f"].median)
    if "k_el" in free:
        known = known.replace(youngs_modulus=cradle.youngs_modulus * chosen.of("k_el")[0] / cradle.k_el)
    return ImpactsMeasurement(
        values, (*findings, *remarks), tuple(warnings), inputs, seed, tuple(passed), tuple(durations), chosen, known
    )


def _values(chosen: Fit, cradle: Cradle, rng: np.random.Generator) -> dict[str, Value]:
    mean, sd = chosen.of("k_f")
    values = {"k_f": Value.normal("k_f", "viscoelastic dissipation of a contact", "N s/m^3/2", mean, sd, 0.0)}
    stiffness = chosen.of("k_el")[0] / cradle.k_el if "k_el" in chosen.names else 1.0
    if "k_el" in chosen.names:
        values["k_el"] = Value.normal("k_el", "elastic stiffness of a contact", "N/m^3/2", *chosen.of("k_el"), 0.0)
    # e depends on k_f k_el^(−3/5) alone: its spread is that of k_f at one k_el.
    loss, loss_sd = _loss(chosen)
    nodes = np.maximum(loss + _NODES * loss_sd, 1e-3 * loss)
    base = cradle.replace(youngs_modulus=cradle.youngs_modulus * stiffness)
    made = [base.replace(k_f=float(node)) for node in nodes]
    draws = np.clip(loss + loss_sd * rng.standard_normal(_DRAWS), nodes[0], nodes[-1])
    order = np.argsort(nodes)
    for name, symbol, meaning in (
        ("alpha", "α", "of e = 1 − α vⁿ, v in m/s, over 0.02–1 m/s"),
        ("n", "n", "of e = 1 − α vⁿ"),
    ):
        curve = np.array([getattr(one, name) for one in made])
        values[name] = Value.of_samples(symbol, meaning, "1", np.interp(draws, nodes[order], curve[order]))
    restitutions = np.array([restitution_curve(one, np.array(_SPEEDS)) for one in made])
    for k, speed in enumerate(_SPEEDS):
        samples = np.interp(draws, nodes[order], restitutions[order, k])
        values[f"e_{speed:g}"] = Value.of_samples("e", f"coefficient of restitution at {speed:g} m/s", "1", samples)
    return values


def _loss(chosen: Fit) -> tuple[float, float]:
    """(k_f, standard deviation of k_f k_el^(−3/5) in units of k_f's)."""
    k_f, k_f_sd = chosen.of("k_f")
    if "k_el" not in chosen.names:
        return k_f, k_f_sd
    k_el = chosen.of("k_el")[0]
    slopes = np.array([1.0 / k_f, -0.6 / k_el])
    return k_f, k_f * float(np.sqrt(slopes @ chosen.covariance @ slopes))


def _stiffness_words(chosen: Fit, cradle: Cradle) -> list[str]:
    if "k_el" not in chosen.names:
        return []
    k_el, sd = chosen.of("k_el")
    return [
        f"Durations and speeds together tell k_el = {format_number(k_el, 4)} ± {format_number(sd, 2)} N/m^(3/2); E, ν"
        f" and R say {format_number(cradle.k_el, 4)}."
    ]


def _warnings(chosen: Fit, cradle: Cradle, passed: Sequence[Passed], assumed: bool) -> list[str]:
    warnings = []
    if assumed:
        warnings.append(
            f"No cradle is stated: mass {cradle.mass:g} kg, radius {cradle.radius:g} m, E {cradle.youngs_modulus:g} Pa"
            f" and ν {cradle.poisson_ratio:g} are taken."
        )
    if chosen.widened > 1.0:
        warnings.append(
            f"The data scatter {format_number(chosen.widened, 2)} times as much as the stated errors; the intervals are"
            " widened by that."
        )
    if "k_el" in chosen.names and abs(chosen.of("k_el")[0] - cradle.k_el) > _DISAGREE * chosen.of("k_el")[1]:
        warnings.append("The measured k_el is not the one that E, ν and R say: check them, and the mass.")
    if not passed:
        warnings.append(
            "Durations alone tell k_f by a small part of theirs: k_el, which sets the rest, is taken as E, ν and R say"
            " it."
        )
    return warnings
