"""results.md: what the films say, as counts with their intervals."""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np
from scipy.stats import binomtest

from studies.film.draw import FRAMES

#: Asked: RMS error of the centres [pixels], and error of an impact's time [frames].
CENTRES, TIMES = 0.1, 0.1


def share(count: int, of: int) -> str:
    """A count, and its share with the 95 % interval of Clopper and Pearson."""
    if of == 0:
        return "–"
    ends = binomtest(count, of).proportion_ci(method="exact")
    return f"{count} of {of}, {100 * count / of:.3g} % ({100 * ends.low:.2g} to {100 * ends.high:.3g} %)"


def _rms(rows: Sequence[dict[str, Any]]) -> np.ndarray:
    """Of each film, over frames, bobs and both coordinates [pixels]."""
    return np.array([np.sqrt(row["squares"] / (2 * row["readings"])) for row in rows])


def _spread(rows: Sequence[dict[str, Any]], value: Any) -> tuple[float, float]:
    """Ends of the 95 % bootstrap interval of a value over films."""
    rng = np.random.default_rng(0)
    drawn = [value([rows[k] for k in rng.integers(len(rows), size=len(rows))]) for _ in range(1000)]
    return float(np.quantile(drawn, 0.025)), float(np.quantile(drawn, 0.975))


def _times(rows: Sequence[dict[str, Any]]) -> np.ndarray:
    return np.concatenate([np.zeros(0), *(row["impacts"] for row in rows)])


def page(rows: Sequence[dict[str, Any]]) -> str:
    """The page of some rows."""
    tracked = [row for row in rows if "squares" in row and row["readings"]]
    angles = [row for row in tracked if "angle_scale" in row]
    codes = sorted({row["code"] for row in rows})
    longest = sum(row["duration"] > 19.9 for row in tracked)
    lines = [
        "# How well films are measured",
        "",
        "`python -m studies.film`. Films of simulated cradles of 1 to 5 bobs, 30 to 960 frames/s, seen by a camera",
        "with blur, noise, glare, a pattern behind, a hand, something that hides a bob, and tilts of about a degree,",
        "through H.264, MPEG-4, MJPEG or VP9. Nobody looked at these films while faults were mended. A film has",
        f"{FRAMES} frames at most: {longest} of {len(tracked)} last 20 s, all together",
        f"{sum(row['duration'] for row in tracked):.0f} s. From number 1560 on, only films of 20 s were made. Code:",
        f"{', '.join(codes)}. Intervals are of 95 %; those of an RMS are bootstrapped over films.",
        "",
    ]
    if not tracked:
        return "\n".join([*lines, "No film has been measured.", ""])
    rms, times = _rms(tracked), np.abs(_times(tracked))
    together = float(np.sqrt(np.mean(rms**2)))
    low, high = _spread(tracked, lambda some: float(np.sqrt(np.mean(_rms(some) ** 2))))
    readings = sum(row["readings"] for row in tracked)
    places = sum(row["places"] for row in tracked)
    refused = len(rows) - len(tracked)
    scale = np.array([(row["angle_scale"] - 1.0) / row["angle_scale_sd"] for row in angles])
    off = np.array([abs(row["angle_scale"] - 1.0) for row in angles])
    lines += [
        "| asked | found |",
        "|---|---|",
        f"| films with all bobs found | {share(len(tracked), len(rows))}; {refused} refused or miscounted |",
        f"| RMS error of centres ≤ {CENTRES} pixels, all films | {together:.3f} ({low:.3f} to {high:.3f}) pixels |",
        f"| films with an RMS error ≤ {CENTRES} pixels | {share(int((rms <= CENTRES).sum()), len(rms))} |",
        f"| largest RMS error of a film | {rms.max():.3f} pixels |",
        f"| centres more than 1 pixel off | {sum(row['wrong'] for row in tracked)} of {readings} |",
        f"| films with a swapped identity: 0 | {share(sum(row['swapped'] > 0 for row in tracked), len(tracked))} |",
        f"| bobs marked missing, nothing before them | {sum(row['missing'] for row in tracked)} of {places} |",
        "| bobs marked missing while a hand or a thing hides one |"
        f" {sum(row['covered_missing'] for row in tracked)} of {sum(row['covered_places'] for row in tracked)} |",
    ]
    if len(times):
        low, high = _spread(
            tracked, lambda some: float(np.sqrt(np.mean(_times(some) ** 2))) if len(_times(some)) else 0
        )
        lines += [
            f"| RMS error of impact times ≤ {TIMES} frames | {np.sqrt(np.mean(times**2)):.3f} ({low:.3f} to"
            f" {high:.3f}) frames |",
            f"| impacts timed to {TIMES} frames | {share(int((times <= TIMES).sum()), len(times))} |",
        ]
    if len(angles):
        lines += [
            f"| films with a geometry | {share(len(angles), len(tracked))} |",
            "| factor of the angles inside its 95 % interval |"
            f" {share(int((np.abs(scale) < 1.96).sum()), len(scale))} |",
            f"| error of that factor, median and largest | {100 * np.median(off):.2g} %, {100 * off.max():.2g} % |",
        ]
    lines += [
        "",
        "The impacts that are timed are those of bobs at the ends that change a velocity by more than 0.1 m/s, with a",
        "flight of 0.3 s or six frames before and after. The two flights meet at the instant. The study takes the",
        "frame of the impact from the simulation; it does not search for it.",
        "",
        "| frames/s | films | RMS of centres [pixels] | impacts | RMS of their times [frames] |",
        "|---|---|---|---|---|",
    ]
    for rate in sorted({row["rate"] for row in tracked}):
        some = [row for row in tracked if row["rate"] == rate]
        timed = _times(some)
        shown = f"{np.sqrt(np.mean(timed**2)):.3f}" if len(timed) else "–"
        lines.append(f"| {rate:g} | {len(some)} | {np.sqrt(np.mean(_rms(some) ** 2)):.3f} | {len(timed)} | {shown} |")
    lines += ["", "| codec | films | RMS of centres [pixels] |", "|---|---|---|"]
    for codec in sorted({row["codec"] for row in tracked}):
        some = [row for row in tracked if row["codec"] == codec]
        lines.append(f"| {codec} | {len(some)} | {np.sqrt(np.mean(_rms(some) ** 2)):.3f} |")
    return "\n".join([*lines, ""])
