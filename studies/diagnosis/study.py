"""The study of diagnoses: python -m studies.diagnosis.study DIR [--rounds 12 13 14] [--processes 2]

Each case is an experiment made by the soft-contact reference, which shares no code with the package, and its
diagnosis. What is hidden is as strong as an oracle says: the χ² that the best wrong model would leave over that of the
right one. Cases are made and diagnosed one at a time and kept in DIR, so that the same command goes on;
`python -m studies.diagnosis.table DIR` adds them to the tables. Rounds from HELD_OUT on are held out: nothing is chosen
by looking at them, and each case is judged once. Those before were made by this module as it was at the commit in their
rows of docs/study.jsonl, and cannot be made by it any more.
"""

from __future__ import annotations

import argparse
import functools
import json
import multiprocessing
import os
import shutil
import time
import traceback
from collections.abc import Mapping
from dataclasses import asdict, dataclass
from pathlib import Path
from unittest import mock

import numpy as np

from studies.kept_rows import committed_code
from tests.reference.laboratory import Recording, drop_frames, record, write_experiment
from tests.reference.soft_contact import SoftCradle

#: Contacts this much stiffer are as good as instantaneous; see tests/integration/test_reference.py. Bobs of unequal
#: length or mass hang at unequal heights, 1e-11 to 1e-7 m apart, and whether they are struck as one hangs on how far a
#: blow presses them: by 0.3 mrad from one stiffness to another, and by 2 to 5 mrad to impacts that take no time at all.
#: Of three such bobs and more, contacts are as stiff as real ones, and the model states that they last (0.003 mrad).
STIFFENED = 1e6
_UNEVEN = frozenset({"length_mismatch", "mass_mismatch"})
_LASTING = "contact_duration"
TARGETS = (15.0, 50.0, 200.0)
#: The first round that is held out, and the first that was judged by the search by evidence; how many there are.
HELD_OUT, SEARCH, ROUNDS = 12, 27, 37
#: Cases of a round with nothing hidden, with two effects, three, and a force of no catalogue; since SEARCH, and before.
_OTHERS, _OTHERS_BEFORE = (6, 4, 2, 6), (4, 3, 0, 4)
#: How many wrong models the oracle refits, and how often it tries a strength.
_REFITTED, _SEARCHES = 2, 8
#: Strengths from which a wrong model is refitted [scales of its parameters], and how many of these starts are.
_FACTORS, _FOLLOWED = (0.01, 0.1, 1.0, 3.0), 3
#: Frames per second at which the oracle looks, with a noise that tells as much as the experiment's.
_ORACLE_RATE = 60.0


@dataclass(frozen=True)
class Kind:
    """Something to hide: its effect in the soft reference, the key that is its strength, the strength from which the
    search begins, numbers of bobs, other keys as ranges, and, for real apparatus that differs from the formula in
    detail, the effect by which it is made instead (friction: see `Apparatus.frame_drag`). each: "bob" or "gap" where
    there is a value for each."""

    name: str
    key: str
    strength: float
    bobs: tuple[int, ...] = (1, 2, 2, 3, 5)
    others: tuple[tuple[str, float, float], ...] = ()
    each: str = ""
    variant: tuple[str, str, dict[str, float]] | None = None
    inverse: bool = False


