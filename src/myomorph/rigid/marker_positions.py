"""Where a model's markers are in a motion."""

from __future__ import annotations

import numpy as np

from myomorph.model.model import Model
from myomorph.model.series import Markers, Motion
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree


def marker_positions(model: Model, motion: Motion) -> Markers:
    """Positions of a model's markers in a motion, as a camera system without errors would record them.

    Source: Featherstone 2008, forward kinematics.

    Parameters
    ----------
    model : with markers
    motion : coordinates over time; what it lacks stands at the model's default

    Returns
    -------
    positions (frames, markers, 3) in ground [m], at the motion's times

    Raises
    ------
    UnknownName
        where the motion has a coordinate that the model does not have

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> markers = mm.marker_positions(model, mm.read_motion("reach.mot", model))
    >>> markers.names, markers.values.shape
    (('UA1', 'UA2', 'FA1', 'FA2'), (61, 4, 3))
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    bodies = np.array([tree.body_number(marker.body) for marker in model.markers], np.int64)
    points = poses.points(bodies, np.array([marker.location for marker in model.markers]).reshape(-1, 3))
    return Markers(motion.time, model.marker_names, points)
