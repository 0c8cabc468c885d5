"""What an instrument beside the trajectories says of the cradle: quantities with normal errors.

`cradle measure` writes a constraint into measurement.json. An experiment.toml names this file, and the constraint
counts in the likelihood of the experiment.
"""

from __future__ import annotations

import json
import math
import re
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from cradle_env.constitutive import contact_times
from cradle_env.cradle import FIELDS, Cradle
from cradle_env.effects import CATALOGUE
from cradle_env.errors import unknown_key
from cradle_env.parameter_name import ParameterName
from identification.storage.files import ExperimentError, json_text
from identification.storage.schema import check_schema

#: Format of measurement.json.
FORMAT = "cradle-measurement/1"
#: Kinds of instruments that give a constraint: tables of an experiment.toml.
KINDS = ("contacts", "impacts", "string", "ringdown")
#: Relative difference of an assumed value from that of the cradle that changes nothing.
_SAME = 1e-3
_GROUP = re.compile(r"b_([1-9]\d{0,2})")
_DURATION = re.compile(r"contact_duration\[(\d+(?:\.\d+)?(?:e[-+]?\d+)?)\]")
_REMEDY = "write it with cradle measure of this version"


def neighbours(bobs):
    """How many neighbours in touch a bob of a group has on average, 2 (n − 1)/n; bobs: n, a number or an array."""
    bobs = np.asarray(bobs, dtype=float)
    return 2.0 * (bobs - 1.0) / bobs


def quantity_of(cradle: Cradle, name: str) -> float:
    """Compute a quantity that instruments measure.

    Parameters
    ----------
    cradle : Cradle
        The cradle.
    name : str
        A field of Cradle; "effect.key", which has its value of absence where the model lacks the effect; "b_n", the
        drag on each of n bobs that swing together [kg/s]; "impact_dissipation", A at 1 m/s; "contact_time_scale",
        (m_eff/k_el)^(2/5) [s (m/s)^(1/5)]; or "contact_duration[v]", of two bobs that meet with v m/s [s].

    Returns
    -------
    float
        In SI units.

    Raises
    ------
    ValueError
        If no quantity has this name.

    Examples
    --------
    >>> from cradle_env import Cradle
    >>> quantity_of(Cradle(b=0.002), "b_3"), round(1e6 * quantity_of(Cradle(), "contact_duration[0.1]"), -1)
    (0.002, 200.0)
    """
    reduced = 0.5 * cradle.mass
    if name == "impact_dissipation":
        return cradle.k_f * cradle.k_el**-0.6 * reduced**-0.4
    if name == "contact_time_scale":
        return (reduced / cradle.k_el) ** 0.4
    if match := _DURATION.fullmatch(name):
        return float(contact_times(cradle, np.array(float(match[1]))))
    if match := _GROUP.fullmatch(name):
        return cradle.b * (1.0 + quantity_of(cradle, "group_drag.slope") * float(neighbours(int(match[1]))))
    if name in FIELDS and name != "delta":
        return float(getattr(cradle, name))
    stated = ParameterName.parse(name)
    for effect in CATALOGUE:
        for parameter in effect.parameters:
            if (effect.name, parameter.key) == (stated.effect, stated.key) and not parameter.each:
                return float(cradle.effects.get(effect.name, {}).get(parameter.key, parameter.absent))
    raise ValueError(unknown_key("quantity", name[:40], ["kappa", "k_f", "b", "b_3", "impact_dissipation"]))


