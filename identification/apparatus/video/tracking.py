"""Which disc is which bob, frame by frame.

Bobs in a row cannot pass through each other, so their order along the row never changes: the discs of a frame, from
left to right, are the bobs from first to last. Where some are hidden, or something else looks like a bob, the
assignment with the most evidence is taken of all that keep the order and leave room for the bobs between. Each frame
is decided anew; what is predicted from earlier ones weighs little. At the end each reading is compared with how the
same bob looks in the rest of the film: a round end of what hides it is not the bob. Where not all bobs are seen, the
order leaves several answers. Such readings count if bobs can be followed to them from a frame in which all are seen.
"""

from __future__ import annotations

import time as clock
from dataclasses import dataclass

import numpy as np

from identification.apparatus.video.discs import Discs, directions, peaks, reduced, response
from identification.apparatus.video.edges import ANGLES, RADIUS_SD, Centres, centres
from identification.apparatus.video.frames import Film
from identification.apparatus.video.survey import Survey
from identification.progress import Progress

#: Radius [pixels] to which pictures are reduced where discs are looked for.
_SEARCHED = 7.0
#: Least response of a disc that may be a bob, and of one that needs no further proof.
_FAINT, _CLEAR = 0.3, 0.55
#: Distance of two bobs over their radius, at least: 2, less what blur and reduction err.
_APART = 1.75
#: What a bob that is not found costs, in units of the response, and how much a distance from where it should be may.
_MISSED, _FAR = 0.25, 0.6
#: By how much the radius of the first look may be wrong [pixels], 1 sigma; part of the rays that cross an edge where a
#: bob is seen well; how many looks tell where an edge usually is; waves of an outline around a bob.
_FIRST_SD, _WELL, _LOOKS, _ORDERS = 1.0, 0.9, 5, (2, 3, 4)
#: A bob looks alike all over a film. Its brightness inside the edge departs from its median by this part of its
#: contrast at most, or by this many standard deviations where light or reflections change it; its edge lies within
#: this many times the median scatter. Bobs seen whole stay within 0.1 and 2.2; the end of a hand is off by 0.4 or more.
_OTHER, _OTHER_SD, _ROUGH = 0.25, 6.0, 2.5
#: Time after which a bob that was not seen is expected where it hangs [s].
_FRESH = 0.1
#: Quantile of the speeds in full frames that counts as the largest: a single wrong centre is above it. What a bob may
#: go beyond that, in radii: errors of places, and of this speed.
_FASTEST, _SLACK = 0.999, 0.25
#: Times in WebM and Matroska are whole milliseconds, half a frame at 500 frames/s.
_TICK = 1e-3
#: Part of the time between two frames that a shutter is taken to be open.
_OPEN = 0.5


@dataclass(frozen=True, eq=False)
class Tracks:
    """Bobs over a film: times (T,) [s]; places (T, N, 2) [pixels], nan where a bob is not seen; scatter (T, N), the RMS
    distance of a bob's edge from its outline [pixels]; radii (T, N)."""

    times: np.ndarray
    places: np.ndarray
    scatter: np.ndarray
    radii: np.ndarray


def track(film: Film, found: Survey, progress: Progress = lambda *_: None) -> Tracks:
    """Follows the bobs through a film; one frame is held at a time."""
    tracker = _Tracker(found, _outlines(found))
    times, rows, began = [], [], clock.monotonic()
    for number, (time, picture) in enumerate(film.gray(), 1):
        times.append(time)
        rows.append(_row(tracker.step(time, picture)))
        if number % 20 == 0:
            rate = number / max(clock.monotonic() - began, 1e-9)
            progress("track", number / found.frames, f"frame {number} of {found.frames}, {rate:.0f} frames/s")
    table = np.array(rows)
    table[strange(table[..., 2], table[..., 4], table[..., 5])] = np.nan
    table = identified(table, np.array(times), found.radius)
    return Tracks(even(np.array(times), _TICK / film.slow_motion), table[..., :2], table[..., 2], table[..., 3])


def _row(seen: Centres) -> np.ndarray:
    """(N, 6): place, scatter, radius, level and contrast of each bob, nan where it is not seen."""
    row = np.column_stack([seen.places, seen.scatter, seen.radii, seen.level, seen.contrast])
    row[np.isnan(seen.places[:, 0])] = np.nan
    return row