_MANY = (2, 2, 3, 5)
#: Every effect of the catalogue over the base model.
SINGLES = (
    Kind("quadratic_drag", "c2", 4e-3, variant=("power_drag", "c", {"power": 1.85})),
    Kind("pivot_friction", "tau_c", 2e-5, variant=("smooth_friction", "tau_c", {"rate": 0.1})),
    Kind("group_drag", "slope", 0.3, _MANY, (("range", 3e-3, 8e-3),)),
    Kind("added_mass", "mass", 1e-4),
    Kind("bob_attraction", "force", 1e-3, _MANY, (("range", 2e-3, 6e-3),),
         variant=("power_attraction", "force", {"distance": 6e-3, "power": 3.0})),
    Kind("frame_compliance", "frame_mass", 20.0, _MANY, (("frequency", 3.0, 12.0), ("damping_ratio", 0.01, 0.1)),
         inverse=True, variant=("frame_compliance", "frame_mass", {"friction": 1.0})),
    Kind("string_creep", "rate", 2e-5),
    Kind("spacer_offset", "offset", 2e-4, _MANY, each="gap"),
    Kind("mass_mismatch", "relative", 2e-3, _MANY, each="bob"),
    Kind("length_mismatch", "relative", 5e-4, _MANY, each="bob"),
    Kind("contact_duration", "scale", 1.0, _MANY),
    Kind("exposure_blur", "duration", 1e-2, _MANY),
    Kind("angle_offset", "offset", 5e-4),
    Kind("angle_scale", "scale", 2e-3),
    Kind("clock_scale", "scale", 1e-4),
)  # fmt: skip
#: Forces that are in no catalogue.
UNKNOWNS = (
    Kind("side_wind", "force", 1e-3, (1, 2, 3), (("centre", -0.05, 0.05), ("width", 0.02, 0.05))),
    Kind("vibration", "acceleration", 5e-3, (1, 2, 3), (("frequency", 0.5, 3.0), ("phase", 0.0, 6.0))),
    Kind("magnet", "energy", 1e-5, (1, 2, 3), (("angle", -0.1, 0.1), ("width", 0.03, 0.06))),
    Kind("squeeze_film", "coefficient", 1e-12, _MANY),
    Kind("string_kink", "stiffening", 0.01, (1, 2, 3), (("angle", -0.1, 0.1), ("width", 0.03, 0.06))),
    Kind("sticky_pair", "energy", 1e-6, _MANY),
)
#: Effects that can be one and the same in all data, for k_f and b are free; and those that always are: lengths that
#: differ from bob to bob are not. Where one of the latter is hidden alone, all must be in the set.
SYMMETRIC = frozenset({"added_mass", "clock_scale", "length_mismatch"})
SAME = frozenset({"added_mass", "clock_scale"})
PAIRS = (
    ("quadratic_drag", "length_mismatch"), ("pivot_friction", "spacer_offset"), ("angle_offset", "quadratic_drag"),
    ("contact_duration", "length_mismatch"), ("exposure_blur", "pivot_friction"), ("spacer_offset", "mass_mismatch"),
)  # fmt: skip
TRIPLES = (
    ("quadratic_drag", "length_mismatch", "exposure_blur"), ("pivot_friction", "spacer_offset", "angle_offset"),
    ("contact_duration", "mass_mismatch", "angle_scale"), ("string_creep", "bob_attraction", "quadratic_drag"),
)  # fmt: skip


@dataclass(frozen=True)
class Case:
    """One experiment to make: its name, what is hidden, the Δχ² asked of each, whether by the variants; seed."""

    name: str
    kinds: tuple[Kind, ...]
    target: float
    variant: bool
    seed: int


def is_held_out(name: str) -> bool:
    """Whether nothing was chosen by the case of this name."""
    return int(name.partition("-")[0]) >= HELD_OUT


def cases(rounds: list[int]) -> list[Case]:
    """Those of some rounds: in each every effect once, nulls, pairs, triples, and forces of no catalogue. Which are
    made by a variant has nothing to do with how strong they are."""
    if min(rounds) < HELD_OUT:
        raise ValueError(f"rounds before {HELD_OUT} are made by the commits in their rows of docs/study.jsonl")
    found = []
    by_name = {kind.name: kind for kind in SINGLES}
    for k in rounds:
        for i, kind in enumerate(SINGLES):
            seed = 1000 * k + i
            variant = kind.variant is not None and bool(np.random.default_rng([seed, 1]).random() < 1.0 / 3.0)
            found.append(Case(f"{k:02d}-{kind.name}", (kind,), TARGETS[(k + i) % 3], variant, seed))
        nulls, pairs, triples, unknowns = _OTHERS if k >= SEARCH else _OTHERS_BEFORE
        for i in range(nulls):
            found.append(Case(f"{k:02d}-nothing-{i}", (), 0.0, False, 1000 * k + 100 + i))
        for word, several, count, first in (("pair", PAIRS, pairs, 200), ("triple", TRIPLES, triples, 400)):
            for i in range(count):
                kinds = tuple(by_name[name] for name in several[(count * k + i) % len(several)])
                found.append(Case(f"{k:02d}-{word}-{i}", kinds, 100.0, False, 1000 * k + first + i))
        for i in range(unknowns):
            kind = UNKNOWNS[(unknowns * k + i) % len(UNKNOWNS)]
            found.append(Case(f"{k:02d}-unknown-{kind.name}", (kind,), 200.0, False, 1000 * k + 300 + i))
    return found


