"""From pixels to angles: the vertical, the scale and the pivots, from the swings themselves.

The arc of a bob is level where it hangs: that gives the vertical. The distance of neighbours at rest, 2R(1 + δ), gives
the scale along the row, in which a camera that looks from the side foreshortens the swings alike; of a single bob its
own disc does. The period of free flights gives the distance of the pivots, g (T/2π)², which the shallow arcs tell
badly: strings stretch by half of what these are high.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.ndimage import maximum_filter1d

from cradle_env.cradle import Cradle
from identification.apparatus.video.tracking import Tracks
from identification.storage.files import ExperimentError

#: Part of a radius by which neighbours must be apart for a bob to count as in flight.
_CLEAR = 0.15
#: Flights used: duration in parts of a period at least, and way in radii.
_LONG, _WIDE = 0.25, 0.5
#: Frames of a flight at least, and of stillness at the beginning.
_LEAST, _STILL = 5, 10
#: By how much bobs hang elsewhere than where they are seen to be still, and than the row says, in radii; by how much a
#: flight departs from a pendulum's [pixels], as strings stretch; 1 sigma.
_STILL_SD, _ELSEWHERE, _UNEVEN = 0.01, 0.05, 0.5
#: By how much bobs of a row hang at unequal heights, in diameters, 1 sigma.
_UNLEVEL = 0.02
#: Periods from which on their scatter tells the error of the slope of the arcs; what perspective adds to that slope
#: [rad], 1 sigma: a camera turned by 2 degrees that sees the bobs 3 degrees from the middle of its picture.
_FEW, _TURN_SD = 5, 2e-3
#: How often the picture is turned upright by the arcs as it shows them.
_TURNS = 2
#: Errors of the scale, 1 sigma: of a disc's radius by what counts as its edge [pixels], and of any by lens and
#: perspective.
_EDGE_SD, _LENS_SD = 0.15, 2e-3


@dataclass(frozen=True, eq=False)
class Geometry:
    """How the cradle lies in the picture, each number with its standard deviation.

    roll [rad]: by which the picture is turned clockwise; scale [pixels/m] along the row; period [s] of small swings;
    reach [m]: from pivot to centre as the period has it; arc [m]: as the curvature of the arcs has it; rest (N, 2)
    [pixels]: where bobs hang in the turned picture; rest_sd (N,); zero_sd [rad]: of the angles at rest.
    """

    roll: tuple[float, float]
    scale: tuple[float, float]
    period: tuple[float, float]
    reach: tuple[float, float]
    arc: tuple[float, float]
    rest: np.ndarray
    rest_sd: np.ndarray

    @property
    def zero_sd(self) -> float:
        """Of angles at rest [rad]."""
        return float(np.max(self.rest_sd)) / (self.scale[0] * self.reach[0])

    @property
    def angle_scale_sd(self) -> float:
        """Of the factor by which all angles may be off."""
        parts = (self.scale[1] / self.scale[0], self.reach[1] / self.reach[0], _LENS_SD)
        return float(np.sqrt(np.sum(np.square(parts))))

    def turned(self, places: np.ndarray) -> np.ndarray:
        """Places [pixels] in a picture whose vertical is upright."""
        return places @ _turn(self.roll[0]).T

    def pivots(self) -> np.ndarray:
        """(N, 2) in the picture as it is [pixels]."""
        upright = self.rest - np.array([0.0, self.scale[0] * self.reach[0]])
        return upright @ _turn(self.roll[0])

    def polar(self, places: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Angles [rad] and distances from the pivots [m] of places (T, N, 2)."""
        height = self.scale[0] * self.reach[0]
        across, down = np.moveaxis(self.turned(places) - self.rest, -1, 0)
        return np.arctan2(across, height + down), np.hypot(across, height + down) / self.scale[0]


def _turn(roll: float) -> np.ndarray:
    return np.array([[np.cos(roll), np.sin(roll)], [-np.sin(roll), np.cos(roll)]])