def _outlines(found: Survey) -> np.ndarray:
    """Of each bob, (N, rays) [pixels], as it is usually seen in the looks from all over the film.

    Lens, shades and codec make an outline not quite a circle. Beside a neighbour half of an edge is hidden, so an
    outline that is wrong by a few hundredths of a pixel moves the centre by as much, each time that bobs touch.
    """
    outlines = np.full((len(found.rest), len(ANGLES)), found.radius)
    looks = _Tracker(found, outlines.copy(), _FIRST_SD)
    seen = [looks.step(float(number), picture) for number, picture in enumerate(found.looks)]
    edges = np.array([np.where(one.seen[:, None] > _WELL, one.edges, np.nan) for one in seen])
    # A centre is the mean of its outline: there is nothing of the first order.
    waves = [np.cos(order * ANGLES + phase) for order in _ORDERS for phase in (0.0, 0.5 * np.pi)]
    basis = np.column_stack([np.ones_like(ANGLES), *waves])
    for bob in range(len(outlines)):
        often = np.isfinite(edges[:, bob]).sum(axis=0) >= _LOOKS
        if often.sum() > len(ANGLES) / 2:
            usual = np.nanmedian(edges[:, bob, often], axis=0)
            outlines[bob] = basis @ np.linalg.lstsq(basis[often], usual, rcond=None)[0]
    return outlines


def identified(table: np.ndarray, times: np.ndarray, radius: float) -> np.ndarray:
    """Rows of readings (T, N, ...), each moved to the bob that it is of; nan where that is not known.

    table: its last axis begins with x, y [pixels]; times: (T,) [s]. Where all the bobs of a frame are seen, their order
    tells which is which. From such a frame on, and back from it, bobs are followed: see `_followed`. Unknown are
    readings that are reached from neither side, that are one bob from before and another from behind, and two readings
    of a frame that would be the same bob.
    """
    places = table[..., :2]
    full = np.array(np.isfinite(places).all(axis=(1, 2)))
    both = full[1:] & full[:-1]
    steps = np.linalg.norm(np.diff(places, axis=0), axis=-1) / np.diff(times)[:, None]
    fastest = np.quantile(steps[both], _FASTEST) if both.any() else np.inf
    forward = _followed(places, times, full, radius, fastest)
    back = _followed(places[::-1], -times[::-1], full[::-1], radius, fastest)[::-1]
    bob = _of_one(np.where(forward < 0, back, np.where((back < 0) | (back == forward), forward, -1)))
    moved = np.full_like(table, np.nan)
    frame, column = np.nonzero(bob >= 0)
    moved[frame, bob[frame, column]] = table[frame, column]
    return moved


def _followed(places: np.ndarray, times: np.ndarray, full: np.ndarray, radius: float, fastest: float) -> np.ndarray:
    """Which bob each reading (T, N) is, -1 where that is not known; times increase. fastest: of all bobs [pixels/s].

    When a bob was last seen, all others were at least two radii away from it. A reading is of this bob if this bob can
    have come there since, and none of the others can.
    """
    frames, bobs = places.shape[:2]
    bob = np.full((frames, bobs), -1)
    last, seen_at = np.full((bobs, 2), np.inf), np.full(bobs, -np.inf)
    for k in range(frames):
        if full[k]:
            bob[k] = np.arange(bobs)
        elif np.isfinite(places[k]).any():
            way = fastest * (times[k] - seen_at)
            apart = np.linalg.norm(places[k, :, None] - last, axis=-1)
            possible = (apart <= way + _SLACK * radius) & (apart + way < 2.0 * radius)
            bob[k] = _of_one(np.where(possible.sum(axis=1) == 1, possible.argmax(axis=1), -1)[None])[0]
        got = np.flatnonzero(bob[k] >= 0)
        last[bob[k, got]], seen_at[bob[k, got]] = places[k, got], times[k]
    return bob


def _of_one(bob: np.ndarray) -> np.ndarray:
    """Bobs of readings (T, N), -1 for those of a frame that are the same bob."""
    same = (bob[:, :, None] == bob[:, None, :]).sum(axis=2) > 1
    return np.where(same, -1, bob)


def strange(scatter: np.ndarray, level: np.ndarray, contrast: np.ndarray) -> np.ndarray:
    """Which readings (T, N) do not look like the same bob in the rest of the film; nan where a bob is not seen."""
    found = np.zeros(scatter.shape, bool)
    for bob in np.flatnonzero(np.isfinite(scatter).any(axis=0)):
        off = np.abs(level[:, bob] - np.nanmedian(level[:, bob]))
        most = max(_OTHER * abs(np.nanmedian(contrast[:, bob])), _OTHER_SD * 1.4826 * np.nanmedian(off))
        found[:, bob] = (off > most) | (scatter[:, bob] > _ROUGH * np.nanmedian(scatter[:, bob]))
    return found


def even(times: np.ndarray, tick: float) -> np.ndarray:
    """Times (T,) of a constant rate where those given are such, rounded to `tick` [s]; else those given."""
    if len(times) < 3:
        return times
    number = np.arange(len(times))
    line = np.polynomial.Polynomial.fit(number, times, 1)(number)
    return line if np.abs(times - line).max() <= tick else times


