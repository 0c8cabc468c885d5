"""Measure instruments that are simulated, with truths drawn at random, and count how often an interval holds the truth.

    python -m studies.apparatus [--sets 40] [--seed 1] [--only KIND]

Data come from the simulators of tests/reference, which share no code with the package. What each kind found is kept in
studies/apparatus/KIND.json; results.md is made of all that is kept there.
"""

from __future__ import annotations

import argparse
import json
import sys
import tempfile
from collections.abc import Callable, Iterator
from pathlib import Path

import numpy as np
from scipy.stats import binom

from cradle_env import Cradle, __version__
from identification.apparatus import (
    Circuit,
    measure_contacts,
    measure_impacts,
    measure_ringdown,
    measure_string,
)
from identification.apparatus.measurement import Value
from tests.reference import impact_chain, oscilloscope, pendulum, string_machine
from tests.reference.soft_contact import SoftCradle, simulate_soft

_HERE = Path(__file__).parent
#: (value, truth) by name, of one data set.
Found = dict[str, tuple[Value, float]]


def ringdown_rigid(rng: np.random.Generator, folder: Path) -> Found:
    """60 s of one bob on rigid strings, b and by chance c2 or τ_c; readings of 1 mrad, 60 a second."""
    truth = {"b_1": rng.uniform(1e-3, 4e-3), "c2": 0.0, "tau_c": 0.0}
    kind = rng.choice(["b", "c2", "tau_c"])
    if kind == "c2":
        truth["c2"] = rng.uniform(1e-2, 4e-2)
    if kind == "tau_c":
        truth["tau_c"] = rng.uniform(1e-4, 4e-4)
    times, theta = pendulum.ring_down(rng.uniform(0.15, 0.35), truth["b_1"], c2=truth["c2"], tau_c=truth["tau_c"])
    path = pendulum.csv_of(folder / "one.csv", times, theta + 1e-3 * rng.standard_normal(len(times)))
    measured = measure_ringdown([path], Cradle(model="pendulum"))
    return {f"{name}, {kind} acts": (value, truth[name]) for name, value in measured.values.items()}


def ringdown_nylon(rng: np.random.Generator, folder: Path) -> Found:
    """60 s of one bob on strings with hysteresis, new ones, linear drag; readings of 1 mrad, 60 a second."""
    b, times = rng.uniform(1e-3, 4e-3), np.arange(3601) / 60.0
    run = simulate_soft(SoftCradle(1, b=b), {1: rng.uniform(0.1, 0.25)}, "hanging", times=times)
    noise = 1e-3 * rng.standard_normal(run.theta.shape)
    measured = measure_ringdown([pendulum.csv_of(folder / "one.csv", times, run.theta + noise)], Cradle())
    return {"b_1": (measured.values["b_1"], b)}


def string(rng: np.random.Generator, folder: Path) -> Found:
    """Three single cycles and three in a row, noise of 5 mN, exponent 2 or another, play of the machine."""
    kappa, exponent = rng.uniform(120.0, 300.0), float(rng.choice([2.0, rng.uniform(1.5, 2.5)]))
    play, creep = rng.choice([0.0, 3e-5]), float(rng.choice([0.0, 2e-5]))
    machine = {"kappa": kappa, "exponent": exponent, "backlash": play, "creep": creep, "zero": rng.normal(0.0, 0.02)}
    paths, losses = [], []
    for k, (peaks, low) in enumerate((((1.0,), 0.0), ((1.8,), 0.0), ((2.6,), 0.0), ((2.0,) * 3, 0.8))):
        stretch = np.array(peaks) / kappa
        made = string_machine.pull(stretch, low=low / kappa, **machine, seed=int(rng.integers(2**31)))
        paths.append(string_machine.csv_of(folder / f"{k}.csv", *made))
        if low == 0.0:
            losses.append(loss_of_string(stretch, machine))
    values = measure_string(paths).values
    truths = {"kappa": kappa, "exponent": exponent, "loss": float(np.mean(losses)), "creep": creep}
    return {name: (values[name], truth) for name, truth in truths.items()} | (
        {"backlash": (values["backlash"], play)} if play else {}
    )


def loss_of_string(stretch: np.ndarray, machine: dict[str, float]) -> float:
    """Share of the work of loading that the string itself takes in a full cycle, its creep included."""
    perfect = machine | {"zero": 0.0, "backlash": 0.0}
    _, x, force = string_machine.pull(stretch, **perfect, noise=0.0, rate=2000.0)
    turn = int(np.argmax(x)) + 1
    return float(np.trapezoid(force, x) / np.trapezoid(force[:turn], x[:turn]))


