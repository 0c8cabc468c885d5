"""A first look at a film: how large the bobs are, how many, and where they hang."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from identification.apparatus.video.discs import Discs, directions, peaks, reduced, response, vertex
from identification.apparatus.video.frames import Film
from identification.progress import Progress
from identification.storage.files import ExperimentError

#: Frames that are looked at, and pixels that their longer side is reduced to at most.
_LOOKS, _LARGEST = 40, 480
#: Radii that are tried [pixels of a reduced picture], each larger than the last by this factor.
_SMALLEST, _FACTOR = 3.5, 1.12
#: Response from which a peak counts as a disc in the first look.
_LEAST = 0.5


@dataclass(frozen=True, eq=False)
class Survey:
    """What a first look has found [pixels].

    radius: of the bobs; sign: 1 for dark bobs on a bright ground, -1 for bright ones; rest: (N, 2), about where they
    hang, from left to right; top, bottom: rows between which centres have been seen; frames: how many there are; looks:
    those that were looked at.
    """

    radius: float
    sign: int
    rest: np.ndarray
    top: float
    bottom: float
    frames: int
    looks: Sequence[np.ndarray]


def survey(
    film: Film,
    bobs: int | None = None,
    boxes: Sequence[tuple[float, float, float, float]] = (),
    clicks: Sequence[tuple[float, float]] = (),
    progress: Progress = lambda *_: None,
) -> Survey:
    """Looks at frames from all over a film. boxes: (x, y, width, height) of each bob in the first frame, or clicks: a
    point on each; ExperimentError where no row of equal discs is found."""
    pictures, count = _looks(film, progress)
    factor = max(1, -(-max(pictures[0].shape) // _LARGEST))
    small = [directions(reduced(picture, factor)) for picture in pictures]
    given = [(x + w / 2.0, y + h / 2.0) for x, y, w, h in boxes] or list(clicks)
    radii = _radii(small[0][0].shape)
    if boxes:
        size = float(np.median([w + h for _, _, w, h in boxes])) / 4.0 / factor
        radii = size * np.array([0.88, 0.94, 1.0, 1.06, 1.12])
    scores = _scores(small, radii, np.array(given) / factor if clicks else None)
    progress("look", 1.0, "")
    best = np.unravel_index(np.argmax(scores), scores.shape)
    if scores[best] <= 0.0:
        raise ExperimentError(
            f"{film.path}: no discs were found that stay alike over the film; film the bobs from the front, before a"
            " plain ground, or state a box for each (--box)"
        )
    sign, radius = (1, -1)[best[0]], _between(radii, scores[best[0]], int(best[1]))
    found = [peaks(sign * response(one, radius), radius, _LEAST, 40) for one in small]
    rest, top, bottom = _row(film, found, radius, bobs or len(given) or None)
    scale, shift = float(factor), (factor - 1) / 2.0
    return Survey(
        radius * scale, sign, rest * scale + shift, top * scale + shift, bottom * scale + shift, count, pictures
    )  # fmt: skip


def _looks(film: Film, progress: Progress) -> tuple[list[np.ndarray], int]:
    """The first frame and some from all over the film, and how many there are in all."""
    total = film.count()
    step, kept, number = 1, [], 0
    for number, (_, picture) in enumerate(film.gray(), 1):
        if (number - 1) % step == 0:
            kept.append(picture)
            if len(kept) >= 2 * _LOOKS:
                kept, step = kept[::2], 2 * step
        if number % 50 == 0:
            progress("look", number / total if total else 0.0, f"frame {number}")
    return kept, number


def _radii(shape: tuple[int, int]) -> np.ndarray:
    largest = min(shape) / 4.0
    return _SMALLEST * _FACTOR ** np.arange(max(1, int(np.log(max(largest / _SMALLEST, 1.0)) / np.log(_FACTOR)) + 1))


def _scores(small: Sequence[tuple], radii: np.ndarray, clicks: np.ndarray | None) -> np.ndarray:
    """How much of edges speaks for discs of each sign and radius, (2, radii): pixels along edges that agree.

    Where bobs have been clicked on, those within a radius of a click count, in the first frame alone.
    """
    chosen = small[:1] if clicks is not None else small[:: max(1, len(small) // 12)]
    scores = np.zeros((2, len(radii)))
    for one in chosen:
        for k, radius in enumerate(radii):
            map_ = response(one, radius)
            for s, sign in enumerate((1, -1)):
                discs = peaks(sign * map_, radius, _LEAST, 30)
                weights = (discs.responses - 0.4) * radius
                if clicks is not None and len(discs.places):
                    apart = np.linalg.norm(discs.places[:, None] - clicks, axis=-1).min(axis=1)
                    weights = weights[apart < radius]
                scores[s, k] += weights.sum()
    return scores


def _between(radii: np.ndarray, score: np.ndarray, best: int) -> float:
    """The radius of the top of a parabola through the best and its neighbours."""
    if not 0 < best < len(radii) - 1:
        return float(radii[best])
    return float(radii[best] * (radii[best + 1] / radii[best]) ** vertex(*score[best - 1 : best + 2]))


def _row(film: Film, found: Sequence[Discs], radius: float, bobs: int | None) -> tuple[np.ndarray, float, float]:
    """Where the bobs hang, (N, 2), and the highest and lowest centre, of discs in a row."""
    level = float(np.median(np.concatenate([discs.places[:, 1] for discs in found])))
    rows = []
    for discs in found:
        near = (discs.places[:, 1] < level + 1.5 * radius) & (discs.places[:, 1] > level - 6.0 * radius)
        places = discs.places[near]
        rows.append(places[np.argsort(places[:, 0])])
    counts = np.array([len(row) for row in rows])
    if bobs is None:
        bobs = int(np.argmax(np.bincount(counts[counts > 0])))
    whole = np.array([row for row in rows if len(row) == bobs])
    if len(whole) == 0:
        raise ExperimentError(
            f"{film.path}: {bobs} bobs were not seen together in any of {len(rows)} frames, but"
            f" {int(np.median(counts))} discs; state --bobs, or a box for each bob in the first frame (--box)"
        )
    steps = 2.0 * radius * (np.arange(bobs) - (bobs - 1) / 2.0)
    middle = float(np.median(whole[:, :, 0] - steps))
    low, high = float(whole[..., 1].min()), float(np.quantile(whole[..., 1], 0.9))
    return np.column_stack([middle + steps, np.full(bobs, high)]), low, float(whole[..., 1].max())
