"""`python -m myomorph.lab.cli`."""

import sys

from myomorph.lab.cli import main

sys.exit(main())
