"""The Missing-Effect Bench: its cases, what its score rewards, its entrants, and that its page is made of its rows."""

import csv
import json
import math
import subprocess
import sys
import tomllib
from collections import Counter
from types import SimpleNamespace
from typing import Any

import numpy as np
import pytest

from cradle_env.cradle import Cradle
from identification.experiment.experiment import Experiment
from studies.diagnosis.rows import is_confounded
from studies.diagnosis.study import SEARCH, is_held_out
from studies.diagnosis.table import ROWS as STUDY
from studies.kept_rows import read_rows
from studies.missing_effect_bench import __main__ as program
from studies.missing_effect_bench.candidates import (
    EQUIVALENTS,
    KINDS,
    NOTHING,
    UNKNOWN,
    all_names,
    candidate_names,
    merge,
    prior,
)
from studies.missing_effect_bench.cases import HERE, PUBLIC_CASES, PUBLIC_SEED, plan, public_truths, write
from studies.missing_effect_bench.entrants import BLIND, ENTRANTS, PROBABILITY_OF_UNKNOWN, answer_case, read_diagnosis
from studies.missing_effect_bench.false_discovery import Q, discover, select
from studies.missing_effect_bench.gaussian_process import weigh
from studies.missing_effect_bench.page import PAGE, ROWS, page
from studies.missing_effect_bench.regression import Direction, false_alarm_probability, fit_as_stated, regress
from studies.missing_effect_bench.scoring import check_answer, judge, reliability, summarize
from studies.missing_effect_bench.sparse_dynamics import Flight, find_flights, learn, name_terms
from tests.synthetic import simulated_run


def answer(nothing=0.0, unknown=0.0, case: Any = "case-000", **sets):
    """An answer; a set of two names is written a__b."""
    entries = [{"effects": names.split("__"), "probability": p} for names, p in sets.items()]
    return {"format": "missing-effect-answer/1", "case": case, "nothing": nothing, "unknown": unknown, "sets": entries}


def truth(kind, *effects):
    return {"case": "case-000", "kind": kind, "effects": [*effects]}


# What the score rewards


def test_score_is_that_of_brier():
    judged = judge(answer(0.2, 0.1, quadratic_drag=0.6, angle_offset=0.1), truth("single", "quadratic_drag"))
    assert judged.score == pytest.approx(0.2**2 + 0.1**2 + 0.4**2 + 0.1**2)
    assert judge(answer(nothing=1.0), truth("single", "quadratic_drag")).score == 2.0
    assert judge(answer(nothing=1.0), truth("nothing")).score == 0.0


def test_no_answer_is_better_than_what_is_believed():
    """Properness, with a belief that spreads over equivalents: 300 other answers have a worse expected score."""
    rng = np.random.default_rng(0)
    names = ["quadratic_drag", "added_mass", "clock_scale", "angle_offset__pivot_friction"]
    truths = [truth("nothing"), truth("unknown", "unknown"), *(truth("", *name.split("__")) for name in names)]

    def stated(p):
        return answer(p[0], p[1], **dict(zip(names, p[2:], strict=True)))

    belief = rng.dirichlet(np.ones(6))

    def expected(p):
        return sum(b * judge(stated(p), one).score for b, one in zip(belief, truths, strict=True))

    others = [rng.dirichlet(np.ones(6)) for _ in range(150)]
    others += [0.9 * belief + 0.1 * p for p in others]
    assert all(expected(belief) < expected(p) for p in others)


@pytest.mark.parametrize("named", EQUIVALENTS)
def test_any_equivalent_is_right_and_being_sure_of_one_is_counted(named):
    hidden = truth("equivalent", "clock_scale")
    sure = judge(answer(0.1, **{named: 0.9}), hidden)
    fair = judge(answer(0.1, **dict.fromkeys(EQUIVALENTS, 0.3)), hidden)
    assert sure.right and fair.right
    assert sure.score == pytest.approx(fair.score) == pytest.approx(2 * 0.1**2)
    assert (sure.overclaims, fair.overclaims) == (True, False)
    assert summarize([sure, fair])["equivalent: sure of one name"].startswith("1 of 2 ")


