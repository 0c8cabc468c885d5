"""Files that were bent in every way: each is read, or refused in one line, in time, and nothing else is touched."""

from __future__ import annotations

import contextlib
import json
import os
import re
import shutil
import signal
import warnings
from collections import Counter
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import h5py
import numpy as np

from cradle_env import Cradle
from cradle_env.model_files import read_model
from cradle_env.simulation import SimulationError
from identification import Experiment
from identification.inference.checkpoint import Checkpoint
from identification.inference.likelihood import Likelihood
from identification.inference.posterior import Posterior

#: How long one file may take [s].
_PATIENCE = 20
#: What stands in the place of something sound.
_ODD = (
    "nan", "inf", "-inf", "0", "-1", "1e308", "1e-320", "1e9", "1.7e9", "99999999999999999999", "true", '""', "'x'",
    "[]", "{}", "[1, 2]", "[[1]]", '"../../x"', '"/dev/zero"', '"a\\nb"', "{ a = 1 }", "\u0000", "\ud7ff", "é",
    '"$x$"', "<b>",
    "a" * 300, "a." * 30 + "a", "[" * 300, '"\\u0000"', "1_0", "1979-05-27", "0x7fffffffffffffff",
)  # fmt: skip


@dataclass(frozen=True)
class Kind:
    """A kind of file: its name in a folder, how it is bent, and how it is read."""

    file: str
    bend: Callable[[Path, np.random.Generator], None]
    read: Callable[[Path], Any]


def corrupt_text(path: Path, rng: np.random.Generator) -> None:
    """Changes a text in one to three places: a line, a word, a number, a few bytes."""
    data = path.read_bytes()
    for _ in range(rng.integers(1, 4)):
        text = data.decode("utf-8", "surrogateescape")
        lines = text.split("\n")
        k = int(rng.integers(len(lines)))
        odd = str(rng.choice(_ODD))
        way = rng.integers(9)
        words = [*re.finditer(r"[\w.+-]+|\"[^\"]*\"", lines[k])]
        if way == 0:
            del lines[k]
        elif way == 1:
            lines.insert(k, lines[int(rng.integers(len(lines)))])
        elif way <= 4 and words:
            word = words[int(rng.integers(len(words)))]
            lines[k] = lines[k][: word.start()] + odd + lines[k][word.end() :]
        elif way == 5:
            lines = lines[:k]
        elif way == 6:
            j = int(rng.integers(len(lines)))
            lines[k], lines[j] = lines[j], lines[k]
        elif way == 7:
            lines[k] = lines[k][: int(rng.integers(len(lines[k]) + 1))] + odd
        data = "\n".join(lines).encode("utf-8", "surrogateescape")
        if way == 8 and data:
            at = int(rng.integers(len(data)))
            data = data[:at] + bytes(rng.integers(0, 256, int(rng.integers(1, 5)), dtype=np.uint8)) + data[at + 1 :]
    path.write_bytes(data)


def corrupt_hdf5(path: Path, rng: np.random.Generator) -> None:
    """Changes an HDF5 file: its bytes, or a member or attribute of it, which goes, or becomes another kind of thing."""
    if rng.random() < 0.2:
        data = bytearray(path.read_bytes())
        if rng.random() < 0.3:
            data = data[: int(rng.integers(len(data)))]
        for _ in range(int(rng.integers(0, 20))):
            if data:
                data[int(rng.integers(len(data)))] = int(rng.integers(256))
        path.write_bytes(bytes(data))
        return
    with h5py.File(path, "a") as file:
        members: list[str] = []
        file.visit(members.append)
        for _ in range(int(rng.integers(1, 3))):
            name = members[int(rng.integers(len(members)))]
            if not isinstance(file.get(name, getlink=True), h5py.HardLink):
                continue  # gone, or a link, by the change before
            attributes = [*file[name].attrs] if rng.random() < 0.8 else [*file.attrs]
            if attributes and rng.random() < 0.6:
                holder = file[name] if attributes[0] in file[name].attrs else file
                _corrupt_attribute(holder, attributes[int(rng.integers(len(attributes)))], rng)
            else:
                _corrupt_member(file, name, rng)