def geometry(tracks: Tracks, cradle: Cradle, rest: np.ndarray, name: str) -> Geometry:
    """From tracks; rest: (N, 2), about where the bobs hang [pixels]; name: of the film. ExperimentError where there is
    no free swing to take a period from."""
    radius = float(np.nanmedian(tracks.radii))
    gravity = cradle.gravity * radius / cradle.radius
    # The slope of an arc is that where its bob hangs; where it hangs across the picture, the upright picture says.
    roll = 0.0, 0.0
    for _ in range(_TURNS):
        turned, (_, middle, *_) = _upright(tracks, rest, roll[0], radius, gravity, name)
        arcs, curvature, levels = _level(tracks.times, turned[..., 0] - middle, turned[..., 1])
        further = _roll(arcs, levels, 2.0 * radius)
        roll = roll[0] + further[0], further[1]
    turned, (omega, middle, middle_sd, amplitude) = _upright(tracks, rest, roll[0], radius, gravity, name)
    scale = _scale(middle, middle_sd, radius, cradle)
    # A swing of half-width A lasts longer by (A/L)²/16: Landau & Lifshitz, Mechanics, § 11.
    length = cradle.gravity / omega[0] ** 2
    slower = 1.0 + (amplitude / (scale[0] * length)) ** 2 / 16.0
    period = 2.0 * np.pi / omega[0] / slower
    part = omega[1] / omega[0]
    reach = cradle.gravity * (period / (2.0 * np.pi)) ** 2
    _, curvature, levels = _level(tracks.times, turned[..., 0] - middle, turned[..., 1])
    arc = 1.0 / (2.0 * max(curvature[0], 1e-12))
    arc_sd = arc * curvature[1] / max(curvature[0], 1e-12)
    return Geometry(
        roll,
        scale,
        (period, period * part),
        (reach, 2.0 * reach * part),
        (arc / scale[0], arc_sd / scale[0]),
        np.column_stack([middle, levels]),
        middle_sd,
    )


_Swings = tuple[tuple[float, float], np.ndarray, np.ndarray, float]


def _upright(
    tracks: Tracks, rest: np.ndarray, roll: float, radius: float, gravity: float, name: str
) -> tuple[np.ndarray, _Swings]:
    """Places in the picture turned by a roll [pixels], and what `_swings` says of them; gravity [pixels/s²]."""
    turned = tracks.places @ _turn(roll).T
    x = turned[..., 0]
    hanging = _hanging(x, (rest @ _turn(roll).T)[:, 0], radius)
    return turned, _swings(tracks.times, x, _flights(tracks.times, x, radius), hanging, radius, gravity, name)


def _level(
    times: np.ndarray, x: np.ndarray, y: np.ndarray
) -> tuple[tuple[float, float], tuple[float, float], np.ndarray]:
    """Slope of the arcs where the bobs hang, as an angle, and half their curvature [1/pixel], with their errors; and
    how far down each is there [pixels], (N,). x, y (T, N): from where they hang, and in the picture [pixels].

    Strings stretch, settle and vibrate as the motion begins, and a bob is then on one side of its arc. Each period of
    each bob therefore has a height and a slope of its own, and the slope is their median.
    """
    number = np.floor((times - times[0]) / _about_period(times, x)).astype(int)
    designs, heights = [], []
    for bob in range(x.shape[1]):
        for one in np.unique(number):
            rows = (number == one) & np.isfinite(x[:, bob]) & np.isfinite(y[:, bob])
            if rows.sum() >= _LEAST:
                design = np.column_stack([x[rows, bob], -(x[rows, bob] ** 2)])
                designs.append(design - design.mean(axis=0))
                heights.append(y[rows, bob] - y[rows, bob].mean())
    normal = np.linalg.pinv(sum(design.T @ design for design in designs))
    pooled = normal @ sum(design.T @ height for design, height in zip(designs, heights, strict=True))
    left = [height - design @ pooled for design, height in zip(designs, heights, strict=True)]
    # Residuals of one period are alike, those of different ones are not.
    pulls = np.array([design.T @ residual for design, residual in zip(designs, left, strict=True)])
    errors = np.sqrt(np.diag(normal @ pulls.T @ pulls @ normal))
    width = np.array([design[:, 0] @ design[:, 0] for design in designs])
    moving = width > 0.1 * width.max()  # a bob that hangs still has no arc
    slopes = pooled[0] + pulls[moving, 0] / width[moving]
    slope = float(np.median(slopes))
    scatter = 1.4826 * float(np.median(np.abs(slopes - slope)))
    few = moving.sum() < _FEW
    slope_sd = float(errors[0]) if few else 1.25 * scatter / np.sqrt(moving.sum())
    levels = np.nanmedian(y - slope * x + pooled[1] * x**2, axis=0)
    return (float(np.arctan(slope)), float(np.hypot(slope_sd, _TURN_SD))), (float(pooled[1]), float(errors[1])), levels


def _about_period(times: np.ndarray, x: np.ndarray) -> float:
    """Of the strongest component of all motions [s]."""
    centred = np.nan_to_num(x - np.nanmean(x, axis=0))
    power = np.sum(np.abs(np.fft.rfft(centred, axis=0)) ** 2, axis=1)
    return float((times[-1] - times[0]) / (1 + np.argmax(power[1:])))


