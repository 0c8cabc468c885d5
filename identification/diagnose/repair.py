"""Add, refit, repeat: from a base model to one that leaves nothing but noise, or as near as the catalogue leads."""

from __future__ import annotations

import dataclasses
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from cradle_env.effects import effect
from cradle_env.simulation import SimulationError
from identification.diagnose.candidates import Candidate, candidates, is_strength, without_effect
from identification.diagnose.decide import (
    ALPHA,
    CLOSE,
    Decision,
    beside,
    coloured,
    decide,
    judged,
    log_evidence,
)
from identification.diagnose.fitted import Fitted
from identification.diagnose.inner import predictions
from identification.diagnose.law import Law, advantage, can_outdo, learn
from identification.diagnose.locate import Located, locate, share
from identification.diagnose.score import Scored, score
from identification.diagnose.search import Searcher
from identification.fit import Progress

#: Replicates of each model, and how many effects may be added.
REPLICATES, _MOST_STEPS = 400, 6
#: Share of the excess that an effect must explain to be named where more than noise is left in the end.
_SHARE = 0.5
#: p from which on one effect has left nothing for a law to do better, and several only if it has fewer unknowns.
_SETTLED = 0.1
#: Several effects that leave less than this share of the excess χ², and yet more than noise, only bend towards it.
_BENT = 0.1
#: Share of an effect's gain in χ² that another must have had to be tried in its place; and that another mode of the
#: model without it must have to be looked at before anything is named.
_RIVAL, _MODE = 0.3, 0.05


@dataclass(frozen=True, eq=False)
class Examined:
    """A model under scrutiny: its fit, where it fails, the scores of what may be missing, and p of both together."""

    fitted: Fitted
    located: Located
    scored: Scored
    p: float

    @property
    def significant(self) -> bool:
        """Whether the model leaves more than noise."""
        return self.p < ALPHA


@dataclass(frozen=True, eq=False)
class Step:
    """One effect added: the model before, what decided, and the fits without and with it (a requirement of the chosen
    one has steps of its own)."""

    effect: str
    before: Fitted
    after: Fitted
    probability: float
    decision: Decision | None


@dataclass(frozen=True, eq=False)
class Repaired:
    """All models examined, the base first; the steps kept; names withdrawn or taken out again; alternatives: sets of
    effects of which each would do as well as the last steps, () where there is no doubt; law: what was learned of the
    remainder, None where there is none or it predicts nothing."""

    examined: tuple[Examined, ...]
    decisions: tuple[Decision, ...]
    steps: tuple[Step, ...]
    removed: tuple[str, ...]
    alternatives: tuple[tuple[str, ...], ...]
    last: Examined
    law: Law | None


def examine(fitted: Fitted, seed: int, estimated: tuple[bool, ...]) -> Examined:
    """Locates and scores, against the same replicates; p of the lesser of the two p, by the replicates again."""
    replicates = fitted.replicates(REPLICATES, np.random.default_rng(seed), estimated)
    located, scored = locate(fitted, replicates), score(fitted, replicates)
    families = ((located.largest, located.replicas), (scored.largest, scored.replicas))
    of_data = min(share(replicas, largest) for largest, replicas in families)
    ranks = [1.0 - np.argsort(np.argsort(replicas)) / len(replicas) for _, replicas in families]
    of_replicates = np.minimum(*ranks)
    return Examined(fitted, located, scored, float((1 + np.sum(of_replicates < of_data)) / (1 + len(of_replicates))))


def examine_settled(
    fitted: Fitted, searcher: Searcher, seed: int, estimated: tuple[bool, ...], tell: Progress
) -> Examined:  # fmt: skip
    """Examines a model; where it leaves more than noise, first makes sure that no better mode of it explains that."""
    found = examine(fitted, seed, estimated)
    if not found.significant:
        return found
    better = searcher.settled(fitted, tell)
    return examine(better, seed, estimated) if better.chi2 < fitted.chi2 - fitted.unit else found


