"""`python -m identification` is the command `cradle`."""

import sys

from identification.cli import main

sys.exit(main())
