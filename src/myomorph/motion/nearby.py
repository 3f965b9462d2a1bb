"""Inverse kinematics near a motion that is known: every frame by itself, from where that motion is."""

from __future__ import annotations

import numpy as np

from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.motion.ik import InverseKinematicsOptions, pose_problem, tracked_markers
from myomorph.motion.newton import frames_shown, solve_poses
from myomorph.motion.sync import refuse_other_times
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
    problem = pose_problem(tree, names, weights, options, markers)
    starts = np.array(motion.values)
    blank = ~(np.isfinite(starts).all(axis=1) & frames_shown(problem))
    starts[blank] = tree.defaults
    values = solve_poses(tree, problem, starts, options.settings, chained=False).values
    values[blank] = np.nan
    return Motion(markers.time, model.coordinate_names, values)
