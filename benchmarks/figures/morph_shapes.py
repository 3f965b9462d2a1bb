"""The figure of carried attachments in docs/validation: `python -m benchmarks.figures morph-shapes`."""

from __future__ import annotations

from functools import partial
from pathlib import Path

import numpy as np

from benchmarks.accuracy.morph.shapes import PLACES, carried, cases, every_map, foreseen
from benchmarks.figures.page import legend, page

COUNTS = (4, 6, 8, 12, 16, 24, 36)
SHOWN = {
    "per-axis scaling, distances": ("per-axis scaling", "#777777", "-"),
    "affine": ("affine", "#e08214", "-"),
    "RBF, r": ("RBF, r", "#2166ac", "-"),
    "SSD": ("SSD", "#b2182b", "-"),
}


def draw(file: Path) -> None:
    """Mean error of attachments over the number of landmarks, in both places."""
    with page(file, 1, len(PLACES), (8.4, 3.6), sharey=True, above=0.92) as (figure, axes):
        makers = every_map()
        for axis, (where, landmarks) in zip(axes, PLACES.items(), strict=True):
            for name, (words, color, style) in SHOWN.items():
                errors = [carried(makers[name], partial(landmarks, count=n), cases("mean")).on.mean() for n in COUNTS]
                axis.plot(COUNTS, 1e3 * np.array(errors), style, color=color, marker="o", ms=3, lw=1.4, label=words)
                if words == "per-axis scaling":
                    axis.plot(COUNTS, 5e2 * np.array(errors), ":", color=color, lw=1.0, label="half of it")
            told = [1e3 * foreseen(partial(landmarks, count=n)) for n in COUNTS]
            axis.plot(COUNTS, told, "--", color="#1b7837", lw=1.2, label="regression on other persons")
            axis.set_title(f"landmarks {where}" if where.startswith("at") else f"landmarks at {where}", fontsize=9)
            axis.set_xlabel("landmarks on each bone")
            axis.set_xticks(COUNTS, [str(n) for n in COUNTS])
        axes[0].set_ylabel("mean error of attachments [mm]")
        axes[0].set_ylim(0.0, 6.5)
        legend(figure, axes[0], 6, fontsize=8)
