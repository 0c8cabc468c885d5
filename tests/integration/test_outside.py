"""What comes from outside, files, numbers, signals, other processes, may neither write, hang nor trace back."""

import html.parser
import json
import os
import re
import resource
import signal
import subprocess
import sys
import threading
import time
import warnings

import gymnasium
import h5py
import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate
from cradle_env.model_files import read_model
from cradle_env.model_files import read_posterior as read_draws
from cradle_env.threads import Threads
from identification.cli.app import main
from identification.experiment.experiment import Experiment
from identification.inference.checkpoint import Checkpoint
from identification.inference.mcmc import Sampler
from identification.inference.posterior import Posterior
from identification.reporting import result_files
from identification.storage.files import ExperimentError
from identification.storage.lock import lock_folder
from identification.storage.stamps import check_replaceable, write_results
from identification.sweep import Grid, sweep
from studies.fuzz import cradles
from tests.paths import ROOT
from tests.synthetic import made_up_posterior, simulated_run
from tests.unit.identification.inference.test_mcmc import Gaussian


@pytest.fixture
def saved(tmp_path):
    """A sound posterior.nc in a folder of its own."""
    cradle = Cradle(bobs=2)
    posterior = made_up_posterior(Experiment(cradle, (simulated_run(cradle, duration=4.0),)), steps=10)
    (tmp_path / "posterior").mkdir()
    return posterior.save(tmp_path / "posterior" / "posterior.nc")


def files_below(folder):
    return sorted(str(path) for path in folder.rglob("*"))


def bend(path, name, value=None):
    """Sets an attribute of the group posterior, or takes it out."""
    with h5py.File(path, "a") as file:
        del file["posterior"].attrs[name]
        if value is not None:
            file["posterior"].attrs[name] = value


# Paths


@pytest.mark.parametrize("name", ["../escaped.csv", "/tmp/escaped.csv", "sub/escaped.csv", "sub\\escaped.csv", ".."])
def test_a_posterior_writes_no_file(saved, tmp_path, name):
    assert Posterior.load(saved).chain.shape[-1] > 0
    with h5py.File(saved) as file:
        texts = json.loads(file["posterior"].attrs["experiment"])
    bend(saved, "experiment", json.dumps({**texts, name: "written"}))
    before = files_below(tmp_path)
    with pytest.raises(ExperimentError, match=r"posterior\.experiment: .*a file name without a folder"):
        Posterior.load(saved)
    assert files_below(tmp_path) == before


@pytest.mark.parametrize("way", ["external link", "soft link", "virtual", "external data", "huge"])
def test_numbers_come_from_the_file_itself(saved, tmp_path, way):
    secret = tmp_path / "secret.h5"
    with h5py.File(secret, "w") as file:
        file["kappa"] = np.ones((2, 160))
    with h5py.File(saved, "a") as file:
        shape = file["posterior/kappa"].shape
        del file["posterior/kappa"]
        if way == "external link":
            file["posterior/kappa"] = h5py.ExternalLink(str(secret), "/kappa")
        elif way == "soft link":
            file["posterior/kappa"] = h5py.SoftLink("/posterior/k_f")
        elif way == "virtual":
            layout = h5py.VirtualLayout(shape, "f8")
            layout[:] = h5py.VirtualSource(str(secret), "kappa", shape)
            file["posterior"].create_virtual_dataset("kappa", layout)
        elif way == "external data":
            file["posterior"].create_dataset("kappa", shape, "f8", external=[(str(secret), 0, h5py.h5f.UNLIMITED)])
        else:
            file["posterior"].create_dataset("kappa", (2**20, 2**20), "f8", chunks=(1024, 1024))
    for read in (Posterior.load, read_draws):
        with pytest.raises(ValueError, match=r"kappa (is a link|takes its numbers from another file|has shape)"):
            read(saved)


def test_a_stamp_lists_no_file_of_another_folder(tmp_path):
    """Or a prepared figure.json would have `reproduce` remove it."""
    (tmp_path / "figure.json").write_text('{"format": "f/1", "files": {"../mine.txt": "0"}}', encoding="utf-8")
    with pytest.raises(ExperimentError, match="no result of this command"):
        check_replaceable(tmp_path, ("figure.json",), "figure.json", "f/1")


def test_rows_of_a_sweep_are_not_written_through_a_link(tmp_path):
    grid, mine = Grid({"beta": [0.1, 0.2]}, Cradle(bobs=2), Release(0.2)), tmp_path / "mine.npy"
    sweep(grid, duration=2.0, out=tmp_path / "out", workers=1)
    (tmp_path / "out" / "runs.npy").rename(mine)
    (tmp_path / "out" / "runs.npy").symlink_to(mine)
    with pytest.raises(ValueError, match=r"runs\.npy is a link"):
        sweep(grid, duration=2.0, out=tmp_path / "out", workers=1)


