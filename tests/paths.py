"""Where things are."""

from pathlib import Path

#: The checkout.
ROOT = Path(__file__).resolve().parents[1]
#: Measured cradles and reference experiments, which the project does not ship: tests that need them skip without.
DATA = ROOT.parent / "shared" / "data"