@dataclass(frozen=True, eq=False)
class Constraint:
    """Quantities of the cradle that an instrument has measured, with normal errors.

    Parameters
    ----------
    kind : str
        Kind of the instrument, one of KINDS.
    quantities : tuple of str
        Names that `quantity_of` knows.
    mean : ndarray of shape (Q,)
        Measured values, in SI units.
    covariance : ndarray of shape (Q, Q)
        Of their errors.
    assumed : mapping of str to float
        Fields of Cradle on which the values rest, as they were assumed.
    file : str
        The measurement.json.

    Raises
    ------
    ValueError
        If a quantity is not known, shapes do not fit, or the covariance is not positive definite.

    Examples
    --------
    >>> import numpy as np
    >>> from cradle_env import Cradle
    >>> string = Constraint("string", ("kappa",), np.array([200.0]), np.array([[4.0]]))
    >>> string.residuals(Cradle(kappa=206.0)).tolist()
    [3.0]
    """

    kind: str
    quantities: tuple[str, ...]
    mean: np.ndarray
    covariance: np.ndarray
    assumed: Mapping[str, float] = field(default_factory=dict)
    file: str = "measurement.json"

    def __post_init__(self) -> None:
        if self.kind not in KINDS:
            raise ValueError(
                f"an instrument of kind {self.kind!r} gives no constraint; those that do: {', '.join(KINDS)}"
            )
        for name in self.quantities:
            quantity_of(Cradle(), name)
        try:
            mean, covariance = np.array(self.mean, dtype=float), np.array(self.covariance, dtype=float)
        except ValueError:
            raise ValueError("the rows of the covariance differ in length; state a square one") from None
        count = len(self.quantities)
        if mean.shape != (count,) or covariance.shape != (count, count) or not count:
            raise ValueError(
                f"{count} quantities, mean of shape {mean.shape} and covariance of shape {covariance.shape} do not fit"
                " together; state one mean for each quantity, and a square covariance"
            )
        if not (np.isfinite(mean).all() and np.isfinite(covariance).all()):
            raise ValueError("mean and covariance must be finite numbers; measure again")
        scale = np.sqrt(np.maximum(np.diag(covariance), 0.0))
        if not (scale > 0.0).all() or np.linalg.eigvalsh(covariance / np.outer(scale, scale))[0] <= 0.0:
            raise ValueError("the covariance is not positive definite; each quantity needs an error above 0")
        object.__setattr__(self, "mean", mean)
        object.__setattr__(self, "covariance", covariance)
        object.__setattr__(self, "_whitener", np.linalg.inv(np.linalg.cholesky(covariance)))

    def predict(self, cradle: Cradle) -> np.ndarray:
        """The quantities of a cradle, (Q,)."""
        return np.array([quantity_of(cradle, name) for name in self.quantities])

    def residuals(self, cradle: Cradle) -> np.ndarray:
        """Predicted less measured, whitened: independent, each with standard deviation 1, (Q,)."""
        return vars(self)["_whitener"] @ (self.predict(cradle) - self.mean)

    def check(self, cradle: Cradle) -> None:
        """Raise ValueError if an assumed value is not that of the cradle."""
        for name, value in self.assumed.items():
            own = float(getattr(cradle, name))
            if not math.isclose(value, own, rel_tol=_SAME):
                raise ValueError(
                    f"was measured with {name} = {value:g} {FIELDS[name][0]}, but [cradle] has {own:g}; measure again"
                    " with --from this experiment, or correct [cradle]"
                )

    def content(self) -> dict[str, Any]:
        """As measurement.json has it."""
        return {
            "quantities": list(self.quantities),
            "mean": self.mean,
            "covariance": self.covariance,
            "assumed": dict(self.assumed),
        }

    def text(self) -> str:
        """Text of a measurement.json with the constraint alone."""
        return json_text({"format": FORMAT, "kind": self.kind, "constraint": self.content()})


def _parse(text: str, kind: str, file: str) -> dict[str, Any]:
    """Parse a measurement.json of this kind. Raises ExperimentError if it is another file."""
    try:
        content = json.loads(text)
    except (ValueError, RecursionError):
        raise ExperimentError(f"{file}: not valid JSON; {_REMEDY}") from None
    if not isinstance(content, dict) or content.get("format") != FORMAT:
        raise ExperimentError(f"{file}: no measurement of this program; name the measurement.json of cradle measure")
    found = content.get("kind")
    if found != kind:
        raise ExperimentError(f"{file}: holds a measurement of {found}; name it under [[{found}]], or measure {kind}")
    return content


def sound_table(text: str, file: str) -> str:
    """Name the file of clicks beside a measurement.json of sound. Raises ExperimentError if it is another file."""
    files = _parse(text, "sound", file).get("files")
    tables = [name for name in files if name.endswith(".csv")] if isinstance(files, dict) else []
    if len(tables) != 1:
        raise ExperimentError(f"{file}: names no table of clicks; {_REMEDY}")
    return tables[0]


def parse_constraint(text: str, kind: str, file: str) -> Constraint:
    """Read the constraint of a measurement.json.

    kind: that the experiment states. Raises ExperimentError if the file is another one or has no constraint.
    """
    known = _parse(text, kind, file).get("constraint")
    if known is None:
        raise ExperimentError(f"{file}: says nothing of the cradle's parameters; {_WHY[kind]}")
    check_schema(known, "constraint", f"{file}: constraint", _REMEDY)
    try:
        return Constraint(
            kind, tuple(known["quantities"]), known["mean"], known["covariance"], known["assumed"], file
        )  # fmt: skip
    except ValueError as problem:
        raise ExperimentError(f"{file}: constraint: {problem}") from None


#: Remedies for a measurement without a constraint.
_WHY = {
    "contacts": "measure the contacts of two bobs with --speed",
    **dict.fromkeys(("impacts", "string", "ringdown"), _REMEDY),
}
