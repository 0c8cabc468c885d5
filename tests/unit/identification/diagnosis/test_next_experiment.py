"""The next experiment: what it is expected to tell, against chance, limits and data of the soft-contact reference."""

import inspect
import json
import math
from types import SimpleNamespace

import numpy as np
import pytest
from scipy.stats import multivariate_normal

from identification import Experiment
from identification.cli.app import main
from identification.diagnosis.next_experiment.design import FORMAT, _read_request
from identification.diagnosis.next_experiment.design_report import check_folder
from identification.diagnosis.next_experiment.expected_information import _lambda_gradient, advise_on_lambda
from identification.diagnosis.next_experiment.planned_run import (
    Instrument,
    LinearizedRun,
    PlannedRun,
    Setting,
    expected_log_bayes,
)
from identification.diagnosis.selection.fit_cache import FitCache
from identification.diagnosis.selection.searcher import Searcher
from identification.inference.fit_result import with_known_noise
from identification.storage.schema import check_schema
from identification.storage.stamps import write_results
from studies.diagnosis.study import fit_near
from tests.reference.laboratory import record, write_experiment
from tests.reference.soft_contact import SoftCradle
from tests.synthetic import fit_with

TRUTH = {"k_f": 18000.0, "kappa": 190.0, "b": 0.002}
STATED = {"k_f": 17000.0, "kappa": 187.0, "b": 0.0023}


def soft(bobs, hidden) -> SoftCradle:
    return SoftCradle(bobs, stiffness_factor=1e4, effects=hidden, **TRUTH)


def written(folder, hidden):
    return write_experiment(folder, [record(soft(2, hidden), {2: 0.228}, duration=16.0, seed=4)], stated=STATED)


def fitted(path, *names):
    """The model as stated, or with an effect each, fitted to all of an experiment from where the truth is."""
    searcher = Searcher(FitCache(None, ""), 0, 1)
    base = fit_near(searcher, with_known_noise(Experiment.load(path)), TRUTH)
    models = [fit_with(searcher, base, name) for name in names] or [base]
    return [searcher.fit_all_data(model) for model in models]


@pytest.fixture(scope="module")
def plain(tmp_path_factory):
    return written(tmp_path_factory.mktemp("plain"), {})


@pytest.fixture(scope="module")
def heavy(tmp_path_factory):
    return written(tmp_path_factory.mktemp("heavy"), {"added_mass": {"mass": 2e-3}})


@pytest.fixture(scope="module")
def dragged(tmp_path_factory):
    return written(tmp_path_factory.mktemp("dragged"), {"quadratic_drag": {"c2": 0.02}})


def test_expected_log_bayes_of_normal_predictions():
    """Against draws: each view predicts N(f, 1 + S C Sᵀ)."""
    rng = np.random.default_rng(0)
    views = [
        LinearizedRun(
            ["a", "b"], np.zeros(6), rng.normal(size=6), rng.normal(size=(6, 2)), np.diag(rng.uniform(0.5, 3.0, 2))
        )
        for _ in range(2)
    ]
    normals = [multivariate_normal(v.model, np.eye(6) + v.S @ np.linalg.inv(v.precision) @ v.S.T) for v in views]
    drawn = normals[0].rvs(20000, random_state=1)
    ratios = normals[0].logpdf(drawn) - normals[1].logpdf(drawn)
    one, other = (SimpleNamespace(linearized=view) for view in views)
    assert expected_log_bayes(one, other, 1.0) == pytest.approx(
        ratios.mean(), abs=4.0 * ratios.std() / math.sqrt(20000)
    )
    assert expected_log_bayes(one, one, 1.0) == pytest.approx(0.0, abs=1e-12)


def test_one_bob_tells_nothing_of_impacts(plain, small_grid):
    """λ stays as uncertain as k_f leaves it when all else is known, var ≥ g² var(k_f | the rest)."""
    (model,) = fitted(plain)
    advice = advise_on_lambda(model)
    gains = {bobs: max(p.predicted for p in advice.plans if p.bobs == bobs) for bobs in (1, 2)}
    gradient, names = _lambda_gradient(model), model.likelihood.names
    own = [i for i, name in enumerate(names) if "@" not in name]
    C, g = model.covariance[np.ix_(own, own)], np.array([gradient[names[i]] for i in own])
    floor = g[0] ** 2 / np.linalg.inv(C)[0, 0]
    assert names[own[0]] == "k_f"
    assert 0.0 < gains[1] <= 0.5 * math.log((g @ C @ g) / floor) < gains[2]


