"""`python -m benchmarks.figures NAME [FILE]`: draw a figure of the documentation."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from benchmarks.figures.page import IMAGES

FIGURES = {
    "contact-intervals": "certificates",
    "hands-lift": "hands",
    "hidden-plates": "hidden_plates",
    "knee-force": "knee",
    "morph-shapes": "morph_shapes",
    "mouse-lengths": "mouse",
    "passive-tensions": "passive",
    "species-leg": "species",
}

parser = argparse.ArgumentParser(prog="python -m benchmarks.figures", description=__doc__)
parser.add_argument("name", choices=FIGURES)
parser.add_argument("file", nargs="?", type=Path)
options = parser.parse_args()
figure = importlib.import_module(f"benchmarks.figures.{FIGURES[options.name]}")
figure.draw(options.file or IMAGES / f"{options.name}.svg")