@dataclass(frozen=True)
class Settings:
    """How an experiment is filmed and described: its start, rightly stated; whether its file states the noise; which
    share of the frames is missing; and the correlation of the noise from one frame to the next."""

    start: str
    noise_stated: bool
    missing: float
    correlation: float

    @classmethod
    def draw(cls, rng: np.random.Generator) -> Settings:
        """Each by itself, but that correlated noise is stated: the readings alone make it look smaller than it is."""
        start, stated = str(rng.choice(["unstretched", "hanging"])), bool(rng.random() < 0.75)
        missing, correlated = rng.random() < 0.25, stated and rng.random() < 1.0 / 6.0
        return cls(start, stated, 0.03 if missing else 0.0, 0.3 if correlated else 0.0)

    def correlation_time(self, rate: float) -> float:
        """That of the noise [s] at this many frames per second."""
        return -1.0 / (rate * float(np.log(self.correlation))) if self.correlation else 0.0

    @property
    def inflation(self) -> float:
        """By how much the noise hides more of slow motion than white noise of its size does, as χ²."""
        return (1.0 + self.correlation) / (1.0 - self.correlation)


class Apparatus:
    """The cradle of a case, drawn from its seed, and recordings of it at any strength of what is hidden."""

    def __init__(self, case: Case):
        rng = np.random.default_rng(case.seed)
        allowed = set.intersection(*({*kind.bobs} for kind in case.kinds)) if case.kinds else {1, 2, 3, 5}
        self.case = case
        self.bobs = int(rng.choice([n for n in (1, 2, 2, 3, 5) if n in allowed]))
        self.truth = {
            "k_f": float(rng.uniform(14e3, 24e3)),
            "kappa": float(rng.uniform(160.0, 240.0)),
            "b": float(10 ** rng.uniform(-3.0, -2.3)),
        }
        self.noise, self.rate = float(rng.choice([1e-3, 5e-3])), float(rng.choice([60.0, 60.0, 240.0]))
        self.angle = float(rng.uniform(0.12, 0.3))
        self.stated = {key: value * rng.uniform(0.85, 1.15) for key, value in self.truth.items()}
        self.lifted = self.angle + 1e-3 * float(rng.standard_normal())
        self.others = [{key: float(rng.uniform(*ends)) for key, *ends in kind.others} for kind in case.kinds]
        self.patterns = [rng.standard_normal({"bob": self.bobs, "gap": self.bobs - 1}.get(kind.each, 1))
                         for kind in case.kinds]  # fmt: skip
        self.pair = int(rng.integers(1, self.bobs)) if self.bobs > 1 else 1
        self.settings = Settings.draw(rng)
        names = {kind.name for kind in case.kinds}
        #: Whether what is hidden is a force that the catalogue does not have.
        self.in_no_catalogue = bool(case.kinds) and case.kinds[0] in UNKNOWNS
        #: Whether the model states that contacts last as long as real ones.
        self.lasting = self.bobs > 2 and not _UNEVEN.isdisjoint(names) and _LASTING not in names

    def strongest(self, i: int) -> float:
        """The strength of what is hidden up to which a search may go: that of the effect's own bounds."""
        from cradle_env.effects import effect

        kind, far = self.case.kinds[i], 100.0
        if self.in_no_catalogue:
            return far * kind.strength
        bound = next(p for p in effect(kind.name).parameters if p.key == kind.key)
        if kind.inverse:
            return min(far * kind.strength, kind.strength**2 / bound.low)
        return min(far * kind.strength, bound.high / float(np.abs(self.patterns[i]).max() if kind.each else 1.0))

    def effects(self, strengths: list[float], variant: bool = False) -> dict:
        """What is hidden at these strengths, as the soft reference has it: by the formula, or by the variant."""
        found: dict = {}
        for i, (kind, s) in enumerate(zip(self.case.kinds, strengths, strict=True)):
            if s == 0.0:
                continue
            pattern = self.patterns[i]
            if kind.name == "mass_mismatch":
                pattern = pattern - pattern.mean()
            value = (pattern * s).tolist() if kind.each else kind.strength**2 / s if kind.inverse else s
            name, key, more = kind.name, kind.key, dict(self.others[i])
            if variant and kind.variant is not None:
                name, key, fixed = kind.variant
                more = {} if name != kind.name else more
                if "friction" in fixed:
                    found["frame_drag"] = {"c2": self.frame_drag(fixed["friction"], float(value), more["frequency"])}
                else:
                    more |= fixed
            if name == "sticky_pair":
                more["pair"] = self.pair
            if name == "magnet":
                more["bob"] = self.bobs
            found[name] = {key: value, **more}
        return found

    def frame_drag(self, share: float, mass: float, frequency: float) -> float:
        """c2 [kg/m] at which a frame of this mass and frequency, swung by one bob, loses this share of its spring's
        force to drag as v²: a frame hardly moves, and what is not as large as that cannot be seen."""
        spring, pull = mass * (2.0 * np.pi * frequency) ** 2, SoftCradle.mass * SoftCradle.gravity * self.angle
        speed = pull / spring * np.sqrt(SoftCradle.gravity / SoftCradle.length)
        return float(share * pull / speed**2)

    def record(self, strengths: list[float], noisy: bool, rate: float = 0.0, exact: bool = False) -> Recording:
        """The recording at these strengths, 45 s of it; exact: by the formula even where the case has a variant."""
        effects = self.effects(strengths, self.case.variant and not exact)
        factor = 1.0 if self.lasting or _LASTING in effects else STIFFENED
        cradle = SoftCradle(self.bobs, stiffness_factor=factor, effects=effects, **self.truth)
        settings, seed = self.settings, self.case.seed
        made = record(cradle, {self.bobs: self.angle}, settings.start, noise=self.noise if noisy else 0.0,
                      correlation_time=settings.correlation_time(self.rate), rate=rate or self.rate, duration=45.0,
                      seed=seed)  # fmt: skip
        return drop_frames(made, settings.missing, seed) if noisy else made

    def write(self, folder: Path, recording: Recording, noise: float | None = None) -> Path:
        """The experiment's files; what they state of k_f, kappa, b and the release is off. noise: to be stated of a
        recording that has none, and whose release is stated as it was."""
        known = {_LASTING: {"scale": 1.0}} if self.lasting else {}
        lifted, told = self.lifted, self.noise if self.settings.noise_stated else None
        if noise is not None:
            lifted, told = self.angle, noise
        return write_experiment(
            folder, [recording], stated=self.stated, effects=[*known], parameters=known,
            release={"angles": {self.bobs: lifted}}, run={"noise": told},
        )  # fmt: skip


