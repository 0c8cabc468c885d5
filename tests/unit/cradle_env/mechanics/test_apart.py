"""Kernels that are compiled when they are first called."""

import logging
import subprocess
import sys

from numba import types

from cradle_env.mechanics.apart import apart
from cradle_env.mechanics.jit import entry

_BROKEN = """
from numba import types
from cradle_env.mechanics.apart import apart
from cradle_env.mechanics.jit import entry

@apart(types.float64, types.float64)
def broken(x):
    return x.no_such_thing

@entry
def caller(x):
    return broken(x)

caller(1.0)
print("went on")
"""


@apart(types.float64, types.float64, types.int64)
def power(x, n):
    """x to the n by repeated multiplication."""
    y = 1.0
    for _ in range(n):
        y *= x
    return y


@entry
def twice(x, n, wanted):
    """Two calls of the kernel, or none."""
    return power(x, n) + power(-x, n + 1) if wanted else 0.0


def test_a_kernel_is_compiled_when_it_is_first_called_and_says_so_once(caplog):
    with caplog.at_level(logging.WARNING, "cradle_env"):
        assert twice(3.0, 2, False) == 0.0
        assert not caplog.records
        assert twice(3.0, 2, True) == 9.0 - 27.0
        assert twice(2.0, 4, True) == 16.0 - 32.0
    # None where an earlier run of the tests has left the kernel in the cache.
    assert [record.args for record in caplog.records] in ([], [("power",)])


def test_a_kernel_that_cannot_be_compiled_ends_the_process_with_its_name(tmp_path):
    script = tmp_path / "script.py"
    script.write_text(_BROKEN, encoding="utf-8")
    run = subprocess.run([sys.executable, script], capture_output=True, text=True, timeout=120, check=False)
    assert run.returncode not in (0, 1)  # not by an exception of Python
    assert "no_such_thing" in run.stderr and "could not be compiled" in run.stderr
    assert "went on" not in run.stdout
