"""Foot strikes and foot offs of a run: from the vertical force that the body's center of mass shows."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.analysis.center_of_mass import centroid
from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

CUTOFF = 8.0
"""Of the filter of the center of mass [Hz]; for a smaller body higher, as its strides are shorter."""
FLIGHT = 0.3
"""A runner's force falls below this share of the weight between contacts; a walker's stays above 0.6."""
EDGE = 0.5
"""Share of the weight at which the slope of the force is taken, along which it goes on to nothing."""
MIN_FRAMES = 24
"""Frames that a second derivative takes."""


def vertical_force(model: Model, motion: Motion) -> Array:
    """Vertical force on the whole body over its weight (frames,): 1 + a / g, with a of the center of mass [m/s^2].
    `motion`: coordinates (frames, coordinates) [rad or m], none missing.
    """
    g = float(np.linalg.norm(model.gravity))
    height = centroid(model, motion).values @ np.asarray(model.up)
    rate = 1.0 / float(np.median(np.diff(motion.time)))
    if rate > 2.0 * CUTOFF:
        from scipy.signal import butter, sosfiltfilt  # Takes half a second to import, and only a run needs it.

        height = sosfiltfilt(butter(2, CUTOFF, fs=rate, output="sos"), height)
    return 1.0 + np.gradient(np.gradient(height, motion.time), motion.time) / g


def running_contacts(
    model: Model, motion: Motion, feet: Sequence[str]
) -> Mapping[str, tuple[tuple[float, float], ...]]:
    """Contact intervals of each foot in a run [s]; none for a walk, in which a foot is always on the ground.

    The events that show a walk's contacts, a foot farthest ahead of and behind the trunk, are far from a runner's:
    a foot goes on backward after it has left the ground. Between two flights one foot carries the body, the lower one.
    The force's slope where it passes half the weight leads to where it begins and ends.

    `motion`: coordinates (frames, coordinates) [rad or m]; `feet`: bodies.
    """
    known = np.isfinite(motion.values).all(axis=1)
    if known.sum() < MIN_FRAMES or not known.all() or model.mass <= 0.0 or not np.linalg.norm(model.gravity) > 0.0:
        return {}
    force = vertical_force(model, motion)
    time = motion.time
    up = np.flatnonzero((force[:-1] < EDGE) & (force[1:] >= EDGE))
    down = np.flatnonzero((force[:-1] >= EDGE) & (force[1:] < EDGE))
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    heights = np.stack([poses.origins[:, tree.body_index[name]] @ np.asarray(model.up) for name in feet], axis=1)
    stances: dict[str, list[tuple[float, float]]] = {name: [] for name in feet}
    for start in up:
        ends = down[down > start]
        if not len(ends):
            continue
        stop = int(ends[0])
        before, after = force[: start + 1], force[stop + 1 :]
        flies = (_dip(before[::-1]), _dip(after))
        if max(flies) > FLIGHT:
            continue
        middle = slice(int(start), stop + 1)
        foot = feet[int(np.argmin(heights[middle].mean(axis=0)))]
        stances[foot].append((_edge(time, force, int(start)), _edge(time, force, stop)))
    return {name: tuple(intervals) for name, intervals in stances.items() if intervals}


def _dip(force: Array) -> float:
    """The least force until it is over half the weight again; that of a recording that ends there counts."""
    over = np.flatnonzero(force >= EDGE)
    return float(force[: over[0]].min()) if len(over) and over[0] else float(force.min()) if len(force) else 1.0


def _edge(time: Array, force: Array, at: int) -> float:
    """Where the line through two samples of the force reaches nothing [s]."""
    slope = (force[at + 1] - force[at]) / (time[at + 1] - time[at])
    return float(time[at] - force[at] / slope)