def test_chaos_is_not_followed(plain):
    """With gaps of 0.4 mm and large swings an impact comes, or does not, by what is not known."""
    (model,) = fitted(plain)
    instrument = Instrument.of(model)
    calm, wild = (
        PlannedRun(model, instrument.run(Setting(2, 1, angle, delta), 60.0)).predictable_duration
        for angle, delta in ((0.2, 0.0), (0.8, 0.01))
    )
    assert calm == math.inf and wild < 60.0


def test_old_data_count_as_in_a_joint_fit(plain):
    """The prior of a planned run is the posterior of the old one: a tenth of its width, not of the stated bounds."""
    (model,) = fitted(plain)
    planned = PlannedRun(model, Instrument.of(model).run(Setting(2, 1, 0.2, 0.0), 8.0))
    k, old = planned.names.index("k_f"), model.likelihood.names.index("k_f")
    assert np.linalg.inv(planned.precision)[k, k] == pytest.approx(model.covariance[old, old], rel=1e-6)
    error = planned.names.index("release_angle_error@1")
    assert planned.precision[error, error] == pytest.approx(1e6)  # of the new release, 1 mrad, whatever the old one was
    assert planned.precision[error, k] == 0.0


def test_exact_symmetries_are_told(heavy, small_grid, tmp_path, capsys):
    """Added mass is a slow clock with other damping, in any run of any number of these bobs."""
    arguments = ["--between", "added_mass", "--between", "clock_scale", "--workers", "1"]
    assert main(["design", str(heavy), "--out", str(tmp_path), *arguments]) == 0
    assert "No experiment of this kind separates added_mass and clock_scale" in capsys.readouterr().out
    content = json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))
    check_schema(content, "design", "design.json")
    assert content["inseparable"] == [[["added_mass"], ["clock_scale"]]] and content["separates"] == []
    assert content["release"] is None and abs(content["expected_log_bayes"]) < 0.1
    assert "film a clock" in (tmp_path / "report.html").read_text(encoding="utf-8")
    assert not (tmp_path / "experiment.toml").exists()


@pytest.mark.slow
def test_the_recommended_run_tells_what_was_expected(dragged, small_grid, tmp_path):
    """The run is made by the reference, quadratic drag being true, with noise drawn several times: within a factor of
    two, for what one set of old data happens to favour."""
    names = ["quadratic_drag", "pivot_friction"]
    assert main(["design", str(dragged), "--out", str(tmp_path), "--workers", "1",
                 *(word for name in names for word in ("--between", name))]) == 0  # fmt: skip
    content = json.loads((tmp_path / "design.json").read_text(encoding="utf-8"))
    assert content["format"] == "cradle-design/1" and content["inputs"] == Experiment.load(dragged).digest
    assert content["separates"] == [[name] for name in names] and content["inseparable"] == []
    best = content["plans"][0]
    setting = Setting(best["bobs"], best["release"]["bobs"], best["release"]["angle"], best["delta"])
    models = fitted(dragged, *names)
    run = Instrument.of(models[0]).run(setting, best["duration"])
    planned = [PlannedRun(model, run) for model in models]
    cradle = soft(setting.bobs, {"quadratic_drag": {"c2": 0.02}})
    told = []
    for seed in range(9, 17):
        recorded = record(cradle, {setting.bobs: setting.angle}, duration=best["duration"], seed=seed)
        drag, friction = (model.with_readings(recorded.readings).log_evidence({}) for model in planned)
        told.append(drag - friction)
    assert min(told) > 3.0
    assert 0.5 < np.mean(told) / best["simulated"] < 2.0
    page = (tmp_path / "report.html").read_text(encoding="utf-8")
    assert page.count("data:image/png;base64,") == 1 and "http" not in page.replace("http-equiv", "")
    write_experiment(tmp_path / "other", [recorded])
    (tmp_path / "run1.csv").write_bytes((tmp_path / "other" / "run1.csv").read_bytes())
    again = Experiment.load(tmp_path / "experiment.toml")
    assert again.runs[0].release.release.angle == setting.angle and again.cradle.bobs == setting.bobs


