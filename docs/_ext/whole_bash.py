"""The magic %%bash of the tutorials: output in one piece, as into a file, and no progress bars."""

from __future__ import annotations

import os
import subprocess
from typing import Any


def bash(_line: str, cell: str) -> None:
    """Runs a cell; CalledProcessError, with what it said, where a command fails."""
    plain = {name: value for name, value in os.environ.items() if name not in ("FORCE_COLOR", "CLICOLOR_FORCE")}
    done = subprocess.run(["bash", "-e"], input=cell, text=True, capture_output=True, env=plain)
    print(done.stdout.strip("\n"))
    if done.returncode:
        raise subprocess.CalledProcessError(done.returncode, cell, done.stdout, done.stderr)


def load_ipython_extension(ipython: Any) -> None:
    """Takes the place of IPython's own."""
    ipython.register_magic_function(bash, "cell")
