"""`python -m myomorph` does what `myomorph` does."""

import sys

from myomorph.lab.cli import main

sys.exit(main())