def _roll(arcs: tuple[float, float], levels: np.ndarray, diameter: float) -> tuple[float, float]:
    """What the slope of the arcs and that of the row say of the roll together; lengths differ by a part of a bob."""
    if len(levels) == 1:
        return arcs
    number = np.arange(len(levels)) - (len(levels) - 1) / 2.0
    row = number @ levels / (number @ number) / diameter, _UNLEVEL / np.sqrt(number @ number)
    share = arcs[1] ** -2, row[1] ** -2
    return float((share[0] * arcs[0] + share[1] * np.arctan(row[0])) / sum(share)), float(sum(share) ** -0.5)


def _flights(times: np.ndarray, x: np.ndarray, radius: float) -> list[tuple[int, slice]]:
    """(bob, frames) in which a bob is seen and touches no other."""
    gap = np.diff(x, axis=1)
    touch = np.nanquantile(gap, 0.02) if gap.size else -np.inf
    free = np.isfinite(x)
    # At a low frame rate an impact falls between two frames, neither of which shows the bobs in touch: they count as
    # apart where their gap could not close within a frame at the fastest pace of the frames around.
    change = np.abs(np.diff(gap, axis=0, prepend=gap[:1], append=gap[-1:]))
    pace = maximum_filter1d(np.nan_to_num(np.maximum(change[1:], change[:-1])), 3, axis=0)
    with np.errstate(invalid="ignore"):
        apart = gap - pace > touch + _CLEAR * radius
    free[:, :-1] &= apart
    free[:, 1:] &= apart
    found = []
    for bob in range(x.shape[1]):
        edges = np.flatnonzero(np.diff(np.concatenate([[0], free[:, bob].astype(int), [0]])))
        for first, last in zip(edges[::2], edges[1::2], strict=True):
            # A bob that is held, or hangs until it is struck, is not in flight; one that turns stays for a frame or
            # two.
            moved = np.flatnonzero(np.abs(x[first:last, bob] - x[first, bob]) > _CLEAR * radius)
            away = int(moved[0]) if len(moved) else last - first
            begins = first + (away if away > _STILL else 1)
            # The first and last frames may average over an impact.
            if last - 1 - begins >= _LEAST:
                found.append((bob, slice(begins, last - 1)))
    return found


def _swings(
    times: np.ndarray,
    x: np.ndarray,
    flights: list[tuple[int, slice]],
    hanging: tuple[np.ndarray, np.ndarray],
    radius: float,
    gravity: float,
    name: str,
) -> _Swings:
    """ω of all flights, each bob's middle with its error [pixels], and the RMS half-width; gravity [pixels/s²]."""
    from scipy.optimize import fminbound

    parts, (about, about_sd) = [], hanging
    for bob, frames in flights:
        moved = np.abs(x[frames, bob] - about[bob])
        if moved.max() > _WIDE * radius and np.ptp(x[frames, bob]) > 0.25 * moved.max():
            parts.append((bob, times[frames], x[frames, bob]))
    parts = _pieces(parts)
    if not parts:
        raise ExperimentError(
            f"{name}: no bob is seen to swing freely; film from the release on, at 30 frames/s or more"
        )
    bobs = sorted({bob for bob, *_ in parts})
    swung = parts

    def third_harmonic(omega: float, middle: np.ndarray) -> list[tuple[int, np.ndarray, np.ndarray]]:
        # x = A cos φ − (3/64) (A ω²/g)² A cos 3φ of a pendulum. Left in, it would pass for a lower frequency about
        # another middle: half a swing hardly tells them.
        found = []
        for bob, t, values in parts:
            A, shift = _wave(omega, t, values - middle[bobs.index(bob)])
            phase = omega * (t - t.mean()) - shift
            third = 3.0 / 64.0 * (A * omega**2 / gravity) ** 2 * A * np.cos(3.0 * phase)
            found.append((bob, t, values + third))
        return found

    def fitted(omega: float) -> tuple[float, np.ndarray, np.ndarray, int]:
        # Each flight has a cosine and a sine of its own; what is common to a bob is left for its middle.
        total, count = 0.0, 0
        normal, pull = np.zeros(len(bobs)), np.zeros(len(bobs))
        for bob, t, values in swung:
            phase = omega * (t - t.mean())
            basis, _ = np.linalg.qr(np.column_stack([np.cos(phase), np.sin(phase)]))
            one = np.ones(len(t)) - basis @ (basis.T @ np.ones(len(t)))
            free = values - basis @ (basis.T @ values)
            k = bobs.index(bob)
            normal[k] += one @ one
            pull[k] += one @ free
            total += free @ free
            count += len(t) - 2
        normal, pull = normal + prior, pull + prior * known
        middle = pull / normal
        total += float(prior @ known**2)
        return float(total - pull @ middle), middle, normal, count - len(bobs)

    prior, known = (_UNEVEN / about_sd[bobs]) ** 2, about[bobs]
    # Between impacts a bob flies for half a period, but two that nearly agree stay apart for longer: the longest
    # flight bounds the frequency from below, the usual one from above. Alone on its strings each piece is a whole one.
    lengths = np.array([t[-1] - t[0] for _, t, _ in parts])
    grid = (1.0 if len(about) > 1 else 2.0) * np.pi * np.geomspace(0.5 / lengths.max(), 1.4 / np.median(lengths), 100)
    cost = [fitted(omega)[0] for omega in grid]
    best = int(np.argmin(cost))
    low, high = grid[max(best - 1, 0)], grid[min(best + 1, len(grid) - 1)]
    omega = float(grid[best])
    for _ in range(3):
        swung = third_harmonic(omega, fitted(omega)[1])
        omega = float(np.asarray(fminbound(lambda w: fitted(w)[0], low, high, xtol=1e-6 * low)))
    rss, middle, normal, freedom = fitted(omega)
    wide = [_wave(omega, t, values - middle[bobs.index(bob)])[0] for bob, t, values in swung]
    step = 1e-3 * omega
    bend = (fitted(omega + step)[0] - 2.0 * rss + fitted(omega - step)[0]) / step**2
    # Residuals are what strings and codec leave, and alike over several frames.
    spread = rss / max(freedom, 1) * 5.0
    omega_sd = float(np.sqrt(2.0 * spread / max(bend, 1e-12)))
    middles, sds = about.copy(), about_sd.copy()
    middles[bobs], sds[bobs] = middle, np.sqrt(spread / np.maximum(normal, 1e-12))
    return (omega, omega_sd), middles, sds, float(np.sqrt(np.mean(np.square(wide))))


