"""Poses and inverse dynamics against Pinocchio and MuJoCo, to 1e-9."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import random_tree, to_mujoco, to_pinocchio

TOLERANCE = 1e-9
SEEDS = range(6)


def moving(model, seed, frames=3):
    rng = np.random.default_rng(1000 + seed)
    values, velocities, accelerations = rng.normal(size=(3, frames, len(model.coordinates)))
    return Motion(
        time=np.arange(frames) * 0.01,
        names=model.coordinate_names,
        values=values,
        velocities=velocities,
        accelerations=accelerations,
    )


def pushed(model, motion, seed):
    rng = np.random.default_rng(2000 + seed)
    forces, points, torques = rng.normal(scale=10.0, size=(3, len(motion), 2, 3))
    return Wrenches(
        time=motion.time,
        names=("left", "right"),
        bodies=(model.bodies[-1].name, model.bodies[4].name),
        forces=forces,
        points=points,
        torques=torques,
    )


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_inverse_dynamics_and_jacobian_agree_with_pinocchio(seed):
    pin = pytest.importorskip("pinocchio")
    model = random_tree(seed)
    motion = moving(model, seed)
    wrenches = pushed(model, motion, seed)
    theirs, ids = to_pinocchio(model)
    data = theirs.createData()
    tree = compile_tree(model)
    poses = forward_kinematics(tree, motion.values)
    tau = inverse_dynamics(model, motion, wrenches).values
    for frame in range(len(motion)):
        pin.forwardKinematics(theirs, data, motion.values[frame])
        expected = pin.rnea(
            theirs,
            data,
            motion.values[frame],
            motion.velocities[frame],
            motion.accelerations[frame],
            _external(pin, theirs, data, ids, wrenches, frame),
        )
        np.testing.assert_allclose(tau[frame], expected, atol=TOLERANCE)
        for body in model.bodies:
            pose = data.oMi[ids[body.name]]
            b = tree.body_index[body.name]
            np.testing.assert_allclose(poses.origins[frame, b], pose.translation, atol=TOLERANCE)
            np.testing.assert_allclose(poses.rotations[frame, b], pose.rotation, atol=TOLERANCE)
        np.testing.assert_allclose(
            center_of_mass(tree, poses)[frame],
            pin.centerOfMass(theirs, data, motion.values[frame]),
            atol=TOLERANCE,
        )
        pin.computeJointJacobians(theirs, data, motion.values[frame])
        # Of the last body
        J = pin.getJointJacobian(
            theirs, data, ids[body.name], pin.ReferenceFrame.LOCAL_WORLD_ALIGNED
        )
        ours = poses.jacobian(b, poses.origins[frame, b])[frame]
        np.testing.assert_allclose(ours, np.vstack([J[3:], J[:3]]), atol=TOLERANCE)


def _external(pin, theirs, data, ids, wrenches, frame):
    """Return Pinocchio's external force on each joint."""
    external = pin.StdVec_Force()
    for _ in range(theirs.njoints):
        external.append(pin.Force.Zero())
    for e, name in enumerate(wrenches.bodies):
        force = wrenches.forces[frame, e]
        moment = wrenches.torques[frame, e] + np.cross(wrenches.points[frame, e], force)
        about_ground = pin.Force(force, moment)
        external[ids[name]] = external[ids[name]] + data.oMi[ids[name]].actInv(about_ground)
    return external


@pytest.mark.parametrize("seed", SEEDS)
def test_poses_and_inverse_dynamics_agree_with_mujoco(seed):
    mujoco = pytest.importorskip("mujoco")
    model = random_tree(seed)
    motion = moving(model, seed)
    theirs = to_mujoco(model)
    data = mujoco.MjData(theirs)
    order = [theirs.joint(joint.name).dofadr[0] for joint in model.joints]
    tree = compile_tree(model)
    poses = forward_kinematics(tree, motion.values)
    tau = inverse_dynamics(model, motion)
    for frame in range(len(motion)):
        data.qpos[order] = motion.values[frame]
        data.qvel[order] = motion.velocities[frame]
        data.qacc[order] = motion.accelerations[frame]
        mujoco.mj_inverse(theirs, data)
        np.testing.assert_allclose(tau.values[frame], data.qfrc_inverse[order], atol=TOLERANCE)
        for body in model.bodies:
            np.testing.assert_allclose(
                poses.origins[frame, tree.body_index[body.name]],
                data.body(body.name).xpos,
                atol=TOLERANCE,
            )
