"""Stretches in which a marker stays where it was, or goes along a straight line: drawn over a gap.

A camera has noise, so that no marker that is seen stays, or moves at exactly one velocity. Programs
fill gaps so. A marker of a model without noise may rest too, as a foot that stands does: then its
distances to the others of its body stay, and nothing is said.

The path is filled by the other markers of the body, so that it goes on at both ends: a marker that
is left out lets the pose jump there.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import replace
from functools import partial

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import MARKERS
from myomorph.core.model.findings import Finding, Repair, spans_of, times_text
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.motion.gap_filling import carried_path

SAME = 2e-6  # Second differences of a path below this are those of a line in single precision [m].
MIN_FRAMES = 6
MIN_TIME = 0.1  # What is filled in a shorter gap changes nothing [s].
REST = 1e-3  # A marker whose path in a stretch is shorter stays [m].
MOVED = 0.012
"""Change of a distance within a body from which a path was drawn, on a human body: skin slides by
less while a marker stays [m].
"""


def drawn_findings(
    model: Model, markers: Markers, names: Sequence[str], unit: float
) -> Iterator[Finding]:
    """Find markers whose path was drawn over a gap, to be left out there.

    Parameters
    ----------
    model : whose bodies carry the markers
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    names : of the markers that count
    unit : what stands for one metre, see `length_unit` [m]

    Yields
    ------
    a finding for each such marker
    """
    steps = np.diff(markers.time)
    if len(markers) < MIN_FRAMES or steps.max() > 1.5 * steps.min():
        return
    bodies = {name: model.marker(name).body for name in names}
    for name in names:
        mates = [other for other in names if other != name and bodies[other] == bodies[name]]
        drawn = _drawn_frames(markers, name, mates, unit)
        if not drawn.any():
            continue
        spans = spans_of(markers.time, drawn)
        path = markers[name][drawn]
        rests = float(np.ptp(path, axis=0).max()) < REST * unit
        what = "stays where it was" if rests else "follows a straight line"
        count = int(drawn.sum())
        text = MARKERS.message(
            f"marker '{name}' {what} {times_text(spans)} ({count} frames) while others on"
            f" '{bodies[name]}' move: it was hidden there, and its path was filled in",
            share=count / len(markers),
        )
        repair = Repair(
            partial(_filled, name=name, frames=drawn, mates=mates),
            "it was filled from those",
            "leave it out there, or fill the gap by the markers beside it",
        )
        yield Finding(kind="drawn path", place=name, text=text, times=spans, repair=repair)


def _drawn_frames(markers: Markers, name: str, mates: Sequence[str], unit: float) -> Array:
    """Flag the frames in which a marker's path was drawn.

    Parameters
    ----------
    markers : (frames, markers, 3) [m]
    name : of the marker
    mates : the others on its body
    unit : what stands for one metre [m]

    Returns
    -------
    (frames,) of bool
    """
    path = markers[name]
    bent = np.full(len(path), np.inf)
    with np.errstate(invalid="ignore"):
        bent[1:-1] = np.abs(path[2:] - 2.0 * path[1:-1] + path[:-2]).max(axis=1)
    straight = np.asarray(np.nan_to_num(bent, nan=np.inf) < SAME * unit)
    drawn = np.zeros(len(path), dtype=bool)
    for start, stop in runs(straight):
        long = markers.time[stop - 1] - markers.time[start] >= MIN_TIME
        if stop - start < MIN_FRAMES or not long:
            continue
        if any(_moves_apart(path, markers[mate], start, stop, unit) for mate in mates):
            # A line begins and ends in frames whose other neighbor is not on it.
            drawn[max(start - 1, 0) : stop + 1] = True
    return drawn


def _moves_apart(path: Array, mate: Array, start: int, stop: int, unit: float) -> bool:
    """Whether the distance to another marker of the body changes in a stretch as bodies do not.

    Parameters
    ----------
    path, mate : (frames, 3) of the marker and of the other [m]
    start, stop : frames [start, stop)
    unit : what stands for one metre [m]
    """
    apart = np.linalg.norm(path - mate, axis=1)
    inside = apart[start:stop]
    outside = np.concatenate([apart[:start], apart[stop:]])
    inside = inside[np.isfinite(inside)]
    outside = outside[np.isfinite(outside)]
    if len(inside) < MIN_FRAMES or len(outside) < MIN_FRAMES:
        return False
    low, high = np.quantile(outside, [0.02, 0.98])
    beyond = np.maximum(low - inside, inside - high).max()
    return bool(beyond > MOVED * unit)


def _filled(markers: Markers, name: str, frames: Array, mates: Sequence[str]) -> Markers:
    """Fill the path of a marker in some frames by the others of its body.

    Parameters
    ----------
    markers : (frames, markers, 3) [m], NaN where hidden
    name : of the marker
    frames : (frames,) of bool
    mates : the others on its body
    """
    values = np.array(markers.values)
    column = markers.names.index(name)
    others = markers.values[:, [markers.names.index(mate) for mate in mates]]
    for start, stop in runs(np.asarray(frames, dtype=bool)):
        path = carried_path(markers.time, values[:, column], others, start, stop)
        values[start:stop, column] = path
    return replace(markers, values=values)