class Oracle:
    """What an apparatus hides, by the χ² that the best wrong model and the right one, both refitted, leave of
    noiseless training data."""

    def __init__(self, apparatus: Apparatus, scratch: Path):
        from identification.diagnosis.selection.candidates import list_candidates
        from identification.diagnosis.selection.score_test import compute_sensitivities

        self.apparatus, self.scratch = apparatus, scratch
        tells = apparatus.settings.inflation * _ORACLE_RATE / apparatus.rate
        self.noise = apparatus.noise * float(np.sqrt(tells))
        # Asked for again where a search ends.
        self.right, self.wrong_leaves = functools.cache(self._refit_right), functools.cache(self._refit_wrong)
        self.clean = self._record([0.0] * len(apparatus.case.kinds))
        self.searcher, self.fitted = self._true(self.clean)
        hidden = {kind.name for kind in apparatus.case.kinds}
        right = hidden | _same(hidden)
        self.wrong = [
            (candidate, sensed, np.linalg.qr(self.fitted.project(sensed.S))[0])
            for candidate in list_candidates(self.fitted.cradle) if candidate.name not in right
            for sensed in compute_sensitivities(self.fitted, candidate)
        ]  # fmt: skip

    def delta(self, strengths: list[float], refitted: bool = True) -> float:
        """Δχ² at these strengths: what the nearest, when refitted, of the wrong models that are nearest to first order
        leaves over the right one. Of what is in no catalogue no model is right, and the wrong one has two effects."""
        if refitted:
            right = 0.0 if self.apparatus.in_no_catalogue else self.right(tuple(strengths)).chi2
            return self.wrong_leaves(tuple(strengths)) - right
        moved = self._moved(self._record(strengths))
        return min(self._left(moved), default=float(moved @ moved))

    def _moved(self, recording: Recording) -> np.ndarray:
        """By how much what is hidden moves the readings, over the noise, with what fits absorb projected out."""
        moved = (self.clean.readings - recording.readings)[self.fitted.likelihood.rows[0]] / self.noise
        return self.fitted.project(np.concatenate([moved.ravel(), np.zeros(len(self.fitted.residuals) - moved.size)]))

    def _left(self, moved: np.ndarray) -> list[float]:
        """χ² that each wrong model leaves, to first order."""
        return [float(moved @ moved - np.sum((Q.T @ moved) ** 2)) for *_, Q in self.wrong]

    def _refit_wrong(self, strengths: tuple[float, ...]) -> float:
        """χ² that the nearest of the wrong models leaves."""
        from identification.diagnosis.selection.score_test import score

        recording = self._record([*strengths])
        moved = self._moved(recording)
        searcher, base = self._true(recording)
        nearest = fit_near(searcher, base.experiment, base.values)
        for i in np.argsort(self._left(moved))[:_REFITTED]:
            candidate, sensed, _ = self.wrong[i]
            likely = [sensed.values(np.linalg.lstsq(self.fitted.project(sensed.S), -moved)[0])]
            nearest = _better_fit(nearest, searcher, base, candidate, base, likely)
        if self.apparatus.in_no_catalogue and nearest.chi2 > self.apparatus.case.target:
            first, replicates = nearest, np.zeros((len(nearest.residuals), 1))
            for s in score(first, replicates).scores[:_REFITTED]:
                nearest = _better_fit(nearest, searcher, first, s.candidate, first, s.likely)
        return nearest.chi2

    def right_leaves(self, strengths: list[float], exact: bool = False) -> float:
        """χ² of the readings that the right model, refitted, leaves; exact: had the formula made them."""
        right = self.right(tuple(strengths), exact)
        return float(np.sum(right.residuals[: right.count] ** 2))

    def _refit_right(self, strengths: tuple[float, ...], exact: bool = False):
        searcher, base = self._true(self._record([*strengths], exact))
        return refit_right_model(self.apparatus, [*strengths], searcher, base)

    def _record(self, strengths: list[float], exact: bool = False) -> Recording:
        """As the experiment's, at fewer frames that tell as much: for the cost of it."""
        return self.apparatus.record(strengths, False, _ORACLE_RATE, exact)

    def _true(self, recording: Recording):
        return fit_at_truth(self.apparatus.write(self.scratch, recording, self.noise), self.apparatus.truth)


