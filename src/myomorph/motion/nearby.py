"""Inverse kinematics near a motion that is known: every frame by itself, from where that motion is."""

from __future__ import annotations

from functools import partial

import numpy as np

from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.motion.closed_frames import settle_closed
from myomorph.motion.ik import InverseKinematicsOptions, coordinate_targets, marker_arrays, tracked_markers
from myomorph.motion.stretch import settle_frames
from myomorph.motion.sync import refuse_other_times
from myomorph.motion.ties import ties_of
from myomorph.rigid.frames import over_frames
from myomorph.rigid.tree import compile_tree


def poses_near(
    model: Model, markers: Markers, motion: Motion, options: InverseKinematicsOptions | None = None
) -> Motion:
    """The coordinates of `inverse_kinematics` for markers and a model that differ little from those of a motion.

    Where two axes of a joint are nearly parallel, other angles give nearly the same pose, and a search that begins
    elsewhere may end in these: here it begins at the motion in every frame.

    Parameters
    ----------
    markers : NaN where hidden (frames, markers, 3) [m]
    motion : all coordinates of the model at the markers' times; unknown frames stay unknown

    Raises
    ------
    BadData
        model and recording share no marker, or the motion is of other times
    """
    options = options or InverseKinematicsOptions()
    refuse_other_times("markers", markers.time, motion.time)
    tree = compile_tree(model)
    names, weights = tracked_markers(model, markers, options)
    observed = np.ascontiguousarray(markers.values[:, [markers.names.index(name) for name in names]])
    targets = coordinate_targets(tree, markers.time, options)
    arrays = marker_arrays(tree, names, weights, options)
    found = np.array(motion.values)
    seen = np.asarray(np.isfinite(observed).all(axis=2))
    blank = np.asarray(~np.isfinite(found).all(axis=1) | ~seen.any(axis=1))
    found[blank] = tree.defaults
    solve = partial(settle_closed, ties_of(tree)) if model.loops else settle_frames
    cost, converged = np.empty(len(found)), np.empty(len(found), np.bool_)

    def part(start: int, stop: int) -> None:
        span = slice(start, stop)
        solve(
            tree.arrays, arrays, observed[span], targets[span], tree.defaults, options.posture_weight,
            options.tolerance, options.iterations, found[span], cost[span], converged[span],
        )  # fmt: skip

    over_frames(part, len(found))
    found[blank] = np.nan
    return Motion(markers.time, model.coordinate_names, found)
