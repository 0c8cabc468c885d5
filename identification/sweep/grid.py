"""The grid of a sweep: named axes over a cradle and its release, and the run at each index."""

from __future__ import annotations

import math
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from cradle_env.cradle import FIELDS, Cradle
from cradle_env.effects import effect
from cradle_env.errors import one_line, unknown_key
from cradle_env.parameter_name import ALL, ParameterName
from cradle_env.release import Release

#: Unit and symbol of the parameters that can be swept besides the numbers of Cradle and "effect.key".
_OTHERS = {
    "bobs": ("1", "N"),
    "beta": ("1", "β"),
    "alpha": ("1", "α"),
    "n": ("1", "n"),
    "gamma": ("1", "γ"),
    "release_angle": ("rad", "θ_0"),
    "lifted": ("1", "lifted bobs"),
}
#: Pairs of parameters that set the same quantity.
EXCLUSIVE = (("beta", "kappa"), ("alpha", "k_f"), ("n", "k_f"), ("gamma", "release_angle"))
#: Largest number of points of a grid.
_MOST = 10**9


@dataclass(frozen=True)
class Axis:
    """One dimension of a grid, along which one or more parameters change together.

    Parameters
    ----------
    name : str
        Name of the axis.
    columns : mapping of str to ndarray of shape (n,)
        Values of each parameter along the axis, by name.
    """

    name: str
    columns: Mapping[str, np.ndarray]

    def __len__(self) -> int:
        return len(next(iter(self.columns.values())))

    @property
    def values(self) -> np.ndarray:
        """Coordinate along the axis, (n,): its parameter, or 0, 1, … if several parameters change together."""
        return self.columns.get(self.name, np.arange(float(len(self))))

    @property
    def unit_and_symbol(self) -> tuple[str, str]:
        """Unit and symbol of the coordinate."""
        return unit_and_symbol(self.name) if self.name in self.columns else ("1", self.name)


class Grid:
    """All combinations of the values of some axes.

    An axis has the name of a parameter:

    - a number of `Cradle` ("kappa", "length", "delta", "bobs"), or "effect.key";
    - a group of the paper: "beta" sets κ, "alpha" and "n" set the contact e = 1 − α vⁿ, "gamma" sets the release angle;
    - "release_angle" [rad], or "lifted" (number of bobs);
    - "delta[2]" for δ of the second gap alone, and likewise "effect.key[2]".

    κ does not change with masses or lengths, unless "beta" is swept. The sweep, not the grid, finds out which points
    can be simulated.

    Parameters
    ----------
    axes : mapping of str to array of shape (n,)
        Values of each axis, by name; the last axis changes fastest. {name: {parameter: values, …}} makes an axis along
        which several parameters change together, such as draws of a posterior.
    cradle : Cradle
        All values that are not swept.
    release : Release
        Release of each run, unless it is swept.

    Raises
    ------
    ValueError
        If a name is unknown, if two axes set the same quantity, or if values are not finite numbers.
    """

    def __init__(
        self, axes: Mapping[str, Sequence[float] | np.ndarray | Mapping[str, Any]], cradle: Cradle, release: Release
    ) -> None:
        self.cradle, self.release = cradle, release
        self.axes = tuple(_axis(name, given) for name, given in axes.items())
        self.names = tuple(name for axis in self.axes for name in axis.columns)
        if not self.axes:
            raise ValueError("no axis to sweep over; give one or more, as beta=0.05:0.4:100")
        for name in self.names:
            unit_and_symbol(name)
            if self.names.count(name) > 1:
                raise ValueError(f"{name} is on two axes; leave one out")
        if len(self) > _MOST:
            raise ValueError(
                f"the grid has {len(self):.3g} points; it must have at most {_MOST:.0e}; sweep it in parts"
            )
        for one, other in EXCLUSIVE:
            if one in self.names and other in self.names:
                raise ValueError(f"{one} and {other} are both swept; {one} sets {other}, so sweep one of them")
        if "lifted" in self.names and release.angles is not None:
            raise ValueError(
                "lifted is swept, but the release states the angle of each bob; state one angle, and how many bobs are"
                " lifted (--lifted 1)"
            )

    @property
    def shape(self) -> tuple[int, ...]:
        """Number of values of each axis."""
        return tuple(len(axis) for axis in self.axes)

    def __len__(self) -> int:
        return math.prod(self.shape)

    def values(self, indices: np.ndarray) -> np.ndarray:
        """Values of the parameters `names`, (n, K), at flat indices (n,) in C order."""
        at = np.unravel_index(indices, self.shape)
        return np.column_stack(
            [column[i] for axis, i in zip(self.axes, at, strict=True) for column in axis.columns.values()]
        )

    def point(self, index: int) -> tuple[Cradle, Release]:
        """Cradle and release at a flat index. Raises ValueError if there is no such cradle."""
        return build_run(
            self.cradle, self.release, dict(zip(self.names, self.values(np.array([index]))[0], strict=True))
        )


