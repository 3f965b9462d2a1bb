"""A leg of two boxes with a hinge, and what a morph of it looks like.

Every depth and moment arm is known by hand.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import trimesh

from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.morphed import Morph, MuscleChange, RebuiltJoint, TransferredPoint
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import linear
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint
from myomorph.core.model.scale import scale
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity

HALF = 0.02
LENGTH = 0.4
"""Half the width of the boxes, and how long they are [m]."""

STILL = Transform.identity()


def box(center_y: float, half: float = HALF, length: float = LENGTH) -> Surface:
    """Make an upright box around (0, center_y, 0)."""
    made = trimesh.creation.box((2 * half, length, 2 * half)).subdivide().subdivide()
    return Surface(np.array(made.vertices) + [0.0, center_y, 0.0], np.array(made.faces))


FRONT = [("thigh", (0.03, -0.1, 0.0)), ("thigh", (0.03, -0.38, 0.0)), ("shank", (0.03, -0.1, 0.0))]
BONES = {"thigh": box(-0.2), "shank": box(-0.22)}


def muscle(
    name: str, points: list[tuple[str, tuple[float, float, float]]], **more: object
) -> Muscle:
    """Make a muscle through points of bodies."""
    path = Path(
        tuple(
            PathPoint(f"{name}-P{i + 1}", body, np.array(at)) for i, (body, at) in enumerate(points)
        )
    )
    plain = Muscle(
        name=name,
        kind="Millard2012EquilibriumMuscle",
        path=path,
        max_isometric_force=1000.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.2,
    )
    return replace(plain, **more)


def leg(**muscles: Muscle) -> Model:
    """Make a thigh and a shank, hinged at the end of the thigh about z.

    An extensor is in front and a flexor behind.
    """
    front = muscle("extensor", FRONT)
    behind = muscle("flexor", [(body, (-x, y, z)) for body, (x, y, z) in FRONT])
    own = {"extensor": front, "flexor": behind} | muscles
    bodies = [
        Body(
            name="thigh",
            mass=8.0,
            mass_center=np.array([0.0, -0.17, 0.0]),
            inertia=np.diag([0.1, 0.03, 0.1]),
        ),
        Body(
            name="shank",
            mass=4.0,
            mass_center=np.array([0.0, -0.19, 0.0]),
            inertia=np.diag([0.05, 0.01, 0.05]),
        ),
    ]
    hinge = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=("knee",),
    )
    knee = Transform(np.eye(3), np.array([0.0, -LENGTH, 0.0]))
    joints = (
        Joint(
            name="root",
            kind="WeldJoint",
            parent=GROUND,
            child="thigh",
            parent_frame=STILL,
            child_frame=STILL,
        ),
        Joint(
            name="knee",
            kind="PinJoint",
            parent="thigh",
            child="shank",
            parent_frame=knee,
            child_frame=STILL,
            axes=(hinge,),
            coordinates=("knee",),
        ),
    )
    bend = Coordinate("knee", range=(-0.1, 0.6))
    return Model(
        name="boxes",
        bodies=tuple(bodies),
        joints=joints,
        coordinates=(bend,),
        gravity=np.array([0.0, -9.81, 0.0]),
        muscles=tuple(own.values()),
    )


def morph_of(source: Model, target: Model, size: float = 1.0) -> Morph:
    """Return the morph that made the target: bones grown by a size, no other information."""
    grown = AffineMap(size * np.eye(3), np.zeros(3))
    whole = Similarity(np.eye(3), np.zeros(3), size)
    bones = {
        name: BoneMap(
            body=name,
            target_body=name,
            map=grown,
            whole=whole,
            basis="bone",
            source=one,
            target=Surface(one.vertices * size, one.faces),
            features=None,
            measures=FrozenMap({"residual [m]": 0.0012, "coverage": 0.97}),
        )
        for name, one in BONES.items()
    }
    points = tuple(
        TransferredPoint(
            owner=one.name,
            name=p.name,
            body=p.body,
            target_body=p.body,
            source=p.location,
            target=q.location,
            lifted=0.001,
            depth_source=0.01,
            depth_target=0.01 * size,
        )
        for one, other in zip(source.muscles, target.muscles, strict=True)
        for p, q in zip(one.path.points, other.path.points, strict=False)
    )
    changes = tuple(
        MuscleChange(
            name=one.name,
            path=1.0,
            fiber=1.0,
            tendon=1.1,
            force=1.2,
            pennation=0.0,
            range_source=(0.5, 1.2),
            range_target=(0.5, 1.2),
        )
        for one in source.muscles
    )
    joints = (
        RebuiltJoint(
            name="knee",
            method="sphere",
            in_parent=np.array([0.0, -LENGTH * size, 0.0]),
            in_child=np.zeros(3),
            moved=0.0005,
            gap=0.001 * size,
        ),
    )
    return Morph(
        source=source, model=target, bones=bones, points=points, joints=joints, muscles=changes
    )


def grown(model: Model, size: float) -> Model:
    """Return the model, uniformly larger."""
    return scale(model, {name: np.full(3, size) for name in model.body_names})


def with_muscle(model: Model, one: Muscle) -> Model:
    """Return the model with a muscle in the place of its namesake."""
    return replace(
        model, muscles=tuple(one if old.name == one.name else old for old in model.muscles)
    )
