"""Run functions on several threads that can be stopped."""

from __future__ import annotations

import os
import sys
import threading
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ThreadPoolExecutor


class InterruptedRun(BaseException):
    """Another thread asked this thread to stop. It is no Exception, so that no caller handles it by mistake."""


def cores() -> int:
    """Number of cores that this process may use."""
    if hasattr(os, "sched_getaffinity"):
        return len(os.sched_getaffinity(0))
    return os.cpu_count() or 1


def in_threads(function: Callable, items: Sequence, workers: int | None = None) -> list:
    """Return [function(item) for item in items], computed on several threads.

    Threads help since the kernels release the interpreter lock. workers: number of threads; all cores if omitted. A
    call from within one of these threads has only those that the outer call leaves idle.
    """
    return list(each_in_threads(function, items, workers))


def each_in_threads(function: Callable, items: Sequence, workers: int | None = None) -> Iterator:
    """Yield the results of `in_threads` in order, each as soon as it and all before it are ready."""
    allowed = min(workers or cores(), _thread.share)
    used = min(allowed, len(items))
    if used <= 1:
        yield from map(function, items)
    else:
        with Threads(used, allowed // used) as pool:
            yield from pool.map(function, items)


class _Stop:
    """Whether the threads of a pool, and of pools that these threads create, must stop."""

    def __init__(self, parent: _Stop | None) -> None:
        self.asked, self.parent = False, parent

    def __bool__(self) -> bool:
        return self.asked or bool(self.parent)


class _Thread(threading.local):
    """What a pool says to each of its threads: when to stop, and how many threads calls within may use."""

    stop: _Stop | None = None
    share: int = sys.maxsize


_thread = _Thread()


class Threads(ThreadPoolExecutor):
    """A thread pool whose runs stop within a second after `stop`, or after an exception such as Ctrl-C in the block.

    `ThreadPoolExecutor` alone would wait until they end. workers: number of threads; all cores if omitted. share: how
    many threads `in_threads` may use within each of them.
    """

    def __init__(self, workers: int | None = None, share: int = 1) -> None:
        self._asked = stop = _Stop(_thread.stop)

        def begin() -> None:
            _thread.stop, _thread.share = stop, share

        super().__init__(workers or cores(), initializer=begin)

    def stop(self) -> None:
        """Make the present runs raise InterruptedRun."""
        self._asked.asked = True

    def __exit__(self, kind, error, traceback) -> None:
        if kind is not None:
            self.stop()
        self.shutdown(cancel_futures=True)


def check_stop() -> None:
    """Raise InterruptedRun if the runs of this thread must stop."""
    if _thread.stop:
        raise InterruptedRun
