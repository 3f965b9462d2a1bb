"""Angles of hip, knee and ankle, flexion positive, and moments against their flexion."""

from __future__ import annotations

import re

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series
from myomorph.lab.analysis.gait_curves import flexion_sign, joint_coordinate

LOW_BACK = (r"lumbar_extension", r"L4_L5_FE", r"L5_S1_FE", r"flex_extension")
"""Spellings of the bend of the low back, the lowest joint that models share first."""


def joint_angle(model: Model, motion: Series, key: str, side: str) -> Array | None:
    """Return a joint angle, flexion positive.

    Parameters
    ----------
    model, motion : of the body; angles (frames, coordinates) [rad]
    key : of `SPELLINGS`
    side : "right" or "left"

    Returns
    -------
    (frames,) [degrees], None where the model has no such joint
    """
    name = joint_coordinate(model, key, side)
    if not name or name not in motion.names:
        return None
    return np.asarray(np.degrees(flexion_sign(model, key, name) * motion[name]))


def extension_moment(model: Model, torques: Series | None, key: str, side: str) -> Array | None:
    """Return the moment that extends a joint.

    Parameters
    ----------
    model : of the body
    torques : (frames, coordinates) [N m]
    key : of `SPELLINGS`, the angle whose flexion the moment is against
    side : "right" or "left"

    Returns
    -------
    (frames,) [N m], None where it is not known
    """
    name = joint_coordinate(model, key, side)
    if torques is None or not name or name not in torques.names:
        return None
    return np.asarray(-flexion_sign(model, key, name) * torques[name])


def low_back_moment(torques: Series | None) -> Array | None:
    """Return the size of the moment that holds the low back against bending.

    Parameters
    ----------
    torques : (frames, coordinates) [N m]

    Returns
    -------
    (frames,) [N m], None where the model has no joint there
    """
    if torques is None:
        return None
    found = (
        name
        for spelling in LOW_BACK
        for name in torques.names
        if re.search(spelling, name, re.IGNORECASE)
    )
    name = next(found, "")
    return np.abs(torques[name]) if name else None
