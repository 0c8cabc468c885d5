"""Sweeps: the same runs as one by one, whoever runs them, whatever stops them."""

import dataclasses
import functools
import os
import signal
import subprocess
import sys
import threading
import time
from concurrent.futures import ProcessPoolExecutor, ThreadPoolExecutor
from multiprocessing import get_context

import numpy as np
import pytest

from cradle_env import Cradle, Release, simulate, simulate_batch
from cradle_env.effects import CATALOGUE, LEARNED, effect, register
from identification.storage.provenance import fingerprint
from identification.sweep import QUANTITIES, Grid, Quantity, sweep
from identification.sweep import engine as sweep_engine

PAIR, RELEASE = Cradle(bobs=2), Release(angle=0.228)


def counted(run) -> float:
    """The number of bobs: a quantity that other processes can find."""
    return float(run.cradle.bobs)


def test_values_are_those_of_single_runs_bit_for_bit():
    grid = Grid({"beta": [0.1, 0.2], "delta": [-0.01, 0.0, 0.002]}, PAIR, RELEASE)
    swept = sweep(grid, ("lambda", "sigma", "impacts"), duration=8.0, times=[0.0, 2.5, 8.0])
    for i, beta in enumerate((0.1, 0.2)):
        for j, delta in enumerate((-0.01, 0.0, 0.002)):
            run = simulate(Cradle.from_groups(bobs=2, beta=beta, delta=delta), RELEASE, 8.0)
            assert swept["lambda"][i, j] == run.newton_exponent()
            assert swept["impacts"][i, j] == len(run.impacts)
            np.testing.assert_array_equal(swept["sigma"][i, j], run.sigma()[[0, 600, 1920]])


@pytest.mark.parametrize(
    ("axes", "cradle", "release"),
    [
        ({"alpha": [0.05]}, PAIR.replace(power_law=(0.05, PAIR.n)), RELEASE),
        ({"alpha": [0.05], "n": [0.3]}, PAIR.replace(power_law=(0.05, 0.3)), RELEASE),
        ({"gamma": [0.01]}, PAIR, Release(angle=0.06**0.5)),
        ({"release_angle": [0.1]}, PAIR, Release(angle=0.1)),
        ({"bobs": [3], "lifted": [2]}, Cradle(bobs=3), Release(angle=0.228, bobs=2)),
        ({"bobs": [4], "delta[2]": [0.01]}, Cradle(bobs=4, delta=(0, 0.01, 0)), RELEASE),
        ({"beta": [0.2], "mass": [0.1]}, Cradle.from_groups(bobs=2, beta=0.2, mass=0.1), RELEASE),
        ({"mass": [0.1]}, Cradle(bobs=2, mass=0.1, kappa=PAIR.kappa), RELEASE),
        ({"quadratic_drag.c2": [0.01]}, Cradle(bobs=2, effects={"quadratic_drag": {"c2": 0.01}}), RELEASE),
        (
            {"bobs": [3], "spacer_offset.offset[1]": [0.01]},
            Cradle(bobs=3, effects={"spacer_offset": {"offset": (0.01, 0.0)}}),
            RELEASE,
        ),
        ({"draw": {"k_f": [9e3], "b": [0.01]}}, Cradle(bobs=2, k_f=9e3, b=0.01), RELEASE),
    ],
    ids=lambda value: ",".join(value) if isinstance(value, dict) else "",
)
def test_every_axis_sets_what_its_name_says(axes, cradle, release):
    assert Grid(axes, PAIR, RELEASE).point(0) == (cradle, release)


def test_release_angles_that_are_stated_one_by_one_are_swept_in_proportion():
    release = Release(angles={1: -0.2, 2: 0.1}, start="hanging")
    for axes in ({"release_angle": [0.05]}, {"gamma": [0.05**2 / 6]}, {"bobs": [2], "release_angle": [0.05]}):
        found = Grid(axes, PAIR, release).point(0)[1]
        assert found.angles == pytest.approx({1: -0.1, 2: 0.05}) and found.start == "hanging"
    with pytest.raises(ValueError, match="lifted is swept, but the release states the angle of each bob"):
        Grid({"lifted": [1]}, PAIR, release)
    with pytest.raises(ValueError, match="bobs is 3, but the release states angles of bobs 1, 2 of 2"):
        Grid({"bobs": [3]}, PAIR, release).point(0)


