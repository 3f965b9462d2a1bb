"""`python -m benchmarks.figures NAME [FILE]`: draw a figure of the documentation."""

from __future__ import annotations

import argparse
import importlib
from pathlib import Path

from benchmarks.figures.page import IMAGES

FIGURES = {
    "chapter3-wrenches": "bodies:draw",
    "contact-intervals": "contacts:draw_intervals",
    "gait.png": "screens:draw_gait",
    "hands-lift": "contacts:draw_lift",
    "hidden-plates": "contacts:draw",
    "inertial-angles": "sensors:draw",
    "knee-force": "muscles:draw",
    "morph-shapes": "bones:draw_errors",
    "mouse-lengths": "muscles:draw_lengths",
    "mujoco-arms": "exchange:draw_arms",
    "opensim-torques": "exchange:draw_torques",
    "passive-tensions": "muscles:draw_passive",
    "report.png": "screens:draw_report",
    "species-leg": "bones:draw",
    "walk.gif": "screens:draw_walk",
}

parser = argparse.ArgumentParser(prog="python -m benchmarks.figures", description=__doc__)
parser.add_argument("name", choices=FIGURES)
parser.add_argument("file", nargs="?", type=Path)
options = parser.parse_args()
module, function = FIGURES[options.name].split(":")
getattr(importlib.import_module(f"benchmarks.figures.{module}"), function)(
    options.file or IMAGES / (options.name if "." in options.name else f"{options.name}.svg")
)
