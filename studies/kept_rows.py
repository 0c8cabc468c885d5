"""The rows that studies keep, one JSON object a line, and shares counted over them."""

from __future__ import annotations

import json
from pathlib import Path
from typing import Any

from scipy.stats import binomtest


def read_rows(path: Path) -> list[dict[str, Any]]:
    """The rows of a file; none where there is no file."""
    return [json.loads(line) for line in path.read_text(encoding="utf-8").splitlines()] if path.is_file() else []


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
