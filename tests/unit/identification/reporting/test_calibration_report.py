"""The report and the pictures: drawn for any experiment, and saying first whether to trust them."""

import dataclasses
import html.parser
import json
import re
import subprocess
import sys

import numpy as np
import pytest

from cradle_env import Cradle, Release
from cradle_env.plot_style import png
from identification.cli.commands import _format_parameter
from identification.experiment.experiment import Experiment
from identification.experiment.run import Prior, ReleaseInfo, Run
from identification.inference import posterior_plots, prediction_plots
from identification.inference.gap import Gap
from identification.inference.posterior import Posterior
from identification.inference.statistics import statistics
from identification.number_format import (
    Rounding,
    format_estimate,
    format_statistics,
    markup,
    mathtext,
    unit_markup,
    unit_plain,
)
from identification.reporting import result_files
from identification.storage.files import write_json
from tests.synthetic import made_up_posterior, simulated_run


def experiment(kind: str) -> Experiment:
    if kind == "two bobs, some held out":
        cradle = Cradle(bobs=2)
        return Experiment(cradle, (simulated_run(cradle, duration=8.0, fit_to=5.0),))
    if kind == "one bob":
        cradle = Cradle(bobs=1, model="pendulum")
        return Experiment(cradle, (simulated_run(cradle, duration=8.0),))
    if kind == "three bobs in mm, one unseen, two runs":
        cradle = Cradle(bobs=3)
        first = simulated_run(cradle, duration=6.0, quantity="x", unit="mm", scale=1e-3, file="a.csv", rest="free")
        first.readings[:, 1] = np.nan
        return Experiment(cradle, (first, simulated_run(cradle, duration=6.0, file="b.csv")))
    cradle = Cradle(bobs=2)
    return Experiment(cradle, (simulated_run(cradle, duration=8.0, state="free", fit_from=2.0, noise=1e-3),))


KINDS = ("two bobs, some held out", "one bob", "three bobs in mm, one unseen, two runs", "free initial state")


