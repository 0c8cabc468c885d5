"""How many bobs meet at once, and where the order of a touching cascade matters."""

from __future__ import annotations

from collections.abc import Sequence

import matplotlib.figure
import numpy as np

from cradle_env.constitutive import contact_times
from cradle_env.cradle import Cradle
from cradle_env.plot_style import BLACK, BLUE, GREY, ORANGE, RED, quiet_grid
from cradle_env.simulation import simulate
from cradle_env.trajectory import Trajectory
from identification.reproduce.figure import BEYOND, STANDARD_RELEASE, Claim, Figure, Study, Table, Tables
from identification.sweep import Quantity

_MANY = (3, 5)
FINITE_CONTACTS = {"contact_duration": {"scale": 1.0}}
_LAWS = {"followed in time": FINITE_CONTACTS, "instantaneous": {}}
#: Gaps between the bobs at rest [m], for the curves and for the map.
_GAPS, _MAP_GAPS = (1e-11, 1e-3), (1e-9, 1e-4)
#: When angles are compared [s]: after five double swings, before rounding errors have grown.
_COMPARED = 5.0


def overlaps(time: np.ndarray, pair: np.ndarray, duration: np.ndarray) -> np.ndarray:
    """Whether each contact (M,), in order of time [s], shares a bob with another one; a contact lasts `duration`."""
    multi = np.zeros(len(time), bool)
    for k in range(len(time)):
        j = k + 1
        while j < len(time) and time[j] <= time[k] + duration[k]:
            if abs(pair[j] - pair[k]) == 1:
                multi[k] = multi[j] = True
            j += 1
    return multi


def _contacts(study: Study) -> Tables:
    tables, rates = {}, []
    for bobs in _MANY:
        run, plain = (simulate(Cradle(bobs=bobs, effects=law), STANDARD_RELEASE, 60.0) for law in _LAWS.values())
        rows = run.impacts[np.argsort(run.impacts["time"], kind="stable")]
        # A pair in touch that is not itself struck has no speed, and lasts as long as the blow that it passes on.
        speed = np.where(rows["speed"] > 0.0, rows["speed"], rows["speed"].max())
        duration = contact_times(run.cradle, speed)
        multi = overlaps(rows["time"], rows["pair"], duration)
        tables[f"impacts-N{bobs}"] = {
            "time [s]": rows["time"], "pair": rows["pair"], "speed [m/s]": rows["speed"],
            "contact time [s]": duration, "three or more": multi,
        }  # fmt: skip
        rates.append([bobs, run.newton_exponent(), plain.newton_exponent()])
    names = ("N", *(f"lambda, contacts {law} [1/s]" for law in _LAWS))
    tables["lambda"] = dict(zip(names, np.array(rates).T, strict=True))
    return tables


def _draw_contacts(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(9.0, 3.6), layout="constrained")
    panels = figure.subplots(1, 2, sharey=True)
    for bobs, axes in zip(_MANY, panels, strict=True):
        table = tables[f"impacts-N{bobs}"]
        multi = table["three or more"] > 0.0
        struck = table["speed [m/s]"] > 0.0
        for rows, colour, size, label in (
            (~multi & struck, GREY, 3.0, "two bobs"), (multi & struck, RED, 14.0, "three or more in touch"),
        ):  # fmt: skip
            axes.scatter(table["time [s]"][rows], table["speed [m/s]"][rows], s=size, color=colour, label=label)
        axes.set(yscale="log", ylim=(1e-4, 1.0), title=f"N = {bobs}", xlabel="time [s]")
        quiet_grid(axes)
    panels[0].set_ylabel("impact velocity [m/s]")
    panels[0].legend(loc="lower left")
    return figure


