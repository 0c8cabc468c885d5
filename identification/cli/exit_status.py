"""How a command of `cradle` ends: exit status, message, and what is kept when it is stopped.

Exit status: 0, done; 2, unusable input, with one line on stderr; 130, interrupted; 1, anything else.
"""

from __future__ import annotations

import errno
import os
import sys
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import typer

_USAGE_ERROR: Any = typer.BadParameter.__mro__[1]  # click's, or typer's own copy of it
_UNUSABLE = (ValueError, FileNotFoundError, FileExistsError, PermissionError, IsADirectoryError, NotADirectoryError)


class _InterruptedError(Exception):
    """Ctrl-C; the message says what is kept and how to go on."""


class _FullDiskError(Exception):
    """No room for a file; the message says what is kept and how to go on."""


#: No space left, a quota used up, a file larger than it may be.
_FULL = (errno.ENOSPC, errno.EDQUOT, errno.EFBIG)


@contextmanager
def report_what_is_kept(out: Path | None, what: Callable[[], str]) -> Iterator[None]:
    """Run the body of a command that writes to `out`; say what is kept if Ctrl-C or a full disk stops it."""
    try:
        yield
    except KeyboardInterrupt:
        raise _InterruptedError(f"interrupted; {what()}") from None
    except OSError as problem:
        if problem.errno not in _FULL:
            raise
        raise _FullDiskError(f"no space left in {out}; {what()}") from None


def nothing_kept() -> str:
    """Say that a command which writes everything at its end has written nothing."""
    return "nothing was written that was not finished"


def resumable(what: str) -> Callable[[], str]:
    """Make the sentence that says `what` is kept and that the same command resumes from it."""
    return lambda: f"{what}, and the same command goes on from there"


def run_to_exit_status(command: Callable[[], int | None]) -> int:
    """Run a command; turn its exception, if any, into one line on stderr and an exit status."""
    try:
        return int(command() or 0)
    except _USAGE_ERROR as problem:
        return _exit_status(2, _usage_message(problem))
    except _InterruptedError as problem:
        return _exit_status(130, str(problem))
    except _FullDiskError as problem:
        return _exit_status(1, str(problem))
    except (KeyboardInterrupt, typer.Abort):
        return _exit_status(130, "interrupted")
    except BrokenPipeError:  # the reader of our output has gone
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        return 1
    except _UNUSABLE as problem:
        return _exit_status(2, _one_line(problem))
    except (OSError, MemoryError) as problem:
        return _exit_status(1, _one_line(problem) or type(problem).__name__)
    except RuntimeError as problem:
        from cradle_env.simulation import SimulationError

        if not isinstance(problem, SimulationError):
            raise
        return _exit_status(1, str(problem))


def _usage_message(problem: Exception) -> str:
    """A mistake on the command line in one line, with the nearest that is right."""
    possible = getattr(problem, "possibilities", None)
    message = problem.format_message()  # type: ignore[attr-defined]
    if possible:
        message = message.partition("(")[0].strip() + f"; did you mean {possible[0]}?"
    return f"{message}{'' if message.endswith(('.', '?')) else '.'} See cradle --help."


def _one_line(problem: BaseException) -> str:
    if isinstance(problem, OSError) and problem.filename is not None:
        return f"{problem.filename}: {problem.strerror}"
    return str(problem)


def _exit_status(status: int, message: str) -> int:
    print("cradle:", " ".join(message.split()), file=sys.stderr)
    return status
