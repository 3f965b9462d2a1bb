"""Sticks that turn about their ends and strike with their tips, for tests."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.contacts import Site
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.spatial import Transform

STILL = Transform.identity()
TIP = [0.0, -0.4, 0.0]
SITES = tuple(Site(f"tip_{name}", name, [TIP]) for name in "ab")


def rods(*names: str, mass: float = 0.06, length: float = 0.4) -> Model:
    """Make sticks that turn about their ends and hang down next to each other.

    Body and coordinate have one name.
    """
    across = mass * length**2 / 12.0
    center = np.array([0.0, -0.5 * length, 0.0])
    inertia = np.diag([across, 1e-9, across])
    joints = []
    for name in names:
        axis = Axis(
            kind="rotation",
            vector=np.array([0.0, 0.0, 1.0]),
            function=linear(1.0),
            coordinates=(name,),
        )
        joints.append(
            Joint(
                name=f"pin_{name}",
                kind="PinJoint",
                parent=GROUND,
                child=name,
                parent_frame=STILL,
                child_frame=STILL,
                axes=(axis,),
                coordinates=(name,),
            )
        )
    bodies = tuple(
        Body(name=name, mass=mass, mass_center=center, inertia=inertia) for name in names
    )
    return Model(
        name="rods",
        bodies=bodies,
        joints=tuple(joints),
        coordinates=tuple(Coordinate(name) for name in names),
        gravity=np.array([0.0, -9.81, 0.0]),
    )
