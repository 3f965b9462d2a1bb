"""Which way is up: a laboratory's axes turned to those of a model, checked by the weight that hangs on the plate."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.series import Wrenches
from myomorph.model.spatial import axis_rotation

AXES = "xyz"
STEADY = 2.0
"""A mean force is that of a weight where it is so many times the force's own change."""
ASLANT = 0.7
"""Cosine of the angle to the vertical from which a weight does not hang in the model's laboratory."""


def turn_to(up: str, gravity: Array) -> Array:
    """(3, 3) that turns vectors of a laboratory, whose axis `up` points up, into axes with this gravity.

    The shortest turn; identity where the axis points up already.
    """
    lab = np.eye(3)[AXES.index(up)]
    own = -np.asarray(gravity) / np.linalg.norm(gravity)
    axis, cosine = np.cross(lab, own), float(lab @ own)
    sine = float(np.linalg.norm(axis))
    if sine < 1e-9:
        aside = np.eye(3)[(AXES.index(up) + 1) % 3]
        return np.eye(3) if cosine > 0.0 else axis_rotation(aside, np.pi)
    return axis_rotation(axis / sine, float(np.arctan2(sine, cosine)))


def turned(wrenches: Wrenches, rotation: Array) -> Wrenches:
    """The same wrenches in axes to which a rotation (3, 3) turns vectors."""
    forces, points, torques = (one @ rotation.T for one in (wrenches.forces, wrenches.points, wrenches.torques))
    return replace(wrenches, forces=forces, points=points, torques=torques)


def carrying(wrenches: Wrenches, gravity: Array, name: str) -> tuple[Wrenches, tuple[str, ...]]:
    """The wrenches as what carries a hanging limb; reversed, and said so, where they are what the limb does.

    A plate that was set to zero with the limb on it tells nothing of the vertical.

    Raises
    ------
    BadData
        where the weight hangs aslant to the model's vertical
    """
    force = wrenches.forces.sum(axis=1)
    force = force[np.isfinite(force).all(axis=1)]
    if not len(force):
        return wrenches, ()
    mean = force.mean(axis=0)
    size, change = float(np.linalg.norm(mean)), float(np.linalg.norm(force.std(axis=0)))
    up = -np.asarray(gravity) / np.linalg.norm(gravity)
    if size <= STEADY * change or size == 0.0:
        return wrenches, ()
    cosine = float(mean @ up) / size
    if abs(cosine) < ASLANT:
        lab, own = AXES[int(np.argmax(np.abs(mean)))], AXES[int(np.argmax(np.abs(up)))]
        raise BadData(
            f"recording '{name}': the weight hangs along {lab}, but the model's vertical is {own}: give up = \"{lab}\" "
            "in the study file"
        )
    if cosine > 0.0:
        return wrenches, ()
    reverse = replace(wrenches, forces=-wrenches.forces, torques=-wrenches.torques)
    return reverse, (f"{name}: the forces were those on the plate, and were reversed",)