def test_the_last_axis_changes_fastest_and_columns_of_an_axis_together():
    grid = Grid({"delta": [0.0, 0.01], "draw": {"k_f": [1e4, 2e4, 3e4], "b": [0.1, 0.2, 0.3]}}, PAIR, RELEASE)
    assert (grid.shape, len(grid), grid.names) == ((2, 3), 6, ("delta", "k_f", "b"))
    np.testing.assert_array_equal(grid.values(np.array([1, 3])), [[0.0, 2e4, 0.2], [0.01, 1e4, 0.1]])


def test_impossible_points_are_nan_and_counted_by_reason():
    grid = Grid({"bobs": [1, 2], "release_angle": [0.0, 0.2, 1.6, 1.7]}, Cradle(), RELEASE)
    swept = sweep(grid, duration=6.0)
    assert np.argwhere(np.isfinite(swept["lambda"])).tolist() == [[1, 1]]
    counts = {reason.split(";")[0]: count for reason, count in swept.failures().items()}
    said = {"one bob has nothing to synchronize with": 2, "release angle is 0 rad": 1}
    assert said.items() <= counts.items() and sum(counts.values()) == 7 and len(counts) == 3


def test_bobs_that_are_lifted_alike_have_no_exponent():
    swept = sweep(Grid({"lifted": [1, 2]}, PAIR, RELEASE), duration=3.0)
    assert np.isfinite(swept["lambda"]).tolist() == [True, False]
    assert swept.failures() == {"all 2 bobs are lifted alike and have nothing to synchronize with; lift fewer": 1}


def test_runs_too_short_for_the_exponent_are_refused():
    with pytest.raises(ValueError, match="duration is 1 s; λ takes more than 1 s"):
        sweep(Grid({"delta": [0.0, 0.01]}, PAIR, RELEASE), duration=1.0)


def test_no_possible_point_is_refused():
    with pytest.raises(ValueError, match="none of the 2 points can be simulated: delta is -2"):
        sweep(Grid({"delta": [-2.0, -1.0]}, PAIR, RELEASE))


def test_a_sweep_of_no_possible_point_leaves_its_folder_free(tmp_path):
    with pytest.raises(ValueError, match="none of the 1 points"):
        sweep(Grid({"delta": [-2.0]}, PAIR, RELEASE), out=tmp_path)
    assert not list(tmp_path.iterdir())
    sweep(Grid({"delta": [0.0]}, PAIR, RELEASE), duration=2.0, out=tmp_path)


@pytest.mark.parametrize(
    ("axes", "said"),
    [
        ({}, "no axis"),
        ({"bet": [1.0]}, "did you mean 'beta'"),
        ({"quadratic_drag.c3": [1.0]}, "did you mean 'c2'"),
        ({"beta": [0.1], "kappa": [200.0]}, "beta and kappa are both swept"),
        ({"n": [0.1], "k_f": [200.0]}, "n and k_f are both swept"),
        ({"beta": np.arange(1e5), "b": np.arange(1e5)}, "points; it must have at most 1e.09"),
        ({"beta": [0.1], "draw": {"beta": [0.2]}}, "beta is on two axes"),
        ({"beta": []}, "not empty"),
        ({"beta": [0.1, 0.2, 0.1]}, "beta = 0.1 is 2 times on its axis"),
        ({"beta": ["a"]}, "list of numbers"),
        ({"draw": {"b": [0.1], "k_f": [1.0, 2.0]}}, "1 of b, 2 of k_f"),
        ({"mass[1]": [1.0]}, "mass is one number"),
    ],
)
def test_unusable_axes_are_refused(axes, said):
    with pytest.raises(ValueError, match=said.replace("[", r"\[")):
        Grid(axes, PAIR, RELEASE)


@pytest.mark.parametrize("names", [("delta[1]", "delta"), ("delta", "delta[1]")])
def test_what_sets_one_gap_stays_where_another_axis_sets_all(names):
    axes = {name: [0.01 * (name == "delta"), 0.02] for name in names}
    grid = Grid(axes, Cradle(bobs=3), RELEASE)
    found = {cradle.delta for cradle, _ in map(grid.point, range(4))}
    assert found == {(0.0, 0.01), (0.0, 0.02), (0.02, 0.01), (0.02, 0.02)}


def test_synchronization_is_when_sigma_stays_low_and_an_ideal_momentum_exchange_leaves_one_nth_of_the_energy():
    """Without external loss, the paper's section 4.1: N bobs that end in step hold 1/N of what one had."""
    lossless = Cradle(bobs=2, b=0.0, k_f=1e5, model="pendulum")
    swept = sweep(Grid({"bobs": [2, 3]}, lossless, RELEASE), ("energy_share", "synchronization_time"))
    # The momentum argument is of instantaneous merging; at σ < 0.05 what is left of relative motion is 0.05²-small.
    np.testing.assert_allclose(swept["energy_share"], [1 / 2, 1 / 3], rtol=0.02)
    run = simulate(lossless, RELEASE)
    start = swept["synchronization_time"][0]
    lasting = (run.t >= start) & (run.t <= start + run.cradle.period)
    assert run.sigma()[lasting].max() < 0.05 <= run.sigma()[run.t < start][-1]