def _contact_claims(tables: Tables) -> Sequence[Claim]:
    counts = {bobs: _count_later_contacts(tables[f"impacts-N{bobs}"]) for bobs in _MANY}
    words = "; ".join(
        f"N = {bobs}: {many} of {total} later contacts share a bob with another, the first of them at {first:.1f} s,"
        f" at up to {speed:.2g} m/s"
        for bobs, (many, total, first, speed) in counts.items()
    )
    most = max(many / total for many, total, *_ in counts.values())
    rates = tables["lambda"]
    exact, plain = (rates[f"lambda, contacts {law} [1/s]"] for law in _LAWS)
    change = np.abs(plain / exact - 1.0)
    listed = ", ".join(f"{a:.4f} and {b:.4f} (N = {n:.0f})" for n, a, b in zip(rates["N"], plain, exact, strict=True))
    return (
        Claim.judge(
            "only the first collision involves more than two bodies",
            "2.2",
            most == 0.0,
            f"contacts followed in time, 60 s: {words}",
            f"{100 * most:.1g} % of the later ones are overlooked",
            most < 0.1,
        ),
        Claim.judge(
            "all later collisions may be taken as instantaneous and of two bodies",
            "2.2",
            bool(change.max() < 0.05),
            f"λ, instantaneous and followed in time [1/s]: {listed}",
        ),
    )


def _count_later_contacts(table: Table) -> tuple[int, int, float, float]:
    """(how many contacts after the first cascade are of three bobs or more, of how many, from when on [s], their
    highest speed [m/s])."""
    later = table["time [s]"] > table["time [s]"][0] + 0.1
    multi = later & (table["three or more"] > 0.0)
    if not multi.any():
        return 0, int(later.sum()), np.inf, 0.0
    return int(multi.sum()), int(later.sum()), table["time [s]"][multi].min(), table["speed [m/s]"][multi].max()


def _swing(run: Trajectory) -> np.ndarray:
    return run.theta[:, -1]


_ANGLES = Quantity("theta_N", "θ_N", "rad", "of the lifted bob", _swing, series=True)