# Schemas

ATTRIBUTES = ("format", "walkers", "seed", "experiment", "inputs", "convergence", "gap", "inflations")


@pytest.mark.parametrize("name", ATTRIBUTES)
@pytest.mark.parametrize("value", [None, "text", -1, [1.0, 2.0, 3.0], '{"a": 1}', h5py.Empty("f8")])
def test_a_posterior_without_what_it_should_hold_is_refused_by_field(saved, name, value):
    bend(saved, name, value)
    with pytest.raises(ExperimentError, match=rf"posterior\.nc: posterior(: |\.){name}\b") as refused:
        Posterior.load(saved)
    assert "\n" not in str(refused.value)


@pytest.mark.parametrize("name", ["kappa", "chain"])
def test_a_posterior_whose_draws_do_not_match_is_refused(saved, name):
    with h5py.File(saved, "a") as file:
        del file[f"posterior/{name}"]
        file[f"posterior/{name}"] = np.ones((2, 7))
    if name == "chain":  # a coordinate, which nothing is read from
        Posterior.load(saved)
    else:
        with pytest.raises(ExperimentError, match=r"posterior/kappa has shape \(2, 7\); expected"):
            Posterior.load(saved)


def test_plans_of_sweeps_are_checked(tmp_path):
    grid = Grid({"beta": [0.1, 0.2]}, Cradle(bobs=2), Release(0.2))
    sweep(grid, duration=2.0, out=tmp_path, workers=1)
    plan = tmp_path / "plan.json"
    content = json.loads(plan.read_text(encoding="utf-8"))
    for bent, words in (
        ({k: v for k, v in content.items() if k != "reasons"}, "reasons is missing"),
        (content | {"reasons": [[1.5, "no"]]}, r"reasons\[0\]\[0\] is 1\.5; expected a whole number"),
        ([], r"the content is \[\]"),
    ):
        plan.write_text(json.dumps(bent), encoding="utf-8")
        with pytest.raises(ValueError, match=rf"plan\.json: {words}"):
            sweep(grid, duration=2.0, out=tmp_path, workers=1)
    plan.write_text("[" * 100_000, encoding="utf-8")
    with pytest.raises(ValueError, match=r"plan\.json: not valid JSON"):
        sweep(grid, duration=2.0, out=tmp_path, workers=1)


# Full disks


def limited(arguments, folder, blocks):
    """A command that may write no file larger than so many kilobytes, as on a disk that is full."""
    limit = lambda: (  # noqa: E731
        signal.signal(signal.SIGXFSZ, signal.SIG_IGN),
        resource.setrlimit(resource.RLIMIT_FSIZE, (1024 * blocks, 1024 * blocks)),
    )
    command = [sys.executable, "-m", "identification", *arguments]
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    run = subprocess.run(command, cwd=folder, env=environment, preexec_fn=limit, capture_output=True, text=True)
    return run.returncode, run.stderr


def test_a_full_disk_is_told_in_a_line_and_left_behind(tmp_path, monkeypatch):
    arguments = ["sweep", "--over", "beta=0.1:0.3:150", "--bobs", "1", "--quantity", "impacts", "--duration", "0.5"]
    arguments += ["--out", "out"]
    status, said = limited(arguments, tmp_path, 1)
    assert status == 1 and said.count("\n") == 1, said
    assert "no space left in out" in said and "the same command goes on" in said
    monkeypatch.chdir(tmp_path)
    assert main(arguments) == 0
    assert not [path for path in (tmp_path / "out").iterdir() if path.name.startswith(".")]


def test_a_checkpoint_that_has_no_room_keeps_the_last(tmp_path):
    program = f"""
import resource, signal, sys
sys.path[:0] = [{str(ROOT)!r}]
import numpy as np
from tests.unit.identification.inference.test_mcmc import chains
from pathlib import Path
folder = Path({str(tmp_path)!r})
chains(folder, 60)
signal.signal(signal.SIGXFSZ, signal.SIG_IGN)
size = (folder / "chain.h5").stat().st_size
resource.setrlimit(resource.RLIMIT_FSIZE, (size, size))
try:
    chains(folder, 500)
except OSError as problem:
    print(problem.strerror)
"""
    run = subprocess.run([sys.executable, "-c", program], capture_output=True, text=True)
    assert run.stdout.strip() == "File too large" and run.stderr == ""
    checkpoint = Checkpoint(tmp_path / "chain.h5", Gaussian(), 3)
    assert checkpoint.exists() and checkpoint.steps() >= 60
    assert [path.name for path in tmp_path.iterdir()] == ["chain.h5"]