def _corrupt_attribute(holder: Any, name: str, rng: np.random.Generator) -> None:
    value = holder.attrs[name]
    way = rng.integers(4)
    if way == 0 or name in ("DIMENSION_LIST", "REFERENCE_LIST"):
        del holder.attrs[name]
    elif way == 1 and isinstance(value, str) and value:
        at = int(rng.integers(len(value)))
        holder.attrs[name] = value[:at] + str(rng.choice([o for o in _ODD if "\0" not in o])) + value[at + 1 :]
    elif way == 2 and isinstance(value, str) and value[:1] in "{[":
        try:
            content = json.loads(value)
        except ValueError:  # bent before
            return
        if not content:
            return
        keys = [*content] if isinstance(content, dict) else [*range(len(content))]
        content[keys[int(rng.integers(len(keys)))]] = _odd_json(rng)
        if isinstance(content, dict) and rng.random() < 0.3:
            content[str(rng.choice(["../x", "/tmp/x", "a\\b", ".."]))] = "text"
        holder.attrs[name] = json.dumps(content)
    else:
        odd = [
            0,
            -1,
            2**40,
            np.nan,
            "text",
            "",
            [1.0, 2.0],
            np.zeros((2, 2)),
            np.bytes_(b"\xff\xfe"),
            h5py.Empty("f8"),
            True,
        ]
        del holder.attrs[name]
        holder.attrs[name] = odd[int(rng.integers(len(odd)))]


def _odd_json(rng: np.random.Generator) -> Any:
    odd = [None, True, -1, 1e308, float("nan"), "x", [], {}, [[]], {"a": 1}, 2**70, "\0", [None], [1, 2, 3]]
    return odd[int(rng.integers(len(odd)))]


def _corrupt_member(file: h5py.File, name: str, rng: np.random.Generator) -> None:
    is_data = isinstance(file[name], h5py.Dataset)
    shape = file[name].shape if is_data else ()
    del file[name]
    way = rng.integers(9)
    if way == 1:
        file[name] = h5py.SoftLink("/nowhere")
    elif way == 2:
        file[name] = h5py.ExternalLink("other.h5", "/secret")
    elif way == 3:
        file.create_group(name)
    elif way == 4:
        file[name] = "text"
    elif way == 5:
        file.create_dataset(name, shape=(2**18, 2**18), dtype="f8", chunks=(1024, 1024))  # 550 GB that take no place
    elif way == 6:
        file[name] = np.full([min(n, 10_000) + int(rng.integers(-1, 2)) for n in shape[:1]], 1.0)
    elif way == 7:
        file[name] = rng.choice([np.nan, np.inf, -1.0, 0.0, 1e308], size=[min(n, 1000) for n in shape])
    elif way == 8 and shape:
        file.create_dataset(name, shape=shape, dtype="f8", external=[("secret.bin", 0, h5py.h5f.UNLIMITED)])


def _read_posterior(path: Path) -> None:
    posterior = Posterior.load(path, workers=1)
    posterior.summary()
    posterior.predict(count=2, duration=2.0, sample_rate=60.0)


def kinds(sound: Path) -> dict[str, Kind]:
    """The kinds of files, sound ones of which stand in a folder."""
    likelihood = Likelihood(Experiment.load(sound / "experiment.toml"), workers=1)

    def read_chain(path: Path) -> None:
        checkpoint = Checkpoint(path, likelihood, 0)
        if checkpoint.exists():
            if checkpoint.steps():
                checkpoint.read()
            checkpoint.mode(checkpoint.steps())
            likelihood.with_noise(checkpoint.noise_model())

    def read_model_file(path: Path) -> None:
        base, effects = read_model(path)
        Cradle(bobs=2, model=base, effects=effects)

    return {
        "experiment.toml": Kind("experiment.toml", corrupt_text, Experiment.load),
        "data": Kind("run1.csv", corrupt_text, lambda path: Experiment.load(path.with_name("experiment.toml"))),
        "model.toml": Kind("model.toml", corrupt_text, read_model_file),
        "posterior.nc": Kind("posterior.nc", corrupt_hdf5, _read_posterior),
        "chain.h5": Kind("chain.h5", corrupt_hdf5, read_chain),
    }


