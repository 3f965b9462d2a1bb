"""Comparisons of accuracy and speed; run from the root of a checkout.

They try more cases than the tests do, with the tests' own models and comparisons: those folders are
importable.
"""

import sys
from pathlib import Path

TESTS = Path(__file__).resolve().parents[1] / "tests"
sys.path += [str(TESTS / room) for room in ("", "rigid", "muscles", "identify", "morph", "fuzz")]
