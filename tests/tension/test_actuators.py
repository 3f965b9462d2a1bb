"""Generalized forces of actuators by virtual work, default reserves, and springs of coordinates."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import UnknownName
from myomorph.core.model.model import Actuator
from myomorph.core.model.scale import scale
from myomorph.core.motion.lengths import length_unit
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.terms.actuators import (
    balanced_coordinates,
    body_directions,
    compile_body_actuators,
    default_reserves,
)
from stick_figure import person

RAJAGOPAL = "rajagopal-walk-emg/subject_walk_scaled.osim"
FLOATING = tuple(f"residual_{kind}{axis}" for kind in "FM" for axis in "XYZ")


@pytest.fixture(scope="module")
def tree(data):
    return compile_tree(read_osim(data(RAJAGOPAL)))


def _pose(tree, seed: int = 0) -> np.ndarray:
    """Return a random pose, couplers ignored: every coordinate moves by itself here."""
    return tree.defaults + np.random.default_rng(seed).uniform(-0.4, 0.4, len(tree.defaults))


def _power(tree, actuator: Actuator, q: np.ndarray, rate: np.ndarray) -> float:
    """Power of the unit actuator while q moves at `rate`, by central differences of poses."""
    h = 1e-6
    before = forward_kinematics(tree, (q + (-1) * h * rate)[None])
    here = forward_kinematics(tree, (q + 0 * h * rate)[None])
    after = forward_kinematics(tree, (q + 1 * h * rate)[None])
    a = tree.body_index[actuator.body]
    b = tree.body_index[actuator.other_body] if actuator.other_body else 0

    def local(point, body):
        return (
            here.rotations[0, body].T @ (point - here.origins[0, body])
            if actuator.point_is_global
            else point
        )

    def at(poses, point, body):
        return poses.rotations[0, body] @ local(point, body) + poses.origins[0, body]

    direction = actuator.direction / (np.linalg.norm(actuator.direction) or 1.0)
    if not actuator.direction_is_global:
        direction = here.rotations[0, a] @ direction
    if actuator.kind == "torque":
        spin = np.zeros(3)
        for body, sign in ((a, 1.0), (b, -1.0)):
            turned = (
                (after.rotations[0, body] - before.rotations[0, body])
                @ here.rotations[0, body].T
                / (2 * h)
            )
            spin += sign * np.array([turned[2, 1], turned[0, 2], turned[1, 0]])
        return float(spin @ direction)
    moved = (at(after, actuator.point, a) - at(before, actuator.point, a)) / (2 * h)
    if actuator.kind == "point":
        return float(moved @ direction)
    gaps = [
        np.linalg.norm(at(poses, actuator.point, a) - at(poses, actuator.other_point, b))
        for poses in (before, after)
    ]
    return float(gaps[1] - gaps[0]) / (2 * h)


ACTUATORS = [
    Actuator(
        "t",
        "torque",
        1.0,
        body="tibia_r",
        other_body="pelvis",
        direction=np.array([1.0, 2.0, -0.5]),
    ),
    Actuator(
        "tl",
        "torque",
        1.0,
        body="torso",
        direction=np.array([0.0, 2.0, 1.0]),
        direction_is_global=False,
    ),
    Actuator(
        "p",
        "point",
        1.0,
        body="calcn_l",
        point=np.array([0.1, 0.02, 0.3]),
        direction=np.array([1.0, 1.0, 0.0]),
    ),
    Actuator(
        "pg",
        "point",
        1.0,
        body="hand_r",
        point=np.array([0.4, 1.0, 0.3]),
        direction=np.array([0.0, 1.0, 3.0]),
        point_is_global=True,
        direction_is_global=False,
    ),
    Actuator(
        "pp",
        "point_to_point",
        1.0,
        body="patella_r",
        other_body="femur_r",
        point=np.array([0.1, 0.2, 0.3]),
        other_point=np.array([-0.2, 0.1, 0.0]),
    ),
    Actuator(
        "pq",
        "point_to_point",
        1.0,
        body="hand_l",
        other_body="calcn_r",
        point=np.array([0.1, 0.2, 0.3]),
        other_point=np.array([-0.2, 0.1, 0.0]),
    ),
]


@pytest.mark.parametrize("actuator", ACTUATORS, ids=lambda one: one.name)
def test_generalized_forces_do_the_work_of_the_force(tree, actuator):
    compiled = compile_body_actuators(tree, [actuator])
    q = _pose(tree)
    found = np.empty((1, len(compiled.coordinate)))
    body_directions(tree.arrays, compiled, q[None], found)
    column = np.zeros(len(q))
    column[compiled.coordinate] = found[0]
    for j in range(len(q)):
        rate = np.zeros(len(q))
        rate[j] = 1.0
        assert column[j] == pytest.approx(_power(tree, actuator, q, rate), abs=2e-8)
    assert np.abs(column).max() > 0.01


def test_an_actuator_on_an_unknown_body_is_refused(tree):
    lost = Actuator("push", "point", 1.0, body="pelvs", direction=np.array([1.0, 0.0, 0.0]))
    with pytest.raises(UnknownName, match=r"push.*'pelvis'"):
        compile_body_actuators(tree, [lost])


def test_every_free_coordinate_gets_a_reserve_and_a_floating_body_residuals(tree):
    model = tree.model
    free = balanced_coordinates(model)
    assert "knee_angle_r_beta" not in free
    made = {one.name: one for one in default_reserves(model, 1.0, 10.0)}
    assert tuple(name for name in made if name.startswith("residual_")) == FLOATING
    assert made["residual_FX"].body == "pelvis"
    assert made["residual_FX"].optimal_force == 10.0
    root = set(model.joints[0].coordinates)
    assert {name for name in made if name.startswith("reserve_")} == {
        f"reserve_{name}" for name in free if name not in root
    }


def test_a_planar_root_is_held_by_its_coordinates(data):
    model = read_osim(
        data("opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim")
    )
    names = {one.name for one in default_reserves(model, 1.0, 10.0)}
    assert names == {f"reserve_{name}" for name in balanced_coordinates(model)}


def test_limits_of_coordinates_pull_as_in_opensim(data):
    opensim = pytest.importorskip("opensim")
    path = data("opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim")
    opensim.Logger.setLevelString("Off")
    other = opensim.Model(str(path))
    state = other.initSystem()
    limit = opensim.CoordinateLimitForce.safeDownCast(
        other.getForceSet().get("AnkleLimitSpringDamper")
    )
    ankle = other.getCoordinateSet().get("ankle_angle_r")
    torques = read_osim(path).passive_torques
    assert {one.coordinate for one in torques} == {"ankle_angle_r"}
    largest = 0.0
    for q in np.radians(np.concatenate([np.linspace(-95, -88, 29), np.linspace(0, 12, 49)])):
        for speed in (-3.0, 0.0, 2.0):
            ankle.setValue(state, q, False)
            ankle.setSpeedValue(state, speed)
            other.realizeVelocity(state)
            ours = sum(float(one.torque(q) - one.damping(q) * speed) for one in torques)
            assert ours == pytest.approx(limit.calcLimitForce(state), abs=1e-9)
            largest = max(largest, abs(ours))
    assert largest > 100.0


def test_what_is_weak_on_a_human_is_weak_on_an_animal_too():
    """By default forces scale with the cube of a small body's length.

    Torques scale with its fourth power.
    """
    human = person().generic
    tiny = scale(human, {body: np.full(3, 0.05) for body in human.body_names})
    unit = length_unit(compile_tree(tiny))
    for one, other in zip(default_reserves(human), default_reserves(tiny), strict=True):
        usual = 10.0 if one.kind in ("point", "torque") else 1.0
        assert one.optimal_force == usual
        assert other.optimal_force == pytest.approx(
            usual * unit ** (3 if one.kind == "point" else 4)
        )
    assert {one.optimal_force for one in default_reserves(tiny, 2.0, 3.0)} == {2.0, 3.0}
