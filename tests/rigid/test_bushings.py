"""Bushings: energy, symmetry, and OpenSim's own forces."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.paths import Bushing
from myomorph.core.model.scale import scale
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.bushings import bushing_forces, deflection
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from trees import random_rotation, random_tree


def bushing(one, two, rng, **parts):
    pose_1 = Transform(random_rotation(rng), 0.1 * rng.normal(size=3))
    pose_2 = Transform(random_rotation(rng), 0.1 * rng.normal(size=3))
    free = Bushing(name="bush", body_1=one, body_2=two, pose_1=pose_1, pose_2=pose_2)
    return replace(free, **parts)


@pytest.fixture
def tied():
    rng = np.random.default_rng(4)
    model = random_tree(7, 8)
    one = bushing(
        model.bodies[1].name,
        model.bodies[6].name,
        rng,
        rotational_stiffness=rng.uniform(1, 5, 3),
        rotational_damping=rng.uniform(0.1, 1, 3),
        translational_stiffness=rng.uniform(10, 50, 3),
        translational_damping=rng.uniform(1, 5, 3),
    )
    return compile_tree(model), one, rng.normal(scale=0.3, size=(5, 8)), rng.normal(size=(5, 8))


def energy(tree, one, c):
    q, _ = deflection(tree, forward_kinematics(tree, c), one)
    return 0.5 * (q**2 @ np.concatenate([one.rotational_stiffness, one.translational_stiffness]))


def test_springs_are_the_slope_of_their_energy(tied):
    tree, one, c, _ = tied
    tau = bushing_forces(tree, [one], c, np.zeros_like(c))
    step = 1e-6
    for j in range(c.shape[1]):
        aside = step * np.eye(c.shape[1])[j]
        slope = (energy(tree, one, c + aside) - energy(tree, one, c - aside)) / (2 * step)
        np.testing.assert_allclose(tau[:, j], -slope, atol=1e-6)


def test_dampers_only_take_energy(tied):
    tree, one, c, rates = tied
    none = dict.fromkeys(("rotational_stiffness", "translational_stiffness"), np.zeros(3))
    tau = bushing_forces(tree, [replace(one, **none)], c, rates)
    step = 1e-6
    q = [
        deflection(tree, forward_kinematics(tree, c + sign * step * rates), one)[0]
        for sign in (1, -1)
    ]
    qdot = (q[0] - q[1]) / (2 * step)
    damping = np.concatenate([one.rotational_damping, one.translational_damping])
    power = (tau * rates).sum(axis=1)
    np.testing.assert_allclose(power, -(qdot**2 @ damping), rtol=1e-6)
    assert (power < 0).all()


def test_frames_grow_with_their_bodies(tied):
    tree, one, _, _ = tied
    grown = scale(replace(tree.model, bushings=(one,)), {one.body_1: (2.0, 2.0, 2.0)}).bushings[0]
    np.testing.assert_allclose(grown.pose_1.translation, 2.0 * one.pose_1.translation)
    np.testing.assert_allclose(grown.pose_2.translation, one.pose_2.translation)


def _forces_of_opensim(opensim, model, names, c, rates):
    """Return generalized forces (frames, coordinates) of the bushing: torques without it less with.

    States are (frames, coordinates) in the order of names.
    """
    state = model.initSystem()
    force = model.getForceSet().get("bush")
    coordinates = [model.getCoordinateSet().get(name) for name in names]
    solver = opensim.InverseDynamicsSolver(model)
    for coordinate in coordinates:
        coordinate.setLocked(state, False)
    for j, coordinate in enumerate(coordinates):
        coordinate.setSpeedValue(state, j + 1.0)
    order = [round(speed) - 1 for speed in state.getU().to_numpy()]
    expected = np.empty_like(c)
    for frame in range(len(c)):
        for j, coordinate in enumerate(coordinates):
            coordinate.setValue(state, float(c[frame, j]), False)
            coordinate.setSpeedValue(state, float(rates[frame, j]))
        found = []
        for on in (True, False):
            force.setAppliesForce(state, on)
            model.realizeDynamics(state)
            found.append(solver.solve(state, opensim.Vector(len(names), 0.0)).to_numpy().copy())
        expected[frame, order] = found[1] - found[0]
    return expected


def test_opensim_applies_the_same_forces(data, tmp_path):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("Off")
    model = read_osim(data("hamner-run-subject04/unscaled_generic.osim"))
    rng = np.random.default_rng(0)
    parts = {
        "rotational_stiffness": rng.uniform(1, 5, 3),
        "rotational_damping": rng.uniform(0.1, 1, 3),
        "translational_stiffness": rng.uniform(10, 50, 3),
        "translational_damping": rng.uniform(1, 5, 3),
    }
    made = replace(
        model,
        muscles=(),
        actuators=(),
        kept=(),
        bushings=(bushing("pelvis", "humerus_r", rng, **parts),),
    )
    write_osim(made, tmp_path / "bushing.osim")
    read = read_osim(tmp_path / "bushing.osim")
    tree = compile_tree(read)
    names = read.coordinate_names
    free = [j for j, name in enumerate(names) if name not in read.dependent_coordinates]
    c = 0.2 * rng.normal(size=(3, len(names)))
    rates = rng.normal(size=(3, len(names)))
    theirs = opensim.Model(str(tmp_path / "bushing.osim"))
    expected = _forces_of_opensim(opensim, theirs, names, c, rates)
    np.testing.assert_allclose(
        bushing_forces(tree, read.bushings, c, rates)[:, free], expected[:, free], atol=1e-7
    )
