"""Random trees that mostly Myomorph, Pinocchio and MuJoCo can all express, in motion."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.functions import SineProduct, constant, linear, polynomial, simm_spline
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Coupler, Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform, rotation_from_quaternion


def random_rotation(rng):
    return rotation_from_quaternion(rng.normal(size=4))


def random_inertia(rng, mass):
    """Inertia of a random cloud of mass points, so that it is physically possible."""
    points = rng.normal(scale=0.1, size=(8, 3))
    points -= points.mean(axis=0)
    return mass / 8 * sum(np.dot(x, x) * np.eye(3) - np.outer(x, x) for x in points)


def random_tree(seed, bodies=12):
    """One hinge or slide a body, random axes, frames and inertias."""
    rng = np.random.default_rng(seed)
    names = [f"body{i}" for i in range(bodies)]
    made = []
    joints = []
    coordinates = []
    for i, name in enumerate(names):
        parent = GROUND if i == 0 else names[rng.integers(max(0, i - 3), i)]
        mass = rng.uniform(0.1, 5.0)
        made.append(
            Body(
                name=name,
                mass=mass,
                mass_center=rng.normal(scale=0.1, size=3),
                inertia=random_inertia(rng, mass),
            )
        )
        vector = rng.normal(size=3)
        kind = "rotation" if rng.random() < 0.7 else "translation"
        axis = Axis(
            kind=kind,
            vector=vector / np.linalg.norm(vector),
            function=linear(1.0),
            coordinates=(f"c{i}",),
        )
        pose = Transform(random_rotation(rng), rng.normal(scale=0.3, size=3))
        joints.append(
            Joint(
                name=f"j{i}",
                kind=kind,
                parent=parent,
                child=name,
                parent_frame=pose,
                child_frame=Transform.identity(),
                axes=(axis,),
                coordinates=(f"c{i}",),
            )
        )
        coordinates.append(Coordinate(f"c{i}"))
    return Model(
        name=f"tree{seed}",
        bodies=tuple(made),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=np.array([0.3, -9.5, 0.7]),
    )


def floating_tree(seed, bodies=12):
    """Make a random tree whose first body moves freely.

    It has three slides, then body-fixed rotations about x, y, z.
    """
    model = random_tree(seed, bodies)
    names = tuple(f"root_{motion}{axis}" for motion in "tr" for axis in "xyz")
    kinds = ("translation",) * 3 + ("rotation",) * 3
    axes = tuple(
        Axis(kind=kind, vector=np.eye(3)[i % 3], function=linear(1.0), coordinates=(name,))
        for i, (kind, name) in enumerate(zip(kinds, names, strict=True))
    )
    root = Joint(
        name="free",
        kind="free",
        parent=GROUND,
        child="body0",
        parent_frame=Transform.identity(),
        child_frame=Transform.identity(),
        axes=axes,
        coordinates=names,
    )
    coordinates = tuple(
        Coordinate(name, kind)
        for name, kind in zip(names, ("translational",) * 3 + ("rotational",) * 3, strict=True)
    )
    return replace(
        model, joints=(root, *model.joints[1:]), coordinates=coordinates + model.coordinates[1:]
    )


def functional_tree(seed, bodies=12):
    """Make a random tree whose joints are splines, polynomials and sine products of coordinates."""
    rng = np.random.default_rng(seed)
    model = random_tree(seed, bodies)
    joints = list(model.joints)
    for i in (2, 5, 8):
        spline = simm_spline(np.linspace(-2, 2, 7), rng.normal(size=7))
        extra = (
            Axis(kind="translation", vector=np.eye(3)[0], function=spline, coordinates=(f"c{i}",)),
            Axis("translation", np.eye(3)[1], constant(0.1)),
            Axis(
                kind="rotation",
                vector=np.eye(3)[2],
                function=polynomial(rng.normal(size=4)),
                coordinates=(f"c{i}",),
                origin=rng.normal(size=3),
            ),
            Axis(
                kind="translation",
                vector=np.eye(3)[2],
                function=SineProduct(0.3, np.array([1.0, 2.0]), rng.normal(size=2)),
                coordinates=(f"c{i}", "c1"),
            ),
            Axis(
                kind="rotation",
                vector=np.array([0.6, 0.0, 0.8]),
                function=constant(0.4),
                coordinates=(),
                origin=rng.normal(size=3),
            ),
        )
        joints[i] = replace(joints[i], axes=joints[i].axes + extra)
    couplers = (
        Coupler(
            name="first",
            dependent="c6",
            function=simm_spline(np.linspace(-2, 2, 5), rng.normal(size=5)),
            independents=("c3",),
        ),
        Coupler(
            name="second",
            dependent="c9",
            function=SineProduct(1.2, np.ones(2), np.array([0.3, 0.1])),
            independents=("c6", "c4"),
        ),
    )
    return replace(model, joints=tuple(joints), couplers=couplers)


def swinging(model, frames, step, seed=0):
    """Make a smooth motion with exact derivatives of the independent coordinates."""
    rng = np.random.default_rng(seed)
    n = len(model.coordinates)
    amplitude = rng.uniform(0.2, 0.8, n)
    rate = rng.uniform(1, 4, n)
    phase = rng.uniform(0, 6, n)
    t = np.arange(frames)[:, None] * step
    return Motion(
        time=t[:, 0],
        names=model.coordinate_names,
        values=amplitude * np.sin(rate * t + phase),
        velocities=amplitude * rate * np.cos(rate * t + phase),
        accelerations=-amplitude * rate**2 * np.sin(rate * t + phase),
    )


def to_mujoco(model, compiled=True):
    """Return the tree as a MuJoCo model (or its specification).

    It is without contacts or passive forces.
    """
    import mujoco

    spec = mujoco.MjSpec()
    spec.option.gravity = model.gravity
    placed = {GROUND: spec.worldbody}
    for body, joint in zip(model.bodies, model.joints, strict=True):
        quaternion = np.empty(4)
        mujoco.mju_mat2Quat(quaternion, joint.parent_frame.rotation.ravel())
        inertia = body.inertia
        added = placed[joint.parent].add_body(
            name=body.name,
            pos=joint.parent_frame.translation,
            quat=quaternion,
            mass=body.mass,
            ipos=body.mass_center,
            fullinertia=[
                inertia[0, 0],
                inertia[1, 1],
                inertia[2, 2],
                inertia[0, 1],
                inertia[0, 2],
                inertia[1, 2],
            ],
            explicitinertial=True,
        )
        if joint.kind == "free":
            added.add_freejoint(name=joint.name)
            placed[body.name] = added
            continue
        kind = (
            mujoco.mjtJoint.mjJNT_HINGE if joint.kind == "rotation" else mujoco.mjtJoint.mjJNT_SLIDE
        )
        added.add_joint(name=joint.name, type=kind, axis=joint.axes[0].vector)
        placed[body.name] = added
    return spec.compile() if compiled else spec


def to_pinocchio(model):
    """Return the tree as a Pinocchio model, and for each body the id of its joint there."""
    import pinocchio as pin

    made = pin.Model()
    made.gravity = pin.Motion(model.gravity, np.zeros(3))
    ids = {GROUND: 0}
    for body, joint in zip(model.bodies, model.joints, strict=True):
        pose = pin.SE3(
            np.array(joint.parent_frame.rotation), np.array(joint.parent_frame.translation)
        )
        if joint.kind == "free":
            moves = pin.JointModelFreeFlyer()
        else:
            kind = (
                pin.JointModelRevoluteUnaligned
                if joint.kind == "rotation"
                else pin.JointModelPrismaticUnaligned
            )
            moves = kind(np.array(joint.axes[0].vector))
        ids[body.name] = made.addJoint(ids[joint.parent], moves, pose, joint.name)
        inertia = pin.Inertia(body.mass, np.array(body.mass_center), np.array(body.inertia))
        made.appendBodyToJoint(ids[body.name], inertia, pin.SE3.Identity())
    return made, ids