def _wave(omega: float, t: np.ndarray, x: np.ndarray) -> tuple[float, float]:
    """A and φ of x ≈ A cos(ω (t − mean t) − φ)."""
    phase = omega * (t - t.mean())
    cosine, sine = np.linalg.lstsq(np.column_stack([np.cos(phase), np.sin(phase)]), x, rcond=None)[0]
    return float(np.hypot(cosine, sine)), float(np.arctan2(sine, cosine))


def _pieces(parts: list[tuple[int, np.ndarray, np.ndarray]]) -> list[tuple[int, np.ndarray, np.ndarray]]:
    """Flights of a bob without neighbours never end: they are cut where it passes its outermost points."""
    found = []
    for bob, t, values in parts:
        turns = np.flatnonzero(np.diff(np.sign(values - values.mean())) != 0)
        if len(turns) < 4:
            found.append((bob, t, values))
            continue
        for first, last in zip(turns[:-2:2], turns[2::2], strict=False):
            found.append((bob, t[first : last + 1], values[first : last + 1]))
    return [piece for piece in found if len(piece[1]) >= _LEAST]


def _hanging(x: np.ndarray, about: np.ndarray, radius: float) -> tuple[np.ndarray, np.ndarray]:
    """About where bobs hang, with its error [pixels]: as those do that are still at the beginning, and neighbours of
    these."""
    still = {}
    for bob, column in enumerate(x.T):
        early = column[np.isfinite(column)][:_STILL]
        if len(early) == _STILL and np.ptp(early) < 0.06 * radius and abs(np.median(early) - about[bob]) < radius:
            still[bob] = float(np.median(early))
    steps = 2.0 * radius * np.arange(len(about))
    middle = float(np.median([place - steps[bob] for bob, place in still.items()])) if still else about[0] - steps[0]
    places = np.array([still.get(bob, middle + step) for bob, step in enumerate(steps)])
    return places, radius * np.array([_STILL_SD if bob in still else _ELSEWHERE for bob in range(len(about))])


def row_spacing(cradle: Cradle) -> float:
    """Mean distance of neighbours at rest [m]; of a single bob its diameter."""
    return 2.0 * cradle.radius * (1.0 + (float(np.mean(cradle.gaps)) if cradle.bobs > 1 else 0.0))


def _scale(middle: np.ndarray, middle_sd: np.ndarray, radius: float, cradle: Cradle) -> tuple[float, float]:
    """Pixels per metre along the row."""
    disc = radius / cradle.radius, _EDGE_SD / cradle.radius
    if len(middle) == 1:
        return disc
    number = np.arange(len(middle)) * row_spacing(cradle)
    weights = 1.0 / middle_sd
    (scale, _), covariance = np.polyfit(number, middle, 1, w=weights, cov="unscaled")
    row = float(scale), float(np.sqrt(covariance[0, 0]))
    share = disc[1] ** -2, row[1] ** -2
    if abs(row[0] - disc[0]) > 3.0 * np.hypot(row[1], disc[1]):
        return row[0], max(row[1], 0.5 * abs(row[0] - disc[0]))
    return (share[0] * disc[0] + share[1] * row[0]) / sum(share), sum(share) ** -0.5
