"""Figures of muscles.

`python -m benchmarks.figures` draws `knee-force`, `passive-tensions`, `mouse-lengths`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.accuracy.tension.knee import (
    BODY_WEIGHT,
    PARTS,
    STRIDES,
    WAYS,
    at_times,
    measured,
    our_loads,
)
from benchmarks.accuracy.tension.passive import solved
from benchmarks.figures.page import legend, page
from data_collection import data_folder
from myomorph.lab.analysis.cycles import band
from truths.mouse_motion import lengths_of

SHOWN = (("default", "#2166ac", "-"), ("personalized", "#b2182b", "-"))
"""Rows of the table, by their names, with a color and a line."""


def draw(file: Path) -> None:
    """Total, medial and lateral force over the strides: measured, and as found."""
    ways = {way.name: way for way in WAYS}
    folder = data_folder()
    with page(file, len(STRIDES), len(PARTS), (9.0, 4.8), sharex=True, sharey="col") as (
        figure,
        axes,
    ):
        percent = np.arange(101)
        for row, stride in zip(axes, STRIDES, strict=True):
            truth, clock = measured(folder, stride)
            found = {
                name: at_times(our_loads(folder, stride, ways[name]), clock) for name, _, _ in SHOWN
            }
            for k, (one, part) in enumerate(zip(row, PARTS, strict=True)):
                one.plot(
                    percent, truth[:, k] / BODY_WEIGHT, color="#222222", lw=1.8, label="measured"
                )
                for name, color, line in SHOWN:
                    one.plot(
                        percent,
                        found[name][:, k] / BODY_WEIGHT,
                        color=color,
                        ls=line,
                        lw=1.2,
                        label=name,
                    )
                one.axhline(0.0, color="#999999", lw=0.6)
                if one in axes[0]:
                    one.set_title(part, fontsize=9)
            row[0].set_ylabel(f"{stride} [body weights]")
        for one in axes[-1]:
            one.set_xlabel("stride [%]")
        legend(figure, axes[0, 0], 3)


PASSIVE_MUSCLES = (
    ("DeltoideusScapula_M", "deltoid, acromial part"),
    ("TRIlong", "triceps, long head"),
)
COLORS = ("#222222", "#2166ac", "#b2182b")


def draw_passive(file: Path) -> None:
    """Tension of two muscles with and without passive dynamics, and the difference, in one lift."""
    plain, (_, (fitting, muscles), (printed, thick)) = solved(data_folder(), "FLX01", "no")
    found = [
        ("no passive dynamics", plain),
        (fitting.replace("d_M", "fitting d_M"), muscles),
        (printed.replace("d_M", "printed d_M"), thick),
    ]
    with page(file, 2, len(PASSIVE_MUSCLES), (8.0, 4.6), sharex=True) as (figure, axes):
        every = slice(None, None, 4)
        for column, (name, words) in enumerate(PASSIVE_MUSCLES):
            m = plain.muscles.index(name)
            for (label, tension), color in zip(found, COLORS, strict=True):
                axes[0, column].plot(
                    tension.time[every],
                    tension.muscle_force[every, m],
                    color=color,
                    lw=1.2,
                    label=label,
                )
                if tension is not plain:
                    change = (tension.muscle_force - plain.muscle_force)[every, m]
                    axes[1, column].plot(tension.time[every], change, color=color, lw=1.2)
            axes[0, column].set_title(words, fontsize=9)
            axes[1, column].set_xlabel("time [s]")
            axes[1, column].axhline(0.0, color="#999999", lw=0.6)
        axes[0, 0].set_ylabel("tension [N]")
        axes[1, 0].set_ylabel("change [N]")
        legend(figure, axes[0, 0], 3)


RECORDING = "1R_12_01_26"
MUSCLES = {
    "ILI": "iliacus",
    "BFP_cranial": "biceps femoris, cranial",
    "SM": "semimembranosus",
    "ST": "semitendinosus",
    "RF": "rectus femoris",
    "VL": "vastus lateralis",
    "TA": "tibialis anterior",
    "MG": "medial gastrocnemius",
    "SOL": "soleus",
}
SIDES = {"": ("right", "#2166ac"), "_l": ("left", "#b2182b")}


def draw_lengths(file: Path) -> None:
    """Every stride as a thin line, the mean with its 95 % interval, right and left."""
    analysis = lengths_of(data_folder(), RECORDING)
    with page(file, 3, 3, (8.4, 6.6), sharex=True, span=(0.0, 0.96)) as (figure, axes):
        percent = np.linspace(0.0, 100.0, 101)
        for axis, (muscle, words) in zip(axes.flat, MUSCLES.items(), strict=True):
            standing = analysis.standing[analysis.muscles.index(muscle)]
            for ending, (side, color) in SIDES.items():
                curves = 100.0 * analysis.curves(f"{muscle}{ending}") / standing
                axis.plot(percent[::4], curves.T[::4], color=color, lw=0.5, alpha=0.35)
                mean = band(curves)
                axis.fill_between(
                    percent[::2], mean.low[::2], mean.high[::2], color=color, alpha=0.18, lw=0
                )
                count = int(np.isfinite(curves).all(axis=1).sum())
                axis.plot(percent, mean.mean, color=color, lw=1.8, label=f"{side}, {count} strides")
            axis.set_title(f"{words} ({muscle.split('_')[0]})", fontsize=9)
        for axis in axes[-1]:
            axis.set_xlabel("stride, strike to strike [%]")
        axes[1, 0].set_ylabel("muscle-tendon length [% of standing]")
        legend(figure, axes[0, 0], 2)
