"""Linear algebra on one thread.

Threads of BLAS would compete with the threads that simulate. Their number also changes the rounding, so that the same
readings would give different fits on different machines.
"""

from __future__ import annotations

import functools
from collections.abc import Callable
from typing import ParamSpec, TypeVar

from threadpoolctl import threadpool_limits

_P = ParamSpec("_P")
_R = TypeVar("_R")


def on_one_thread(function: Callable[_P, _R]) -> Callable[_P, _R]:
    """Decorate a function so that BLAS uses one thread, in the whole process, while it runs."""

    @functools.wraps(function)
    def limited(*args: _P.args, **kwargs: _P.kwargs) -> _R:
        with threadpool_limits(1, user_api="blas"):
            return function(*args, **kwargs)

    return limited