def _axis(name: str, given: Any) -> Axis:
    together = given if isinstance(given, Mapping) else {name: given}
    columns = {key: _check_values(key, values) for key, values in together.items()}
    if len({len(column) for column in columns.values()}) != 1:
        lengths = ", ".join(f"{len(column)} of {key}" for key, column in columns.items())
        raise ValueError(f"axis {name} must hold equally many values of each parameter; it has {lengths or 'none'}")
    axis = Axis(name, columns)
    several, counts = np.unique(axis.values, return_counts=True)
    if len(several) < len(axis):
        raise ValueError(f"{name} = {several[np.argmax(counts)]:g} is {counts.max()} times on its axis; give it once")
    return axis


def _check_values(name: str, values: Any) -> np.ndarray:
    try:
        column = np.array(values, dtype=float)
    except (TypeError, ValueError):
        raise ValueError(f"the values of {name} are {one_line(values)}; give a list of numbers") from None
    if column.ndim != 1 or len(column) == 0 or not np.all(np.isfinite(column)):
        raise ValueError(f"the values of {name} must be a list of finite numbers, not empty")
    return column


def unit_and_symbol(text: str) -> tuple[str, str]:
    """Unit and symbol of a parameter. Raises ValueError, with the nearest name, if it cannot be swept."""
    name = ParameterName.parse(text)
    declared = effect(name.effect).parameters if name.effect else ()
    parameter = next((p for p in declared if p.key == name.key), None)
    if name.effect and parameter is None:
        raise ValueError(unknown_key(f"parameter of {name.effect}", name.key, (p.key for p in declared)))
    of_cradle = FIELDS | _OTHERS
    if name.run is not None or name.element == ALL or not (parameter or name.key in of_cradle):
        raise ValueError(unknown_key("axis", text, of_cradle) + '; or "effect.key"')
    unit, symbol = (parameter.unit, parameter.symbol) if parameter else of_cradle[name.key]
    if name.element is None:
        return unit, symbol
    if not (parameter.each if parameter else name.key == "delta"):
        raise ValueError(f"{text}: {name.whole} is one number; leave [{name.element}] out")
    return unit, f"{symbol}[{name.element}]"


def build_run(cradle: Cradle, release: Release, values: Mapping[str, float]) -> tuple[Cradle, Release]:
    """Set some parameters of a cradle and its release. Raises ValueError if there is no such cradle."""
    fields: dict[str, Any] = {}
    effects = {name: dict(keys) for name, keys in cradle.effects.items()}
    bobs = int(values.get("bobs", cradle.bobs))
    named = [(ParameterName.parse(text), value) for text, value in values.items()]
    for name, value in sorted(named, key=lambda item: item[0].element is not None):  # all bobs before single ones
        of, key = name.effect, name.key
        if of:
            here, several = effects.setdefault(of, {}), effects[of].get(key, effect(of).absent_values()[key])
            here[key] = _with_element(several, name, value, _count(of, key, bobs))
        elif key == "delta":
            fields["delta"] = _with_element(fields.get("delta", cradle.delta), name, value, bobs - 1)
        elif key not in _OTHERS or key == "bobs":
            fields[key] = value
    if "alpha" in values or "n" in values:
        fields["power_law"] = (values.get("alpha", cradle.alpha), values.get("n", cradle.n))
    made = cradle.replace(beta=values.get("beta"), effects=effects, **fields)
    return made, _build_release(release_for_bobs(release, cradle.bobs, made.bobs), cradle, values)


def release_for_bobs(release: Release, stated: int, bobs: int) -> Release:
    """Use a release of `stated` bobs for `bobs` bobs. Raises ValueError if it states angles of single bobs."""
    if release.angles is not None and bobs != stated:
        named = ", ".join(map(str, release.angles))
        raise ValueError(
            f"bobs is {bobs}, but the release states angles of bobs {named} of {stated}; state one angle, and how many"
            " bobs are lifted (--lifted 1)"
        )
    return release


def _count(of: str, key: str, bobs: int) -> int:
    return next(p for p in effect(of).parameters if p.key == key).count(bobs)


def _with_element(several: Any, name: ParameterName, value: float, count: int) -> Any:
    """Return the value, or for one bob or gap the values of all with this one changed."""
    if name.element is None:
        return value
    if name.element > count:
        raise ValueError(f"{name} does not exist; this cradle has {count} of them")
    changed = list(several) if isinstance(several, Sequence) else [several] * count
    changed[name.element - 1] = value
    return tuple(changed)


def _build_release(release: Release, cradle: Cradle, values: Mapping[str, float]) -> Release:
    if not values.keys() & {"release_angle", "gamma", "lifted"}:
        return release
    angle = values.get("release_angle")
    if "gamma" in values:
        if values["gamma"] < 0.0:
            raise ValueError(f"gamma is {values['gamma']:g}; it must be at least 0")
        angle = math.sqrt(6.0 * values["gamma"])
    if "lifted" not in values:
        return release if angle is None else release.lifted_to(angle, cradle)
    lifted: Any = values["lifted"]
    return Release(angle=release.angle if angle is None else angle, bobs=lifted, start=release.start)
