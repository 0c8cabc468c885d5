"""`python -m identification` is the command `cradle`."""

import sys

from identification.cli.app import main

sys.exit(main())