def repair(
    fitted: Fitted, searcher: Searcher, seed: int, estimated: tuple[bool, ...], tell: Progress
) -> Repaired:  # fmt: skip
    """Adds the most probable effect as long as the model leaves more than noise and an effect helps; then tries what
    was added for removal, and for exchange against what was nearly as good."""
    tell("locate", 0.0, "where model and data part")
    examined = [examine_settled(fitted, searcher, seed, estimated, tell)]
    decisions: list[Decision] = []
    steps: list[Step] = []
    replaced: list[str] = []
    while examined[-1].significant and len(steps) < _MOST_STEPS:
        now = examined[-1]
        decision = decide(now.fitted, now.scored, searcher, tell)
        if decision.chosen is None:
            decisions.append(decision)
            break
        better = searcher.beside(now.fitted, decision.chosen.fitted)
        if now.fitted.chi2 - better.chi2 > _MODE * decision.chosen.gain:  # the model may lack less than it seemed
            examined[-1] = examine(better, seed, estimated)
            continue
        decisions.append(decision)
        _take(decision, examined, steps, searcher, seed, estimated, tell)
        replaced += one_for_two(examined, decisions, steps, searcher, seed, estimated, tell)
    withdrawn = replaced + _withdraw(examined, steps, searcher)
    law = _outdoing(examined, steps, searcher, tell)
    if law is not None:
        withdrawn += _back_to(law.before, examined, steps)
    last, kept, removed = _without_the_needless(examined[-1], steps, searcher, seed, estimated)
    alternatives = _exchanges(last, kept, searcher, tell)
    if last.significant and (law is None or law.before is not last.fitted):
        law = learn(last.fitted, searcher, tell)
    return Repaired(tuple(examined), tuple(decisions), tuple(kept), (*withdrawn, *removed), alternatives, last, law)


def _take(
    decision: Decision, examined: list[Examined], steps: list[Step], searcher: Searcher, seed: int,
    estimated: tuple[bool, ...], tell: Progress,
) -> None:  # fmt: skip
    """Adds what was chosen to the model examined last, and examines that."""
    steps += _steps(examined[-1].fitted, decision, searcher)
    tell("locate", 0.0, f"what is left with {steps[-1].effect}")
    examined.append(examine_settled(steps[-1].after, searcher, seed, estimated, tell))
    steps[-1] = dataclasses.replace(steps[-1], after=examined[-1].fitted)


def one_for_two(
    examined: list[Examined], decisions: list[Decision], steps: list[Step], searcher: Searcher, seed: int,
    estimated: tuple[bool, ...], tell: Progress,
) -> list[str]:  # fmt: skip
    """Puts one effect in the place of the last two, where it does as well: the two may have led to the right mode of
    the other unknowns, far from which nothing foretells what an effect can do; and one cause is more probable than
    two. Returns the names replaced."""
    if len(examined) < 3:
        return []
    before, last = examined[-3], examined[-1]
    decision = beside(before.fitted, before.scored, last.fitted, searcher, tell)
    more = len(last.fitted.point) - len(before.fitted.point)
    both = log_evidence(before.fitted.chi2 - last.fitted.chi2, more, decision.inflation, decision.effective)
    if decision.chosen is None or decision.chosen.log_evidence < both - CLOSE:
        return []
    names = _back_to(before.fitted, examined, steps)
    decisions[-2:] = [decision]
    _take(decision, examined, steps, searcher, seed, estimated, tell)
    return [name for name in names if name != decision.chosen.candidate.name]


def _withdraw(examined: list[Examined], steps: list[Step], searcher: Searcher) -> list[str]:
    """Takes back names that leave most of what they were to explain: where more than noise remains, something unknown
    is at work, and an effect that only bends towards it is not what is missing; nor are several that together come
    close to the data and not to the noise: one unknown cause is more probable than they and yet another. Returns the
    names."""
    withdrawn = []
    while steps and examined[-1].significant:
        first, after = _excess(examined[0]), _excess(examined[-1])
        bent = after < _BENT * first and sum(_bends(step.effect) for step in steps) > 1
        if _explains(examined[-2], examined[-1], searcher) and not bent:
            break
        withdrawn += _back_to(examined[0 if bent else -2].fitted, examined, steps)
    return withdrawn


def _explains(before: Examined, after: Examined, searcher: Searcher) -> bool:
    """Whether the last effect explains most of what the model before it left: of its predictions, where they tell."""
    gaps = predictions(before.fitted, after.fitted, searcher)
    first, left = (_excess(before), _excess(after)) if gaps is None else (gaps[0] ** 2 - 1.0, gaps[1] ** 2 - 1.0)
    return left < (1.0 - _SHARE) * first


def _excess(examined: Examined) -> float:
    return examined.fitted.chi2 - examined.fitted.count


def _bends(name: str) -> bool:
    """Whether an effect has a strength by which it could stand in for another cause."""
    return any(is_strength(p) for p in effect(name).parameters)