# Two processes, and killed ones


def test_one_process_works_in_a_folder(tmp_path):
    folder, said = tmp_path / "out", []

    def second():
        try:
            with lock_folder(folder):
                said.append("in")
        except ExperimentError as refused:
            said.append(str(refused))

    with lock_folder(folder), lock_folder(folder):  # the same thread may
        threads = [threading.Thread(target=second)]
        threads[0].start()
        threads[0].join()
        (folder / "kept.txt").write_text("")
    assert f"process {os.getpid()} on" in said[0] and "works there; wait for it, or choose another --out" in said[0]
    second()
    assert said[1] == "in" and [path.name for path in folder.iterdir()] == ["kept.txt"]


def test_the_lock_of_a_dead_process_is_taken_over(tmp_path):
    program = f"""
import os, sys
sys.path[:0] = [{str(ROOT)!r}]
from pathlib import Path
from identification.storage.lock import lock_folder
with lock_folder(Path({str(tmp_path / "out")!r})):
    os._exit(9)
"""
    assert subprocess.run([sys.executable, "-c", program]).returncode == 9
    assert (tmp_path / "out" / ".cradle.lock").exists()
    with lock_folder(tmp_path / "out"):
        pass


@pytest.mark.parametrize("renames", range(5))
def test_killed_between_the_last_renames_it_goes_on(tmp_path, renames):
    """Three files, the stamp, and before them what is about to be written."""
    program = f"""
import os, sys
sys.path[:0] = [{str(ROOT)!r}]
from pathlib import Path
from identification.storage.stamps import write_results
left = {renames}
def counted(rename):
    def renamed(*arguments):
        global left
        if left == 0:
            os._exit(9)
        left -= 1
        return rename(*arguments)
    return renamed
Path.replace, os.replace = counted(Path.replace), counted(os.replace)
write_results(Path({str(tmp_path)!r}), dict.fromkeys("abc", "new"), "stamp.json", {{"format": "f/1"}})
"""
    assert subprocess.run([sys.executable, "-c", program]).returncode == 9
    check_replaceable(tmp_path, [*"abc", "stamp.json"], "stamp.json", "f/1")
    write_results(tmp_path, dict.fromkeys("abc", "again"), "stamp.json", {"format": "f/1"})
    assert sorted(path.name for path in tmp_path.iterdir()) == ["a", "b", "c", "stamp.json"]
    (tmp_path / "a").write_text("mine")
    with pytest.raises(ExperimentError, match="no result of this command"):
        check_replaceable(tmp_path, [*"abc", "stamp.json"], "stamp.json", "f/1")


def test_an_interruption_while_sampling_prints_nothing(capfd):
    class Interrupted(Gaussian):
        def log_densities(self, points):
            raise KeyboardInterrupt

    with pytest.raises(KeyboardInterrupt):
        Sampler(Interrupted(), 16).run_mcmc(np.random.default_rng(0).standard_normal((16, 2)), 5)
    assert capfd.readouterr().err == ""


# Numbers that hang or overflow


def test_a_long_run_hears_an_interruption_within_a_second():
    cradle = Cradle(bobs=200, effects={"group_drag": {"slope": 0.1, "range": 0.005}})
    heard = []
    simulate(cradle, Release(0.2), 0.1)  # compiled: while kernels load, an interruption can get lost
    # A job in the background of a shell begins with SIGINT ignored, and hears none.
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        threading.Timer(1.0, lambda: (heard.append(time.monotonic()), os.kill(os.getpid(), signal.SIGINT))).start()
        with pytest.raises(KeyboardInterrupt):
            simulate(cradle, Release(0.2), 10_000.0, 1.0)
    finally:
        signal.signal(signal.SIGINT, before)
    assert time.monotonic() - heard[0] < 1.5  # a second, and half of one for a machine under load


def test_threads_stop_their_runs(tmp_path):
    began = time.monotonic()
    with pytest.raises(ZeroDivisionError), Threads(2) as pool:
        for _ in range(4):
            pool.submit(simulate, Cradle(bobs=200), Release(0.2), 20_000.0, 1.0)
        time.sleep(0.5)
        raise ZeroDivisionError
    assert time.monotonic() - began < 3.0


def test_what_takes_too_long_is_refused_before_it_begins(tmp_path):
    with pytest.raises(ValueError, match=r"1e\+09 s of this cradle takes .* steps .* days; .* at most 1e\+09"):
        simulate(Cradle(), Release(0.2), 1e9, 1e-6)
    with pytest.raises(ValueError, match="samples times bobs"):
        simulate(Cradle(bobs=200), Release(0.2), 100.0, 1e4)
    with pytest.raises(ValueError, match="give a shorter control_interval"):
        gymnasium.make("NewtonCradle-v0", bobs=200, control_interval=50.0, duration=60.0).reset()


