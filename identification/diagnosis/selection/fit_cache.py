"""Points of finished fits, kept in a file so that an interrupted diagnosis goes on."""

from __future__ import annotations

import hashlib
import json
import threading
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np

from cradle_env.effects import known_effects
from identification.experiment.experiment import Experiment
from identification.storage.files import ExperimentError, json_text, write_together
from identification.storage.provenance import program_hash
from identification.storage.schema import read_json

#: How the result of long work, a vector, is kept: the key of the work, and the work.
PointCache = Callable[[str, Callable[[], np.ndarray]], np.ndarray]


def compute_uncached(_: str, find: Callable[[], np.ndarray]) -> np.ndarray:
    """What is found, kept nowhere."""
    return find()


class FitCache:
    """Points of finished fits by what was fitted, in a file (None: in memory only). inputs: "program/data", of which
    fits of other data are refused (ExperimentError), and those by another program made anew."""

    def __init__(self, path: Path | None, inputs: str):
        self.path, self.inputs, self.points = path, inputs, {}
        self._writing = threading.Lock()
        if path is not None and path.is_file():
            known = read_json(path, "fits", "remove it to begin anew, or choose another --out")
            data, points = known["inputs"].partition("/")[2], known["points"]
            if data != inputs.partition("/")[2]:
                raise ExperimentError(
                    f"{path}: holds the fits of another experiment, or with another seed, which would be lost; "
                    "choose another --out"
                )
            self.points = points if known["inputs"] == inputs else {}  # of another program: begin anew

    @classmethod
    def of(cls, out: str | Path | None, experiment: Experiment, seed: int) -> FitCache:
        """That of an experiment in folder `out` (None: in memory); fits by other code are not taken over."""
        path = None if out is None else Path(out) / "fits.json"
        return cls(path, f"{program_hash(known_effects())}/{experiment.digest}/{seed}")

    def point(self, key: str, find: Callable[[], np.ndarray]) -> np.ndarray:
        """The point of that key, found if it is not known; of several threads at once, too."""
        if key not in self.points:
            found = [float(z) for z in find()]
            with self._writing:
                self.points[key] = found
                if self.path is not None:
                    kept = {k: z for k, z in self.points.items() if np.isfinite(z).all()}  # JSON knows no others
                    text = json_text({"inputs": self.inputs, "points": kept})
                    write_together(self.path.parent, {self.path.name: text})
        return np.array(self.points[key])


def fit_key(what: str, experiment: Experiment, *more: Any) -> str:
    """What a fit of a model is stored by: the kind of fit, the model's effects, and what else it depends on."""
    cradle = experiment.cradle
    model = (cradle.model, sorted(cradle.effects), sorted(experiment.unknown_effect_parameters))
    return hashlib.sha256(json.dumps([what, model, *more]).encode()).hexdigest()[:20]
