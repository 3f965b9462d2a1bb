"""A block that stands still on legs, all of whose forces are known."""

from __future__ import annotations

import numpy as np

from myomorph.model.contacts import Cone, Site
from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.model.series import Motion
from myomorph.model.spatial import Transform

MASS, HEIGHT = 50.0, 0.8
WEIGHT = 9.80665 * MASS


def block() -> Model:
    """One body that floats, its origin on the floor, its mass center above it; y is up."""
    names = tuple(f"{kind}{axis}" for kind in "tr" for axis in "xyz")
    axes = tuple(
        Axis("translation" if name[0] == "t" else "rotation", np.eye(3)[i % 3], linear(1.0), (name,))
        for i, name in enumerate(names)
    )
    joint = Joint("free", "FreeJoint", GROUND, "block", Transform.identity(), Transform.identity(), axes, names)
    body = Body("block", MASS, np.array([0.0, HEIGHT, 0.0]), np.diag([4.0, 2.0, 4.0]))
    coordinates = tuple(Coordinate(name, "translational" if name[0] == "t" else "rotational") for name in names)
    return Model("block", (body,), (joint,), coordinates, np.array([0.0, -9.80665, 0.0]))


def standing_still(frames: int) -> Motion:
    """The block upright."""
    still = np.zeros((frames, 6))
    return Motion(0.01 * np.arange(frames), block().coordinate_names, still, still, still)


def legs(places, friction=0.8, edges=6, most=np.inf) -> tuple[Site, ...]:
    """Points on the floor at (x, z) [m], each a leg of its own."""
    cone = Cone(friction=friction, edges=edges, most=most)
    return tuple(Site(f"leg{k}", "block", np.array([[x, 0.0, z]]), cone) for k, (x, z) in enumerate(places))
