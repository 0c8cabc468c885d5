"""Which candidate, if any: refits on the training part, judged by evidence and by what chance gives the best of all.

Log evidence over the model without a candidate, by Laplace with a prior worth one reading: ½ (Δχ²/c − k ln n_eff),
k more unknowns. c = s² τ inflates for residuals that are not white: s² is what the best model leaves of the noise's
variance (at least 1), τ = 1 + 2 Σ ρ the readings that count for one; n_eff = R/τ. Far above the noise, what is chosen
must also predict (see `inner`).
"""

from __future__ import annotations

import contextlib
import dataclasses
import functools
import math
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.effects.added_mass import added_mass
from cradle_env.effects.clock_scale import clock_scale
from cradle_env.effects.length_mismatch import length_mismatch
from identification.diagnosis.criteria import Criteria, fails_prediction, is_misspecified, only_noise
from identification.diagnosis.selection.candidates import Candidate, list_candidates
from identification.diagnosis.selection.inner_validation import EQUAL, predictions
from identification.diagnosis.selection.score_test import ScoreTest, family_p, gain_neg_log10_p
from identification.diagnosis.selection.search import Searcher
from identification.diagnosis.selection.start_values import standing_in
from identification.inference.fit_result import FitResult
from identification.inference.impossible_model import ImpossibleModelError
from identification.inference.least_squares import MIN_BOBS_WITH_IMPACT_ORDER
from identification.progress import Progress

#: Candidates with parameters that are refitted at most.
_REFITS = 8
#: Score [−log10 p] from which a candidate is refitted.
_WORTH = 1.0
#: Share of the best candidate's gain in χ² from which others are fitted to the end.
_NEAR = 0.3
#: Distance in χ² from the best candidate within which others always are [χ² over its worth].
_ALWAYS = 100.0
#: What changes the period of all bobs alike, if it has the same value for each.
_PERIOD = (clock_scale.name, added_mass.name, length_mismatch.name)


@dataclass(frozen=True, eq=False)
class Refit:
    """A model with one candidate more: its fit, Δχ² gained over the model without, k more unknowns, inflated log
    evidence over that model, p among all candidates, and the gap on what was held out (told; it chooses
    nothing)."""

    candidate: Candidate
    fitted: FitResult
    gain: float
    unknowns: int
    log_evidence: float
    p: float
    gap: float


@dataclass(frozen=True, eq=False)
class Decision:
    """Refits, the most probable first; chosen: the best that is significant and predicts; probability: of the chosen
    among all and none; inflation c and effective number of readings."""

    refits: tuple[Refit, ...]
    chosen: Refit | None
    probability: float
    inflation: float
    effective: float


def decide(
    fitted: FitResult, scored: ScoreTest, searcher: Searcher, tell: Progress, exhaust: bool = True,
    also: Sequence[Candidate] = (),
) -> Decision:  # fmt: skip
    """Refits the candidates worth it, and those given also, and decides between them and none. Asked to exhaust them,
    near the noise it gives up only when it has refitted the others too: first order foretells little of an effect that
    changes the order of impacts."""
    tried = dict.fromkeys([*worth_refitting(scored), *also])
    fits = refitted(fitted, list(tried), scored, searcher, tell)
    decision = _decision(fitted, fits, scored, searcher)
    if decision.chosen is not None or is_misspecified(fitted) or not exhaust:
        return decision
    left = [s.candidate for s in scored.scores if s.directions and s.candidate not in fits]
    fits |= refitted(fitted, left, scored, searcher, tell)
    return _decision(fitted, fits, scored, searcher)


def beside(fitted: FitResult, scored: ScoreTest, other: FitResult, searcher: Searcher, tell: Progress) -> Decision:
    """Refits all candidates that bring no others, from where another model has its mode, far above which none is
    fitted to the end; decides between them and none."""
    fits, enough = {}, other.chi2 + _ALWAYS * other.chi2_scale
    for i, s in enumerate(scored.scores):
        if len(s.candidate.effects) == 1:
            tell("exchange", i / len(scored.scores), f"{s.candidate.label} alone")
            try:
                likely = [*s.likely, *standing_in(fitted, other, s.candidate)]
                fits[s.candidate] = searcher.fit_with_candidate_from_mode(fitted, s.candidate, other, likely, enough)
            except ImpossibleModelError:
                continue
    return _decision(fitted, fits, scored, searcher, other)


