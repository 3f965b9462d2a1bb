"""A small body with two legs and a trunk.

Also persons of other lengths and markers, and what cameras see of them.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.lengths import factors_of, lengths_of
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

X, Y, Z = np.eye(3)
PLACES = {
    "pelvis": ((0.05, 0.02, 0.12), (0.05, 0.02, -0.12), (-0.15, 0.03, 0.05), (-0.15, 0.03, -0.05)),
    "torso": ((0.05, 0.35, 0.02), (-0.08, 0.4, 0.0), (0.0, 0.4, 0.16), (0.0, 0.4, -0.16)),
    "femur": ((0.08, -0.2, 0.03), (0.0, -0.38, 0.06), (0.02, -0.37, -0.05), (-0.05, -0.25, 0.07)),
    "tibia": ((0.04, -0.1, 0.03), (0.0, -0.38, 0.05), (0.01, -0.38, -0.04), (-0.05, -0.2, 0.05)),
    "foot": ((-0.05, -0.03, 0.0), (0.15, -0.03, 0.05), (0.16, -0.02, -0.03)),
}


def stick_figure() -> Model:
    """Pelvis that floats, trunk and legs: 16 coordinates, 30 markers."""
    bodies = []
    joints = []
    coordinates = []
    markers = []

    def add(name, parent, at, turns, mass, place, slides=()):
        kinds = [("translation", one) for one in slides] + [("rotation", one) for one in turns]
        names = tuple(f"{name}_{kind[0]}{i}" for i, (kind, _) in enumerate(kinds))
        axes = tuple(
            Axis(kind=kind, vector=u, function=linear(1.0), coordinates=(c,))
            for (kind, u), c in zip(kinds, names, strict=True)
        )
        frame = Transform(np.eye(3), np.array(at, dtype=float))
        joints.append(
            Joint(
                name=f"to_{name}",
                kind="custom",
                parent=parent,
                child=name,
                parent_frame=frame,
                child_frame=Transform.identity(),
                axes=axes,
                coordinates=names,
            )
        )
        for c, (kind, _) in zip(names, kinds, strict=True):
            bent = c == f"{name}_r0" and name.startswith("tibia")
            coordinates.append(
                Coordinate(
                    c,
                    "rotational" if kind == "rotation" else "translational",
                    range=(-2.4, 0.0) if bent else (-np.inf, np.inf),
                    clamped=bent,
                )
            )
        bodies.append(
            Body(
                name=name,
                mass=mass,
                mass_center=np.array([0.0, -0.1, 0.0]),
                inertia=0.01 * mass * np.eye(3),
            )
        )
        side = 1.0 if not name.endswith("_l") else -1.0
        for i, location in enumerate(PLACES[place]):
            markers.append(Marker(f"{name}{i}", name, np.array(location) * [1.0, 1.0, side]))

    add("pelvis", GROUND, (0, 0.95, 0), (Z, X, Y), 11.0, "pelvis", slides=(X, Y, Z))
    add("torso", "pelvis", (-0.1, 0.08, 0), (Z, X, Y), 30.0, "torso")
    for side, z in (("r", 0.08), ("l", -0.08)):
        add(f"femur_{side}", "pelvis", (-0.06, -0.07, z), (Z, X, Y), 9.0, "femur")
        add(f"tibia_{side}", f"femur_{side}", (0, -0.4, 0), (Z,), 3.5, "tibia")
        add(f"foot_{side}", f"tibia_{side}", (0, -0.41, 0), (Z, X), 1.2, "foot")
    return Model(
        name="figure",
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=np.array([0, -9.81, 0]),
        markers=tuple(markers),
    )


@dataclass(frozen=True, eq=False)
class Person:
    """A body whose lengths and markers are known, and a recording of it."""

    generic: Model
    model: Model
    markers: Markers


def person(seed: int = 0, frames: int = 200, noise: float = 3e-4, symmetric: bool = True) -> Person:
    """Make a person with lengths 5 % off and markers 1 cm off, moving in all coordinates.

    Parameters
    ----------
    seed : of lengths, markers, motion and noise
    frames : at 50 Hz
    noise : SD of a marker along one axis [m]
    symmetric : both sides have the same lengths
    """
    rng = np.random.default_rng(seed)
    generic = stick_figure()
    lengths = lengths_of(generic, symmetric)
    along = {one.segment: 1.04 * (1.0 + 0.05 * rng.normal()) for one in lengths if one.along}
    values = np.array(
        [along[one.segment] * (1.0 if one.along else 1.0 + 0.04 * rng.normal()) for one in lengths]
    )
    model = scale(generic, factors_of(lengths, values))
    model = model.with_markers(
        tuple(
            replace(one, location=one.location + 0.01 * rng.normal(size=3)) for one in model.markers
        )
    )
    tree = compile_tree(model)
    time = np.arange(frames) / 50.0
    q = 0.4 * np.sin(
        np.outer(time, rng.uniform(1, 7, len(tree.defaults)))
        + rng.uniform(0, 6, len(tree.defaults))
    )
    bent = [j for j, one in enumerate(model.coordinates) if one.clamped]
    q[:, bent] -= 0.6
    poses = forward_kinematics(tree, q)
    bodies = np.array([tree.body_index[one.body] for one in model.markers])
    places = poses.points(bodies, np.array([one.location for one in model.markers]))
    return Person(
        generic,
        model,
        Markers(time, model.marker_names, places + noise * rng.normal(size=places.shape)),
    )
