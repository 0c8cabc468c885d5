"""Which bobs touch, when and for how long, from traces of the contact resistance; and k_f from durations."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar

import numpy as np

from cradle_env.cradle import Cradle
from cradle_env.errors import check_range
from identification.apparatus.columns import digest_of
from identification.apparatus.contacts.circuit import Circuit, joined
from identification.apparatus.contacts.decode import Decoded, decode, intervals
from identification.apparatus.contacts.trace import open_trace
from identification.apparatus.impacts.data import Durations
from identification.apparatus.impacts.durations import duration_constraint
from identification.apparatus.impacts.fit import fit
from identification.apparatus.measurement import Measurement, Value
from identification.experiment.constraint import Constraint
from identification.number_format import format_number
from identification.progress import Progress

if TYPE_CHECKING:
    from matplotlib.figure import Figure

#: The table of all contacts.
TABLE = "contacts.csv"


@dataclass(frozen=True)
class Contact:
    """One contact: bobs pair and pair + 1, from start [s] for duration [s], each with its standard deviation.

    most: the most bobs that touch one another meanwhile; ambiguous: whether a level of it may be another one; whole:
    whether the trace shows both its ends.
    """

    pair: int
    start: float
    start_sd: float
    duration: float
    duration_sd: float
    most: int
    ambiguous: bool
    whole: bool


@dataclass(frozen=True, eq=False)
class Traced:
    """One trace: what was decoded, its contacts, and the speed of its first impact [m/s] where that is stated."""

    file: str
    decoded: Decoded
    contacts: tuple[Contact, ...]
    speed: float | None


@dataclass(frozen=True, eq=False)
class ContactsMeasurement(Measurement):
    """Contacts of all traces; see `measure_contacts`.

    durations: what those of first contacts at stated speeds say of the cradle.
    """

    kind: ClassVar[str] = "contacts"
    caption: ClassVar[str] = (
        "Top: which pairs touch in the first trace, by time; red where three bobs or more do. Bottom left: how far the"
        " voltage of each state is from its level, after gain and offset; beyond the dotted lines it would be"
        " another's; ambiguous ones red. Bottom right: durations, by pair, or against the stated speeds with eq. 1."
    )

    circuit: Circuit
    traces: tuple[Traced, ...]
    cradle: Cradle
    durations: Constraint | None

    def figure(self) -> Figure:
        """Contacts in time, levels, and durations."""
        from identification.apparatus.contacts.figure import contacts_figure

        return contacts_figure(self)

    def constraint(self) -> Constraint | None:
        """The duration of a contact, where speeds are stated."""
        return self.durations

    def files(self) -> Mapping[str, str | bytes | Path]:
        """contacts.csv: a row for each contact."""
        head = "trace,pair,start [s],start_sd [s],duration [s],duration_sd [s],most bobs,ambiguous,whole"
        rows = [
            f"{k},{c.pair},{c.start!r},{c.start_sd:.3g},{c.duration!r},{c.duration_sd:.3g},{c.most},{int(c.ambiguous)},"
            f"{int(c.whole)}"
            for k, trace in enumerate(self.traces, 1)
            for c in trace.contacts
        ]
        return {TABLE: "\n".join([head, *rows, ""])}

    def details(self) -> dict[str, Any]:
        """Of each trace: calibration of the oscilloscope, edges, and counts."""
        return {
            "circuit": {
                "supply_V": self.circuit.supply,
                "resistances_ohm": list(self.circuit.resistances),
                "shunt_ohm": self.circuit.shunt,
                "levels_V": {
                    f"{state:0{len(self.circuit.resistances)}b}": v for state, v in enumerate(self.circuit.levels)
                },
            },
            "traces": [
                {
                    "file": trace.file,
                    "samples": trace.decoded.samples,
                    "rate": trace.decoded.rate,
                    "gain": trace.decoded.gain,
                    "offset_V": trace.decoded.offset,
                    "noise_V": trace.decoded.noise,
                    "closing_s": trace.decoded.constants[0],
                    "opening_s": trace.decoded.constants[1],
                    "contacts": len(trace.contacts),
                    "ambiguous": sum(contact.ambiguous for contact in trace.contacts),
                    "of_three_or_more": sum(contact.most > 2 for contact in trace.contacts),
                }
                for trace in self.traces
            ],
        }


def measure_contacts(
    traces: Sequence[str | Path],
    circuit: Circuit,
    cradle: Cradle | None = None,
    *,
    rate: float | None = None,
    channel: int | None = None,
    speeds: Sequence[float] | None = None,
    speed_sd: float | None = None,
    progress: Progress = lambda *_: None,
) -> ContactsMeasurement:
    """Decode traces of the voltage across R_a: which bobs touch, when and how long.

    Parameters
    ----------
    traces : sequence of path
        CSV of an oscilloscope, NumPy array, WAV, or raw numbers behind a header line of JSON; read in one pass.
    circuit : Circuit
        Resistors and supply.
    cradle : Cradle, optional
        Mass, radius, E and ν, for k_f. The default cradle where omitted.
    rate : float, optional
        Samples per second, where a file does not state it.
    channel : int, optional
        Which channel of a CSV with several, from 1.
    speeds : sequence of float, optional
        Speed of the first impact of each trace [m/s]; their durations give k_f.
    speed_sd : float, optional
        Standard deviation of each of these [m/s]; 0 where omitted.
    progress : callable, optional
        Called with a stage, the part that is done, and words.

    Returns
    -------
    ContactsMeasurement

    Raises
    ------
    ValueError
        One line, for traces that cannot be used.
    """
    if not traces:
        raise ValueError("no trace is given; name at least one file")
    if speeds and len(speeds) != len(traces):
        raise ValueError(f"{len(speeds)} speeds are given for {len(traces)} traces; give one for each, in order")
    for speed in speeds or ():
        check_range("speed", speed, "m/s", 0.0, above=True)
    cradle, read, digests = cradle or Cradle(), [], []
    for k, path in enumerate(map(Path, traces)):
        trace = open_trace(path, rate, channel)
        decoded = decode(trace, circuit, progress)
        digests.append(trace.digest.hexdigest())
        contacts = _contacts(decoded, len(circuit.resistances))
        read.append(Traced(str(path), decoded, contacts, speeds[k] if speeds else None))
    values, words, durations = _k_f(read, cradle, speed_sd or 0.0) if speeds else ({}, [], None)
    values = {**_counts(read), **values}
    return ContactsMeasurement(
        values,
        (*_findings(read), *words),
        tuple(_warnings(read)),
        digest_of(digests),
        0,
        circuit,
        tuple(read),
        cradle,
        durations,
    )


def _contacts(decoded: Decoded, pairs: int) -> tuple[Contact, ...]:
    most = np.array([joined(int(state), pairs) for state in decoded.states])
    found = []
    for pair, first, last in intervals(decoded, pairs):
        near = max(
            (_own(int(decoded.states[k]), pair, pairs) for k in range(first, last + 1)),
            default=int(most[first]),
        )
        start, end = decoded.starts[first], decoded.ends[last]
        sd = float(np.hypot(decoded.starts_sd[first], decoded.ends_sd[last]))
        found.append(
            Contact(
                pair + 1,
                float(start),
                float(decoded.starts_sd[first]),
                float(end - start),
                sd,
                near,
                bool(decoded.ambiguous[first : last + 1].any()),
                first > 0 and last < len(decoded.states) - 1,
            )
        )
    return tuple(found)


def _own(state: int, pair: int, pairs: int) -> int:
    """How many bobs touch one another with this pair among them."""
    low = high = pair
    while low > 0 and state >> (low - 1) & 1:
        low -= 1
    while high < pairs - 1 and state >> (high + 1) & 1:
        high += 1
    return high - low + 2


def _counts(read: Sequence[Traced]) -> dict[str, Value]:
    whole = [contact for trace in read for contact in trace.contacts if contact.whole]
    if not whole:
        return {}
    durations = np.array([contact.duration for contact in whole])
    first = whole[0]
    return {
        "first_duration": Value.normal(
            "τ", "duration of the first whole contact", "s", first.duration, first.duration_sd, 0.0
        ),
        "duration": Value.of_samples("τ", "durations of all whole contacts: median and spread", "s", durations),
    }


def _k_f(
    read: Sequence[Traced], cradle: Cradle, speed_sd: float
) -> tuple[dict[str, Value], list[str], Constraint | None]:
    """k_f from the first contact of each trace, where it is of two bobs alone."""
    pairs = [
        (trace.speed, trace.contacts[0])
        for trace in read
        if trace.contacts and trace.contacts[0].most == 2 and trace.contacts[0].whole
    ]
    if not pairs:
        return {}, ["No trace begins with a whole contact of two bobs alone: durations say nothing of k_f."], None
    speeds = np.array([speed for speed, _ in pairs])
    table = Durations(
        "traces",
        speeds,
        np.full(len(pairs), speed_sd),
        np.array([contact.duration for _, contact in pairs]),
        np.array([contact.duration_sd for _, contact in pairs]),
    )
    found = fit((), (table,), cradle, ("k_f",))
    mean, sd = found.of("k_f")
    stiffer = fit((), (table,), cradle.replace(youngs_modulus=1.01 * cradle.youngs_modulus), ("k_f",)).of("k_f")[0]
    words = [
        f"k_f rests on k_el as E, ν and R say it: were k_el 1 % larger, k_f would be {format_number(stiffer)} instead"
        f" of {format_number(mean)} N s/m^(3/2). cradle measure impacts fits both, with speeds before and after."
    ]
    values = {"k_f": Value.normal("k_f", "viscoelastic dissipation, from durations", "N s/m^3/2", mean, sd, 0.0)}
    return values, words, duration_constraint("contacts", cradle.replace(k_f=mean), sd, speeds)


def _findings(read: Sequence[Traced]) -> list[str]:
    contacts = [contact for trace in read for contact in trace.contacts]
    words = [f"{len(contacts)} contacts in {len(read)} trace{'s' if len(read) > 1 else ''}."]
    for trace in read:
        if not trace.contacts:
            continue
        first = trace.contacts[0]
        end = first.start + first.duration
        for contact in trace.contacts:  # those that overlap with the first, one after the other
            if contact.start <= end:
                end = max(end, contact.start + contact.duration)
        early = [contact for contact in trace.contacts if contact.start <= end]
        later = [contact for contact in trace.contacts if contact.start > end]
        many = [contact for contact in later if contact.most > 2]
        said = f"{Path(trace.file).name}: the first impact joins {max(c.most for c in early)} bobs"
        if not later:
            words.append(f"{said}; no other contact follows.")
        elif not many:
            words.append(f"{said}; none of the {len(later)} contacts after it joins more than two.")
        else:
            words.append(
                f"{said}; {len(many)} of the {len(later)} contacts after it join more than two, the first of them"
                f" {format_number(many[0].start - first.start)} s later."
            )
    return words


def _warnings(read: Sequence[Traced]) -> list[str]:
    warnings = []
    for trace in read:
        doubtful = [contact for contact in trace.contacts if contact.ambiguous]
        if doubtful:
            warnings.append(
                f"{Path(trace.file).name}: {len(doubtful)} of {len(trace.contacts)} contacts have an ambiguous level,"
                f" the first at {doubtful[0].start:.9g} s; check supply and resistances."
            )
        cut = sum(not contact.whole for contact in trace.contacts)
        if cut:
            warnings.append(f"{Path(trace.file).name}: {cut} contacts reach beyond the trace; their durations are cut.")
        if not trace.contacts:
            warnings.append(f"{Path(trace.file).name}: no contact; check supply, bobs and the file.")
        if len({*trace.decoded.states.tolist()}) < 2 and trace.contacts:
            warnings.append(f"{Path(trace.file).name}: one level only; gain and offset are taken as 1 and 0.")
    return warnings
