"""Learns a smooth law for residuals that no effect of the catalogue explains: few terms of a fixed library.

1. Two linear models show what each term would do to the residuals: one of windows with start states of their own
   (multiple shooting), one of the free run. The first shows where a force acts; the second sees more where the misfit
   is small. Where the model is misspecified, the second is asked only if the first finds no law.
2. Each proposes the best subset of terms of each size, chosen by evidence, and smaller subsets.
3. Drafts with these terms compete by what they predict within the training part (see `drafts`).
4. Periodic forces join in the same way.
5. The residuals of the law's free run are searched for further terms, unless it is misspecified and has windows.

Held-out data play no part.
"""

from __future__ import annotations

import functools
import math

from identification.diagnosis.criteria import is_misspecified, only_noise
from identification.diagnosis.learned_law.drafts import complete_best, draft_extensions
from identification.diagnosis.learned_law.free_run import fit_free_run, is_in_step
from identification.diagnosis.learned_law.inner_validation import hold_out_last_third, validate_inner
from identification.diagnosis.learned_law.law import LearnedLaw, law_scales
from identification.diagnosis.learned_law.periodic_force import add_periodic_terms
from identification.diagnosis.learned_law.terms import MAX_TERMS, LinearModel
from identification.diagnosis.residuals.multiple_shooting import can_be_segmented, fit_multiple_shooting
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.noise import noise_gap_bound
from identification.experiment.train_test import training_rows
from identification.inference.fit_result import FitResult, estimate_effective_sample
from identification.progress import Progress

#: How often further terms are looked for in the residuals of a law.
_ROUNDS = 3
#: Inner gap of a law, over that of the effects named instead, up to which the law is completed.
_MAX_GAP_OVER_RIVAL = 1.15


def learn_law(
    fitted: FitResult, searcher: Searcher, progress: Progress, rival: FitResult | None = None
) -> LearnedLaw | None:
    """The law that a fitted model lacks.

    Returns None if no law predicts better than the model alone with more evidence, or if every law predicts far worse
    than `rival`, the model with effects named instead.
    """
    if fitted.has_learned_law or "b" not in fitted.likelihood.names:
        return None
    progress("law", 0.0, "window by window")
    scales = law_scales(fitted)
    shooting = LinearModel.of(fit_multiple_shooting(fitted), scales) if can_be_segmented(fitted.cradle) else None
    progress("law", 0.4, "which terms")
    part, alone = hold_out_last_third(fitted.experiment), len(fitted.experiment.runs) == 1
    inner_gap = fit_free_run(fitted, searcher, part, scales, (), {}).held_out_gap()
    none = LearnedLaw(fitted, fitted, (), scales, inner_gap, inner_gap)
    most = math.inf if rival is None else _MAX_GAP_OVER_RIVAL * validate_inner(rival, searcher)[1]
    free = _linearize_free_run(none) if shooting is None or is_in_step(fitted) else []
    views = free if shooting is None else [shooting, *free]
    drafts = [draft_extensions(none, searcher, part, scales, view, candidate_subsets(view), most) for view in views]
    # The residuals of a misspecified model's free run hold the accumulated effect of all forces so far. Terms chosen to
    # fit them can predict the next third well and fail later, so the free run is asked only where windows find no law.
    windows_first = shooting is not None and is_misspecified(fitted)
    drafts, later = (drafts[:1], drafts[1:]) if windows_first else (drafts, [])
    progress("law", 0.6, "periodic forces")
    # Runs share no phase of a force in time, and those that are held out count as well.
    timed = add_periodic_terms(shooting, scales, best_subset(shooting)) if shooting and alone else None
    if timed is not None:
        linear, scales_in_time = timed
        subsets = candidate_subsets(linear)
        periodic = tuple(i for i in subsets[0] if linear.term(i).in_time) if subsets else ()
        if periodic:
            # Near the frequency of the swing, a periodic force can imitate anything that swings with the bobs for a
            # while. So it must predict to within the noise.
            most = min(most, noise_gap_bound(part.runs, training_rows(part)[1]))
            for some in ([periodic], subsets):
                drafts.append(draft_extensions(none, searcher, part, scales_in_time, linear, some, most))
    law = complete_best(none, searcher, part, drafts) or complete_best(none, searcher, part, later)
    if law is None:
        return None
    for i in range(_ROUNDS):
        if only_noise(law.fitted, searcher.criteria):  # further terms would fit noise, and predict worse
            break
        if shooting is not None and is_misspecified(law.fitted):  # not from its free run
            break
        progress("law", 0.8 + 0.05 * i, "further terms")
        proposals = ((view, best_subset(view)) for view in _linearize_free_run(law))
        drafts = [draft_extensions(law, searcher, part, law.scales, view, [best]) for view, best in proposals if best]
        further = complete_best(law, searcher, part, drafts)
        if further is None:
            break
        law = further
    return law


def _linearize_free_run(law: LearnedLaw) -> list[LinearModel]:
    """Linear models of the free run of a law: of the terms common to all bobs, then of all terms."""
    linear = LinearModel.of(law.fitted, law.scales, law.terms)
    return [linear] if law.fitted.cradle.bobs == 1 else [linear.with_common_terms(), linear]


def candidate_subsets(linear: LinearModel) -> list[tuple[int, ...]]:
    """The best subset, then the best ones with half as many terms, a quarter, and one term.

    More terms can fit residuals that they do not cause, and predict worse.
    """
    path, best = linear.subset_path(MAX_TERMS), best_subset(linear)
    sizes = dict.fromkeys((len(best) // 2, len(best) // 4, 1))
    return [best, *(path[size - 1] for size in sizes if 0 < size < len(best))] if best else []


def best_subset(linear: LinearModel) -> tuple[int, ...]:
    """The subset of the path with the most evidence, without terms that lower it; () if no subset has any."""
    path = linear.subset_path(MAX_TERMS)
    if not path:
        return ()
    residuals = linear.solve(path[-1])[0]
    inflation, effective = estimate_effective_sample(residuals[: linear.fitted.count], linear.fitted.readings)
    evidence = functools.partial(linear.log_evidence, inflation=inflation, effective=effective)
    best = max([(), *path], key=evidence)
    while best:
        fewer = max((tuple(j for j in best if j != i) for i in best), key=evidence)
        if evidence(fewer) <= evidence(best):
            break
        best = fewer
    return best
