"""`python -m myomorph.cli`."""

import sys

from myomorph.cli import main

sys.exit(main())
