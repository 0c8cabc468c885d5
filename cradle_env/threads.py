"""Runs on several threads, which stop when asked."""

from __future__ import annotations

import os
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor


class InterruptedRun(BaseException):
    """Another thread has asked the runs of this thread to stop; not an error that a caller could mend."""


def cores() -> int:
    """How many cores this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_threads(function: Callable, items: Sequence, workers: int | None = None) -> list:
    """[function(item) for item in items] on several threads; the kernels run without the interpreter lock."""
    return list(each_in_threads(function, items, workers))


def each_in_threads(function: Callable, items: Sequence, workers: int | None = None) -> Iterator:
    """The same one by one, in their order, as soon as each is there."""
    workers = min(workers or cores(), max(len(items), 1))
    if workers == 1:
        yield from map(function, items)
    else:
        with Threads(workers) as pool:
            yield from pool.map(function, items)


class _Stop:
    """Whether the threads of a pool, and of the pools that they make, are to stop."""

    def __init__(self, parent: _Stop | None) -> None:
        self.asked, self.parent = False, parent

    def __bool__(self) -> bool:
        return self.asked or bool(self.parent)


_thread = threading.local()


class Threads(ThreadPoolExecutor):
    """Threads (all cores where omitted) whose runs stop within a second when asked, or when the block ends by an
    exception, as by Ctrl-C; `ThreadPoolExecutor` alone would wait for their end."""

    def __init__(self, workers: int | None = None) -> None:
        self._asked = stop = _Stop(getattr(_thread, "stop", None))
        super().__init__(workers or cores(), initializer=lambda: setattr(_thread, "stop", stop))

    def stop(self) -> None:
        """Ends the runs under way by InterruptedRun."""
        self._asked.asked = True

    def __exit__(self, kind, error, traceback) -> None:
        if kind is not None:
            self.stop()
        self.shutdown(cancel_futures=True)


def check_stop() -> None:
    """InterruptedRun where the runs of this thread are to stop."""
    if getattr(_thread, "stop", None):
        raise InterruptedRun
