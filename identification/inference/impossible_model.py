"""The error of points for which there is no cradle, no release or no motion."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from cradle_env.simulation import SimulationError

_P = ParamSpec("_P")
_R = TypeVar("_R")


class ImpossibleModelError(SimulationError):
    """No cradle, release or motion belongs to these values of the unknowns; the message says why."""


def raises_impossible(work: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function so that ValueError and SimulationError become `ImpossibleModelError`."""

    @functools.wraps(work)
    def tried(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        try:
            return work(*args, **kwargs)
        except ImpossibleModelError:
            raise
        except (SimulationError, ValueError) as problem:
            raise ImpossibleModelError(str(problem)) from problem

    return tried