def test_lengths_that_differ_are_no_equivalent():
    assert not judge(answer(length_mismatch=1.0), truth("equivalent", "clock_scale")).right
    assert merge(["clock_scale", "quadratic_drag"]) == merge(["common_length", "quadratic_drag"])


def test_a_credible_set_is_as_small_as_can_be_and_a_tie_is_not_right():
    judged = judge(answer(0.6, 0.3, quadratic_drag=0.06, angle_offset=0.04), truth("single", "quadratic_drag"))
    assert judged.credible == {NOTHING, UNKNOWN, frozenset({"quadratic_drag"})}
    tied = judge(answer(0.5, 0.5), truth("nothing"))
    assert tied.top is None and not tied.right and tied.credible == {NOTHING, UNKNOWN}


def test_a_table_counts_what_it_says():
    several = [
        judge(answer(nothing=1.0), truth("nothing")),
        judge(answer(unknown=0.96, nothing=0.04), truth("nothing")),
        judge(answer(quadratic_drag=0.7, unknown=0.3), truth("unknown", "unknown")),
        judge(answer(nothing=0.7, unknown=0.3), truth("unknown", "unknown")),
        judge(answer(nothing=0.1, unknown=0.9), truth("unknown", "unknown")),
    ]
    found = summarize(several)
    assert found["right"] == "2 of 5 (12–77 %)"
    assert found["nothing: false alarm"].startswith("1 of 2 ")
    assert found["unknown: wrong name"].startswith("1 of 3 ")
    assert found["in the 95 % credible set"].startswith("4 of 5 ")
    assert found["answers in that set, median"] == "2"
    assert found["right, pair"] == "–"
    assert [cell[:6] for cell in reliability(several).values()] == ["–", "0 of 2", "1 of 1", "0 of 1", "1 of 1"]


@pytest.mark.parametrize(
    "wrong, said",
    [
        (answer(0.5), r"sum to 0\.5; they must sum to 1"),
        (answer(0.5, dragg=0.5), "'dragg' is no candidate"),
        (answer(1.0, case="case-001"), "name each file as its case"),
        (answer(1.5), "nothing is 1.5; expected a number from 0 to 1"),
        ({"case": "case-000"}, "the file is"),
        (answer(0.5, quadratic_drag__quadratic_drag=0.5), "different names"),
    ],
)
def test_an_answer_that_cannot_be_scored_is_refused_in_one_line(wrong, said):
    with pytest.raises(ValueError, match=said) as refused:
        check_answer(wrong, "case-000", "folder")
    assert "\n" not in str(refused.value)


# The cases


def test_each_five_cases_have_one_of_each_kind_and_an_order_of_their_own():
    kinds = [[plan(seed, number)[0] for number in range(30)] for seed in (0, 1)]
    for some in kinds:
        assert all(sorted(some[i : i + 5]) == sorted(KINDS) for i in range(0, 30, 5))
    assert kinds[0] != kinds[1]
    assert len({kind.name for n in range(90) for kind in plan(0, n)[1] if plan(0, n)[0] == "single"}) == 13