@pytest.mark.parametrize("last", [1.7e9, 1e9, 1e6])
def test_clocks_that_do_not_begin_at_the_release_are_refused(last):
    cradle = Cradle(bobs=2)
    run = simulated_run(cradle, duration=4.0)
    times = run.times.copy()
    times[-1] = last
    with pytest.raises(ValueError, match="count t from the release, not from 1970"):
        Experiment.from_arrays(cradle, times, run.readings, Release(0.228))


def test_the_smallest_numbers_overflow_nowhere():
    with warnings.catch_warnings():
        warnings.simplefilter("error")
        slow, none = (simulate(Cradle(bobs=2, b=b), Release(0.2), 1.0).theta for b in (1e-320, 0.0))
    np.testing.assert_allclose(slow, none, rtol=0, atol=1e-12)


@pytest.mark.parametrize("text", ["a" + ".a" * 30_000 + " = 1", "[" + "a." * 30_000 + "a]", "[" * 5000, "x" * 2**21])
def test_deep_or_long_descriptions_are_refused_at_once(tmp_path, text):
    path = tmp_path / "experiment.toml"
    path.write_text(text, encoding="utf-8")
    began = time.monotonic()
    for read in (Experiment.load, read_model):
        with pytest.raises(ValueError, match=r"experiment\.toml"):
            read(path)
    assert time.monotonic() - began < 2.0


def test_bobs_in_a_row_that_rounding_would_hide_are_refused():
    with pytest.raises(ValueError, match="rounding hides the motion"):
        Cradle(bobs=3, radius=1e7)
    with pytest.raises(ValueError, match=r"pivot_half_spacing .* rounding hides the motion"):
        Cradle(pivot_half_spacing=1e6, kappa=200.0)


def test_overdamped_contacts_are_refused_before_they_diverge():
    """The energy ledger closes up to the bound on k_f; above it (at 3.4 times the bound) it gained 1e23 J."""
    followed = {"contact_duration": {"scale": 1.0}}
    with pytest.raises(ValueError, match=r"must be at most (.+?) N s") as refused:
        Cradle(bobs=2, k_f=1e11, effects=followed)
    most = float(re.findall(r"at most (\S+) N s", str(refused.value))[0])
    run = simulate(Cradle(bobs=2, k_f=0.99 * most, effects=followed), Release(0.5), 2.0)
    assert cradles.violations(run) == []
    assert Cradle(bobs=2, k_f=1e11).k_f == 1e11  # instantaneous impacts have no such bound


def test_random_cradles_obey_physics():
    """A few of the study's; and bobs that pass through each other are noticed."""
    for k in range(25):
        outcome = cradles.run_case(cradles.draw(np.random.default_rng([99, k])))
        assert outcome.kind != "broken", (k, outcome.text)
    run = simulate(Cradle(bobs=2), Release(0.228), 2.0)
    assert cradles.violations(run) == []
    run.theta[200:, 1] -= 0.1
    assert "overlap" in cradles.violations(run)[0]


# Words


@pytest.mark.parametrize("name", ["length", "bobs", "power_law", "mass"])
def test_errors_stay_on_one_line_whatever_they_show(name):
    with pytest.raises(ValueError) as refused:
        Cradle(**{name: np.zeros((9, 9))})
    assert "\n" not in str(refused.value) and len(str(refused.value)) < 200


class Danger(html.parser.HTMLParser):
    """Tags and attributes that no report of ours has."""

    def __init__(self, text):
        super().__init__()
        self.found, self.texts = [], []
        self.feed(text)

    def handle_starttag(self, tag, attrs):
        self.found += [tag] * (tag in ("script", "iframe", "object", "x")) + [a for a, _ in attrs if a[:2] == "on"]

    def handle_data(self, data):
        self.texts.append(data)


def test_names_from_outside_are_text_in_reports_and_pictures(tmp_path):
    name = "<script>alert(1)<x onload=1>&$\\frac{$_^.csv"
    cradle = Cradle(bobs=1, model="pendulum")
    runs = [simulated_run(cradle, duration=5.0, file=file) for file in (name, f"b{name}")]
    posterior = made_up_posterior(Experiment(cradle, tuple(runs)), steps=20)
    result_files.save_calibration(posterior, tmp_path)  # Matplotlib refuses mathtext that is none
    page = Danger((tmp_path / "report.html").read_text(encoding="utf-8"))
    assert page.found == []
    assert any("<script>alert(1)" in text for text in page.texts)