def _cascade(study: Study) -> Tables:
    times = _COMPARED - np.arange(0.0, 1.11, 0.01)[::-1]
    gaps = np.concatenate([[0.0], np.geomspace(*_GAPS, max(16, study.values // 4))])
    curves = {"gap [m]": gaps[1:]}
    for bobs in _MANY:
        for law, effects in _LAWS.items():
            cradle = Cradle(bobs=bobs, effects=effects)
            axes = {"delta": gaps / (2.0 * cradle.radius)}
            swept = study.sweep(f"gaps N{bobs} {law}", axes, cradle, quantities=("lambda", _ANGLES), times=times)
            away = np.abs(swept["theta_N"][1:] - swept["theta_N"][0]).max(axis=1)
            curves[f"change of theta_N, N = {bobs}, {law} [rad]"] = away
            curves[f"lambda, N = {bobs}, {law} [1/s]"] = swept["lambda"][1:]
    cradle = Cradle(bobs=3, effects=FINITE_CONTACTS)
    each = np.concatenate([[0.0], np.geomspace(*_MAP_GAPS, max(8, study.values // 10))])
    axes = {f"delta[{i}]": each / (2.0 * cradle.radius) for i in (1, 2)}
    swept = study.sweep("gaps one by one", axes, cradle, quantities=(_ANGLES,), times=times)
    away = np.abs(swept["theta_N"] - swept["theta_N"][0, 0]).max(axis=2)[1:, 1:]
    columns = {
        f"gap 2 = {gap:.4g} m: change of theta_3 [rad]": column for gap, column in zip(each[1:], away.T, strict=True)
    }
    return {"gaps": curves, "map": {"gap 1 [m]": each[1:], **columns}}


def _draw_cascade(tables: Tables) -> matplotlib.figure.Figure:
    figure = matplotlib.figure.Figure(figsize=(10.0, 6.0), layout="constrained")
    (a, b), (c, d) = figure.subplots(2, 2, width_ratios=(1.25, 1.0))
    table = tables["gaps"]
    gap = table["gap [m]"]
    for axes, bobs in ((a, 3), (c, 5)):
        for law, colour, dashes in (("followed in time", BLUE, "-"), ("instantaneous", ORANGE, (0, (5, 1.5)))):
            changed = 1e3 * table[f"change of theta_N, N = {bobs}, {law} [rad]"]
            axes.plot(1e9 * gap, changed, color=colour, linestyle=dashes, label=f"contacts {law}")
        axes.set(
            xscale="log", yscale="log", ylim=(1e-5, 30.0), xlabel="all gaps [nm]",
            ylabel=f"change of $θ_{bobs}$ [mrad]", title=f"N = {bobs}: against bobs in touch, {_COMPARED:g} s on",
        )  # fmt: skip
        axes.axhline(1.0, color=GREY, linewidth=0.7, linestyle=":")
        quiet_grid(axes)
    a.legend(loc="lower right")
    away = np.array([column for label, column in tables["map"].items() if label != "gap 1 [m]"])
    each = tables["map"]["gap 1 [m]"]
    seconds = np.array([float(label.split()[3]) for label in list(tables["map"])[1:]])
    image = b.pcolormesh(1e9 * each, 1e9 * seconds, np.log10(1e3 * away), cmap="cividis", rasterized=True)
    b.set(
        xscale="log", yscale="log", xlabel="gap of bobs 1 and 2 [nm]", ylabel="gap of bobs 2 and 3 [nm]",
        title="N = 3, contacts followed in time",
    )  # fmt: skip
    figure.colorbar(image, ax=b).set_label("log$_{10}$ change of $θ_3$ [mrad]")
    for bobs, colour in ((3, BLACK), (5, RED)):
        for law, dashes in (("followed in time", "-"), ("instantaneous", (0, (5, 1.5)))):
            rate = table[f"lambda, N = {bobs}, {law} [1/s]"]
            d.plot(1e9 * gap, rate, color=colour, linestyle=dashes, label=f"N = {bobs}, {law}")
    d.set(xscale="log", xlabel="all gaps [nm]", ylabel="λ [s$^{-1}$]", title="λ hardly notices below 1 µm")
    d.legend(loc="upper left")
    quiet_grid(d)
    return figure


def _cascade_claims(tables: Tables) -> Sequence[Claim]:
    table = tables["gaps"]
    gap = table["gap [m]"]
    words, quiet = [], {law: [] for law in _LAWS}
    for bobs in _MANY:
        exact, plain = (table[f"change of theta_N, N = {bobs}, {law} [rad]"] for law in _LAWS)
        notable = gap[np.argmax(exact > 1e-3)]
        jump = int(np.argmax(np.diff(np.log(plain))))
        for law, changed in zip(_LAWS, (exact, plain), strict=True):
            quiet[law].append(bool(changed[gap <= 1e-8].max() < 1e-3))
        words.append(
            f"N = {bobs}: θ changes by {1e3 * np.interp(1e-8, gap, exact):.2g} mrad at 10 nm, 1 mrad at"
            f" {1e9 * notable:.3g} nm; with instantaneous impacts it jumps by {1e3 * plain[jump + 1]:.2g} mrad at"
            f" {1e9 * gap[jump + 1]:.2g} nm, where bobs no longer count as one group"
        )
    rates = [table[f"lambda, N = {bobs}, followed in time [1/s]"][gap <= 1e-6] for bobs in _MANY]
    spread = [float(np.ptp(rate) / np.mean(rate)) for rate in rates]
    return (
        Claim.judge(
            f"gaps of nanometres do not matter to θ in the first {_COMPARED:g} s",
            BEYOND,
            all(all(law) for law in quiet.values()),
            "; ".join(words),
            "contacts are followed in time (contact_duration); instantaneous impacts must know the order",
            all(quiet["followed in time"]),
        ),
        Claim.judge(
            "λ of bobs in touch is defined to a few percent whatever gaps below a micrometre there are",
            BEYOND,
            max(spread) < 0.06,
            ", ".join(f"N = {n}: λ varies by {100 * s:.2g} %" for n, s in zip(_MANY, spread, strict=True)),
        ),
    )


FIGURES = (
    Figure("contacts", "How many bobs meet at once", _contacts, _draw_contacts, _contact_claims),
    Figure("cascade", "Where the order of a touching cascade matters", _cascade, _draw_cascade, _cascade_claims),
)
