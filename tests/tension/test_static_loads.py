"""Forces of joints by statics: a shank held level by hand, laws, and no muscle counts."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.muscles.published_arms import PATELLAR_TENDON, size_of_person
from myomorph.core.rigid.knees import knee_joints
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.core.tension.static_loads import static_joint_loads
from myomorph.lab.study.inputs.reading import read_motion
from myomorph.lab.study.trial.static_load_step import bent_knee_notes

STUDY = "knee-implant-walk"
KNEE = "walker_knee_l"


@pytest.fixture(scope="module")
def model(data):
    return read_osim(data(f"{STUDY}/nominal.osim"))


@pytest.fixture(scope="module")
def walk(data, model):
    motion = differentiate(read_motion(data(f"{STUDY}/walk1_ik.mot"), model), 6.0)
    loads = read_external_loads(data(f"{STUDY}/walk1_grf.xml"))
    return motion, resample_wrenches(loads, motion.time, cutoff=6.0)


def held(model, hip: float, knee: float) -> Motion:
    """Hang a body still, its left hip and knee bent [rad]."""
    names = ("hip_flexion_l", "knee_angle_l")
    still = np.tile([hip, knee], (3, 1))
    none = np.zeros_like(still)
    return Motion(np.arange(3) * 0.01, names, still, velocities=none, accelerations=none)


def test_a_shank_held_level_by_hand(model) -> None:
    """Quadriceps hold the moment of a level shank with the published arm, along the shank."""
    found = static_joint_loads(model, held(model, np.pi / 2, 0.0))
    place = found.joints.index(KNEE)
    knee = next(joint for joint in knee_joints(model) if joint.name == KNEE)
    beyond = [model.body(f"{name}_l") for name in ("tibia", "talus", "calcn", "toes")]
    weight = 9.80665 * sum(body.mass for body in beyond)
    size = size_of_person(model, knee)
    arms = [float(end[0]) for end in PATELLAR_TENDON.ends(np.zeros(1), size)]
    forces = (found.static_load_high[0, place], found.static_load_low[0, place])
    # The pull is at a right angle to the weight: both give the moment back.
    moments = [np.sqrt(force**2 - weight**2) * arm for force, arm in zip(forces, arms, strict=True)]
    assert moments[0] == pytest.approx(moments[1], rel=0.02)
    assert 5.0 < moments[0] < 15.0
    assert found.flexion[0, place] == pytest.approx(0.0, abs=1e-9)


def test_the_least_is_not_above_the_greatest_and_no_muscle_counts(model, walk) -> None:
    found = static_joint_loads(model, *walk)
    without = static_joint_loads(replace(model, muscles=()), *walk)
    assert set(found.joints) == {"walker_knee_r", "ankle_r", "walker_knee_l", "ankle_l"}
    assert (found.static_load_low <= found.static_load_high + 1e-9).all()
    np.testing.assert_array_equal(found.static_load_low, without.static_load_low)
    np.testing.assert_array_equal(found.static_load_high, without.static_load_high)


def test_the_measured_force_is_seldom_below_the_least(data, model, walk) -> None:
    """An implant cannot measure less than statics ask for, but for errors of plates and clocks."""
    found = static_joint_loads(model, *walk)
    table = np.loadtxt(data(f"{STUDY}/walk1_knee_force.csv"), delimiter=",", skiprows=1)
    least = found.static_load_low[:, found.joints.index(KNEE)]
    missing = np.interp(table[:, 0], found.time, least) - table[:, 3]
    assert np.mean(missing > 0.0) < 0.2
    assert np.maximum(missing, 0.0).mean() < 0.05 * 735.75


def test_ankles_push_off_with_calves_whichever_way_the_angle_counts(model, walk) -> None:
    """At push-off the Achilles tendon presses two body weights and more onto the talus."""
    found = static_joint_loads(model, *walk)
    place = found.joints.index("ankle_l")
    least = found.static_load_low[:, place].max() / found.weight
    greatest = found.static_load_high[:, place].max() / found.weight
    assert 2.0 < least < greatest < 8.0
    assert np.degrees(found.flexion[:, place]).max() == pytest.approx(16.0, abs=6.0)


def test_animals_have_none(model) -> None:
    small = scale(model, dict.fromkeys(model.body_names, np.full(3, 0.1)))
    assert static_joint_loads(small, held(small, 0.0, 0.5)).joints == ()


@pytest.mark.parametrize(("weight", "named"), [(1e4, False), (100.0, True)])
def test_a_bent_knee_is_named_under_load_only(model, weight, named) -> None:
    found = static_joint_loads(model, held(model, 2.8, np.radians(80.0)))
    found = replace(found, weight=weight)
    place = found.joints.index(KNEE)
    totals = np.full((3, 1), 2.0 * weight)
    contacts = JointContactForces(
        time=found.time,
        joints=(KNEE,),
        points=(),
        joint_of=(),
        joint_contact_force=np.zeros((3, 0)),
        joint_contact_total=totals,
        joint_contact_shear=totals,
        joint_contact_unbalanced_force=totals,
        joint_contact_unbalanced_moment=totals,
        weight=weight,
    )
    notes = list(bent_knee_notes(found, contacts))
    assert len(notes) == named
    if named:
        least = found.static_load_low[0, place] / weight
        assert f"{KNEE}: bends to 80°" in str(notes[0])
        assert f"allow {least:.1f} to" in str(notes[0])
        assert "2.0 are estimated" in str(notes[0])
