"""Derivatives of a run by named parameters: what is theirs in the records and at the start, and what follows."""

from __future__ import annotations

import dataclasses
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from cradle_env.cradle import FIELDS, Cradle
from cradle_env.effects import CATALOGUE
from cradle_env.errors import unknown_key
from cradle_env.kernel_records import records
from cradle_env.mechanics import layout as p
from cradle_env.mechanics import tangents
from cradle_env.mechanics.tangent_lanes import INPUTS, SHEET, TANGENT_ORDER
from cradle_env.mechanics.tangent_layout import BOB_FIELDS, LAW_FIELDS, STATES
from cradle_env.parameter_name import ALL, ParameterName
from cradle_env.release import InitialState, Release

Start = Release | InitialState
#: Records and state at the start of a run: (cradle (1,), bobs (N,), S (N, COLUMNS)).
Begun = tuple[np.ndarray, np.ndarray, np.ndarray]
#: Function of records, cradle and release that gives the state at the start of a run, and scratch.
Begin = Callable[[np.ndarray, np.ndarray, Cradle, Start], tuple[np.ndarray, np.ndarray]]

# Step of the differences of records and start, which are smooth and exact to rounding, as a part of a parameter's size.
_STEP = 1e-3
# Fields of a cradle that stand in the records as they are, and nothing else but the step depends on them.
_RECORDED = ("k_f", "kappa", "b")
# Sizes of parameters that may be 0.
_SIZES = {"b": 1e-3, "k_f": 1e3, "delta": 1e-2, "poisson_ratio": 0.1, "pivot_half_spacing": 0.1}
# Half the step leaves a quarter of a smooth function's second difference, but half of that of a kink; and rounding.
_KINK, _ROUNDING = 0.375, 1e-13


def supported(c: np.ndarray) -> str:
    """Why runs of a cradle with this record have no derivatives; empty where they have."""
    if not c["series"][0]:
        return "they cover elastic strings with linear drag, and no effect that acts along the way or between bobs"
    if c["contact_scale"][0] > 0.0 or c["departure_speed"][0] != 0.0:
        return "they cover instantaneous impacts under eq. 1, a power law or a constant restitution"
    return ""


def with_parameters(cradle: Cradle, release: Start, values: Mapping[str, float]) -> tuple[Cradle, Start]:
    """Cradle and release with other values of parameters, by the names of sensitivities; ValueError for values out of
    bounds."""
    for name, value in values.items():
        _, _, varied = _parameter(name, cradle, release)
        cradle, release = varied(float(value))
    return cradle, release