@pytest.mark.parametrize(
    ("quantities", "said"),
    [
        ((), "none"),
        (("lambda", "lambda"), "each once"),
        (("lamda",), "did you mean 'lambda'"),
        ((Quantity("delta", "δ", "1", "", counted),), "a quantity is named 'delta'"),
        ((Quantity("status", "s", "1", "", counted),), "a quantity is named 'status'"),
    ],
)
def test_unusable_quantities_are_refused(quantities, said):
    with pytest.raises(ValueError, match=said):
        sweep(Grid({"delta": [0.0]}, PAIR, RELEASE), quantities)


def test_bobs_that_change_places_are_told():
    """At β = 0.36 strings stretch by 0.08 m, two diameters, in the first swing: the released bob clears the other."""
    swept = sweep(Grid({"beta": [0.114, 0.36]}, PAIR, RELEASE), ("overtaking_time",), duration=3.0)
    run = simulate(Cradle.from_groups(bobs=2, beta=0.36), RELEASE, 3.0)
    beyond = run.t[run.x()[:, 0] > run.x()[:, 1]]
    assert np.isnan(swept["overtaking_time"][0]) and swept["overtaking_time"][1] == beyond[0]
    at = np.searchsorted(run.t, beyond[0])
    # One above the other as they pass, without touching: so much higher do they hang apart.
    assert abs(np.diff(run.r[at] * np.cos(run.theta[at]))[0]) >= 2.0 * run.cradle.radius - 1e-3


@pytest.mark.slow
def test_a_sweep_costs_little_more_than_its_runs():
    """A second run of each point would make it 2. Runs of 300 s: what a point costs besides is 2 ms, a tenth of one."""
    duration = 300.0
    grid = Grid({"beta": np.linspace(0.05, 0.33, 24)}, PAIR, RELEASE)
    cradles = [grid.point(i)[0] for i in range(24)]

    def seconds(work) -> float:
        began = time.process_time()
        work()
        return time.process_time() - began

    pairs = [
        (seconds(lambda: sweep(grid, duration=duration)), seconds(lambda: simulate_batch(cradles, RELEASE, duration)))
        for _ in range(4)
    ]
    # Both of a pair see the same load of the machine.
    assert np.median([ours / bare for ours, bare in pairs]) < 1.5, pairs


@pytest.mark.parametrize(("quantity", "kept"), [("lambda", False), ("energy_share", True)])
def test_the_ledger_is_kept_only_for_who_reads_it(quantity, kept, monkeypatch):
    asked = []

    def told(*run, ledger):
        asked.append(ledger)
        return simulate(*run, ledger=ledger)

    monkeypatch.setattr(sweep_engine, "simulate", told)
    sweep(Grid({"delta": [0.0, 0.01]}, PAIR, RELEASE), (quantity,), duration=3.0)
    assert asked == [kept, kept]


@pytest.mark.parametrize("executor", ["threads", "processes"])
def test_any_executor_gives_the_same(executor):
    grid = Grid({"bobs": [2, 3, 4]}, PAIR, RELEASE)
    quantities = ("lambda", Quantity("count", "N", "1", "number of bobs", counted))
    pool = ThreadPoolExecutor(1) if executor == "threads" else ProcessPoolExecutor(1, get_context("spawn"))
    with pool:
        swept = sweep(grid, quantities, duration=5.0, executor=pool)
    np.testing.assert_array_equal(swept["lambda"], sweep(grid, duration=5.0)["lambda"])
    np.testing.assert_array_equal(swept["count"], [2, 3, 4])


def test_dask():
    distributed = pytest.importorskip("distributed", reason="needs the extra 'cluster'")
    grid = Grid({"bobs": [2, 3, 4]}, PAIR, RELEASE)
    with distributed.Client(processes=False, n_workers=1, dashboard_address=None) as client:
        swept = sweep(grid, duration=5.0, executor=client)
        again = sweep(grid, duration=5.0, executor=client.get_executor())
    np.testing.assert_array_equal(swept["lambda"], sweep(grid, duration=5.0)["lambda"])
    np.testing.assert_array_equal(again["lambda"], swept["lambda"])


