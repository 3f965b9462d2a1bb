"""The figure that explains the numbers of a movement: its curve over time with its phases."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.lab.analysis.phases import Phase
from myomorph.lab.movements.part import MovementNumbers
from myomorph.lab.movements.recorded_movement import (
    RecordedMovement,
    body_curves,
    support_force,
)
from myomorph.lab.movements.support_force import SupportForce
from myomorph.lab.report.charts.curves import Line
from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.charts.tracks import (
    Backdrop,
    TrackLook,
    draw_track,
    phase_names,
    time_axis,
)

AIR = 0.25
"""The figure begins so long before the first part and ends so long after the last one [s]."""
MAX_SHOWN = 3.0
"""Of a run so much is drawn, in the middle [s]."""
MAX_LONG = 6.5
"""Of other movements so much, from the first part on [s]."""
HEIGHT = 150


@dataclass(frozen=True, kw_only=True)
class MovementFigure:
    """A drawing with what it shows.

    Attributes
    ----------
    svg : the drawing
    caption : what lines and stripes are
    sides : whether it tells right from left
    """

    svg: str
    caption: str
    sides: bool


def movement_figure(recorded: RecordedMovement, numbers: MovementNumbers) -> MovementFigure | None:
    """Draw forces as measured, and angles of squats and rises; None where neither is known."""
    span = _span(recorded, numbers)
    phases = tuple(
        phase
        for part in numbers.parts
        for phase in part.phases
        if phase.stop > span[0] and phase.start < span[1]
    )
    behind = Backdrop(span, phases)
    force = support_force(recorded)
    tracks = [*_angle_tracks(recorded, behind)]
    if force is not None:
        tracks.append(_force_track(force, behind))
    if not tracks:
        tracks = _stance_track(numbers, behind)
    svg = "".join([phase_names(behind), *tracks, time_axis(behind)])
    sides = force is not None and force.right is not None
    shown = (
        "" if span[1] >= numbers.parts[-1].stop else f" Drawn: {span[0]:.1f} to {span[1]:.1f} s."
    )
    return MovementFigure(svg=svg, caption=f"{_caption(phases, force)}{shown}", sides=sides)


def _span(recorded: RecordedMovement, numbers: MovementNumbers) -> tuple[float, float]:
    """From when to when it is drawn [s]."""
    first = float(recorded.motion.time[0])
    last = float(recorded.motion.time[-1])
    start = max(numbers.parts[0].start - AIR, first)
    stop = min(max(part.stop for part in numbers.parts) + AIR, last)
    if recorded.movement == "running" and stop - start > MAX_SHOWN:
        middle = 0.5 * (start + stop)
        return middle - 0.5 * MAX_SHOWN, middle + 0.5 * MAX_SHOWN
    return start, min(stop, start + MAX_LONG)


def _angle_tracks(recorded: RecordedMovement, behind: Backdrop) -> list[str]:
    """Knees of a squat; trunk and hips of a rise."""
    curves = body_curves(recorded) if recorded.movement in ("squatting", "rising") else None
    if curves is None:
        return []
    if recorded.movement == "squatting":
        return [_track(behind, "Knee flexion", "°", curves.time, curves.bend)]
    tracks = [_track(behind, "Height of the hips", "m", curves.time, curves.hips)]
    if curves.lean is not None:
        tracks.insert(0, _track(behind, "Trunk and vertical", "°", curves.time, curves.lean))
    return tracks


def _track(behind: Backdrop, title: str, unit: str, time: Array, values: Array) -> str:
    """One line over time."""
    line = Line(time=time, values=values, style="middle", label=title.lower())
    return draw_track(behind, title, unit, [line], TrackLook(height=HEIGHT // 2 + 20))


def _force_track(force: SupportForce, behind: Backdrop) -> str:
    """Vertical force over body weight: of both feet, and of each where plates tell."""
    parts = (("right", force.right), ("left", force.left))
    lines = [
        Line(time=force.time, values=values / force.weight, style=side, label=side)
        for side, values in parts
        if values is not None
    ]
    whole = Line(
        time=force.time, values=force.total / force.weight, style="middle", label="both feet"
    )
    levels = [Level(1.0, "body weight", "middle")]
    drawn = lines if len(lines) > 1 and _in_turn(force) else [whole, *lines]
    return draw_track(
        behind,
        "Vertical force",
        "body weights",
        drawn,
        TrackLook(height=HEIGHT, levels=levels, low=0),
    )


def _in_turn(force: SupportForce) -> bool:
    """Whether the feet never bear weight together, so that their sum says nothing new."""
    if force.right is None or force.left is None:
        return False
    together = np.minimum(force.right, force.left) > 0.1 * force.weight
    return not together.any()


def _stance_track(numbers: MovementNumbers, behind: Backdrop) -> list[str]:
    """Contacts of both feet, where no plate and no angle shows the movement."""
    time = np.linspace(*behind.span, 601)
    lines = []
    for side in numbers.sides:
        on = np.zeros(len(time))
        for part in numbers.parts:
            if part.side == side:
                on[(time >= part.start) & (time <= part.stop)] = 1.0
        label = side or "contact"
        lines.append(Line(time=time, values=on, style=side or "middle", label=label, filled=True))
    return [
        draw_track(
            behind, "On the ground", "", lines, TrackLook(height=60, low=0.0, high=1.0, small=True)
        )
    ]


def _caption(phases: Sequence[Phase], force: SupportForce | None) -> str:
    """Say what stripes and lines are."""
    names = list(dict.fromkeys(phase.name for phase in phases))
    stripes = f"Phases: {', '.join(names)}." if names else ""
    measured = "" if force is None else " The force is as measured, without a low-pass filter."
    return f"{stripes}{measured}".strip()
