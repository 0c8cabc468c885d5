"""The rows that studies keep, one JSON object a line, the code that made them, and shares counted over them."""

from __future__ import annotations

import json
import subprocess
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from scipy.stats import binomtest


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The rows of a file; none where there is no file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.is_file() else []


def keep_row(path: Path, row: Mapping[str, Any]) -> None:
    """Adds a row to a file."""
    with path.open("a", encoding="utf-8") as file:
        file.write(json.dumps(row) + "\n")


def committed_code(folder: Path) -> str:
    """The commit of the repository around a folder; RuntimeError where its code differs from what is committed."""

    def git(*asked: str) -> str:
        return subprocess.run(["git", *asked], cwd=folder, capture_output=True, text=True, check=True).stdout.rstrip()

    changed = git("status", "--porcelain", "--untracked-files=no", "--", ":/*.py")
    if changed:
        raise RuntimeError(f"commit these first, for rows name the commit that made them:\n{changed}")
    return git("rev-parse", "--short=7", "HEAD")


def wilson_interval(count: int, total: int) -> tuple[float, float]:
    """95 % interval of a share."""
    ends = binomtest(count, total).proportion_ci(method="wilson")
    return ends.low, ends.high


def format_count(count: int, total: int) -> str:
    """ "k of n (95 % Wilson interval of the share)"."""
    if total == 0:
        return "–"
    low, high = wilson_interval(count, total)
    return f"{count} of {total} ({100 * low:.0f}–{100 * high:.0f} %)"