def test_the_public_set_is_balanced_and_hides_what_its_candidates_allow():
    truths = public_truths()
    assert [row["case"] for row in truths] == [f"case-{k:03d}" for k in range(PUBLIC_CASES)]
    assert Counter(row["kind"] for row in truths) == dict.fromkeys(KINDS, PUBLIC_CASES // len(KINDS))
    for row in truths:
        kind, hidden, _ = plan(PUBLIC_SEED, int(row["case"][-3:]))
        assert kind == row["kind"] and {one.name for one in hidden} == {*row["made_by"]}
        assert row["kind"] == "unknown" or {*row["effects"]} <= {*candidate_names(row["bobs"])}
        assert row["bobs"] <= 3 and (kind == "nothing" or row["delta_chi2"] >= 10.0)


def test_probabilities_before_the_data_are_of_all_that_can_be_hidden():
    for bobs in (1, 2, 3):
        assert sum(prior(bobs).values()) == pytest.approx(1.0)
    rows = [row for row in public_truths() if row["kind"] != "unknown"]
    assert all(frozenset(row["effects"]) in prior(row["bobs"]) for row in rows)


@pytest.fixture(scope="module")
def written(tmp_path_factory):
    folder = tmp_path_factory.mktemp("bench")
    write(folder, PUBLIC_SEED, 5)
    return folder


def test_a_case_is_read_without_the_package(written):
    task = json.loads((written / "task.json").read_text(encoding="utf-8"))
    assert {*task["candidates"]} == {*all_names()} and task["equivalents"] == [*EQUIVALENTS]
    for case in task["cases"]:
        folder = written / "cases" / case["case"]
        assert sorted(path.name for path in folder.iterdir()) == ["experiment.toml", "run1.csv"]
        experiment = tomllib.loads((folder / "experiment.toml").read_text(encoding="utf-8"))
        assert experiment["cradle"]["bobs"] == case["bobs"] and experiment["model"]["effects"] == []
        header, *lines = csv.reader((folder / "run1.csv").read_text(encoding="utf-8").splitlines())
        assert header == ["t [s]", *(f"theta_{i + 1} [rad]" for i in range(case["bobs"]))]
        assert float(lines[-1][0]) > 44.0  # of 45 s, the last frames of which may be missing


def test_the_same_seed_writes_the_same_data(written, tmp_path):
    write(tmp_path, PUBLIC_SEED, 1)
    for name in ("cases/case-000/run1.csv", "cases/case-000/experiment.toml", "truth/case-000.json"):
        assert (tmp_path / name).read_bytes() == (written / name).read_bytes()
    with pytest.raises(ValueError, match="holds the cases of seed 0"):
        write(tmp_path, PUBLIC_SEED + 1, 1)


def test_the_example_enters(written, tmp_path):
    source = (HERE / "example_entrant.py").read_text(encoding="utf-8")
    quoted = source[source.index("task, answers") :]
    assert f"```python\n{quoted}```" in (HERE / "README.md").read_text(encoding="utf-8")
    subprocess.run([sys.executable, HERE / "example_entrant.py", written, tmp_path / "mine"], check=True, cwd=tmp_path)
    assert "| right | " in program.score(tmp_path / "mine", written)
    (tmp_path / "mine" / "case-003.json").unlink()
    with pytest.raises(ValueError, match=r"case-003\.json: no such file"):
        program.score(tmp_path / "mine", written)


# The entrants


def explained(probability, *effects, kind="set"):
    return {"kind": kind, "effects": effects, "probability": probability}


def test_a_diagnosis_is_read_as_probabilities():
    both, rest = explained(0.7, "quadratic_drag", "angle_offset"), explained(0.04, kind="other")
    sets = [both, explained(0.2, "quadratic_drag"), explained(0.05, kind="law"), explained(0.01, kind="nothing"), rest]
    found = read_diagnosis({"verdict": "named", "sets": sets, "alike": []}, 2)
    assert found[frozenset({"quadratic_drag", "angle_offset"})] == 0.7
    assert (found[frozenset({"quadratic_drag"})], found[UNKNOWN], found[NOTHING]) == (0.2, 0.05, 0.01)
    assert math.fsum(found.values()) == pytest.approx(1.0)
    refuted = read_diagnosis({"verdict": "unknown", "sets": sets, "alike": []}, 2)
    assert refuted[UNKNOWN] == PROBABILITY_OF_UNKNOWN
    assert math.fsum(refuted.values()) == pytest.approx(1.0)
    assert refuted[frozenset({"quadratic_drag"})] / refuted[NOTHING] == pytest.approx(20.0)
    length = [explained(1.0, "length_mismatch")]
    for alike, bobs, name in ((["length_mismatch"], 2, "common_length"), ([], 1, "common_length"),
                              ([], 2, "length_mismatch")):  # fmt: skip
        found = read_diagnosis({"verdict": "named", "sets": length, "alike": alike}, bobs)
        assert found[frozenset({name})] == 1.0


def test_the_probability_of_a_refuted_diagnosis_is_that_of_the_study():
    def kind(row):
        hidden = row["hidden"]
        if hidden == ["?"]:
            return "unknown"
        return "equivalent" if len(hidden) == 1 and hidden[0] in EQUIVALENTS else KINDS[len(hidden)]

    rows = [row for row in read_rows(STUDY) if is_held_out(row["case"]) and row["bobs"] <= 3]
    rows = [row for row in rows if int(row["case"][:2]) < SEARCH and not row["variant"] and not is_confounded(row)]
    of = Counter(map(kind, rows))
    share = {name: sum(kind(r) == name and r["verdict"] == "unknown" for r in rows) / of[name] for name in KINDS}
    assert share["unknown"] / sum(share.values()) == pytest.approx(PROBABILITY_OF_UNKNOWN, abs=0.005)


def pendulum(effects, seed=1):
    described = Cradle(bobs=1, b=0.002)
    run = simulated_run(described.replace(effects=effects), duration=12.0, noise=1e-3, seed=seed)
    return Experiment(described, (run,))


@pytest.mark.slow  # ten fits
def test_regression_finds_what_is_plain():
    found = regress(pendulum({"quadratic_drag": {"c2": 4e-2}}), prior(1))
    assert max(found, key=found.__getitem__) == {"quadratic_drag"}
    assert sum(found.values()) == pytest.approx(1.0)


def test_regression_finds_nothing_where_nothing_is():
    assert regress(pendulum({}), prior(1))[NOTHING] > 0.6  # without the criterion, more unknowns always fit better


def most_probable(found):
    assert sum(found.values()) == pytest.approx(1.0)
    return max(found, key=found.__getitem__)


@pytest.mark.slow  # ten fits
def test_discoveries_are_what_is_plain():
    assert most_probable(discover(pendulum({"quadratic_drag": {"c2": 4e-2}}), prior(1))) == {"quadratic_drag"}


def test_nothing_is_discovered_where_nothing_is():
    assert discover(pendulum({}), prior(1))[NOTHING] == 1.0 - Q


@pytest.mark.slow
def test_false_discoveries_are_as_rare_as_is_said():
    """In white noise any discovery is false: of 1000 draws Q have one, to 4 standard deviations of a count."""
    fitted: Any = SimpleNamespace(count=400, noise_inflation=1.0)
    rng = np.random.default_rng(0)
    directions = {f"{k}": Direction(np.eye(400)[:, [k]], 1) for k in range(12)}
    found = []
    for _ in range(1000):
        fitted.residuals = rng.standard_normal(400)
        found.append(bool(select(fitted, directions)))
    assert np.mean(found) == pytest.approx(Q, abs=4.0 * math.sqrt(Q / 1000))
    fitted.residuals[3] = 30.0
    assert select(fitted, directions)[0] == "3"


def test_a_gaussian_process_sees_that_something_is_missing():
    pytest.importorskip("sklearn", reason="needs the extra 'rivals'")
    assert most_probable(weigh(pendulum({}), prior(1))) == NOTHING
    assert weigh(pendulum({"quadratic_drag": {"c2": 4e-2}}), prior(1))[NOTHING] < 0.01


def test_pysindy_finds_a_term_that_is_plain():
    """A wrong zero of the angles, 5 standard deviations of their noise, is a constant force beyond the model."""
    pytest.importorskip("pysindy", reason="needs the extra 'rivals'")
    times, noise = np.arange(0.0, 40.0, 1 / 60), 1e-3 * np.random.default_rng(0).standard_normal(2400)
    swing = 0.1 * np.exp(-0.01 * times)

    def most_votes(beyond):
        terms = learn([Flight(times, beyond, swing * np.cos(times), -swing * np.sin(times))], 2.0 * np.pi)
        return Counter(terms).most_common(1)[0][0]

    assert most_votes(noise) == frozenset()
    assert most_votes(noise + 5e-3) == {"1"} and name_terms(frozenset({"1", "v"})) == {"angle_offset"}
    assert name_terms(frozenset({"1", "θ³"})) == UNKNOWN
    with pytest.raises(ValueError, match="no flight has more than the"):
        learn([Flight(times[:9], noise[:9], swing[:9], swing[:9])], 2.0 * np.pi)


def test_a_flight_holds_what_the_readings_have_beyond_the_model():
    """A lone bob has one flight."""
    experiment = pendulum({})
    (flight,) = find_flights(fit_as_stated(experiment))
    assert flight.theta + flight.beyond == pytest.approx(experiment.runs[0].readings[:, 0], abs=1e-12)


def test_a_peak_of_noise_is_as_rare_as_is_said():
    """White noise of two bobs: p below 0.05 in 5 % of 2000 draws, to 4 standard deviations of a count (0.5 %)."""

    fitted: Any = SimpleNamespace(count=400, noise_inflation=1.0, cradle=Cradle(bobs=2))
    fitted.readings = SimpleNamespace(bob=np.repeat([0, 1], 200))
    rng = np.random.default_rng(0)
    p = np.array([false_alarm_probability(fitted, rng.standard_normal(400)) for _ in range(2000)])
    assert np.mean(p < 0.05) == pytest.approx(0.05, abs=0.02)
    assert false_alarm_probability(fitted, 3.0 * np.sin(0.3 * np.arange(400))) < 1e-6


# What is kept


def test_kept_results_go_on_where_they_stopped(monkeypatch, tmp_path):
    asked, sighted = [], len(ENTRANTS) - len(BLIND)

    def answers(entrant, folder, bobs):
        asked.append((entrant, folder.name))
        if len(asked) == sighted + 2:
            raise KeyboardInterrupt
        return answer(1.0, case=folder.name)

    monkeypatch.setattr(program, "answer_case", answers)
    monkeypatch.setattr(program, "write", lambda *_: None)
    monkeypatch.setattr(program, "ROWS", tmp_path / "rows.jsonl")
    monkeypatch.setattr(program, "PAGE", tmp_path / "page.md")
    with pytest.raises(KeyboardInterrupt):
        program.keep_results(tmp_path)
    assert len(read_rows(tmp_path / "rows.jsonl")) == sighted + 1
    assert f"1 of the {PUBLIC_CASES} cases" in (tmp_path / "page.md").read_text(encoding="utf-8")  # of all entrants
    program.keep_results(tmp_path)
    rows = read_rows(tmp_path / "rows.jsonl")
    assert len({(row["case"], row["entrant"]) for row in rows}) == len(rows) == sighted * PUBLIC_CASES
    assert len(asked) == sighted * PUBLIC_CASES + 1
    assert (tmp_path / "page.md").read_text(encoding="utf-8") == page(rows, public_truths())


def test_the_page_is_made_of_the_rows():
    rows = read_rows(ROWS)
    assert page(rows, public_truths()) == PAGE.read_text(encoding="utf-8")
    for row in rows:
        check_answer(row["answer"], row["case"], ROWS)


def test_entrants_that_look_at_no_data_need_none(tmp_path):
    for entrant in BLIND:
        assert answer_case(entrant, tmp_path / "case-000", 2)["case"] == "case-000"
    assert {*BLIND} < {*ENTRANTS}
