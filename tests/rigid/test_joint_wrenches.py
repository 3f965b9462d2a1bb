"""What joints transmit: Newton's and Euler's laws, and Pinocchio's joint forces.

Also accelerations back from forces.
"""

from __future__ import annotations

import numpy as np
import pytest

from looped import looped_tree
from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.series import Motion
from myomorph.core.rigid.dynamics import (
    MotionArrays,
    inverse_dynamics,
    joint_wrenches,
    motion_arrays,
)
from myomorph.core.rigid.forward import (
    balancing_multipliers,
    forward_accelerations,
    gathered,
    loop_wrenches,
)
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import (
    close_loops,
    closed_motion,
    closure_jacobian,
    closure_rates,
    free_coordinates,
)
from myomorph.core.rigid.tree import compile_tree
from trees import functional_tree, random_tree, swinging, to_pinocchio


def pushed(tree, frames, seed):
    return np.random.default_rng(seed).normal(scale=5.0, size=(frames, len(tree.arrays.parent), 6))


def test_each_body_keeps_its_laws_of_momentum():
    """Joint of the body less those of its children, gravity and what is applied.

    The sum is the rate of momentum.
    """
    model = functional_tree(3)
    step = 3e-4
    tree = compile_tree(model)
    arrays = motion_arrays(tree, swinging(model, 5, step, seed=3))
    applied = pushed(tree, 5, 0)
    found = joint_wrenches(tree, *arrays, applied)
    poses = forward_kinematics(tree, arrays.values)
    for b in range(1, len(tree.arrays.parent)):
        T = tree.arrays
        children = np.flatnonzero(T.parent == b)
        center = poses.origins[:, b] + poses.rotations[:, b] @ T.mass_center[b]
        force = found.forces[2, b] - sum(found.forces[2, k] for k in children)
        moment = found.moments[2, b] - sum(found.moments[2, k] for k in children)
        weight = T.mass[b] * T.gravity
        total = np.concatenate([force + weight, moment + np.cross(center[2], weight)])
        rate = _momentum_rate(T, b, poses.rotations[:, b], center, step)
        np.testing.assert_allclose(total + applied[2, b], rate, atol=5e-4)


def _momentum_rate(T, b, R, center, step):
    """Return the rates (6,) of linear and angular momentum of a body in frame 2.

    They are by differences of its rotations R (5, 3, 3) and centers of mass (5, 3).
    """
    acceleration = (center[3] - 2 * center[2] + center[1]) / step**2
    before, _, after = _angular_momenta(T, b, R, center, step)
    return np.concatenate([T.mass[b] * acceleration, (after - before) / (2 * step)])


def _angular_momenta(T, b, R, center, step):
    """Return the angular momenta of a body about the ground's origin in frames 1 to 3.

    They are by differences of its rotations R (5, 3, 3) and centers of mass (5, 3).
    """
    momenta = []
    for f in (1, 2, 3):
        near = (R[f + 1] - R[f - 1]) / (2 * step) @ R[f].T
        omega = np.array([near[2, 1], near[0, 2], near[1, 0]])
        speed = (center[f + 1] - center[f - 1]) / (2 * step)
        inertia = R[f] @ T.inertia[b] @ R[f].T
        momenta.append(inertia @ omega + T.mass[b] * np.cross(center[f], speed))
    return momenta


@pytest.mark.parametrize("seed", range(4))
def test_joint_forces_agree_with_pinocchio(seed):
    pin = pytest.importorskip("pinocchio")
    model = random_tree(seed)
    tree = compile_tree(model)
    states = np.random.default_rng(seed).normal(size=(3, 2, len(model.coordinates)))
    applied = pushed(tree, 2, seed)
    found = joint_wrenches(tree, *states, applied)
    theirs, ids = to_pinocchio(model)
    data = theirs.createData()
    pairs = [(tree.body_index[body.name], ids[body.name]) for body in model.bodies]
    for frame in range(2):
        pin.forwardKinematics(theirs, data, states[0, frame])
        external = pin.StdVec_Force()
        for _ in range(theirs.njoints):
            external.append(pin.Force.Zero())
        for b, i in pairs:
            wrench = pin.Force(applied[frame, b, :3], applied[frame, b, 3:])
            external[i] = data.oMi[i].actInv(wrench)
        pin.rnea(theirs, data, *states[:, frame], external)
        for b, i in pairs:
            carried = data.oMi[i].act(data.f[i])
            np.testing.assert_allclose(found.forces[frame, b], carried.linear, atol=1e-9)
            np.testing.assert_allclose(found.moments[frame, b], carried.angular, atol=1e-9)


def unknown(arrays):
    """Drop the accelerations of a motion."""
    return arrays._replace(accelerations=np.zeros_like(arrays.accelerations))


def test_forces_give_the_accelerations_back():
    """Inverse dynamics, then forward: couplers and curved joints included."""
    model = functional_tree(2)
    motion = swinging(model, 4, 0.01, seed=5)
    tree = compile_tree(model)
    arrays = motion_arrays(tree, motion)
    c, cdot, cddot = arrays
    applied = pushed(tree, 4, 1)
    tau = gathered(tree, c, joint_wrenches(tree, c, cdot, cddot, applied).torques)
    found, multipliers = forward_accelerations(tree, unknown(arrays), applied, tau)
    assert multipliers.shape == (4, 0)
    np.testing.assert_allclose(found, cddot, rtol=1e-7, atol=1e-7)


