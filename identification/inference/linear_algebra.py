"""Linear algebra on one thread: several would be in the way of threads that simulate, and would round by how many they
are, so that the same readings led to other fits on another machine."""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_P = ParamSpec("_P")
_R = TypeVar("_R")


def on_one_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """The function, during which BLAS, as far as it can be told to, uses one thread in the whole process."""

    @functools.wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
