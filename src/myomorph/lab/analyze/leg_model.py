"""The bundled legs under a trunk whose shoulder rises as arms swing."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.spatial import Transform
from myomorph.lab.analyze.generic_model import legs_and_trunk

LOCKED = ("lumbar_bending", "lumbar_rotation", "mtp_angle_r", "mtp_angle_l")


FREED = ("ankle_angle_r", "ankle_angle_l", "subtalar_angle_r", "subtalar_angle_l")
"""A jumper's ankle bends further than the model's range."""


def leg_model() -> Model:
    """Model of myo-sim's legs (80 muscles) under a trunk that bends (6 muscles).

    In the ground x is forward, y up, z right. The pelvis moves by the six coordinates that
    OpenSim's gait models have: `pelvis_tilt`, `pelvis_list` and `pelvis_rotation` about z, x and y
    in this order, `pelvis_tx`, `pelvis_ty`, `pelvis_tz`. Side bending and twist of the trunk and
    the toes are locked.
    """
    model = legs_and_trunk()
    girdle, rise, lift = _shoulder_girdle()
    held = [_held(coordinate) for coordinate in model.coordinates]
    return replace(
        model,
        bodies=(*model.bodies, girdle),
        joints=(*model.joints, rise),
        coordinates=(*held, lift),
    )


def _held(coordinate: Coordinate) -> Coordinate:
    """Lock a coordinate, or free it of its bounds where the jump needs it."""
    if coordinate.name in LOCKED:
        return replace(coordinate, locked=True, default=0.0)
    if coordinate.name in FREED:
        return replace(coordinate, clamped=False)
    return coordinate


def _shoulder_girdle() -> tuple[Body, Joint, Coordinate]:
    """Make a weightless body that slides up and down the trunk.

    The arms' swing lifts the shoulder by centimeters.
    """
    name = "shoulder_elevation_r"
    still = Transform.identity()
    axis = Axis(
        kind="translation",
        vector=np.array([0.0, 1.0, 0.0]),
        function=linear(1.0),
        coordinates=(name,),
    )
    body = Body(name="shoulder_r", mass=0.0, mass_center=np.zeros(3), inertia=np.zeros((3, 3)))
    joint = Joint(
        name=name,
        kind="SliderJoint",
        parent="torso",
        child=body.name,
        parent_frame=still,
        child_frame=still,
        axes=(axis,),
        coordinates=(name,),
    )
    return body, joint, Coordinate(name, "translational", range=(-0.15, 0.15), clamped=True)