#: Long enough, a second or two, to be killed half way on a busy machine.
SWEPT = """
import signal, sys
import numpy as np
from cradle_env import Cradle, Release
from identification.sweep import Grid, sweep
grid = Grid({"beta": np.linspace(0.05, 0.33, 150)}, Cradle(bobs=2), Release(angle=0.228))
signal.signal(signal.SIGINT, signal.default_int_handler)  # a shell may have it ignored in the background
sweep(grid, duration=60.0, out=sys.argv[1], workers=1)
"""


@pytest.fixture(scope="module")
def undisturbed():
    return sweep(Grid({"beta": np.linspace(0.05, 0.33, 150)}, PAIR, RELEASE), duration=60.0)


@pytest.mark.parametrize("by", [signal.SIGKILL, signal.SIGINT])
def test_what_a_kill_leaves_is_kept_and_the_rest_is_run(by, undisturbed, tmp_path, monkeypatch):
    process = subprocess.Popen([sys.executable, "-c", SWEPT, tmp_path], stderr=subprocess.DEVNULL)
    rows = tmp_path / "runs.npy"
    while process.poll() is None and not (rows.exists() and np.load(rows)["status"].sum() > 20):
        time.sleep(0.02)
    process.send_signal(by)
    assert process.wait() == -by
    kept = np.load(rows)
    kept = kept[kept["status"] > 0]
    assert 20 < len(kept) < 150
    ran = []
    monkeypatch.setattr(sweep_engine, "simulate", lambda *run, **more: ran.append(run) or simulate(*run, **more))
    grid = Grid({"beta": np.linspace(0.05, 0.33, 150)}, PAIR, RELEASE)
    swept = sweep(grid, duration=60.0, out=tmp_path)
    assert len(ran) == 150 - len(kept)
    assert set(kept["lambda"]) <= set(swept["lambda"])
    np.testing.assert_array_equal(swept["lambda"], undisturbed["lambda"])


def test_a_sweep_that_stops_keeps_what_was_running(tmp_path, monkeypatch):
    """Of two points that had begun, one stops it; the other comes to its end."""
    begun = threading.Event()

    def evaluated(cradle, release, names, values, quantities, times, *_):
        if values[0, 0] == 0.0:
            begun.wait()
            raise RuntimeError("stop")
        begun.set()
        time.sleep(0.3)
        rows = np.zeros(len(values), sweep_engine.row_type(quantities, times))
        rows["status"], rows["lambda"] = 1, 5.0
        return rows, {}

    monkeypatch.setattr(sweep_engine, "evaluate", evaluated)
    with pytest.raises(RuntimeError, match="stop"):
        sweep(Grid({"delta": [0.0, 0.01]}, PAIR, RELEASE), out=tmp_path, workers=2)
    np.testing.assert_array_equal(np.load(tmp_path / "runs.npy")["lambda"], [0.0, 5.0])


def test_another_sweep_is_not_mixed_into_a_folder(tmp_path):
    sweep(Grid({"delta": [0.0, 0.01]}, PAIR, RELEASE), duration=2.0, out=tmp_path)
    with pytest.raises(ValueError, match="another sweep"):
        sweep(Grid({"delta": [0.0, 0.02]}, PAIR, RELEASE), duration=2.0, out=tmp_path)


LEVEL = 0.1


def at_level(run) -> float:
    return float(run.sigma().min()) + LEVEL


def beyond(level: float, past: int = 0):
    return lambda run: float(len(run.impacts) > level + past)


class Count:
    def __init__(self, least: float) -> None:
        self.least = least

    def __call__(self, run) -> float:
        return float(len(run.impacts) >= self.least)


def test_a_sweep_does_not_go_on_once_its_quantity_is_edited(tmp_path):
    grid = Grid({"delta": [0.0, 0.01]}, PAIR, RELEASE)
    sweep(grid, (Quantity("q", "q", "1", "", lambda run: run.theta[0, 1]),), duration=2.0, out=tmp_path)
    sweep(grid, (Quantity("q", "q", "1", "", lambda run: run.theta[0, 1]),), duration=2.0, out=tmp_path)
    with pytest.raises(ValueError, match="another sweep"):
        sweep(grid, (Quantity("q", "q", "1", "", lambda run: run.theta[0, 1] + 1.0),), duration=2.0, out=tmp_path)


