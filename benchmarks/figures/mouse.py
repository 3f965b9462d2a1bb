"""The figure of docs/validation: muscle lengths of a mouse, `python -m benchmarks.figures mouse-lengths`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.figures.page import legend, page
from data_collection import data_folder
from myomorph.analysis.cycles import band
from truths.mouse_motion import lengths_of

SHOWN = "1R_12_01_26"
MUSCLES = {
    "ILI": "iliacus", "BFP_cranial": "biceps femoris, cranial", "SM": "semimembranosus", "ST": "semitendinosus",
    "RF": "rectus femoris", "VL": "vastus lateralis", "TA": "tibialis anterior", "MG": "medial gastrocnemius",
    "SOL": "soleus",
}  # fmt: skip
SIDES = {"": ("right", "#2166ac"), "_l": ("left", "#b2182b")}


def draw(file: Path) -> None:
    """Every stride as a thin line, the mean with its 95 % interval, right and left."""
    analysis = lengths_of(data_folder(), SHOWN)
    with page(file, 3, 3, (8.4, 6.6), sharex=True, above=0.96) as (figure, axes):
        percent = np.linspace(0.0, 100.0, 101)
        for axis, (muscle, words) in zip(axes.flat, MUSCLES.items(), strict=True):
            standing = analysis.standing[analysis.muscles.index(muscle)]
            for ending, (side, color) in SIDES.items():
                curves = 100.0 * analysis.curves(f"{muscle}{ending}") / standing
                axis.plot(percent[::4], curves.T[::4], color=color, lw=0.5, alpha=0.35)
                mean = band(curves)
                axis.fill_between(percent[::2], mean.low[::2], mean.high[::2], color=color, alpha=0.18, lw=0)
                count = int(np.isfinite(curves).all(axis=1).sum())
                axis.plot(percent, mean.mean, color=color, lw=1.8, label=f"{side}, {count} strides")
            axis.set_title(f"{words} ({muscle.split('_')[0]})", fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("stride, strike to strike [%]")
        axes[1, 0].set_ylabel("muscle-tendon length [% of standing]")
        legend(figure, axes[0, 0], 2)