class Page(html.parser.HTMLParser):
    """Tags opened and closed, images and their texts."""

    def __init__(self, text: str):
        super().__init__()
        self.open, self.images, self.links = [], [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        attributes = dict(attrs)
        if tag == "img":
            self.images.append(attributes)
        if tag not in ("img", "meta", "br", "link"):
            self.open.append(tag)
        self.links += [value for key, value in attrs if key in ("href", "src") and not value.startswith("data:")]

    def handle_endtag(self, tag):
        assert self.open.pop() == tag


@pytest.mark.parametrize(
    "kind", [KINDS[1], KINDS[3], *(pytest.param(kind, marks=pytest.mark.slow) for kind in (KINDS[0], KINDS[2]))]
)
def test_pictures_and_report_of_any_experiment(kind, tmp_path, monkeypatch):
    monkeypatch.setattr(Posterior.newton_exponent, "__defaults__", (8,))  # draws for a λ that did not come along
    posterior = made_up_posterior(experiment(kind), steps=20)
    summary = result_files.save_calibration(posterior, tmp_path)
    page = Page((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert page.open == [] and page.links == []
    assert len(page.images) == (3 if kind == "one bob" else 4)
    assert all(image["alt"] and image["src"].startswith("data:image/png;base64,") for image in page.images)
    assert json.loads((tmp_path / "summary.json").read_text())["format"] == summary["format"] == "cradle-posterior/1"
    assert not [path for path in tmp_path.iterdir() if path.name.endswith(".part")]


def test_bobs_that_were_lifted_alike_have_no_exponent(tmp_path):
    cradle, release = Cradle(bobs=2), ReleaseInfo(Release(angle=0.2, bobs=2))
    posterior = made_up_posterior(Experiment(cradle, (simulated_run(cradle, duration=4.0, release=release),)), steps=20)
    assert result_files.save_calibration(posterior, tmp_path)["lambda"] is None
    assert not (tmp_path / "lambda.png").exists()
    with pytest.raises(ValueError, match="all 2 bobs are lifted alike"):
        posterior.predict()


@pytest.mark.parametrize(
    ("stated", "asked", "let_go"),
    [
        (Release(angles={1: -0.2}), {"release_angle": 0.1}, Release(angles={1: -0.1})),
        (Release(angles={1: -0.2}), {"bobs": 5}, Release(angles={1: -0.2})),
        (Release(angles={1: -0.2, 3: 0.1}), {"release_angle": 0.05}, Release(angles={1: -0.1, 3: 0.05})),
        (Release(angles={1: -0.2, 3: 0.1}), {"bobs": 5}, r"bobs is 5, but .* names bob 3 of 3; predict for 3 bobs"),
        (Release(angles={1: -0.2, 2: -0.2}), {"bobs": 1}, r"bobs is 1, but .* names bob 2 of 3; predict for 3 bobs"),
        (Release(angles={2: 0.2, 3: 0.2}), {"bobs": 5}, Release(angle=0.2, bobs=2)),
        (Release(angle=0.2, bobs=2), {"bobs": 5, "release_angle": 0.1}, Release(angle=0.1, bobs=2)),
    ],
)
def test_a_prediction_lets_go_of_the_bobs_that_were_let_go(stated, asked, let_go):
    """A cradle with unequal gaps has another λ where the other end is lifted."""
    cradle = Cradle(bobs=3, delta=(0.0, 0.01))
    run = Run(np.arange(3.0), np.zeros((3, 3)), release=ReleaseInfo(stated), delta=cradle.delta, noise=1e-3)
    posterior = made_up_posterior(Experiment(cradle, (run,)), steps=20)
    if isinstance(let_go, str):
        with pytest.raises(ValueError, match=let_go):
            posterior.predict(**asked, count=1, duration=3.0)
    else:
        assert posterior.predict(**asked, count=1, duration=3.0).release == let_go


@pytest.mark.parametrize(("bobs", "asked"), [(2, None), (3, None), (2, 0.001)])
def test_an_inferred_delta_is_told_by_its_median(bobs, asked):
    """One draw's δ is a random number; a δ that is asked for has no spread."""
    cradle, prior = Cradle(bobs=bobs), {"delta": Prior(mean=-0.003, sd=1e-3)}
    posterior = made_up_posterior(Experiment(cradle, (simulated_run(cradle, duration=2.0),), infer=prior), steps=20)
    prediction = posterior.predict(asked, count=9, duration=3.0)
    drawn = [posterior.likelihood.values(point)["delta"] for point in posterior.draws(9)]
    assert prediction.cradle.delta == (np.median(drawn) if asked is None else asked)
    title = prediction_plots.prediction_figure(prediction).axes[1].get_title(loc="left")
    told = "δ = 0.001, " if asked else format_statistics(statistics(np.array(drawn)))["median"] + " ± "
    assert told in title


@pytest.mark.parametrize(
    ("gap", "converged"), [(1.02, True), (3.1, True), (1.02, False), pytest.param(3.1, False, marks=pytest.mark.slow)]
)
def test_the_report_says_first_whether_to_trust_it(gap, converged, tmp_path):
    posterior = made_up_posterior(experiment("one bob"), converged=converged, gap=Gap(1.0, gap))
    result_files.save_calibration(posterior, tmp_path)
    text = (tmp_path / "report.html").read_text(encoding="utf-8")
    words = re.sub(r"<style>.*?</style>|<[^>]+>", " ", text, flags=re.DOTALL)
    first = words[: words.index("Parameters")]
    assert ("The chains have not converged" in first) is not converged
    assert ("The model does not describe these data" in first) is (gap > 2.0)
    assert ("The intervals must not be trusted" in first) is (gap > 2.0)
    assert ("R̂ = 1.0700, wanted below 1.01" in first) is not converged


def test_the_report_tells_of_correlated_readings(tmp_path):
    posterior = made_up_posterior(experiment("one bob"))
    for inflation, told in ((1.0, False), (1.857, True)):
        likelihood = posterior.likelihood.with_noise(posterior.likelihood.noise_model.with_inflations([inflation]))
        result_files.save_calibration(dataclasses.replace(posterior, likelihood=likelihood), tmp_path)
        text = (tmp_path / "report.html").read_text(encoding="utf-8")
        assert ("are correlated: 1.9 readings count" in text) is told
    assert json.loads((tmp_path / "summary.json").read_text())["noise_inflation"] == [1.857]


def test_pictures_are_the_same_each_time_and_leave_matplotlib_alone():
    import matplotlib

    before = dict(matplotlib.rcParams)
    posterior = made_up_posterior(experiment("one bob"))
    assert png(posterior_plots.residual_figure(posterior)) == png(posterior_plots.residual_figure(posterior))
    assert dict(matplotlib.rcParams) == before


def test_drawing_does_not_load_pyplot():
    """It would take 0.7 s of each command that draws."""
    code = """
import sys
from matplotlib.figure import Figure
from cradle_env.plot_style import png
png(Figure())
sys.exit("matplotlib.pyplot" in sys.modules)
"""
    subprocess.run([sys.executable, "-c", code], check=True)


def test_json_knows_no_nan(tmp_path):
    path = write_json(tmp_path / "deep" / "a.json", {"a": np.nan, "b": [np.float64(1.5), np.inf], "c": np.int64(2)})
    assert json.loads(path.read_text()) == {"a": None, "b": [1.5, None], "c": 2}


@pytest.mark.parametrize(
    ("value", "sd", "text", "exponent"),
    [
        (18012.34, 23.4, "18012", 0),
        (196.6098, 0.0123, "196.610", 0),
        (0.0020131, 4.1e-6, "2.0131", -3),
        (2.0e11, 3.0e9, "200.0", 9),
        (-3.2e-4, 1.0e-4, "−320", -6),
        (0.0, 0.0, "0.0000", 0),
        (0.0597, 9.97e-5, "0.05970", 0),
        (3.0e-6, 1.2e-3, "0.0", -3),
        (-2.0e-5, 0.05, "0.000", 0),
    ],
)
def test_numbers_are_rounded_to_their_uncertainty(value, sd, text, exponent):
    rounding = Rounding.of(value, sd)
    assert (rounding.text(value), rounding.exponent) == (text, exponent)


def test_missing_numbers_are_dashes():
    assert format_statistics({"median": None, "sd": None, "ci68": [None, None], "ci95": [None, None]})["median"] == "–"


def test_symbols_and_units():
    assert mathtext("k_f") == r"$k_{\mathrm{f}}$"
    assert mathtext("c₂") == r"$c_{\mathrm{2}}$"
    assert markup("τ_c") == "<i>τ</i><sub>c</sub>"
    assert markup("<b>") == "<i>&lt;b&gt;</i>"
    assert unit_markup("N s m^-3/2") == "N s m<sup>−3/2</sup>"
    assert unit_markup("1") == ""
    assert unit_plain("kg/s", -3) == "10⁻³ kg/s"


@pytest.mark.parametrize(
    ("median", "ci95", "texts"),
    [
        (17852.9, (17766.2, 18016.2), ("17853", "17766 to 18016", 0)),
        (2.448, (0.01026, 5.0), ("2.4", "0.010 to 5.0", 0)),  # not 0.0 to 5.0
        (0.00695, (0.0, 2.0), ("0.0069", "0 to 2.0", 0)),
        (4e-6, (0.0, 12e-6), ("4.0", "0 to 12", -6)),
        (-2e-4, (-3e-4, -1e-4), ("−200", "−300 to −100", -6)),
    ],
)
def test_an_interval_of_more_than_a_decade_has_two_digits_at_each_end(median, ci95, texts):
    assert format_estimate(median, ci95) == texts


def test_the_command_line_says_how_well_a_parameter_is_known():
    assert _format_parameter({"median": 13.0, "ci95": [9.16, 200.0]}, "Hz") == "13 (9.2 to 200) Hz"
    assert _format_parameter({"median": 0.0069, "ci95": [0.0, 2.0]}, "1") == "0.0069 (0 to 2.0)"
    gaps = {"median": [0.002, 0.003], "ci95": [[0.0019, 0.0021], [0.0028, 0.0032]]}
    assert _format_parameter(gaps, "m") == "[2.000 (1.900 to 2.100) 10⁻³ m, 3.00 (2.80 to 3.20) 10⁻³ m]"
