"""The figure of docs/contact-forces.md: hands and spine in a lift, `python -m benchmarks.figures hands-lift`."""

from __future__ import annotations

from pathlib import Path

import numpy as np

from benchmarks.figures.page import page
from benchmarks.hands_lift import BOX_MASS, LIFTS, hands_measured, recorded
from benchmarks.hands_lift_forces import found, holding, left_floor, left_open, task
from benchmarks.hands_spine import carried_moment, of_laboratory, spine
from data_collection import data_folder

TRUTH = "#222222"
SHOWN = {
    "body": ("found: body and plate", "#2166ac", "-"),
    "box": ("found: body, plate and box", "#1b7837", "-"),
    "hidden": ("found: body and box, no plate", "#b2182b", "--"),
}


def draw(file: Path) -> None:
    """Vertical force of the hands and bending moment at L5/S1 over both lifts."""
    folder = data_folder()
    with page(file, 2, len(LIFTS), (8.4, 6.0), sharex="col", sharey="row", below=0.09, above=0.90) as (figure, axes):
        for column, lift in enumerate(LIFTS):
            time, off = recorded(folder, lift).markers.time, left_floor(folder, lift)
            below, above = of_laboratory(recorded(folder, lift))
            passing = spine(folder, lift)
            force, moment = axes[:, column]
            force.axhline(BOX_MASS * 9.80665, color="#999999", lw=0.8, ls=":")
            force.text(0.05, BOX_MASS * 9.80665 + 3.0, "weight of the box", color="#777777", fontsize=8)
            force.plot(time, hands_measured(folder, lift)[:, 1], color=TRUTH, lw=2.2, label="measured")
            moment.plot(time, -below[:, 2], color=TRUTH, lw=2.2, label="laboratory, from below")
            late = time >= off
            moment.plot(time[late], -above[late, 2], color="#777777", lw=1.4, label="laboratory, from above")
            moment.plot(time, -passing.from_below[:, 2], color="#e08214", lw=1.4, label="ours, from below")
            for way, (words, color, style) in SHOWN.items():
                one = found(folder, lift, way)
                force.plot(time, one.hands[:, 1], color=color, ls=style, lw=1.2, label=words)
                if way != "box":
                    told = passing.from_above + carried_moment(passing, one)
                    label = words.replace("found", "ours, from above")
                    moment.plot(time, -told[:, 2], color=color, ls=style, lw=1.1, label=label)
            held = np.flatnonzero(holding(folder, lift)[1].any(axis=1))[::2]
            _, greatest, least = (
                -one[:, 1] for one in left_open(task(folder, lift, "hidden"), held.tolist()).of("hands")
            )
            force.fill_between(
                time[held], least, greatest, color="#b2182b", alpha=0.12, lw=0, label="left open, no plate"
            )
            for axis in (force, moment):
                axis.axvline(off, color="#bbbbbb", lw=0.8)
            force.set_title(f"lift {column + 1}", fontsize=9)
            moment.set_xlabel("time [s]")
            moment.text(off + 0.03, 2.0, "off the floor", color="#777777", fontsize=8)
        axes[0, 0].set_ylabel("hands on the box, up [N]")
        axes[1, 0].set_ylabel("extending moment at L5/S1 [N m]")
        for row, (place, columns) in enumerate(((0.95, 3), (0.045, 3))):
            handles, labels = axes[row, 0].get_legend_handles_labels()
            figure.legend(handles, labels, loc="center", bbox_to_anchor=(0.5, place), ncols=columns, frameon=False)
