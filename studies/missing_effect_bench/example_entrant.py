"""An entrant without this package: python example_entrant.py DIR ANSWERS. It looks whether the mean angle is 0."""

import json
import sys
from pathlib import Path

import numpy as np

task, answers = Path(sys.argv[1]), Path(sys.argv[2])
answers.mkdir(parents=True, exist_ok=True)
for case in json.loads((task / "task.json").read_text(encoding="utf-8"))["cases"]:
    readings = np.genfromtxt(task / "cases" / case["case"] / "run1.csv", delimiter=",", skip_header=1)
    t, theta = readings[:, 0], readings[:, 1:]  # s since the release, and rad, a column for each bob
    p = 0.5 if abs(theta.mean()) > 5.0 * theta.std() / len(t) ** 0.5 else 0.1
    answer = {"format": "missing-effect-answer/1", "case": case["case"], "nothing": 0.7 * (1.0 - p)}
    answer |= {"unknown": 0.3 * (1.0 - p), "sets": [{"effects": ["angle_offset"], "probability": p}]}
    (answers / f"{case['case']}.json").write_text(json.dumps(answer), encoding="utf-8")