def _outdoing(
    examined: Sequence[Examined], steps: Sequence[Step], searcher: Searcher, tell: Progress
) -> Law | None:  # fmt: skip
    """The law of a model with fewer names that does better than all names do: an effect is named only if it is still
    needed once a law is allowed. Of laws about as good the one that takes the place of most; None where names stand."""
    last = examined[-1]
    if not steps or (len(examined) == 2 and last.p > _SETTLED):
        return None
    models = [m.fitted for m in examined[:-1] if last.p <= _SETTLED or can_outdo(m.fitted, last.fitted)]
    laws = [law for law in (learn(model, searcher, tell) for model in models) if law is not None]
    over = [advantage(law, last.fitted) for law in laws]
    if not over or max(over) < CLOSE:
        return None
    return next(law for law, own in zip(laws, over, strict=True) if own > max(over) - CLOSE)


def _back_to(fitted: Fitted, examined: list[Examined], steps: list[Step]) -> list[str]:
    """Takes back the steps beyond a model, with what was examined after it; returns the names."""
    withdrawn = []
    while examined[-1].fitted is not fitted:
        decision = steps[-1].decision
        while steps and steps[-1].decision is decision:
            withdrawn.append(steps.pop().effect)
        examined.pop()
    return withdrawn


def _steps(before: Fitted, decision: Decision, searcher: Searcher) -> list[Step]:
    """The steps of a decision: what the chosen effect requires comes first, each with a fit of its own."""
    chosen, steps = decision.chosen, []
    assert chosen is not None
    for name in chosen.candidate.effects:
        if name == chosen.candidate.name:
            after = chosen.fitted
        else:
            own = next(c for c in candidates(before.cradle) if c.name == name)
            after = searcher.adding(before, own)
        steps.append(Step(name, before, after, decision.probability, decision))
        before = after
    return steps


def _without_the_needless(
    last: Examined, steps: Sequence[Step], searcher: Searcher, seed: int, estimated: tuple[bool, ...]
) -> tuple[Examined, list[Step], list[str]]:
    """The last model without what it no longer needs, the steps that remain, and names of what went. Where modes are
    many, an effect may only have led to a better one of the model without it."""
    kept, removed = list(steps), []
    for step in steps:
        required = any(step.effect in _required(other.effect) for other in kept)
        if required:
            continue
        model = without_effect(last.fitted.experiment, step.effect)
        try:
            fit = searcher.beside(searcher.nearby(model, last.fitted.values), last.fitted)
        except (SimulationError, ValueError):
            continue
        inflation, effective = coloured(last.fitted)
        fewer = len(last.fitted.point) - len(fit.point)
        if (fit.chi2 - last.fitted.chi2) / inflation < fewer * np.log(effective):
            last = examine(fit, seed, estimated)
            kept.remove(step)
            removed.append(step.effect)
    return last, kept, removed


def _required(name: str) -> tuple[str, ...]:
    return effect(name).requires


def _exchanges(
    last: Examined, steps: Sequence[Step], searcher: Searcher, tell: Progress
) -> tuple[tuple[str, ...], ...]:
    """Sets of effects that complete the other steps as well as those chosen, the chosen ones first."""
    inflation, effective = coloured(last.fitted)
    rivals: list[tuple[str, str]] = []
    for step in steps:
        others = _rivals(step)
        if not others or any(step.effect in _required(other.effect) for other in steps):
            continue
        model = without_effect(last.fitted.experiment, step.effect)
        base = searcher.nearby(model, last.fitted.values)
        more = len(last.fitted.point) - len(base.point)
        own = log_evidence(base.chi2 - last.fitted.chi2, more, inflation, effective)
        for i, candidate in enumerate(others):
            tell("exchange", i / len(others), f"{candidate.name} for {step.effect}")
            if base.cradle.has(candidate.name):
                continue
            try:
                searcher.adding(base, candidate)
                fit = searcher.adding_beside(base, candidate, last.fitted)
                refit = judged(base, candidate, fit, last.scored.replicas, inflation, effective)
            except (SimulationError, ValueError):
                continue
            if own - refit.log_evidence < CLOSE:
                rivals.append((step.effect, candidate.name))
    doubtful = tuple(dict.fromkeys(own for own, _ in rivals))
    exchanged = (tuple(rival if name == own else name for name in doubtful) for own, rival in rivals)
    return tuple(dict.fromkeys((doubtful, *exchanged))) if rivals else ()


def _rivals(step: Step) -> list[Candidate]:
    """Candidates that were significant where a step was decided and could stand in its place."""
    if step.decision is None or step.decision.chosen is None:
        return []
    least = _RIVAL * step.decision.chosen.gain
    return [
        refit.candidate for refit in step.decision.refits
        if refit.candidate.name != step.effect and len(refit.candidate.effects) == 1
        and refit.p < ALPHA and refit.gain >= least
    ]  # fmt: skip
