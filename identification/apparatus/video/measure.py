"""Film → angles: what a film of a cradle says, as an experiment ready for calibration."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from identification.apparatus.measurement import Measurement, Value
from identification.apparatus.video.frames import Film
from identification.apparatus.video.geometry import Geometry, geometry, row_spacing
from identification.apparatus.video.release import Begin, begin
from identification.apparatus.video.survey import survey
from identification.apparatus.video.tracking import Tracks, track
from identification.experiment.experiment import Experiment
from identification.experiment.run import Prior, ReleaseInfo, Run, Tracking
from identification.number_format import format_number
from identification.progress import Progress
from identification.storage.files import ExperimentError

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: Part of a length by which it may differ from what the period says, 1 sigma: strings stretch, and wear in.
_LENGTH_SD = 0.02
#: Stretch of worn-in strings over that of new ones, in the mean over a film.
_WORN = 1.5
#: Change of scale along a pendulum's length, 1 sigma: a camera at two lengths' distance that is turned by 2 degrees.
_SLANT_SD = 0.02
#: Part of a frame for which a shutter is open: mean and 1 sigma.
_OPEN = 0.35, 0.25
#: Errors of tracked centres that repeat: their standard deviation over that of those that do not, and the distance
#: [radii] and the speed [radii per radian of a swing] over which they are alike. At this speed, which is a guess, the
#: other two are the likeliest for 38 bobs in 22 made films; studies/film/calibrations.md counts what comes of them.
_REPEATED = 0.6, 0.23, 1.0
#: Part by which a stated length and that of the period may differ before the film's clock is doubted; what the arcs say
#: of a length may differ from it by this much more, as a logarithm, for strings stretch, and by so many sd.
_DOUBT, _STRETCHED, _DOUBT_SD = 0.08, 0.3, 2.0
#: Radii from pivot to centre at least: of toys it is 8 or more.
_SHORT = 3.0
#: Part of the frames in which a bob may be missing without a warning.
_MISSING = 0.02


@dataclass(frozen=True, eq=False)
class VideoMeasurement(Measurement):
    """What a film says of a cradle; see `measure_video`.

    tracks: the bobs in pixels; geometry: how the cradle lies in the picture; theta (T, N) [rad], nan where a bob was
    not seen; begin: how the motion begins; experiment: ready for `calibrate`; overlay: a film to look at, where one
    was made.
    """

    kind: ClassVar[str] = "video"
    caption: ClassVar[str] = (
        "Top left: angles against time; gaps are frames in which a bob was not seen. Top right: the arcs in the"
        " picture, turned upright, the rest positions, and circles about the pivots that the period gives. Bottom left:"
        " distance from the pivots against time. Bottom right: RMS distance of each bob's edge from its usual outline."
    )

    tracks: Tracks
    geometry: Geometry
    theta: np.ndarray
    begin: Begin
    experiment: Experiment
    overlay: Path | None

    def figure(self) -> Figure:
        """Angles, arcs, distances and residuals."""
        from identification.apparatus.video.figure import video_figure

        return video_figure(self)

    def details(self) -> dict[str, Any]:
        """Frames, and how many of them each bob is missing in."""
        steps = np.diff(self.tracks.times)
        missing = np.isnan(self.theta)
        return {
            "frames": len(self.theta),
            "bobs": self.theta.shape[1],
            "rate_hz": float(1.0 / np.median(steps)),
            "rate_varies": bool(np.ptp(steps) > 0.01 * np.median(steps)),
            "missing": missing.mean(axis=0).tolist(),
            "angle_scale_sd": self.geometry.angle_scale_sd,
            "zero_sd_rad": self.geometry.zero_sd,
            "rest_pixels": self.geometry.rest.tolist(),
            "release_time_s": self.begin.time,
        }

    def files(self) -> Mapping[str, str | bytes | Path]:
        """experiment.toml, run1.csv and the overlay."""
        return {**self.experiment.texts(), **({} if self.overlay is None else {"overlay.mp4": self.overlay})}


def measure_video(
    film: str | Path,
    cradle: Cradle,
    *,
    bobs: int | None = None,
    boxes: Sequence[tuple[float, float, float, float]] = (),
    clicks: Sequence[tuple[float, float]] = (),
    slow_motion: float = 1.0,
    rate: float | None = None,
    stated_length: float | None = None,
    overlay: Path | None = None,
    progress: Progress = lambda *_: None,
) -> VideoMeasurement:
    """Measure the angles of the bobs in a film.

    Parameters
    ----------
    film : path
        A film, or a folder of images.
    cradle : Cradle
        What is known of the cradle: its radius sets the scale, gravity the length; mass, κ and the rest go into the
        experiment.
    bobs : int, optional
        How many there are; counted where omitted.
    boxes : sequence of (x, y, width, height), optional
        Around each bob in the first frame [pixels], instead of looking for them.
    clicks : sequence of (x, y), optional
        A point on each bob in the first frame [pixels], likewise.
    slow_motion : float
        By which factor the film plays more slowly than what it shows.
    rate : float, optional
        Frames per second as played, instead of the times in the file.
    stated_length : float, optional
        Length of the pendulums by a ruler [m], against which the film's clock is checked.
    overlay : path, optional
        Where to write a film that shows what was found.
    progress : callable, optional
        Called with a stage, the part that is done, and words.

    Returns
    -------
    VideoMeasurement

    Raises
    ------
    ValueError
        One line, for a film that cannot be used.
    """
    source = Film(Path(film), slow_motion, rate)
    if bobs is not None:
        bobs = int(check_range("bobs", bobs, "", 1, 200))
    found = survey(source, bobs, boxes, clicks, progress)
    cradle = cradle.replace(bobs=len(found.rest), delta=_delta_of(cradle, len(found.rest)))
    tracks = track(source, found, progress)
    lie = geometry(tracks, cradle, found.rest, source.path.name)
    if lie.reach[0] < _SHORT * cradle.radius:
        raise ExperimentError(
            f"{source.path.name}: bobs with a diameter of {2.0 * cradle.radius:.3g} m do not swing as fast as these;"
            " state the diameter in m, or the speed of the film"
        )
    theta, r = lie.polar(tracks.places)
    start = begin(tracks.times, theta, r, 2.0 * np.pi / lie.period[0], cradle)
    experiment = _experiment(cradle, tracks, lie, theta, start)
    if overlay is not None:
        from identification.apparatus.video.overlay import write_overlay

        write_overlay(overlay, source, tracks, lie, progress)
    values = {
        "period": Value.normal("T", "of small swings", "s", *lie.period),
        "reach": Value.normal("r", "from pivot to centre of a bob that hangs, by the period", "m", *lie.reach),
        "pixels": Value.normal("s", "scale along the row", "1/m", *lie.scale),
        "roll": Value.normal("ρ", "by which the picture is turned clockwise", "rad", *lie.roll),
    }
    return VideoMeasurement(
        values, _findings(tracks, lie, start, cradle), _warnings(tracks, lie, start, stated_length, cradle),
        source.digest, 0, tracks, lie, theta, start, experiment, overlay,
    )  # fmt: skip


def _delta_of(cradle: Cradle, bobs: int) -> float | tuple[float, ...]:
    """δ as it is stated, or its mean where it is stated for another number of gaps."""
    return cradle.delta if bobs == cradle.bobs else float(np.mean(cradle.delta))


def _experiment(cradle: Cradle, tracks: Tracks, lie: Geometry, theta: np.ndarray, start: Begin) -> Experiment:
    """The film as one run; what the camera leaves uncertain becomes priors."""
    sag = cradle.mass * cradle.gravity / cradle.radial_stiffness if cradle.has("radial_elasticity") else 0.0
    length = float(f"{lie.reach[0] - _WORN * sag:.5g}")
    view = {"slant": 0.0, "pitch": 0.0, "roll": 0.0, "spacing": float(f"{row_spacing(cradle) / length:.4g}")}
    frame = float(np.median(np.diff(tracks.times)))
    opened, opened_sd = (float(f"{share * frame:.3g}") for share in _OPEN)
    camera = {"exposure_blur": {"duration": opened}, "angle_scale": {"scale": 0.0}, "oblique_view": view}
    cradle = cradle.replace(length=length, effects={**cradle.effects, **camera})
    infer = {
        "length": Prior(mean=length, sd=float(f"{_LENGTH_SD * length:.3g}")),
        "angle_scale.scale": Prior(mean=0.0, sd=float(f"{lie.angle_scale_sd:.3g}")),
        "exposure_blur.duration": Prior(mean=opened, sd=opened_sd),
        "oblique_view.slant": Prior(mean=0.0, sd=_SLANT_SD),
        "oblique_view.pitch": Prior(mean=0.0, sd=_SLANT_SD),
        "oblique_view.roll": Prior(mean=0.0, sd=float(f"{lie.roll[1]:.3g}")),
    }
    times = tracks.times - start.time
    info = None
    if start.release is not None:
        info = ReleaseInfo(start.release, start.angle_sd, start.time_sd)
    run = Run(
        times, theta, release=info, delta=cradle.delta, state="free" if info is None else "release", rest="free",
        fit_from=0.0, tracking=_tracking(cradle, lie),
    )  # fmt: skip
    return Experiment(cradle, (run,), infer, tuple(name for name in infer if "." in name))


def _tracking(cradle: Cradle, lie: Geometry) -> Tracking:
    """Errors of the tracked centres that repeat, as those of angles."""
    ratio, place, speed = _REPEATED
    radius = cradle.radius / lie.reach[0]
    rate = 2.0 * np.pi / lie.period[0]
    return Tracking(ratio, float(f"{place * radius:.3g}"), float(f"{speed * radius * rate:.3g}"))


def _findings(tracks: Tracks, lie: Geometry, start: Begin, cradle: Cradle) -> tuple[str, ...]:
    seen = 100.0 * np.isfinite(tracks.places[..., 0]).mean()
    scatter = float(np.nanmedian(tracks.scatter))
    if start.release is None:
        how = f"No release was seen; the state at {start.time:.3f} s of the film, t = 0, is to be inferred."
    else:
        angles = ", ".join(
            f"bob {bob}: {format_number(angle)} rad"
            for bob, angle in enumerate(start.release.angles_of(cradle), 1)
            if np.isfinite(angle)
        )
        how = f"Released at {start.time:.3f} s of the film, which is t = 0, strings {start.release.start}; {angles}."
    return (
        f"{tracks.places.shape[1]} bobs in {len(tracks.times)} frames, found in {seen:.1f} % of the places where they"
        f" might be; their edges lie {format_number(scatter, 2)} pixels (RMS) from their usual outlines.",
        how,
        f"Curvature of the arcs: {format_number(lie.arc[0])} ± {format_number(lie.arc[1], 2)} m; the period is more"
        " exact.",
    )


def _warnings(tracks: Tracks, lie: Geometry, start: Begin, length: float | None, cradle: Cradle) -> tuple[str, ...]:
    warnings = []
    for bob, share in enumerate(np.isnan(tracks.places[..., 0]).mean(axis=0), 1):
        if share > _MISSING:
            warnings.append(
                f"Bob {bob} is missing in {100.0 * share:.1f} % of the frames; these fields are left empty."
            )
    if length is not None and abs(lie.reach[0] / length - 1.0) > _DOUBT:
        factor = np.sqrt(lie.reach[0] / length)
        warnings.append(
            f"The period belongs to {lie.reach[0]:.3g} m, but the stated length is {length:.3g} m: the film plays"
            f" {format_number(float(factor))} × as slow as that; state --slow-motion, --rate or the length."
        )
    doubt = _STRETCHED + _DOUBT_SD * lie.arc[1] / lie.arc[0]
    if length is None and abs(np.log(lie.reach[0] / lie.arc[0])) > doubt:
        factor = np.sqrt(lie.reach[0] / lie.arc[0])
        warnings.append(
            f"The period belongs to {lie.reach[0]:.3g} m, the curvature of the arcs to {lie.arc[0]:.3g} m: the diameter"
            f" of a bob is not {2.0 * cradle.radius:.3g} m, or the film plays {format_number(float(factor), 2)} × as"
            " slow as what it shows; state --diameter, --slow-motion, or --set length=."
        )
    if start.release is None:
        warnings.append("No bob is seen to be held still and let go; film from before the release where you can.")
    return tuple(warnings)
