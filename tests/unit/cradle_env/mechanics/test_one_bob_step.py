"""The generated step of one bob is current, and no run needs its generator."""

import subprocess
import sys

from cradle_env.mechanics import write_one_bob_step


def test_the_file_is_current():
    assert write_one_bob_step.TARGET.read_text(encoding="utf-8") == write_one_bob_step.source(), (
        "run `python -m cradle_env.mechanics.write_one_bob_step`"
    )


def test_no_run_imports_the_generator():
    code = "import sys, cradle_env.simulation; sys.exit('cradle_env.mechanics.write_one_bob_step' in sys.modules)"
    subprocess.run([sys.executable, "-c", code], check=True)