def _closed_at(model, pose, velocities, accelerations):
    """Return a motion of three frames at a pose whose rates keep loops closed."""
    given = Motion(
        time=np.arange(3.0),
        names=model.coordinate_names,
        values=np.tile(pose, (3, 1)),
        velocities=velocities,
        accelerations=accelerations,
    )
    return closed_motion(model, given)[0]


def test_loops_carry_what_they_were_given_to_carry():
    """Multipliers and accelerations are recovered; loop forces move no closed motion."""
    model, pose = looped_tree(1, kinds=("WeldConstraint",), bodies=16)
    rng = np.random.default_rng(2)
    tree = compile_tree(model)
    arrays = motion_arrays(tree, _closed_at(model, pose, *rng.normal(size=(2, 3, len(pose)))))
    c = arrays.values
    applied = pushed(tree, 3, 3)
    forces = rng.normal(scale=4.0, size=(3, 6))
    tau = joint_wrenches(tree, *arrays, applied + loop_wrenches(tree, c, forces)).torques
    # What a loop does to bodies is what its multipliers do along coordinates.
    alone = joint_wrenches(tree, *arrays, applied).torques - tau
    along = np.einsum("frj,fr->fj", closure_jacobian(tree, c), forces)
    np.testing.assert_allclose((alone - along)[:, free_coordinates(tree)], 0.0, atol=1e-8)
    found, multipliers = forward_accelerations(tree, unknown(arrays), applied, tau)
    np.testing.assert_allclose(found, arrays.accelerations, atol=1e-6)
    np.testing.assert_allclose(multipliers, forces, atol=1e-6)
    assert np.abs(closure_rates(tree, c, arrays.velocities, found)[1]).max() < 1e-7
    np.testing.assert_allclose(balancing_multipliers(tree, arrays, applied, tau), forces, atol=1e-7)


def test_a_model_at_rest_weighs_on_its_root():
    model = random_tree(4)
    still = np.zeros((1, len(model.coordinates)))
    motion = Motion(
        time=np.zeros(1),
        names=model.coordinate_names,
        values=still,
        velocities=still,
        accelerations=still,
    )
    tree = compile_tree(model)
    found = joint_wrenches(tree, still, still, still, np.zeros((1, len(tree.arrays.parent), 6)))
    np.testing.assert_allclose(found.forces[0, 0], -model.mass * model.gravity, rtol=1e-12)
    np.testing.assert_allclose(found.torques, inverse_dynamics(model, motion).values, atol=1e-12)


def _fall(tree, c):
    """Return accelerations and joint wrenches of a model released at poses c."""
    still = np.zeros_like(c)
    nothing = np.zeros((len(c), len(tree.arrays.parent), 6))
    at_rest = MotionArrays(values=c, velocities=still, accelerations=still)
    accelerations, multipliers = forward_accelerations(tree, at_rest, nothing, still)
    loops = loop_wrenches(tree, c, multipliers)
    return accelerations, joint_wrenches(tree, c, still, accelerations, loops)


def test_a_loop_falls_and_carries_as_in_opensim(data):
    """A released shoulder: accelerations and reactions of OpenSim 4.6, without muscles."""
    opensim = pytest.importorskip("opensim")
    path = data("shoulder-thoracoscapular/model_cmc/TSM_subject_CMC_noWeight.osim")
    model = read_osim(path)
    tree = compile_tree(model)
    given = motion_from_table(read_sto(data("shoulder-thoracoscapular/ik/ABD01.mot")), model)
    c = close_loops(tree, tree.coordinates_of(given)[[150, 300, 420]])
    accelerations, found = _fall(tree, c)
    opensim.Logger.setLevelString("Off")
    theirs = opensim.Model(str(path))
    theirs.updForceSet().clearAndDestroy()
    state = theirs.initSystem()
    # OpenSim's speeds of the scapula are angular velocities: its accelerations are of other
    # quantities.
    same = [not one.name.startswith("scapula_") and not one.locked for one in model.coordinates]
    for frame in range(3):
        wanted = _released(theirs, state, model, c[frame])
        np.testing.assert_allclose(accelerations[frame, same], wanted[same], rtol=1e-5, atol=1e-5)
        for joint in model.joints:
            load = theirs.getJointSet().get(joint.name).calcReactionOnChildExpressedInGround(state)
            force, moment = _at_joint(found, tree, joint, frame)
            np.testing.assert_allclose(force, load.get(1).to_numpy(), atol=1e-4)
            np.testing.assert_allclose(moment, load.get(0).to_numpy(), atol=1e-4)


def _released(theirs, state, model, c):
    """Release OpenSim's model from a pose (coordinates,); return its accelerations."""
    coordinates = [theirs.getCoordinateSet().get(name) for name in model.coordinate_names]
    for coordinate, value in zip(coordinates, c, strict=True):
        coordinate.setLocked(state, False)
        coordinate.setValue(state, float(value), False)
        coordinate.setSpeedValue(state, 0.0)
    for coordinate, one in zip(coordinates, model.coordinates, strict=True):
        coordinate.setLocked(state, one.locked)
    theirs.realizeAcceleration(state)
    return np.array([coordinate.getAccelerationValue(state) for coordinate in coordinates])


def _at_joint(found, tree, joint, frame):
    """Return force and moment on the child about the joint's center, in ground."""
    b = tree.body_index[joint.child]
    point = found.origins[frame, b] + found.rotations[frame, b] @ joint.child_frame.translation
    force = found.forces[frame, b]
    return force, found.moments[frame, b] - np.cross(point, force)
