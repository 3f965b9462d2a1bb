"""Laws of the tree.

Finite differences, power balance, couplers, inverted axes, functions of two coordinates.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadModel, UnknownName
from myomorph.core.model.functions import SineProduct, constant, polynomial, simm_spline
from myomorph.core.model.model import Axis, Coupler
from myomorph.core.model.series import Wrenches
from myomorph.core.rigid.coordinates import (
    compile_functions,
    couple_frames,
    evaluate,
    gather_dependents,
)
from myomorph.core.rigid.dynamics import inverse_dynamics, motion_arrays
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import functional_tree, random_tree, swinging


@pytest.mark.parametrize("seed", range(4))
def test_jacobian_is_the_derivative_of_poses(seed):
    model = functional_tree(seed)
    tree = compile_tree(model)
    c = np.random.default_rng(seed).normal(scale=0.5, size=(1, len(model.coordinates)))
    couple_frames(tree.arrays, c)
    poses = forward_kinematics(tree, c)
    step = 1e-6
    for body in (6, 12):
        local = np.array([0.1, 0.2, -0.3])
        point = poses.points(np.array([body]), local[None])[0, 0]
        J = poses.jacobian(body, point)[0][3:]
        gather_dependents(tree.arrays, c[0], J)
        for j in tree.independent:
            moved = np.vstack([c, c])
            moved[0, j] -= step
            moved[1, j] += step
            couple_frames(tree.arrays, moved)
            x = forward_kinematics(tree, moved).points(np.array([body]), local[None])[:, 0]
            np.testing.assert_allclose(J[:, j], (x[1] - x[0]) / (2 * step), atol=1e-7)


@pytest.mark.parametrize("seed", range(4))
def test_power_of_generalized_forces_is_the_rate_of_energy(seed):
    """sum tau cdot = d(kinetic + potential)/dt - external power, with couplers and curved axes."""
    model = functional_tree(seed)
    tree = compile_tree(model)
    step = 1e-4
    motion = swinging(model, 5, step, seed)
    c, cdot, _ = motion_arrays(tree, motion)
    wrenches = Wrenches(
        time=motion.time,
        names=("push",),
        bodies=("body7",),
        forces=np.full((5, 1, 3), [30.0, -20.0, 10.0]),
        points=np.full((5, 1, 3), 0.3),
        torques=np.full((5, 1, 3), 2.0),
    )
    tau = inverse_dynamics(model, motion, wrenches).values
    energy = np.array([mechanical_energy(tree, c[i], cdot[i]) for i in range(5)])
    rate = (energy[0] - 8 * energy[1] + 8 * energy[3] - energy[4]) / (12 * step)
    poses = forward_kinematics(tree, c)
    twist = poses.jacobian(8, np.full(3, 0.3))[2] @ cdot[2]
    external = twist[3:] @ [30.0, -20.0, 10.0] + twist[:3] @ [2.0, 2.0, 2.0]
    assert tau[2] @ cdot[2] + external == pytest.approx(rate, rel=1e-6, abs=1e-6)


def mechanical_energy(tree, c, cdot):
    poses = forward_kinematics(tree, c[None])
    arrays = tree.arrays
    total = 0.0
    for b in range(1, len(arrays.parent)):
        R = poses.rotations[0, b]
        center = poses.origins[0, b] + R @ arrays.mass_center[b]
        twist = poses.jacobian(b, center)[0] @ cdot
        inertia = R @ arrays.inertia[b] @ R.T
        total += (
            0.5 * arrays.mass[b] * twist[3:] @ twist[3:] + 0.5 * twist[:3] @ inertia @ twist[:3]
        )
        total -= arrays.mass[b] * arrays.gravity @ center
    return total


def test_folded_constants_change_nothing():
    model = random_tree(2)
    joint = model.joints[3]
    folded = replace(joint, axes=(Axis("translation", np.eye(3)[1], constant(0.7)),) + joint.axes)
    shifted = replace(
        joint,
        parent_frame=joint.parent_frame
        @ type(joint.parent_frame)(np.eye(3), np.array([0, 0.7, 0])),
    )
    c = np.random.default_rng(0).normal(size=(1, 12))
    one = forward_kinematics(
        compile_tree(replace(model, joints=model.joints[:3] + (folded,) + model.joints[4:])), c
    )
    other = forward_kinematics(
        compile_tree(replace(model, joints=model.joints[:3] + (shifted,) + model.joints[4:])), c
    )
    np.testing.assert_allclose(one.origins, other.origins, atol=1e-14)


def test_center_of_mass_moves_with_the_whole_body():
    model = random_tree(1)
    tree = compile_tree(model)
    c = np.random.default_rng(0).normal(size=(2, 12))
    poses = forward_kinematics(tree, c)
    by_hand = sum(
        body.mass * poses.points(np.array([i + 1]), body.mass_center[None])[:, 0]
        for i, body in enumerate(model.bodies)
    )
    np.testing.assert_allclose(center_of_mass(tree, poses), by_hand / model.mass, atol=1e-13)


def test_compiled_functions_agree_with_the_nouns_and_their_differences():
    rng = np.random.default_rng(0)
    functions = [
        constant(3.0),
        polynomial(rng.normal(size=5)),
        simm_spline(np.sort(rng.normal(size=6)), rng.normal(size=6)),
        SineProduct(factor=2.0, frequencies=np.array([1.5]), phases=np.array([0.2]), offset=0.7),
        SineProduct(
            factor=-1.0, frequencies=np.array([1.0, 0.5]), phases=np.array([0.2, 1.0]), offset=0.1
        ),
    ]
    arrays = compile_functions(functions)
    for i, function in enumerate(functions):
        for x1, x2 in rng.normal(size=(50, 2)):
            value, d1, d2, d11, d12, d22 = evaluate(arrays, i, x1, x2)
            h = 1e-6
            up1 = evaluate(arrays, i, x1 + h, x2)
            down1 = evaluate(arrays, i, x1 - h, x2)
            up2 = evaluate(arrays, i, x1, x2 + h)
            down2 = evaluate(arrays, i, x1, x2 - h)
            arguments = (x1, x2)[: max(function.arity, 1)]
            assert value == pytest.approx(float(function(*arguments)), abs=1e-12)
            assert d1 == pytest.approx((up1[0] - down1[0]) / (2 * h), abs=1e-5)
            assert d2 == pytest.approx((up2[0] - down2[0]) / (2 * h), abs=1e-5)
            assert d11 == pytest.approx((up1[1] - down1[1]) / (2 * h), abs=1e-3)
            assert d12 == pytest.approx((up2[1] - down2[1]) / (2 * h), abs=1e-5)
            assert d22 == pytest.approx((up2[2] - down2[2]) / (2 * h), abs=1e-5)


def test_couplers_in_a_circle_are_refused():
    couplers = (
        Coupler(name="a", dependent="c1", function=polynomial([0, 1]), independents=("c2",)),
        Coupler(name="b", dependent="c2", function=polynomial([0, 1]), independents=("c1",)),
    )
    with pytest.raises(BadModel, match="circle"):
        compile_tree(replace(random_tree(0), couplers=couplers))


def test_a_wrench_on_an_unknown_body_is_refused():
    model = random_tree(0)
    motion = swinging(model, 3, 0.01)
    zero = np.zeros((3, 1, 3))
    with pytest.raises(UnknownName, match=r"'body99'.*'body9'"):
        inverse_dynamics(
            model,
            motion,
            Wrenches(
                time=motion.time,
                names=("w",),
                bodies=("body99",),
                forces=zero,
                points=zero,
                torques=zero,
            ),
        )


def test_defaults_given_as_whole_numbers_do_not_round_motions():
    model = random_tree(0)
    whole = replace(model, coordinates=tuple(replace(one, default=0) for one in model.coordinates))
    moved = swinging(whole, 3, 0.1)
    np.testing.assert_array_equal(compile_tree(whole).coordinates_of(moved), moved.values)
