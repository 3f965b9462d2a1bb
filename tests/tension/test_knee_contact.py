"""Knees that stay in contact: each side carries its least where the knee is nearly straight."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.leg_angles import leg_angles
from myomorph.core.tension.joint_contact import joint_contact_forces
from myomorph.core.tension.knee_points import knee_points
from myomorph.core.tension.knee_sides import MAX_FLEXION, knee_sides
from myomorph.core.tension.recruitment import RecruitmentOptions, recruitment_terms
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.terms.knee_contact import KneeContactTerm
from myomorph.lab.study.inputs.reading import read_motion

STUDY = "knee-implant-walk"
KNEE = "walker_knee_l"
LEVEL = 0.2


@pytest.fixture(scope="module")
def model(data):
    return read_osim(data(f"{STUDY}/nominal.osim"))


@pytest.fixture(scope="module")
def walk(data, model):
    motion = differentiate(read_motion(data(f"{STUDY}/walk1_ik.mot"), model), 6.0).frames(
        np.arange(0, 132, 4)
    )
    loads = read_external_loads(data(f"{STUDY}/walk1_grf.xml"))
    return motion, resample_wrenches(loads, motion.time, cutoff=6.0)


def side_forces(model, walk, level):
    """(frames, 2) forces of both sides of the left knee [body weights], and tensions."""
    motion, wrenches = walk
    torques = inverse_dynamics(model, motion, wrenches)
    options = RecruitmentOptions(knee_contact=level)
    tension = solve_tension(model, motion, torques, recruitment=options)
    points = [point for point in knee_points(model, {}).points if point.joint == KNEE]
    found = joint_contact_forces(model, motion, tension, wrenches, points)
    return found.joint_contact_force / model.weight, tension


def test_each_side_keeps_its_least_where_the_knee_is_nearly_straight(model, walk) -> None:
    plain, _ = side_forces(model, walk, 0.0)
    kept, tension = side_forces(model, walk, LEVEL)
    leg = next(leg for leg in leg_angles(model) if leg.knee.joint.name == KNEE)
    values = np.zeros((len(walk[0]), len(model.coordinates)))
    values[:, leg.knee.coordinate] = walk[0]["knee_angle_l"]
    asked = leg.knee.of(values) < MAX_FLEXION
    assert tension.optimal.all()
    assert asked.sum() > 10
    assert (~asked).sum() > 3
    assert plain[asked].min() < 0.1
    # An aim: what it lacks is what the effort for it is worth.
    assert kept[asked].min() > LEVEL - 0.05
    assert np.abs(kept - plain)[plain.min(axis=1) < 0.1].max() > 0.05


def test_without_muscles_a_side_has_the_force_that_its_point_carries(model, walk) -> None:
    motion, wrenches = walk
    term = KneeContactTerm(model, knee_sides(model, motion, wrenches), LEVEL)
    from_alone = {side.point: side.alone for side in term._sides if side.knee == KNEE}
    without = joint_contact_forces(
        model,
        motion,
        None,
        wrenches,
        [point for point in knee_points(model, {}).points if point.joint == KNEE],
    )
    both = without.joint_contact_force.min(axis=1) > 1.0
    assert both.any()
    for column, point in enumerate(without.points):
        np.testing.assert_allclose(
            from_alone[point][both] * model.weight,
            without.joint_contact_force[both, column],
            atol=1e-3 * model.weight,
        )


def test_no_knee_no_force_no_contact(arm, model, walk) -> None:
    motion, wrenches = walk
    with pytest.raises(BadData, match="expected 0 to 1 body weight"):
        RecruitmentOptions(knee_contact=2.0)
    with pytest.raises(BadData, match="expected above 0"):
        KneeContactTerm(model, knee_sides(model, motion, wrenches), 0.0)
    with pytest.raises(BadModel, match="has no knee"):
        knee_sides(read_osim(arm.model), motion, None)
    torques = inverse_dynamics(model, motion, wrenches)
    assert recruitment_terms(model, motion, torques, wrenches, RecruitmentOptions(0.0)) == ()


def test_a_knee_that_its_coordinates_move_down_the_thigh_has_two_sides(data) -> None:
    """The knee's frame on the thigh lies in the hip in this model; its points lay in one place."""
    points = knee_points(read_osim(data("ceinms-emg-walk/model/gait2392.osim")), {}).points
    for knee in ("knee_r", "knee_l"):
        places = np.array([point.point for point in points if point.joint == knee])
        assert np.linalg.norm(places[0] - places[1]) == pytest.approx(0.045, abs=0.01)
