"""A block that stands still on legs, all of whose forces are known."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform

MASS = 50.0
HEIGHT = 0.8
WEIGHT = 9.80665 * MASS


def block() -> Model:
    """One body that floats, its origin on the floor, its mass center above it; y is up."""
    names = tuple(f"{kind}{axis}" for kind in "tr" for axis in "xyz")
    axes = tuple(
        Axis(
            kind="translation" if name[0] == "t" else "rotation",
            vector=np.eye(3)[i % 3],
            function=linear(1.0),
            coordinates=(name,),
        )
        for i, name in enumerate(names)
    )
    joint = Joint(
        name="free",
        kind="FreeJoint",
        parent=GROUND,
        child="block",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=axes,
        coordinates=names,
    )
    body = Body(
        name="block",
        mass=MASS,
        mass_center=np.array([0.0, HEIGHT, 0.0]),
        inertia=np.diag([4.0, 2.0, 4.0]),
    )
    coordinates = tuple(
        Coordinate(name, "translational" if name[0] == "t" else "rotational") for name in names
    )
    return Model(
        name="block",
        bodies=(body,),
        joints=(joint,),
        coordinates=coordinates,
        gravity=np.array([0.0, -9.80665, 0.0]),
    )


def standing_still(frames: int) -> Motion:
    """Return the block upright."""
    still = np.zeros((frames, 6))
    return Motion(
        time=0.01 * np.arange(frames),
        names=block().coordinate_names,
        values=still,
        velocities=still,
        accelerations=still,
    )


def legs(places, friction=0.8, edges=6, most=np.inf) -> tuple[Site, ...]:
    """Points on the floor at (x, z) [m], each a leg of its own."""
    cone = Cone(friction=friction, edges=edges, most=most)
    return tuple(
        Site(name=f"leg{k}", body="block", points=np.array([[x, 0.0, z]]), cone=cone)
        for k, (x, z) in enumerate(places)
    )
