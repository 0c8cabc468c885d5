"""Rows and shares that studies keep."""

import math

from studies.kept_rows import format_count, read_rows


def test_wilson_interval_is_that_of_the_formula():
    p, n, z = 0.9, 10, 1.959963984540054
    centre = (p + z**2 / (2 * n)) / (1 + z**2 / n)
    half = z / (1 + z**2 / n) * math.sqrt(p * (1 - p) / n + z**2 / (4 * n**2))
    assert format_count(9, 10) == f"9 of 10 ({100 * (centre - half):.0f}–{100 * (centre + half):.0f} %)"


def test_no_file_holds_no_rows(tmp_path):
    assert read_rows(tmp_path / "none.jsonl") == []
