"""`python -m myomorph` does what `myomorph` does."""

import sys

from myomorph.cli import main

sys.exit(main())
