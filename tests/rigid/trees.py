"""Random trees that Myomorph, Pinocchio and MuJoCo can all express."""

from __future__ import annotations

import numpy as np

from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Model
from myomorph.model.spatial import Transform, rotation_from_quaternion


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
    made, joints, coordinates = [], [], []
    for i, name in enumerate(names):
        parent = GROUND if i == 0 else names[rng.integers(max(0, i - 3), i)]
        mass = rng.uniform(0.1, 5.0)
        made.append(Body(name, mass, rng.normal(scale=0.1, size=3), random_inertia(rng, mass)))
        vector = rng.normal(size=3)
        kind = "rotation" if rng.random() < 0.7 else "translation"
        axis = Axis(kind, vector / np.linalg.norm(vector), linear(1.0), (f"c{i}",))
        pose = Transform(random_rotation(rng), rng.normal(scale=0.3, size=3))
        joints.append(Joint(f"j{i}", kind, parent, name, pose, Transform.identity(), (axis,), (f"c{i}",)))
        coordinates.append(Coordinate(f"c{i}"))
    return Model(f"tree{seed}", tuple(made), tuple(joints), tuple(coordinates), np.array([0.3, -9.5, 0.7]))


def to_mujoco(model):
    """The tree as a compiled MuJoCo model, without contacts or passive forces."""
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
            fullinertia=[inertia[0, 0], inertia[1, 1], inertia[2, 2], inertia[0, 1], inertia[0, 2], inertia[1, 2]],
            explicitinertial=True,
        )
        kind = mujoco.mjtJoint.mjJNT_HINGE if joint.kind == "rotation" else mujoco.mjtJoint.mjJNT_SLIDE
        added.add_joint(name=joint.name, type=kind, axis=joint.axes[0].vector)
        placed[body.name] = added
    return spec.compile()


def to_pinocchio(model):
    """The tree as a Pinocchio model, and for each body the id of its joint there."""
    import pinocchio as pin

    made = pin.Model()
    made.gravity = pin.Motion(model.gravity, np.zeros(3))
    ids = {GROUND: 0}
    for body, joint in zip(model.bodies, model.joints, strict=True):
        kind = pin.JointModelRevoluteUnaligned if joint.kind == "rotation" else pin.JointModelPrismaticUnaligned
        pose = pin.SE3(np.array(joint.parent_frame.rotation), np.array(joint.parent_frame.translation))
        ids[body.name] = made.addJoint(ids[joint.parent], kind(np.array(joint.axes[0].vector)), pose, joint.name)
        inertia = pin.Inertia(body.mass, np.array(body.mass_center), np.array(body.inertia))
        made.appendBodyToJoint(ids[body.name], inertia, pin.SE3.Identity())
    return made, ids