@contextlib.contextmanager
def _time_limit(seconds: int) -> Iterator[None]:
    def late(*_: Any) -> None:
        raise TimeoutError(f"more than {seconds} s")

    signal.signal(signal.SIGALRM, late)
    signal.alarm(seconds)
    try:
        yield
    finally:
        signal.alarm(0)


def judge(kind: Kind, folder: Path) -> tuple[str, str]:
    """("read" | "refused" | "broken", what is wrong)."""
    before = _listing(folder.parent)
    try:
        with _time_limit(_PATIENCE), warnings.catch_warnings():
            warnings.simplefilter("error")
            warnings.simplefilter("ignore", FutureWarning)
            kind.read(folder / kind.file)
        outcome, text = "read", ""
    except (ValueError, SimulationError) as problem:
        outcome, text = "refused", str(problem)
    except Exception as problem:
        return "broken", f"{type(problem).__name__}: {problem}"
    if len(text.splitlines()) > 1 or len(text) > 1000:
        return "broken", f"a message of {len(text)} characters on {len(text.splitlines())} lines: {text[:200]!r}"
    if _listing(folder.parent) != before:
        return "broken", "files were written or removed"
    return outcome, text


def _listing(folder: Path) -> list[tuple[str, int]]:
    return sorted((str(path), path.stat().st_mtime_ns) for path in folder.rglob("*") if path.is_file())


def fuzz(
    count: int, seed: int, sound: Path, scratch: Path, report: Callable[[str], None]
) -> tuple[dict[str, Counter[str]], list[str]]:
    """How many of `count` bent files of all kinds, in turn, ended how; and what was broken."""
    every = kinds(sound)
    counts: dict[str, Counter[str]] = {name: Counter() for name in every}
    broken = []
    folder = scratch / "inside" / "case"
    with contextlib.chdir(scratch):
        for k in range(count):
            name = [*every][k % len(every)]
            shutil.rmtree(folder, ignore_errors=True)
            shutil.copytree(sound, folder)
            every[name].bend(folder / every[name].file, np.random.default_rng([seed, k]))
            outcome, text = judge(every[name], folder)
            counts[name][outcome] += 1
            if outcome == "broken":
                broken.append(f"{name} {k}: {' '.join(text.split())[:300]}")
            if k % 500 == 499:
                report(f"{k + 1} of {count} files, {len(broken)} broken")
    return counts, broken


def make_valid_files(folder: Path) -> None:
    """An experiment of a few seconds, its calibration and a model file."""
    from identification import calibrate
    from identification.cli import commands

    commands.simulate(Cradle(bobs=2), _release(), 4.0, 40.0, folder, 1e-3, 0)
    experiment = Experiment.load(folder / "experiment.toml")
    calibrate(experiment, out=folder, steps=50, workers=os.cpu_count()).save(folder / "posterior.nc")
    (folder / "model.toml").write_text(
        '[model]\nbase = "nsp"\neffects = ["quadratic_drag", "frame_compliance", "-string_hysteresis"]\n\n'
        "[model.parameters]\nquadratic_drag = { c2 = 0.002 }\n"
        "frame_compliance = { frame_mass = 5.0, frequency = 12.0, damping_ratio = 0.05 }\n"
        "mass_mismatch = { relative = [0.01, -0.01] }\n",
        encoding="utf-8",
    )
    for name in ("trajectory.csv", "impacts.csv", "summary.json", "run.png"):
        (folder / name).unlink()


def _release() -> Any:
    from cradle_env import Release

    return Release(0.228)
