"""Figures of contact forces.

`python -m benchmarks.figures` draws `hidden-plates`, `contact-intervals`, `hands-lift`.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
from matplotlib.axes import Axes

from benchmarks.accuracy.tension.certificates import solved_case
from benchmarks.figures.page import legend, page, zero_lines
from benchmarks.hands_lift import BOX_MASS, LIFTS, hands_measured, recorded
from benchmarks.hands_lift_forces import found, holding, left_floor, left_open, task
from benchmarks.hands_spine import carried_moment, of_laboratory, spine
from benchmarks.hidden_plates import CASES, Hidden, estimated, feet_of, foot_wrench, opened
from data_collection import data_folder
from myomorph.core.tension.certificates import contact_intervals

SHOWN = (0, 1, 2, 5)
COLORS = {"right": "#b2182b", "left": "#2166ac"}
ROWS = ((1, "vertical [weight]"), (0, "fore-aft [weight]"))


def draw(file: Path) -> None:
    """Measured and estimated force of each foot over its weight: vertical above, fore-aft below."""
    folder = data_folder()
    with page(file, len(ROWS), len(SHOWN), (11.0, 4.8), sharex="col", sharey="row") as (
        figure,
        axes,
    ):
        for column, number in enumerate(SHOWN):
            hidden = opened(folder, CASES[number])
            _panels(axes[:, column], hidden)
            axes[0, column].set_title(hidden.case.name, fontsize=9)
            axes[-1, column].set_xlabel("time [s]")
        for row, (_, label) in enumerate(ROWS):
            axes[row, 0].set_ylabel(label)
        legend(figure, axes[0, 0], 4)
        zero_lines(axes)


def _panels(axes: np.ndarray, hidden: Hidden) -> None:
    tension = estimated(hidden)
    use = hidden.use & (hidden.motion.time < hidden.motion.time[hidden.use][0] + 1.4)
    time = hidden.motion.time
    for side, force, _ in feet_of(hidden):
        found = foot_wrench(tension, side)[0]
        for panel, (axis, _) in zip(axes, ROWS, strict=True):
            _line(
                panel,
                time,
                force[:, axis] / hidden.weight,
                use,
                COLORS[side],
                "-",
                f"{side}, measured",
            )
            _line(
                panel,
                time,
                found[:, axis] / hidden.weight,
                use,
                COLORS[side],
                "--",
                f"{side}, estimated",
            )


def _line(
    panel: Axes,
    time: np.ndarray,
    values: np.ndarray,
    use: np.ndarray,
    color: str,
    style: str,
    label: str,
) -> None:
    panel.plot(
        time[use], values[use], style, color=color, lw=1.3 if style == "-" else 1.6, label=label
    )


SHOWN_INTERVALS = (0, 3)
SPAN = 1.4
"""How much of each recording is shown [s]."""


def draw_intervals(file: Path) -> None:
    """Draw measured and estimated force of each foot.

    What the data leave undetermined is drawn around it, with solutions near the optimum.
    """
    folder = data_folder()
    with page(file, len(ROWS), len(SHOWN_INTERVALS), (11.0, 4.8), sharex="col", sharey="row") as (
        figure,
        axes,
    ):
        for column, number in enumerate(SHOWN_INTERVALS):
            hidden, problem, tension = solved_case(folder, CASES[number])
            time = hidden.motion.time
            start = time[hidden.use][0]
            frames = np.flatnonzero(hidden.use & (time < start + SPAN))
            found = contact_intervals(problem, tension, frames.tolist())
            for side, force, _ in feet_of(hidden):
                group = found.groups.index(f"foot_{side[0]}")
                for panel, (axis, _) in zip(axes[:, column], ROWS, strict=True):
                    bands = (
                        (found.low, found.high, 0.12, "may be"),
                        (found.near_low, found.near_high, 0.35, "near optimum"),
                    )
                    for low, high, strength, label in bands:
                        ends = (one[:, group, axis] / hidden.weight for one in (low, high))
                        panel.fill_between(
                            found.time,
                            *ends,
                            color=COLORS[side],
                            alpha=strength,
                            lw=0.0,
                            label=f"{side}, {label}",
                        )
                    panel.plot(
                        found.time,
                        force[frames, axis] / hidden.weight,
                        color=COLORS[side],
                        label=f"{side}, measured",
                    )
                    panel.plot(
                        found.time,
                        found.forces[:, group, axis] / hidden.weight,
                        "--",
                        color=COLORS[side],
                        label=f"{side}, found",
                    )
            axes[0, column].set_title(hidden.case.name, fontsize=9)
            axes[-1, column].set_xlabel("time [s]")
        for row, (_, label) in enumerate(ROWS):
            axes[row, 0].set_ylabel(label)
        legend(figure, axes[0, 0], 8, fontsize=7)
        zero_lines(axes)


TRUTH = "#222222"
WAYS = {
    "body": ("found: body and plate", "#2166ac", "-"),
    "box": ("found: body, plate and box", "#1b7837", "-"),
    "hidden": ("found: body and box, no plate", "#b2182b", "--"),
}


def draw_lift(file: Path) -> None:
    """Draw vertical force of the hands and bending moment at L5/S1 over both lifts."""
    folder = data_folder()
    with page(file, 2, len(LIFTS), (8.4, 6.0), sharex="col", sharey="row", span=(0.09, 0.90)) as (
        figure,
        axes,
    ):
        for column, lift in enumerate(LIFTS):
            force, moment = axes[:, column]
            _draw_hand_force(force, folder, lift)
            _draw_spine_moment(moment, folder, lift)
            off = left_floor(folder, lift)
            for axis in (force, moment):
                axis.axvline(off, color="#bbbbbb", lw=0.8)
            force.set_title(f"lift {column + 1}", fontsize=9)
            moment.set_xlabel("time [s]")
            moment.text(off + 0.03, 2.0, "off the floor", color="#777777", fontsize=8)
        axes[0, 0].set_ylabel("hands on the box, up [N]")
        axes[1, 0].set_ylabel("extending moment at L5/S1 [N m]")
        for row, place in enumerate((0.95, 0.045)):
            handles, labels = axes[row, 0].get_legend_handles_labels()
            figure.legend(
                handles,
                labels,
                loc="center",
                bbox_to_anchor=(0.5, place),
                ncols=3,
                frameon=False,
            )


def _draw_hand_force(axis: Axes, folder: Path, lift: str) -> None:
    """Draw the vertical force of the hands: measured, estimated, and what is undetermined."""
    time = recorded(folder, lift).markers.time
    weight = BOX_MASS * 9.80665
    axis.axhline(weight, color="#999999", lw=0.8, ls=":")
    axis.text(0.05, weight + 3.0, "weight of the box", color="#777777", fontsize=8)
    measured = hands_measured(folder, lift)[:, 1]
    axis.plot(time, measured, color=TRUTH, lw=2.2, label="measured")
    for way, (words, color, style) in WAYS.items():
        hands = found(folder, lift, way).hands[:, 1]
        axis.plot(time, hands, color=color, ls=style, lw=1.2, label=words)
    held = np.flatnonzero(holding(folder, lift)[1].any(axis=1))[::2]
    intervals = left_open(task(folder, lift, "hidden"), held.tolist())
    group = intervals.groups.index("hands")
    axis.fill_between(
        time[held],
        -intervals.high[:, group, 1],
        -intervals.low[:, group, 1],
        color="#b2182b",
        alpha=0.12,
        lw=0,
        label="left open, no plate",
    )


def _draw_spine_moment(axis: Axes, folder: Path, lift: str) -> None:
    """Draw the bending moment at L5/S1: the laboratory's and ours, from below and from above."""
    time = recorded(folder, lift).markers.time
    below, above = of_laboratory(recorded(folder, lift))
    passing = spine(folder, lift)
    axis.plot(time, -below[:, 2], color=TRUTH, lw=2.2, label="laboratory, from below")
    late = time >= left_floor(folder, lift)
    axis.plot(time[late], -above[late, 2], color="#777777", lw=1.4, label="laboratory, from above")
    ours = -passing.from_below[:, 2]
    axis.plot(time, ours, color="#e08214", lw=1.4, label="ours, from below")
    for way, (words, color, style) in WAYS.items():
        if way == "box":
            continue
        from_above = passing.from_above + carried_moment(passing, found(folder, lift, way))
        label = words.replace("found", "ours, from above")
        axis.plot(time, -from_above[:, 2], color=color, ls=style, lw=1.1, label=label)