def of_the_period(fitted: FitResult, searcher: Searcher, tell: Progress) -> dict[Candidate, FitResult]:
    """Near the noise, of three bobs and more: fits with what changes the period of all bobs alike, of which data can
    hardly tell one from another; the first from anywhere, the others from there. κ sets the period, too, and of many
    bobs it has so many modes that one far away may make up for the change and leave little more than noise; from there
    first order foretells nothing of it."""
    by_name = {c.name: c for c in reversed(list_candidates(fitted.cradle))}  # those with one value for all come first
    modes = fitted.cradle.bobs >= MIN_BOBS_WITH_IMPACT_ORDER and "kappa" in fitted.likelihood.names
    if not modes or not by_name.keys() >= {*_PERIOD} or is_misspecified(fitted):
        return {}
    clock, *others = (by_name[name] for name in _PERIOD)
    tell("refit", 0.0, f"{clock.label} from anywhere")
    try:
        first = searcher.fit_global_with(fitted, clock)
    except ImpossibleModelError:  # from these draws nowhere
        return {}
    fits = {clock: first}
    if fitted.chi2 - first.chi2 > 2.0 * searcher.criteria.equivalent_log_odds * fitted.chi2_scale:
        for candidate in others:
            with contextlib.suppress(ImpossibleModelError):
                fits[candidate] = searcher.fit_with_candidate_from_mode(
                    fitted, candidate, first, standing_in(fitted, first, candidate)
                )
    return fits


def hidden(
    fitted: FitResult, known: dict[Candidate, FitResult], scored: ScoreTest, searcher: Searcher, tell: Progress
) -> Decision:  # fmt: skip
    """What a model that leaves no more than noise may have hidden by a wrong mode: decides between known fits with a
    candidate more, what looks the same, and none, which stands unless another is clearly more probable."""
    decision = _decision(fitted, _alike(fitted, known, scored, searcher, tell), scored, searcher)
    if decision.chosen is not None and decision.chosen.log_evidence <= searcher.criteria.equivalent_log_odds:
        return dataclasses.replace(decision, chosen=None, probability=0.0)
    return decision


def from_anywhere(
    fitted: FitResult, decision: Decision, scored: ScoreTest, searcher: Searcher, tell: Progress,
    enough: Callable[[FitResult], bool] | None = None,
) -> Decision:  # fmt: skip
    """A decision again, after searches from anywhere for the models with each of its candidates, the most probable
    first, until one is enough: from where the model without it has its mode, refits may not find the right one. Far
    above the noise the same decision, for there no one candidate is all that is missing."""
    if is_misspecified(fitted):
        return decision
    enough = enough or functools.partial(only_noise, criteria=searcher.criteria)
    fits = {refit.candidate: searcher.best(refit.fitted) for refit in decision.refits}
    for i, candidate in enumerate(fits):
        if any(map(enough, fits.values())):
            break
        tell("refit", i / len(fits), f"{candidate.label} from anywhere")
        try:
            fits[candidate] = searcher.fit_global(fits[candidate].experiment)
        except ImpossibleModelError:
            continue
    return again(fitted, decision, scored, searcher, tell)


def again(fitted: FitResult, decision: Decision, scored: ScoreTest, searcher: Searcher, tell: Progress) -> Decision:
    """A decision again, by the best fits known by now, what looks the same refitted from where the best has its
    mode."""
    fits = {refit.candidate: searcher.best(refit.fitted) for refit in decision.refits}
    return _decision(fitted, _alike(fitted, fits, scored, searcher, tell), scored, searcher)


def that_stands(
    fitted: FitResult, decision: Decision, scored: ScoreTest, searcher: Searcher, tell: Progress
) -> Decision:  # fmt: skip
    """A decision again, after searches from anywhere, between those candidates alone with which a model leaves only
    noise and predicts what was held out."""
    found = from_anywhere(fitted, decision, scored, searcher, tell, lambda _: False)
    refits = [
        refit for refit in _significant(found.refits, searcher.criteria)
        if _stands(refit.fitted, searcher.criteria)
    ]  # fmt: skip
    chosen = refits[0] if refits else None
    return dataclasses.replace(found, chosen=chosen, probability=_probability(chosen, refits))


def _stands(fitted: FitResult, criteria: Criteria) -> bool:
    return only_noise(fitted, criteria) and not fails_prediction(fitted)


def _decision(
    fitted: FitResult, fits: Mapping[Candidate, FitResult], scored: ScoreTest, searcher: Searcher, *others: FitResult
) -> Decision:
    """Judges fits of a model with a candidate more, by the noise that the best of them and of others leaves."""
    best = min([*fits.values(), *others], key=lambda fit: fit.chi2, default=fitted)
    inflation, effective = best.effective_sample
    refits = []
    for candidate, fit in fits.items():
        try:
            refits.append(judged(fitted, candidate, fit, scored.replicate_maxima, inflation, effective))
        except ImpossibleModelError:  # it ends where nothing was fitted: not a model of this experiment
            continue
    refits.sort(key=lambda refit: -refit.log_evidence)
    significant = _significant(refits, searcher.criteria)
    chosen = next((refit for refit in significant if _predicts(fitted, refit, searcher)), None)
    if chosen is not None and is_misspecified(fitted):
        chosen = _simplest(fitted, chosen, significant, searcher)
    return Decision(tuple(refits), chosen, _probability(chosen, refits), inflation, effective)


def _significant(refits: Sequence[Refit], criteria: Criteria) -> list[Refit]:
    return [refit for refit in refits if refit.p < criteria.significance_level and refit.log_evidence > 0.0]


