"""The picture of a measurement of contacts."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

from cradle_env.constitutive import contact_times
from cradle_env.notebook_figure import NotebookFigure
from cradle_env.plot_style import BLACK, BLUE, GREY, RED, bob_styles, quiet_grid, styled

if TYPE_CHECKING:
    from matplotlib.axes import Axes

    from identification.apparatus.contacts.measure import ContactsMeasurement

#: Contacts of the first trace that are drawn.
_DRAWN = 200


@styled
def contacts_figure(measured: ContactsMeasurement) -> NotebookFigure:
    """Contacts in time, levels, and durations."""
    figure = NotebookFigure(figsize=(9.0, 6.4), layout="constrained")
    grid = figure.add_gridspec(2, 2)
    time, levels, durations = (figure.add_subplot(grid[part]) for part in (np.s_[0, :], np.s_[1, 0], np.s_[1, 1]))
    _time(time, measured)
    _levels(levels, measured)
    _durations(durations, measured)
    for axes in (time, levels, durations):
        quiet_grid(axes)
    return figure


def _levels(axes: Axes, measured: ContactsMeasurement) -> None:
    """How far each state is from the level that it is taken for, on the way to the nearest other one."""
    circuit = measured.circuit
    spacing = np.array([np.min(np.abs(np.delete(circuit.levels, k) - level)) for k, level in enumerate(circuit.levels)])
    for trace in measured.traces:
        decoded = trace.decoded
        seen = (decoded.means - decoded.offset) / decoded.gain
        away = (seen - circuit.levels[decoded.states]) / spacing[decoded.states]
        for rows, colour, marker in ((~decoded.ambiguous, BLACK, "."), (decoded.ambiguous, RED, "x")):
            axes.plot(circuit.levels[decoded.states][rows], away[rows], color=colour, linestyle="", marker=marker)
    for half in (-0.5, 0.5):
        axes.axhline(half, color=GREY, linewidth=0.8, linestyle=":")
    axes.set(xlabel="level of the state [V]", ylabel="departure / distance to the next level",
             title="States told by their level", ylim=(-0.6, 0.6))  # fmt: skip


def _time(axes: Axes, measured: ContactsMeasurement) -> None:
    contacts = measured.traces[0].contacts[:_DRAWN]
    begin = contacts[0].start if contacts else 0.0
    for contact in contacts:
        colour = RED if contact.most > 2 else BLUE
        axes.barh(contact.pair, 1e3 * contact.duration, left=1e3 * (contact.start - begin), height=0.6, color=colour,
                  edgecolor=BLACK, linewidth=0.4, hatch="//" if contact.most > 2 else None)  # fmt: skip
    pairs = len(measured.circuit.resistances)
    axes.set_yticks(range(1, pairs + 1), [f"{pair} – {pair + 1}" for pair in range(1, pairs + 1)])
    axes.set(
        xlabel="time from the first contact [ms]", ylabel="bobs", title="Who touches whom", ylim=(0.4, pairs + 0.6)
    )


def _durations(axes: Axes, measured: ContactsMeasurement) -> None:
    stated = [(trace.speed, trace.contacts[0]) for trace in measured.traces if trace.speed and trace.contacts]
    if stated and "k_f" in measured.values:
        speeds = np.array([speed for speed, _ in stated])
        errors = [1.96e6 * contact.duration_sd for _, contact in stated]
        axes.errorbar(speeds, [1e6 * contact.duration for _, contact in stated], errors, color=BLACK, linestyle="",
                      marker="o", markersize=3.0, capsize=2.0)  # fmt: skip
        v = np.geomspace(0.8 * speeds.min(), 1.2 * speeds.max(), 80)
        value = measured.values["k_f"]
        cradle = measured.cradle.replace(k_f=value.median)
        axes.plot(v, 1e6 * contact_times(cradle, v), color=BLUE, label="eq. 1 at the measured k_f")
        ends = (1e6 * contact_times(cradle.replace(k_f=max(0.0, end)), v) for end in value.ci95)
        axes.fill_between(v, next(ends), next(ends), color=BLUE, alpha=0.2, linewidth=0.0)
        axes.set(xlabel="impact velocity [m/s]", ylabel="contact duration [µs]", title="Durations against speed")
        axes.legend(loc="best")
        return
    pairs = len(measured.circuit.resistances)
    for pair, look in zip(range(1, pairs + 1), bob_styles(pairs), strict=True):
        own = [c for trace in measured.traces for c in trace.contacts if c.pair == pair and c.whole]
        starts, lengths = [1e3 * c.start for c in own], [1e6 * c.duration for c in own]
        axes.plot(starts, lengths, color=look["color"], linestyle="", marker="o",
                  markersize=3.0, label=f"bobs {pair} and {pair + 1}")  # fmt: skip
    axes.set(xlabel="time [ms]", ylabel="contact duration [µs]", title="Durations")
    axes.legend(loc="best")