def fit_at_truth(path: Path, truth: dict[str, float]):
    """A search over an experiment, and its base model at the true values."""
    from identification.diagnosis.selection.fit_cache import FitCache
    from identification.diagnosis.selection.searcher import Searcher
    from identification.experiment.experiment import Experiment
    from identification.inference.fit_result import FitResult, with_known_noise
    from identification.inference.start_points import point_at

    searcher = Searcher(FitCache(None, ""), 0, 1)
    likelihood = searcher.likelihood(with_known_noise(Experiment.load(path)))
    return searcher, FitResult(likelihood, point_at(likelihood, truth))


def refit_right_model(apparatus: Apparatus, strengths: list[float], searcher, base):
    """The right model, refitted from the truth."""
    from cradle_env.effects import effect
    from identification.diagnosis.selection.candidates import with_effects

    truth = {
        name: {p.key: np.clip(values[p.key], p.low, p.high).tolist() for p in effect(name).parameters}
        for name, values in apparatus.effects(strengths).items()
    }
    return fit_near(searcher, with_effects(base.experiment, truth), base.values)


def fit_near(searcher, experiment, values: Mapping[str, float]):
    """The mode of a model near these values of its unknowns."""
    from identification.diagnosis.selection.searcher import refine_to_mode
    from identification.inference.fit_result import FitResult
    from identification.inference.start_points import point_at

    likelihood = searcher.likelihood(experiment)
    return FitResult(likelihood, refine_to_mode(likelihood, point_at(likelihood, values)))