def impacts(rng: np.random.Generator, folder: Path) -> Found:
    """30 impacts on two bobs at rest, both speeds known to 1 mm/s, and 30 contact durations known to 0.5 µs."""
    k_f, k_el = rng.uniform(8e3, 3e4), impact_chain.K_EL * rng.uniform(0.97, 1.03)
    nodes = np.geomspace(0.1, 1.0, 4)
    third = [impact_chain.collide(3, v, k_f, k_el)[0][-1] / v for v in nodes]
    length = [impact_chain.collide(2, v, k_f, k_el)[1] for v in nodes]

    def at(values: list[float], speeds: np.ndarray) -> np.ndarray:
        return np.exp(np.polyval(np.polyfit(np.log(nodes), np.log(values), 3), np.log(speeds)))

    speeds = rng.uniform(0.15, 0.9, 30)
    noise = 1e-3 * rng.standard_normal((2, 30))
    rows = (
        f"{a},{b},0.001,0.001" for a, b in zip(speeds + noise[0], speeds * at(third, speeds) + noise[1], strict=True)
    )
    (folder / "v.csv").write_text("\n".join(["v1,v3,v1_sd,v3_sd", *rows, ""]), encoding="utf-8")
    times = 1e6 * at(length, speeds) + 0.5 * rng.standard_normal(30)
    rows = (f"{v},{t},0.5" for v, t in zip(speeds, times, strict=True))
    (folder / "t.csv").write_text("\n".join(["v [m/s],duration [us],duration_sd [us]", *rows, ""]), encoding="utf-8")
    values = measure_impacts([folder / "v.csv", folder / "t.csv"], Cradle()).values
    after = impact_chain.collide(2, 0.5, k_f, k_el)[0]
    truths = {"k_f": k_f, "k_el": k_el, "e_0.5": (after[1] - after[0]) / 0.5, "exponent": 0.2}
    return {name: (values[name], truth) for name, truth in truths.items()}


def contacts(rng: np.random.Generator, folder: Path) -> Found:
    """k_f of five traces of two bobs at 250 MS/s, noise of 0.1 % of the supply, speeds known to 0.4 mm/s."""
    k_f, rate, paths, speeds = rng.uniform(1e4, 3e4), 250e6, [], []
    for k, speed in enumerate((0.15, 0.25, 0.4, 0.6, 0.9)):
        length = round(impact_chain.collide(2, speed, k_f)[1] * rate)
        volts = oscilloscope.trace(
            [(0, 2000, 2000 + length)], 1, 4000 + length, noise=0.005, rate=rate, bandwidth=25e6,
            seed=int(rng.integers(2**31)),
        )  # fmt: skip
        paths.append(folder / f"{k}.npy")
        np.save(paths[-1], volts)
        speeds.append(speed + 4e-4 * rng.standard_normal())
    circuit = Circuit.binary(2, oscilloscope.SUPPLY)
    values = measure_contacts(paths, circuit, Cradle(), rate=rate, speeds=speeds, speed_sd=4e-4).values
    return {"k_f": (values["k_f"], k_f)}


def assignments(seed: int, folder: Path, parts: int = 20, each: int = 500) -> list[dict]:
    """10 000 contacts of five bobs at 2.5 GS/s, 1 to 3 µs each, at two noises: misassigned, errors of durations."""
    rows = []
    for noise in (0.001, 0.004):
        missed, errors, spreads = 0, [], []
        for part in range(parts):
            found, samples = oscilloscope.schedule(each, 4, 4000, 600, seed=1000 * seed + part)
            volts = oscilloscope.trace(found, 4, samples, noise=noise * oscilloscope.SUPPLY, gain=1.01, offset=0.01,
                                       seed=part)  # fmt: skip
            np.save(folder / "t.npy", volts)
            circuit = Circuit.binary(5, oscilloscope.SUPPLY)
            got = measure_contacts([folder / "t.npy"], circuit, rate=oscilloscope.RATE).traces[0].contacts
            true = sorted(found, key=lambda one: (one[1], one[0]))
            if len(got) != len(true):
                missed += each
                continue
            missed += sum(c.pair - 1 != pair for c, (pair, _, _) in zip(got, true, strict=True))
            errors += [abs(c.duration * oscilloscope.RATE - (b - a)) for c, (_, a, b) in zip(got, true, strict=True)]
            spreads += [c.duration_sd * oscilloscope.RATE for c in got]
            print(f"contacts, noise {noise}: {len(errors)} of {parts * each}, {missed} misassigned", file=sys.stderr)
        within = float(np.mean(np.array(errors) <= 1.96 * np.array(spreads)))
        rows.append({"noise": noise, "contacts": parts * each, "misassigned": missed,
                     "median": float(np.median(errors)), "within_1": float(np.mean(np.array(errors) <= 1.0)),
                     "largest": float(np.max(errors)), "inside": within})  # fmt: skip
    return rows