def differentiate(
    names: Sequence[str],
    cradle: Cradle,
    release: Start,
    begin: Begin,
    begun: Begun,
    table: np.ndarray,
    impacts: np.ndarray,
    times: np.ndarray,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives (P, T, N) of θ and r at the sample times and (P, M) of the instants of the impacts (M, LOGGED), per
    unit of each of P parameters; nan where they do not exist.

    begun: records and state of this run.
    """
    c, bobs, S = begun
    if refused := supported(c):
        raise ValueError(f"sensitivities of this cradle are not known: {refused}; leave them out")
    law, fields, D = _of_start(names, cradle, release, begin, c, bobs)
    D[:, :][S[:, p.LINK] != p.OPEN] = np.nan
    D[1:][S[:-1, p.LINK] != p.OPEN] = np.nan
    coarser = c.copy()
    coarser["tolerance"] **= TANGENT_ORDER / p.ORDER
    W, sheet, inputs = np.zeros((len(bobs), p.SCRATCH)), np.zeros(SHEET), np.zeros((len(names), INPUTS))
    theta = np.empty((len(names), len(times), len(bobs)))
    r, instants = np.empty_like(theta), np.empty((len(names), len(impacts)))
    tangents.differentiate(
        coarser[0], bobs, table, S, W, sheet, inputs, impacts, times, float(times[-1]),
        law, fields, D, theta, r, instants,
    )  # fmt: skip
    return theta, r, instants


def _of_start(
    names: Sequence[str], cradle: Cradle, release: Start, begin: Begin, c: np.ndarray, bobs: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Derivatives of the law of impacts (P, LAW_FIELDS), of the bobs' records (N, P, BOB_FIELDS) and of the start
    (N, P, STATES)."""
    n, split = cradle.bobs, np.cumsum([LAW_FIELDS, cradle.bobs * BOB_FIELDS])
    law, fields, D = [], [], []
    here = _numbers(c, bobs, begin(c, bobs, cradle, release)[0])
    for name in names:
        value, size, varied = _parameter(name, cradle, release)

        def numbers(x: float, name=name, varied=varied) -> np.ndarray:
            if name in _RECORDED and x >= 0.0:  # a fifth of the time that records of another cradle take
                of_cradle, of_bobs = c.copy(), bobs.copy()
                (of_cradle if name == "k_f" else of_bobs)[name] = x
                return _numbers(of_cradle, of_bobs, begin(of_cradle, of_bobs, cradle, release)[0])
            other, start = varied(x)
            same = other is cradle
            of_cradle, of_bobs = (c, bobs) if same else records(other)
            return _numbers(of_cradle, of_bobs, begin(of_cradle, of_bobs, other, start)[0])

        of_law, of_bobs, of_start = np.split(_slopes(numbers, here, value, _STEP * size), split)
        law.append(of_law)
        fields.append(of_bobs.reshape(n, BOB_FIELDS))
        D.append(of_start.reshape(n, STATES))
    return np.array(law), np.stack(fields, axis=1), np.stack(D, axis=1)


def _numbers(c: np.ndarray, bobs: np.ndarray, S: np.ndarray) -> np.ndarray:
    """All that `mechanics.tangents` needs the derivatives of, in a row."""
    law = [c["k_f"][0] * c["k_el"][0] ** -0.6, c["alpha"][0], c["exponent"][0], c["restitution"][0], c["radius"][0]]
    fields = [
        bobs["pivot"],
        bobs["grip"] * bobs["mobility"],
        bobs["b"] * bobs["mobility"],
        bobs["half_spacing"] ** 2,
        bobs["string"],
        bobs["fall"],
        bobs["kappa"],
        bobs["mobility"],
    ]
    start = np.concatenate([S[:, p.START : p.START + 4], S[:, p.TENSION : p.TENSION + 3]], axis=1)
    return np.concatenate([law, np.stack(fields, axis=1).ravel(), start.ravel()])


def _slopes(numbers: Callable[[float], np.ndarray], here: np.ndarray, x: float, h: float) -> np.ndarray:
    """Derivatives of smooth numbers at x, where they are `here`, by differences of order 4: central, or one-sided at a
    bound. nan, all of them, where there is a kink."""
    for side in (0.0, 1.0, -1.0):
        try:
            if side == 0.0:
                ahead, behind, near_ahead, near_behind = (numbers(x + k * h) for k in (1.0, -1.0, 0.5, -0.5))
                bend, near_bend = ahead - 2.0 * here + behind, near_ahead - 2.0 * here + near_behind
                kink = np.abs(near_bend) > _KINK * np.abs(bend) + _ROUNDING * np.abs(here)
                slopes = (8.0 * (near_ahead - near_behind) - (ahead - behind)) / (6.0 * h)
                return np.full(len(here), np.nan) if kink.any() else slopes
            step = side * h
            at = [numbers(x + k * step) for k in range(1, 5)]
            return (-25.0 * here + 48.0 * at[0] - 36.0 * at[1] + 16.0 * at[2] - 3.0 * at[3]) / (12.0 * step)
        except ValueError:  # beyond a bound
            continue
    return np.full(len(here), np.nan)


def _parameter(
    name: str, cradle: Cradle, release: Start
) -> tuple[float, float, Callable[[float], tuple[Cradle, Start]]]:
    """(value, size, function of its value that gives cradle and release) of a parameter by name."""
    parsed = ParameterName.parse(name)
    if parsed.effect:
        return _effect_parameter(parsed, cradle, release)
    # ALL has no meaning here: it becomes element -1, which no field of a cradle or release has.
    field, element = parsed.key, None if parsed.element is None else parsed.element - 1
    if field in ("release_angle", *_STATE_FIELDS):
        return _start_parameter(name, field, element, cradle, release)
    if field in ("alpha", "n") and cradle.power_law is not None and element is None:
        k = ("alpha", "n").index(field)
        both = cradle.power_law
        return (
            both[k],
            max(abs(both[k]), 1e-2),
            lambda x: (
                cradle.replace(power_law=(x, both[1]) if k == 0 else (both[0], x)),
                release,
            ),
        )
    has_gap = element is not None and 0 <= element < cradle.bobs - 1
    if field == "delta" and (has_gap or (element is None and not isinstance(cradle.delta, tuple))):
        gaps = np.broadcast_to(np.asarray(cradle.delta, dtype=float), cradle.bobs - 1)
        chosen = np.ones(len(gaps)) if element is None else np.eye(len(gaps))[element]
        value = float(gaps[element or 0])
        return value, _SIZES["delta"], lambda x: (cradle.replace(delta=tuple(gaps + (x - value) * chosen)), release)
    if name not in FIELDS or name == "delta":
        known = [*FIELDS, "alpha", "n", "release_angle", *_STATE_FIELDS]
        raise ValueError(unknown_key("sensitivity", name, known) + "; effects by effect.key")
    value = float(getattr(cradle, name))
    return value, max(abs(value), _SIZES.get(name, 0.0)), lambda x: (cradle.replace(**{name: x}), release)


def _effect_parameter(name: ParameterName, cradle: Cradle, release: Start):
    effect = next((e for e in CATALOGUE if e.name == name.effect), None)
    known = {} if effect is None else {q.key: q for q in effect.parameters}
    if name.effect not in cradle.effects or name.key not in known:
        listed = [f"{e.name}.{q.key}" for e in cradle.composition for q in e.parameters if e.name in cradle.effects]
        raise ValueError(unknown_key("sensitivity", str(name), listed) + "; the cradle must have the effect")
    values = np.atleast_1d(cradle.effects[name.effect][name.key])
    if (name.element or ALL) > len(values):
        raise ValueError(f"sensitivity {name}: {name.effect} has {len(values)} values of {name.key}, numbered from 1")
    value = float(values[max((name.element or ALL) - 1, 0)])
    size = max(abs(value), abs(known[name.key].scale))
    return value, size, lambda x: (cradle.with_values({str(name): x}), release)


#: Fields of an `InitialState`, one number a bob.
_STATE_FIELDS = ("theta", "theta_dot", "r", "r_dot", "tension_ratio")


def _angle_size(angle: float) -> float:
    return max(abs(angle), 1e-3)


def _start_parameter(name: str, field: str, element: int | None, cradle: Cradle, release: Start):
    if isinstance(release, Release):
        if field == "release_angle" and element is None and release.angle is not None:
            return release.angle, _angle_size(release.angle), lambda x: (cradle, dataclasses.replace(release, angle=x))
        if field == "release_angle" and element is not None and element + 1 in (release.angles or {}):
            angles = dict(release.angles or {})
            bob = element + 1
            return (
                angles[bob],
                _angle_size(angles[bob]),
                lambda x: (cradle, dataclasses.replace(release, angles={**angles, bob: x})),
            )
        listed = ["release_angle"] if release.angles is None else [f"release_angle[{bob}]" for bob in release.angles]
        raise ValueError(unknown_key("sensitivity", name, listed) + " of this release")
    given = getattr(release, field, None)
    if given is None or element is None or not 0 <= element < len(given):
        listed = [f"{f}[{i + 1}]" for f in _STATE_FIELDS if getattr(release, f) is not None for i in range(cradle.bobs)]
        raise ValueError(unknown_key("sensitivity", name, listed) + " of this initial state")
    array, chosen = np.asarray(given, dtype=float), np.eye(cradle.bobs)[element]
    size, value = {"r": cradle.length, "r_dot": 0.1}.get(field, 1.0), float(array[element])
    return value, size, lambda x: (cradle, dataclasses.replace(release, **{field: array + (x - value) * chosen}))