class _Tracker:
    def __init__(self, found: Survey, outlines: np.ndarray, radius_sd: float = RADIUS_SD):
        self.rest, self.radius, self.sign = found.rest, found.radius, found.sign
        self.outlines, self.radius_sd = outlines, radius_sd
        self.factor = max(1, round(found.radius / _SEARCHED))
        self.rows = found.top - 3.0 * found.radius, found.bottom + 3.0 * found.radius
        self.last = found.rest.copy()
        self.speed = np.zeros_like(found.rest)
        self.seen_at = np.full(len(found.rest), -np.inf)

    def step(self, time: float, picture: np.ndarray) -> Centres:
        """What is seen of the bobs in the next frame."""
        discs = self._discs(picture)
        fresh = time - self.seen_at < _FRESH
        ago = np.where(fresh, time - self.seen_at, 0.0)
        expected = np.where(fresh[:, None], self.last + self.speed * ago[:, None], self.rest)
        reach = np.where(fresh, 1.0 + 2.0 * np.linalg.norm(self.speed, axis=1) * ago / self.radius, 6.0) * self.radius
        while True:
            chosen = assign(discs, expected, reach, self.radius)
            places = np.full_like(self.rest, np.nan)
            places[chosen >= 0] = discs.places[chosen[chosen >= 0]]
            moved = np.where(np.isfinite(places) & fresh[:, None], places - self.last, 0.0)
            exact = centres(picture, places, self.outlines, self.sign, _OPEN * moved, self.radius_sd)
            got = np.isfinite(exact.places[:, 0])
            without_edge = chosen[(chosen >= 0) & ~got]
            if not len(without_edge):
                break
            # What has no edge is no bob, and must not decide which bobs the others are.
            discs = Discs(np.delete(discs.places, without_edge, axis=0), np.delete(discs.responses, without_edge))
        self._remember(time, exact.places, got)
        return exact

    def _remember(self, time: float, places: np.ndarray, got: np.ndarray) -> None:
        """Only readings that are surely of their bob tell where it is expected next; see `identified`."""
        ago = time - self.seen_at
        near = np.linalg.norm(places - self.last, axis=1) < self.radius
        known = got & (got.all() | (near & (ago < _FRESH)))
        fresh = known & (ago < _FRESH)
        self.speed[known] = 0.0
        self.speed[fresh] = (places[fresh] - self.last[fresh]) / ago[fresh, None]
        self.last[known], self.seen_at[known] = places[known], time

    def _discs(self, picture: np.ndarray) -> Discs:
        """Those in the strip in which the bobs move, in pixels of the picture."""
        top = max(int(self.rows[0]), 0)
        strip = reduced(picture[top : int(self.rows[1]) + 1], self.factor)
        radius = self.radius / self.factor
        found = peaks(self.sign * response(directions(strip), radius), radius, _FAINT, 3 * len(self.rest) + 5)
        shift = (self.factor - 1) / 2.0
        return Discs(found.places * self.factor + shift + np.array([0.0, top]), found.responses)


def assign(discs: Discs, expected: np.ndarray, reach: np.ndarray, radius: float) -> np.ndarray:
    """Which disc each bob is, (N,), -1 for none. expected: (N, 2), reach: (N,), about where it should be [pixels].

    Dynamic programming over the bobs from left to right: as in the alignment of sequences, with a cost for bobs that
    are left out and the order of the others kept.
    """
    order = np.argsort(discs.places[:, 0])
    x = discs.places[order, 0]
    bobs, count = len(expected), len(order)
    apart = np.linalg.norm(discs.places[order][None] - expected[:, None], axis=-1) / reach[:, None]
    gain = discs.responses[order][None] - _FAR * np.minimum(apart**2, 4.0)
    if count == bobs and (discs.responses > _CLEAR).all() and (apart.diagonal() < 1.0).all():
        if (np.diff(x) > _APART * radius).all():
            return order
    # best[j, m]: the most that bobs up to j gain if bob j is disc m, less what is missed.
    best = np.full((bobs, count), -np.inf)
    source = np.full((bobs, count, 2), -1)
    for j in range(bobs):
        best[j] = gain[j] - _MISSED * j
        for i in range(j):
            room = x[None, :] - x[:, None] > _APART * radius * (j - i)
            through = np.where(room, best[i][:, None], -np.inf) - _MISSED * (j - i - 1)
            if count:
                via = through.argmax(axis=0)
                total = through[via, np.arange(count)] + gain[j]
                better = total > best[j]
                best[j, better] = total[better]
                source[j, better, 0], source[j, better, 1] = i, via[better]
    chosen = np.full(bobs, -1)
    if count == 0:
        return chosen
    ends = best - _MISSED * (bobs - 1 - np.arange(bobs))[:, None]
    j, m = np.unravel_index(np.argmax(ends), ends.shape)
    if ends[j, m] <= -_MISSED * bobs:
        return chosen
    while j >= 0:
        chosen[j] = order[m]
        j, m = source[j, m]
    return chosen
