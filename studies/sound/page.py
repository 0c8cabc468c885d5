"""results.md: what the recordings say."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from typing import Any

import numpy as np

from studies.kept_rows import format_count
from studies.sound.judge import CLASSES
from studies.sound.made import CONDITIONS


def _share(rows: Sequence[dict[str, Any]], part: int | None = None) -> str:
    part_of = slice(None) if part is None else slice(part, part + 1)
    found, of = (sum(sum(row[key][part_of]) for row in rows) for key in ("found", "impacts"))
    return f"{found} of {of}, {100.0 * found / of:.1f} %" if of else "–"


def _microseconds(rows: Sequence[dict[str, Any]], key: str) -> str:
    counts = np.array([sum(row["found"]) for row in rows], float)
    known = [(row[key], n) for row, n in zip(rows, counts, strict=True) if row[key] is not None]
    if not known:
        return "–"
    sizes, weights = np.array(known).T
    return f"{1e6 * (np.sqrt(np.average(sizes**2, weights=weights)) if key == 'rms' else np.median(sizes)):.0f}"


def calibrations(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the part on calibrations."""
    yield from (
        "## Calibrations",
        "",
        "The same run of two bobs, 60 s, by its sound (OGG, music, 30 dB; the instant of the release unknown, missed",
        "and false clicks and the lag of a click in the likelihood) and by its angles (60 a second, 1 mrad). The",
        "release angle is known. Truths are drawn at random; k_f, κ and b start from the defaults. Importance sampling",
        "about the mode samples the posterior. Behind counts: 95 % Wilson interval. z: (median − truth)/sd.",
        "",
        "| value | by | runs | inside 95 % | RMS z | median sd/truth |",
        "|---|---|---|---|---|---|",
    )
    for name in ("k_f", "kappa", "b", "lambda"):
        for way in ("sound", "angles"):
            found = [(row[way][name], row["truth"][name]) for row in rows if way in row]
            if found:
                inside = sum(f["ci95"][0] <= truth <= f["ci95"][1] for f, truth in found)
                z = np.sqrt(np.mean([((f["median"] - truth) / f["sd"]) ** 2 for f, truth in found]))
                share = np.median([f["sd"] / truth for f, truth in found])
                count = format_count(inside, len(found))
                yield f"| {name} | {way} | {len(found)} | {count} | {z:.2f} | {100 * share:.2g} % |"
    yield ""
    apart = [
        (row["sound"]["lambda"]["median"] - row["angles"]["lambda"]["median"])
        / np.hypot(row["sound"]["lambda"]["sd"], row["angles"]["lambda"]["sd"])
        for row in rows
    ]
    ratio = [row["sound"]["lambda"]["sd"] / row["angles"]["lambda"]["sd"] for row in rows]
    if rows:
        yield from (
            "λ by sound less λ by angles, over their joint standard deviation: RMS"
            f" {np.sqrt(np.mean(np.square(apart))):.2f}. The standard deviation of",
            f"λ by sound is {np.median(ratio):.1f} times that by angles (median). Effective samples of a calibration by"
            f" sound: {min(row['sound']['effective'] for row in rows):.0f} at least.",
            "",
        )


def clicks(rows: Sequence[dict[str, Any]]) -> Iterator[str]:
    """Lines of the part on clicks."""
    yield from (
        "# Cradles by their sound",
        "",
        "`python -m studies.sound`. `tests/reference/click_sound.py` makes the recordings, and shares no code with the",
        "package: pressure pulses of simulated impacts, modes of the frame, a room that reverberates for 0.2 to 0.8 s,",
        "music, speech and hiss; 44.1 or 48 kHz; WAV, FLAC or OGG (Vorbis). A minute each. The dB are the peak of the",
        "loudest click over the RMS of the background; within the minute clicks become 20 dB softer.",
        "",
        "## Clicks",
        "",
        f"Impacts are fast above {CLASSES[0]:g} m/s, slow below {CLASSES[1]:g} m/s. A click within 2 ms of an impact",
        "is of it. Errors of instants are less the median of their recording. False clicks: all, and those that are",
        "not marked as doubtful.",
        "",
    )  # fmt: skip
    for bobs in (2, 3):
        some = [row for row in rows if row["bobs"] == bobs]
        if not some:
            continue
        yield from (
            f"{len(some)} recordings of {bobs} bobs:",
            "",
            "| background | recordings | found | fast | middling | slow | false | not doubtful | RMS error [µs] |"
            " median error [µs] |",
            "|---|" + "---|" * 9,
        )
        kinds = [(f"{name}, {snr:g} dB", [r for r in some if (r["background"], r["snr"]) == (name, snr)])
                 for name, snr in CONDITIONS]  # fmt: skip
        for name, part in (*kinds, ("all", some)):
            if part:
                shares = " | ".join([_share(part), *(_share(part, k) for k in range(3))])
                false = sum(row["false"] for row in part), sum(row["false_not_doubtful"] for row in part)
                yield (f"| {name} | {len(part)} | {shares} | {false[0]} | {false[1]} | {_microseconds(part, 'rms')} |"
                       f" {_microseconds(part, 'median')} |")  # fmt: skip
        yield ""
    coded = [row for row in rows if row["bobs"] == 2]
    yield from ("| file, two bobs | recordings | found | RMS error [µs] |", "|---|---|---|---|")
    for kind in sorted({row["format"] for row in coded}):
        part = [row for row in coded if row["format"] == kind]
        yield f"| {kind} | {len(part)} | {_share(part)} | {_microseconds(part, 'rms')} |"
    yield ""
