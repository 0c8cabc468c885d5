"""How far what is measured in a film is from what is true of it."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np

from identification.apparatus.video.frames import Film
from identification.apparatus.video.geometry import geometry
from identification.apparatus.video.survey import survey
from identification.apparatus.video.tracking import Tracks, track
from studies.film.made import Case, Truth

#: A centre that is this far off is counted as wrong [pixels].
_WRONG = 1.0
#: Flights on either side of an impact: at least this long [s], half of what a bob flies, and of this many frames.
_FLIGHT, _LEAST = 0.3, 5
#: Impacts of slower bobs are not timed: a change of velocity [m/s].
_SLOW = 0.1


def judge(path: Path, case: Case, truth: Truth) -> dict[str, Any]:
    """Errors of the centres [pixels], counts of frames and bobs, times of impacts [frames], factor of the angles.

    Raises ValueError for a film that the program refuses.
    """
    film = Film(path)
    found = survey(film)
    if len(found.rest) != case.bobs:
        return {"bobs_found": len(found.rest)}
    tracks = track(film, found)
    error = tracks.places - truth.places
    seen = np.isfinite(error[..., 0])
    apart = np.linalg.norm(tracks.places[:, :, None] - truth.places[:, None], axis=-1)
    nearest = np.where(seen, np.nan_to_num(apart, nan=np.inf).argmin(axis=2), np.arange(case.bobs))
    covered = np.zeros(len(truth.times), bool)
    for first, last in ((0.0, case.hand[0]) if case.hand else (0.0, 0.0), case.hidden[:2] if case.hidden else (0, 0)):
        covered |= (truth.times >= first) & (truth.times < last)
    row: dict[str, Any] = {
        "bobs_found": case.bobs,
        "readings": int(seen.sum()),
        "squares": float(np.nansum(error**2)),
        "largest": float(np.nanmax(np.linalg.norm(error, axis=-1))),
        "wrong": int((np.linalg.norm(error, axis=-1) > _WRONG).sum()),
        "swapped": int((nearest != np.arange(case.bobs)).sum()),
        "places": int((~covered).sum() * case.bobs),
        "missing": int((~seen[~covered]).sum()),
        "covered_places": int(covered.sum() * case.bobs),
        "covered_missing": int((~seen[covered]).sum()),
        "impacts": impact_errors(case, truth, tracks),
    }
    try:
        lie = geometry(tracks, truth.cradle, found.rest, path.name)
    except ValueError as problem:
        return {**row, "no_geometry": str(problem)}
    theta, _ = lie.polar(tracks.places)
    good = np.isfinite(theta)
    slope = float(np.polyfit(truth.theta[good], theta[good], 1)[0])
    return {**row, "angle_scale": slope, "angle_scale_sd": lie.angle_scale_sd}


def impact_errors(case: Case, truth: Truth, tracks: Tracks) -> list[float]:
    """By how many frames the instants at which bobs at the ends are struck are off.

    Taken are impacts before and after which the bob flies alone for some frames. The instant is where the flights
    before and after meet; the frame in which the impact lies is taken from the truth.
    """
    errors = []
    step = 1.0 / case.camera.rate
    flight = max(_FLIGHT, (_LEAST + 1) * step)
    pixels_per_metre = case.camera.focal / case.camera.distance
    for bob, pair in ((0, 1), (case.bobs - 1, case.bobs - 1)) if case.bobs > 1 else ():
        instants = np.sort(truth.impacts[truth.impacts[:, 1] == pair, 0])
        for instant in instants:
            near = instants[np.abs(instants - instant) < flight + step]
            if instant != near[0] or np.ptp(near) > 0.02 * step:
                continue
            got = _meeting(tracks, bob, instant, flight, 0.5 * case.camera.exposure * step, step)
            if got is not None and got[1] > _SLOW * pixels_per_metre:
                errors.append((got[0] - instant) / step)
    return errors


def _meeting(
    tracks: Tracks, bob: int, instant: float, flight: float, shutter: float, step: float
) -> tuple[float, float] | None:
    """(when the flights before and after meet [s], change of velocity [pixels/s]); None where too little is seen."""
    omega = np.sqrt(9.81 / 0.306)  # 1/s; over a flight its error of 1 % does not matter
    times, x = tracks.times, tracks.places[:, bob, 0]
    about = round(instant / step) * step
    found = about
    for _ in range(3):
        lines = []
        for low, high in ((found - flight, found - shutter), (found + shutter, found + flight)):
            use = (times > low) & (times < high) & np.isfinite(x)
            if use.sum() < _LEAST:
                return None
            phase = omega * (times[use] - about)
            basis = np.column_stack([np.ones(use.sum()), np.cos(phase), np.sin(phase)])
            lines.append(np.linalg.lstsq(basis, x[use], rcond=None)[0])
        a, b, c = lines[1] - lines[0]
        fine = about + step * np.linspace(-1.5, 1.5, 6001)
        apart = a + b * np.cos(omega * (fine - about)) + c * np.sin(omega * (fine - about))
        crossings = np.flatnonzero(np.diff(np.sign(apart)))
        if len(crossings) == 0:
            return None
        found = float(fine[crossings[np.abs(fine[crossings] - about).argmin()]])
    return found, abs(omega * c)