def _better_fit(nearest, searcher, base, candidate, beside, likely):
    """The nearer to the data of a fit and of a model with a candidate added, from where another model has its mode."""
    from cradle_env.effects import effect
    from identification.diagnosis.selection.candidates import starts, with_effects
    from identification.diagnosis.selection.continuation import least
    from identification.diagnosis.selection.searcher import refine_to_mode
    from identification.inference.fit_result import FitResult
    from identification.inference.start_points import flatten_values, point_at

    bobs, name = base.cradle.bobs, candidate.name
    several = [*likely, *starts(candidate.declaration, bobs, _FACTORS)]
    brought = {name: next(starts(effect(name), bobs, (1.0,))) for name in candidate.effects}
    try:
        likelihood = searcher.likelihood(with_effects(base.experiment, brought, candidate.unknown))
    except ValueError:
        return nearest
    points = [point_at(likelihood, {**beside.values, **flatten_values(name, values)}) for values in several]
    fits = [FitResult(likelihood, refine_to_mode(likelihood, point)) for point in least(likelihood, points, _FOLLOWED)]
    return min([nearest, *fits], key=lambda fit: fit.chi2)


def find_strengths(apparatus: Apparatus, oracle: Oracle) -> list[float]:
    """Strengths at which what is hidden leaves the Δχ² that the case asks; of two, each alone."""
    case, found = apparatus.case, []
    for i, kind in enumerate(case.kinds):
        s, most = kind.strength, apparatus.strongest(i)
        for refitted, tries in ((False, _SEARCHES), (True, _SEARCHES // 2)):
            weaker = stronger = None
            for _ in range(tries):
                reached = oracle.delta([s if j == i else 0.0 for j in range(len(case.kinds))], refitted)
                lack = float(np.log(case.target / max(reached, 0.01 * case.target)))
                if abs(lack) < 0.3 or (s == most and lack > 0.0):
                    break
                weaker, stronger = ((s, lack), stronger) if lack > 0.0 else (weaker, (s, lack))
                if weaker and stronger:
                    share = weaker[1] / (weaker[1] - stronger[1])
                    s = weaker[0] * (stronger[0] / weaker[0]) ** share
                else:
                    s = min(s * float(np.exp(0.5 * lack)), most)
        found.append(s)
    return found


def hide(apparatus: Apparatus, scratch: Path) -> dict:
    """What a case hides, for its row: strengths, all values, Δχ² by the oracle, and the χ² that the right model
    leaves of these data without their noise and, of a variant's, of the same made by the formula."""
    if not apparatus.case.kinds:
        return {"oracle": 0.0, "strengths": []}
    oracle = Oracle(apparatus, scratch)
    strengths = find_strengths(apparatus, oracle)
    variant = apparatus.case.variant
    found = {"oracle": round(oracle.delta(strengths), 1), "strengths": strengths,
             "made by": apparatus.effects(strengths, variant)}  # fmt: skip
    if not apparatus.in_no_catalogue:
        found["right leaves"] = round(oracle.right_leaves(strengths), 2)
    if variant:
        found["formula leaves"] = round(oracle.right_leaves(strengths, exact=True), 2)
    return found


#: What a row says of a case, whatever judges it.
_OF_THE_CASE = ("case", "held_out", "bobs", "noise", "rate", "settings", "target", "variant", "oracle", "strengths",
                "made by", "right leaves", "formula leaves")  # fmt: skip


def run(case: Case, folder: Path, judged: dict | None) -> None:
    """Makes a case and diagnoses it; its row goes to result.json. judged: the row of an earlier code, if there is one,
    which says how strong that is that the case hides."""
    out = folder / case.name
    commit, apparatus = committed_code(Path(__file__).parent), Apparatus(case)
    if judged is None:
        row = {
            "case": case.name, "held_out": is_held_out(case.name), "bobs": apparatus.bobs, "noise": apparatus.noise,
            "rate": apparatus.rate, "settings": asdict(apparatus.settings), "target": case.target,
            "variant": case.variant, **hide(apparatus, out / "clean"), "commit": commit,
        }  # fmt: skip
    else:
        row = {key: judged[key] for key in _OF_THE_CASE if key in judged} | {"commit": commit}
    path = apparatus.write(out, apparatus.record(row["strengths"], True))
    names = ["?"] if apparatus.in_no_catalogue else [kind.name for kind in case.kinds]
    answer = {"effects": names, "truth": apparatus.truth}
    began = time.process_time()
    try:
        row |= diagnose_case(path, out / "out", answer)
    except Exception as problem:  # a crash is a miss, to be listed as such
        row |= {"hidden": answer["effects"], "verdict": f"crashed: {problem!r}", "named": [], "one of": [],
                "gap after": None, "right": False, "errors": {}, "trace": traceback.format_exc(),
                "seconds": round(time.process_time() - began, 1)}  # fmt: skip
    shutil.rmtree(out / "clean", ignore_errors=True)
    for data in out.glob("run*.csv"):
        data.unlink()
    text = json.dumps(row, indent=1)
    (out / "result.part").write_text(text, encoding="utf-8")
    os.replace(out / "result.part", out / "result.json")
    print(f"{case.name:28} Δχ² {row['oracle']:6.0f}  N = {apparatus.bobs}  {row['verdict']:16} {row['named']} "
          f"{row['one of']} {row['seconds']} s  {'' if row['right'] else 'NOT RIGHT'}", flush=True)  # fmt: skip


def diagnose_without_advice(path: Path):
    """The diagnosis of an experiment, without the search for the next one: nothing judges that here."""
    from identification.diagnosis import workflow
    from identification.experiment.experiment import Experiment

    with mock.patch.object(workflow, "_advise", lambda *_: None):
        return workflow.diagnose(Experiment.load(path), seed=0, workers=1)


def diagnose_case(path: Path, out: Path, answer: dict) -> dict:
    """The diagnosis of a case; margin: what χ² the best wrong model leaves over that of the right one, both refitted
    to these very data. No advice is asked for, nor a report: nothing judges them here. Its seconds are those of the
    processor: a study shares its machine."""
    from identification.bench import diagnosis as bench
    from identification.storage.files import json_text, write_together

    began = time.process_time()
    diagnosis = diagnose_without_advice(path)
    content = diagnosis.content()
    row = bench.row(content, answer) | {"sets": content["sets"], "seconds": round(time.process_time() - began, 1)}
    write_together(out, {"diagnosis.json": json_text(content)})
    hidden, first = set(answer["effects"]), diagnosis.repaired.examined[0].fitted
    refits = diagnosis.repaired.alone
    right = [refit.fitted.chi2 for refit in refits if refit.candidate.name in hidden]
    wrong = [refit.fitted.chi2 for refit in refits if refit.candidate.name not in hidden | _same(hidden)]
    if right and len(hidden) == 1:
        row["margin"] = round(min([first.chi2, *wrong]) - min(right), 1)
    return row


def _same(hidden: set[str]) -> frozenset[str]:
    return SYMMETRIC if hidden & SYMMETRIC else frozenset()


def main() -> None:
    """Runs what is not yet there."""
    parser = argparse.ArgumentParser(description="The study of diagnoses.")
    parser.add_argument("folder", type=Path)
    parser.add_argument("--rounds", type=int, nargs="+", default=list(range(SEARCH, ROUNDS)))
    parser.add_argument("--misses", action="store_true", help="judge again what an earlier selection missed")
    parser.add_argument("--processes", type=int, default=2)
    chosen = parser.parse_args()
    committed_code(Path(__file__).parent)
    judged = missed_before() if chosen.misses else {}
    rounds = range(HELD_OUT, SEARCH) if chosen.misses else chosen.rounds
    left = [
        case for case in cases([*rounds])
        if (case.name in judged or not chosen.misses) and not (chosen.folder / case.name / "result.json").is_file()
    ]  # fmt: skip
    # What is done when it stops is some whole rounds and the cases with few bobs of the next: five bobs take an hour.
    np.random.default_rng(0).shuffle(left)  # type: ignore[arg-type]
    left.sort(key=lambda case: ("" if chosen.misses else case.name[:2], Apparatus(case).bobs))
    with multiprocessing.get_context("spawn").Pool(chosen.processes, maxtasksperchild=20) as pool:
        pool.starmap(run, [(case, chosen.folder, judged.get(case.name)) for case in left], chunksize=1)


def missed_before() -> dict[str, dict]:
    """The rows of what the earlier selection missed in its held-out rounds, by case."""
    from studies.diagnosis.rows import is_exact
    from studies.kept_rows import read_rows

    rows = read_rows(Path(__file__).parents[2] / "docs" / "study.jsonl")
    judged = [row for row in rows if HELD_OUT <= int(row["case"][:2]) < SEARCH]
    return {row["case"]: row for row in judged if not is_exact(row)}


if __name__ == "__main__":
    main()