@pytest.mark.parametrize(
    "arguments, words",
    [
        (["--between", "added_mass"], "name two models or more"),
        (["--between", "added_mas", "--between", "clock_scale"], "did you mean 'added_mass'"),
        (["--between", "large_angle", "--between", "clock_scale"], "in the model already"),
        (["--diagnosis", "nowhere"], "no such file"),
    ],
)
def test_refusals(plain, tmp_path, capsys, arguments, words):
    assert main(["design", str(plain), "--out", str(tmp_path), *arguments]) == 2
    message = capsys.readouterr().err
    assert message.count("\n") == 1 and words in message


def test_a_diagnosis_is_taken_over(plain, tmp_path, capsys):
    kept, out = tmp_path / "diagnosis", tmp_path / "out"
    kept.mkdir()
    found = {
        "format": "cradle-diagnosis/1", "steps": [{"effect": "quadratic_drag"}],
        "equivalent": [["added_mass"], ["length_mismatch"]],
        "alike": [], "taken_out": ["radial_elasticity", "string_hysteresis"],
    }  # fmt: skip
    digest = Experiment.load(plain).digest
    (kept / "diagnosis.json").write_text(json.dumps(found | {"inputs": digest}), encoding="utf-8")
    asked = _read_request(Experiment.load(plain), (), kept)
    assert asked.certain == ("quadratic_drag",) and asked.sets == (("added_mass",), ("length_mismatch",))
    assert "length_mismatch" in asked.each and asked.model.digest == digest
    assert not asked.model.cradle.has("radial_elasticity") and not asked.model.cradle.has("string_hysteresis")
    with pytest.raises(ValueError, match="alone"):  # the same twice
        _read_request(Experiment.load(plain), ("added_mass+clock_scale", "clock_scale+added_mass+added_mass"), None)
    for folder, text, words in (
        (kept, json.dumps(found | {"inputs": digest}), "would be lost"),
        (out, json.dumps(found | {"inputs": "other"}), "of another experiment"),
        (out, "[]", "not a diagnosis"),
    ):
        (kept / "diagnosis.json").write_text(text, encoding="utf-8")
        assert main(["design", str(plain), "--out", str(folder), "--diagnosis", str(kept)]) == 2
        assert words in capsys.readouterr().err


def test_a_plan_that_was_corrected_is_not_replaced(tmp_path):
    (tmp_path / "experiment.toml").write_text("planned", encoding="utf-8")
    with pytest.raises(ValueError, match="no result of this command"):
        check_folder(tmp_path)  # it may be of the data
    write_results(tmp_path, {"experiment.toml": "planned"}, "design.json", {"format": FORMAT})
    check_folder(tmp_path)
    (tmp_path / "experiment.toml").write_text("planned, and corrected", encoding="utf-8")
    with pytest.raises(ValueError, match="no result of this command"):
        check_folder(tmp_path)


@pytest.mark.parametrize(
    ("command", "left"), [("calibrate", "diagnosis.json"), ("diagnose", "posterior.nc"), ("design", "posterior.nc")]
)
def test_no_command_replaces_the_report_of_another(plain, tmp_path, capsys, command, left):
    (tmp_path / left).write_text("", encoding="utf-8")
    assert main([command, str(plain), "--out", str(tmp_path)]) == 2
    assert "which would be lost; choose another --out" in capsys.readouterr().err
    assert [file.name for file in tmp_path.iterdir()] == [left]


def test_diagnose_is_a_function_whatever_was_imported_before(tmp_path):
    import identification

    assert inspect.isfunction(identification.diagnose)
    with pytest.raises(ValueError, match="no such file"):
        identification.diagnose(Experiment.load(tmp_path / "none.toml"))