KINDS: dict[str, Callable[[np.random.Generator, Path], Found]] = {
    "ringdown-rigid": ringdown_rigid,
    "ringdown-nylon": ringdown_nylon,
    "string": string,
    "impacts": impacts,
    "contacts": contacts,
}


def run(kind: str, sets: int, seed: int) -> None:
    """Measures some sets of one kind, and keeps what was found."""
    found: list[dict] = []
    for k in range(sets):
        with tempfile.TemporaryDirectory() as folder:
            values = KINDS[kind](np.random.default_rng([seed, k]), Path(folder))
        found += [
            {"set": k, "name": name, "truth": truth, "median": value.median, "sd": value.sd, "ci95": value.ci95}
            for name, (value, truth) in values.items()
        ]
        print(f"{kind}: {k + 1} of {sets}", file=sys.stderr)
    content = {"version": __version__, "seed": seed, "sets": sets, "found": found}
    (_HERE / f"{kind}.json").write_text(json.dumps(content, indent=1) + "\n", encoding="utf-8")


def table() -> Iterator[str]:
    """Lines of results.md."""
    yield "# How often the intervals of measurements hold the truth"
    yield ""
    yield "`python -m studies.apparatus`. The independent simulators in `tests/reference` make the data, with truths"
    yield "drawn at random. The number of correct 95 % intervals that hold the truth lies in the range of the fifth"
    yield "column in 99 of 100 studies. A number below this range means that the intervals are too narrow."
    for kind, measure in KINDS.items():
        path = _HERE / f"{kind}.json"
        if not path.exists():
            continue
        found = json.loads(path.read_text(encoding="utf-8"))["found"]
        yield from ("", f"## {kind}", "", (measure.__doc__ or "").strip(), "")
        yield from (
            "| value | sets | inside 95 % | of | chance | RMS (value − truth)/sd | median sd/truth |",
            "|---|" + "---|" * 6,
        )
        for name in dict.fromkeys(row["name"] for row in found):
            rows = [row for row in found if row["name"] == name]
            inside = sum(row["ci95"][0] <= row["truth"] <= row["ci95"][1] for row in rows)
            low, high = (int(x) for x in binom.ppf((0.005, 0.995), len(rows), 0.95))
            z = np.sqrt(np.mean([((row["median"] - row["truth"]) / row["sd"]) ** 2 for row in rows]))
            share = np.median([row["sd"] / abs(row["truth"]) if row["truth"] else np.nan for row in rows])
            shown = "–" if np.isnan(share) else f"{share:.2g}"
            yield f"| {name} | {len(rows)} | {inside} | {len(rows)} | {low} to {high} | {z:.2f} | {shown} |"
    path = _HERE / "assignments.json"
    if path.exists():
        yield from ("", "## Contacts told apart", "", (assignments.__doc__ or "").strip(), "")
        yield "| noise / supply | contacts | misassigned | median error of the duration [samples] | within 1 sample |"
        yield "|---|---|---|---|---|"
        for row in json.loads(path.read_text(encoding="utf-8")):
            yield (f"| {100 * row['noise']:g} % | {row['contacts']} | {row['misassigned']} | {row['median']:.2f} |"
                   f" {100 * row['within_1']:.1f} % (inside their 95 %: {100 * row['inside']:.1f} %) |")  # fmt: skip
    yield ""


def main() -> int:
    """Runs the study, and writes the page."""
    parser = argparse.ArgumentParser(
        prog="python -m studies.apparatus", description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter
    )
    parser.add_argument("--sets", type=int, default=40, help="data sets of each kind")
    parser.add_argument("--seed", type=int, default=1)
    parser.add_argument("--only", choices=[*KINDS, "assignments", "table"], help="one kind; table: results.md alone")
    asked = parser.parse_args()
    for kind in KINDS:
        if asked.only in (None, kind):
            run(kind, asked.sets, asked.seed)
    if asked.only in (None, "assignments"):
        with tempfile.TemporaryDirectory() as folder:
            rows = assignments(asked.seed, Path(folder))
        (_HERE / "assignments.json").write_text(json.dumps(rows, indent=1) + "\n", encoding="utf-8")
    (_HERE / "results.md").write_text("\n".join(table()), encoding="utf-8")
    return 0


if __name__ == "__main__":
    sys.exit(main())
