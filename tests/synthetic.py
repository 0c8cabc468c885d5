"""Experiments simulated by the project itself or recorded elsewhere, and posteriors made up around their truth."""

from pathlib import Path

import numpy as np
import pytest

from cradle_env import Cradle, Release, effects, simulate
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.model_search import ModelSearch
from identification.diagnosis.selection.searcher import Searcher
from identification.experiment.experiment import Experiment
from identification.experiment.run import ReleaseInfo, Run
from identification.inference.convergence import Convergence
from identification.inference.fit_result import FitResult, with_known_noise
from identification.inference.gap import Gap
from identification.inference.likelihood import Likelihood
from identification.inference.posterior import Posterior
from identification.inference.start_points import point_at
from studies.diagnosis.study import SINGLES, Apparatus, Case, Settings
from tests.reference.laboratory import Recording

#: Relative width of the made-up posterior, by unknown.
WIDTHS = {"k_f": 1.5e-3, "kappa": 2e-4, "b": 3e-3}


def leave_candidates(patch: pytest.MonkeyPatch, *names: str) -> None:
    """Leaves a diagnosis no candidates but these."""
    kept = (*names, *effects.MODELS["nsp"], *(e.name for e in effects.LEARNED))
    patch.setattr(effects, "_EFFECTS", {name: effects.effect(name) for name in kept})


def simulated_run(
    cradle: Cradle, angle: float = 0.228, duration: float = 20.0, noise: float = 1e-3, seed: int = 1, **fields
) -> Run:
    """One run of a cradle at 60 readings a second; fields as in Run."""
    release = Release(angle=angle)
    motion = simulate(cradle, release, duration, 60.0)
    rng = np.random.default_rng(seed)
    seen = motion.theta
    if fields.get("quantity") == "x":
        seen, noise = motion.r * np.sin(motion.theta), noise * cradle.length
    fields = {"release": ReleaseInfo(release, angle_sd=1e-3), "noise": noise, "delta": cradle.delta} | fields
    return Run(motion.t, seen + noise * rng.standard_normal(seen.shape), **fields)


def recorded_run(recording: Recording, **fields) -> Run:
    """The run that the files of a recording would state; fields as in Run."""
    release = ReleaseInfo(Release(angles=recording.angles, start=recording.start), angle_sd=1e-3)
    delta = recording.cradle.delta if np.ndim(recording.cradle.delta) == 0 else tuple(recording.cradle.delta)
    stated = {"quantity": recording.quantity, "release": release, "noise": recording.noise or None, "delta": delta}
    if recording.quantity == "x":
        stated["unit"] = "m"
    return Run(recording.times, recording.readings, **{**stated, **fields})


def made_up_posterior(
    experiment: Experiment, *, steps: int = 60, walkers: int = 16, converged: bool = True, gap: Gap | None = None
) -> Posterior:
    """Two ensembles of independent Gaussian samples about what the experiment states."""
    likelihood = Likelihood(experiment)
    centre = likelihood.start()
    width = [
        u.sd * 0.2 if np.isfinite(u.sd) else WIDTHS.get(u.name, 1e-3) * (1.0 if u.log else abs(u.start) + 1e-3)
        for u in likelihood.unknowns
    ]
    rng = np.random.default_rng(0)
    z = rng.standard_normal((2, steps, walkers, len(centre)))
    z[0, 0, 0] = 0.0
    rates = 0.06 + 2e-5 * (z[..., 0] + 0.3 * rng.standard_normal(z.shape[:3]))
    reasons = () if converged else ("R̂ = 1.0700, wanted below 1.01", "ESS = 120, wanted at least 400")
    return Posterior(
        likelihood,
        centre + np.array(width) * z,
        -0.5 * np.sum(z**2, axis=-1),
        rates if likelihood.gives_lambda else None,
        Convergence(converged, 1.004 if converged else 1.07, 812.0 if converged else 120.0, 31.0, steps, 20, reasons),
        gap or Gap(1.004, 1.013, {"train": np.full(1 + experiment.cradle.bobs, 1e-3)}),
        seed=3,
    )


def fit_with(searcher: Searcher, base: FitResult, label: str) -> FitResult:
    """The model of a fit with a candidate more, fitted."""
    search = ModelSearch(base.experiment, searcher.store, 1)
    return search.extended(search.fit_base([base.point]), label).fitted


def early_case(name: str) -> Apparatus:
    """The apparatus of a case of the study's first rounds, "round-nothing-number" or "round-effect", by its seed."""
    at, what = int(name[:2]), name[3:]
    if what.startswith("nothing-"):
        case = Case(name, (), 0.0, False, 1000 * at + 100 + int(what.rpartition("-")[2]))
    else:
        i = next(i for i, kind in enumerate(SINGLES) if kind.name == what)
        case = Case(name, (SINGLES[i],), 15.0, False, 1000 * at + i)
    apparatus = Apparatus(case)
    apparatus.settings = Settings("unstretched", noise_stated=True, missing=0.0, correlation=0.0)
    return apparatus


def nothing_hidden(folder: Path, name: str, several_starts: bool = False) -> tuple[FitResult, np.ndarray]:
    """A case of the study's first rounds in which nothing is hidden, its model fitted to everything, from one start or
    from as many as a diagnosis takes; and the truth, (D,)."""
    apparatus = early_case(name)
    folder.mkdir(exist_ok=True)
    experiment = Experiment.load(apparatus.write(folder, apparatus.record([], True)))
    searcher = Searcher(FitCache(None, ""), 0, None)
    fitted = searcher.fit_global(with_known_noise(experiment))
    found = searcher.fit_all_data(searcher.refit_multistart(fitted) if several_starts else fitted)
    truth = {**apparatus.truth, "release_angle_error@1": apparatus.angle - apparatus.lifted}
    return found, point_at(found.likelihood, truth)
