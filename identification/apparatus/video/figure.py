"""The picture of a measured film."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

if TYPE_CHECKING:
    from matplotlib.figure import Figure

    from identification.apparatus.video.measure import VideoMeasurement


def video_figure(measured: VideoMeasurement) -> Figure:
    """Angles, arcs, distances from the pivots, and how round the edges are."""
    from matplotlib.figure import Figure

    figure = Figure(figsize=(10.0, 7.0), layout="constrained")
    angles, arcs, distances, edges = figure.subplots(2, 2).ravel()
    tracks, lie = measured.tracks, measured.geometry
    times = tracks.times - measured.begin.time
    turned = lie.turned(tracks.places)
    _, r = lie.polar(tracks.places)
    sweep = np.linspace(np.nanmin(measured.theta), np.nanmax(measured.theta), 100)
    height = lie.scale[0] * lie.reach[0]
    for bob in range(turned.shape[1]):
        name = str(bob + 1)
        angles.plot(times, measured.theta[:, bob], lw=0.8, label=name)
        arcs.plot(*turned[:, bob].T, ".", ms=1.5)
        x, y = lie.rest[bob]
        arcs.plot(x + height * np.sin(sweep), y - height * (1.0 - np.cos(sweep)), ":", color="0.4", lw=0.8)
        arcs.plot(x, y, "k+")
        distances.plot(times, 1e3 * r[:, bob], ".", ms=1.5)
        edges.plot(times, tracks.scatter[:, bob], ".", ms=1.5)
    angles.set(xlabel="t [s]", ylabel="θ [rad]")
    angles.legend(title="bob", ncols=min(turned.shape[1], 5), fontsize="small")
    arcs.set(xlabel="x [pixels]", ylabel="y [pixels]")
    arcs.invert_yaxis()
    distances.set(xlabel="t [s]", ylabel="r [mm]")
    edges.set(xlabel="t [s]", ylabel="edge from outline, RMS [pixels]")
    edges.set_ylim(bottom=0.0)
    return figure