def _simplest(fitted: FitResult, best: Refit, refits: Sequence[Refit], searcher: Searcher) -> Refit:
    """Of what is about as probable as the best, that with the fewest unknowns: far above the noise evidence hangs on
    how near to its mode each model was fitted, too."""
    close = searcher.criteria.equivalent_log_odds
    near = (r for r in refits if r.unknowns < best.unknowns and best.log_evidence - r.log_evidence < close)
    ordered = sorted(near, key=lambda refit: refit.unknowns)
    return next((refit for refit in ordered if _predicts(fitted, refit, searcher)), best)


def _predicts(fitted: FitResult, refit: Refit, searcher: Searcher) -> bool:
    """Whether a refit predicts better than the model without, wherever predictions tell."""
    gaps = predictions(fitted, refit.fitted, searcher)
    return gaps is None or gaps[1] < (1.0 - EQUAL) * gaps[0]


def refitted(
    fitted: FitResult, tried: Sequence[Candidate], scored: ScoreTest, searcher: Searcher, tell: Progress
) -> dict[Candidate, FitResult]:  # fmt: skip
    """Fits of the model with each of these candidates; then from where the best has its mode."""
    fits: dict[Candidate, FitResult] = {}
    likely = {s.candidate: s.likely for s in scored.scores}
    for i, candidate in enumerate(tried):
        tell("refit", 0.5 * i / len(tried), candidate.label)
        enough = _enough(fitted, min((fit.chi2 for fit in fits.values()), default=fitted.chi2))
        try:
            fits[candidate] = searcher.fit_with_candidate(fitted, candidate, likely[candidate], enough)
        except ImpossibleModelError:  # this effect cannot be in this cradle
            continue
    return _alike(fitted, fits, scored, searcher, tell)


def _alike(
    fitted: FitResult, fits: dict[Candidate, FitResult], scored: ScoreTest, searcher: Searcher, tell: Progress
) -> dict[Candidate, FitResult]:  # fmt: skip
    """Fits of the model with each of some candidates, and with what looks the same as the best or one near it, from
    where the best has its mode."""
    best = min(fits, key=lambda candidate: fits[candidate].chi2, default=None)
    if best is None:
        return fits
    likely = {s.candidate: s.likely for s in scored.scores}
    enough = _enough(fitted, fits[best].chi2)
    looks_the_same = next(s.parallel for s in scored.scores if s.candidate == best)
    near = (s for s in scored.scores if s.candidate in fits and fits[s.candidate].chi2 <= enough)
    others = list(dict.fromkeys([*fits, *(candidate for s in near for candidate in s.parallel)]))
    for i, candidate in enumerate(others):
        if candidate != best:
            tell("refit", 0.5 + 0.5 * i / len(others), candidate.label)
            try:
                several = standing_in(fitted, fits[best], candidate) if candidate in looks_the_same else []
                several += likely[candidate]
                fits[candidate] = searcher.fit_with_candidate_from_mode(fitted, candidate, fits[best], several, enough)
            except ImpossibleModelError:
                continue
    return fits


def _enough(fitted: FitResult, least: float) -> float:
    """The χ² that a candidate must come near to be fitted to the end, where the best so far has the least."""
    return max(fitted.chi2 - _NEAR * (fitted.chi2 - least), least + _ALWAYS * fitted.chi2_scale)


def worth_refitting(scored: ScoreTest) -> list[Candidate]:
    """The candidates with the best scores, and all that no score can judge."""
    judged_ = [s.candidate for s in scored.scores if s.directions and s.neg_log10_p >= _WORTH]
    return judged_[:_REFITS] + [s.candidate for s in scored.scores if not s.directions and _unscored(s.candidate)]


def _unscored(candidate: Candidate) -> bool:
    return len(candidate.effects) > 1 or not candidate.declaration.strengths


def judged(
    fitted: FitResult,
    candidate: Candidate,
    fit: FitResult,
    replicate_maxima: np.ndarray,
    inflation: float,
    effective: float,
) -> Refit:
    """A refit with its figures."""
    gain = fitted.chi2 - fit.chi2
    more = len(fit.point) - len(fitted.point)
    strengths = candidate.declaration.strengths
    sided = bool(strengths) and all(p.one_sided for p in strengths)
    beyond = max(1.0, inflation / fitted.noise_inflation)  # what the replicas do not have
    own = float(gain_neg_log10_p(np.array(gain / beyond), max(more, 1), sided))
    evidence = log_evidence(gain, more, inflation, effective)
    return Refit(candidate, fit, gain, more, evidence, family_p(own, replicate_maxima), fit.held_out_gap())


def log_evidence(gain: float, unknowns: int, inflation: float, effective: float) -> float:
    """½ (Δχ²/c − k ln n_eff), of a gain in χ² by k more unknowns."""
    return 0.5 * (gain / inflation - unknowns * math.log(effective))


def _probability(chosen: Refit | None, refits: Sequence[Refit]) -> float:
    """Of the chosen among all refits and none, each as probable beforehand."""
    if chosen is None:
        return 0.0
    return float(1.0 / (math.exp(-chosen.log_evidence) + sum(
        math.exp(min(refit.log_evidence - chosen.log_evidence, 50.0)) for refit in refits
    )))  # fmt: skip