def test_a_sweep_does_not_go_on_once_an_effect_is_edited(tmp_path, monkeypatch):
    """Be it one that only an axis brings."""
    monkeypatch.setattr("cradle_env.effects._EFFECTS", {e.name: e for e in (*CATALOGUE, *LEARNED)})
    declaration = dataclasses.replace(effect("quadratic_drag"), name="gusts", apply=None)
    register(dataclasses.replace(declaration, force=lambda t, r, theta, v_r, v_t, p: (0.0, p[0])))
    grid = Grid({"gusts.c2": [0.0, 0.01]}, PAIR, RELEASE)
    sweep(grid, duration=2.0, out=tmp_path)
    sweep(grid, duration=2.0, out=tmp_path)
    register(dataclasses.replace(declaration, force=lambda t, r, theta, v_r, v_t, p: (0.0, 2.0 * p[0])))
    with pytest.raises(ValueError, match="another sweep"):
        sweep(grid, duration=2.0, out=tmp_path)


def test_callables_are_told_apart_by_all_that_decides_their_results(monkeypatch):
    """By code, names, constants, closures, defaults, globals, and the state of an object; not by their line."""
    measures = [
        at_level, beyond(1.0), beyond(2.0), beyond(1.0, 3), Count(1.0), Count(2.0), Count(1.0).__call__, np.mean, len,
        functools.partial(at_level), functools.partial(beyond, 1.0), functools.partial(beyond, 2.0),
        lambda run, k=1: k, lambda run, k=2: k, lambda run, *, k=1: k, lambda run: run.t, lambda run: run.r,
        lambda run: run in {"a", "b", "c"}, lambda run: [x + 1 for x in run], lambda run: [x + 2 for x in run],
        lambda run: run[np.array([1, 2])],
    ]  # fmt: skip
    told = [fingerprint(measure) for measure in measures]
    assert len(set(told)) == len(told)
    assert [fingerprint(measure) for measure in (beyond(1.0), Count(1.0))] == [told[1], told[4]]
    monkeypatch.setitem(globals(), "LEVEL", 0.2)
    assert fingerprint(at_level) != told[0]


def peak(run) -> float:
    return Peak(run).value


class Extreme:
    def __init__(self, run) -> None:
        self.run = run

    def of(self, bob: int) -> float:
        return float(self.run.theta[:, bob].max())


class Peak(Extreme):
    @property
    def value(self) -> float:
        return self.of(0)


@pytest.mark.parametrize("kind", [Extreme, Peak])
def test_a_class_that_a_measure_names_is_told_by_what_it_does(kind, monkeypatch):
    told = fingerprint(peak)
    assert fingerprint(peak) == told
    if kind is Peak:
        monkeypatch.setattr(Peak, "value", property(lambda self: self.of(1)))
    else:
        monkeypatch.setattr(Extreme, "of", lambda self, bob: float(self.run.theta[:, bob].min()))
    assert fingerprint(peak) != told


def test_a_function_is_told_alike_in_every_process():
    measure = "lambda run: run.cradle.model in {'ho', 'pendulum', 'nsp'}"
    code = f"""from identification.sweep import QUANTITIES
from identification.storage.provenance import fingerprint
print(*map(fingerprint, [*(q.measure for q in QUANTITIES.values()), {measure}]), sep="", end="")"""
    measures = [*(q.measure for q in QUANTITIES.values()), eval(measure, {"__name__": "__main__"})]
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True)
    assert done.stdout == "".join(map(fingerprint, measures))


PLANNED = """
import resource, sys
from concurrent.futures import Future
import numpy as np
from cradle_env import Cradle, Release
from identification.sweep import Grid, engine, sweep

class Instant:
    def submit(self, function, *arguments):
        future = Future()
        future.set_result(function(*arguments))
        return future

def instantly(cradle, release, names, values, quantities, times, *_):
    rows = np.zeros(len(values), engine.row_type(quantities, times))
    rows["status"] = 1
    return rows, {}

engine.evaluate, engine._TASK = instantly, 256
n = int(sys.argv[2])
sweep(Grid({"beta": np.linspace(0.1, 0.2, n), "delta": np.linspace(0.0, 0.01, n)}, Cradle(bobs=2), Release(angle=0.2)),
      ("lambda", "impacts"), out=sys.argv[1], executor=Instant())
print(resource.getrusage(resource.RUSAGE_SELF).ru_maxrss)
"""


def test_memory_does_not_grow_with_the_number_of_runs(tmp_path):
    """The peak of a million planned and stored runs is that of a thousand, to 10 MB: a list of their values alone, at
    two numbers each, would take 16 MB, and one of cradles gigabytes."""
    peaks = []
    for n in (32, 1000):
        done = subprocess.run(
            [sys.executable, "-c", PLANNED, tmp_path / str(n), str(n)], capture_output=True, text=True
        )
        assert done.returncode == 0, done.stderr
        peaks.append(int(done.stdout) / 1024)
    assert os.stat(tmp_path / "1000" / "runs.npy").st_size > 17e6
    assert peaks[1] - peaks[0] < 10.0, peaks
