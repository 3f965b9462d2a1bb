"""Sticks that turn about their ends and strike with their tips, for tests."""

from __future__ import annotations

import numpy as np

from myomorph.model.contacts import Site
from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.model.spatial import Transform

STILL, TIP = Transform.identity(), [0.0, -0.4, 0.0]
SITES = tuple(Site(f"tip_{name}", name, [TIP]) for name in "ab")


def rods(*names: str, mass: float = 0.06, length: float = 0.4) -> Model:
    """Sticks that turn about their ends, hanging down beside each other; body and coordinate have one name."""
    across = mass * length**2 / 12.0
    center, inertia = np.array([0.0, -0.5 * length, 0.0]), np.diag([across, 1e-9, across])
    joints = []
    for name in names:
        axis = Axis("rotation", np.array([0.0, 0.0, 1.0]), linear(1.0), (name,))
        joints.append(Joint(f"pin_{name}", "PinJoint", GROUND, name, STILL, STILL, (axis,), (name,)))
    bodies = tuple(Body(name, mass, center, inertia) for name in names)
    return Model("rods", bodies, tuple(joints), tuple(Coordinate(name) for name in names), np.array([0.0, -9.81, 0.0]))
