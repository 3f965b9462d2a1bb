"""Knees, paths and muscles of the generic model against Rajagopal's.

Anatomists' tables are the basis of that model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.lab.analyze.anatomy import architectures, strength_of, with_architecture
from myomorph.lab.analyze.generic_model import generic_model

pytest.importorskip("myo_sim")
RAJAGOPAL = "rajagopal-walk-emg/raw/Rajagopal2016.osim"
ABDUCTORS = "passive-joint-moments/Rajagopal_modifiedAbductors.osim"


def arms(model, coordinate, angles):
    motion = Motion(0.01 * np.arange(len(angles)), (coordinate,), np.radians(angles)[:, None])
    found = muscle_kinematics(model, motion, velocities=False)
    return {
        name: found.moment_arm_of(name, coordinate) for name in found.muscles if name.endswith("_r")
    }


@pytest.mark.parametrize(
    ("coordinate", "low", "high", "model"),
    [
        ("hip_flexion_r", -20.0, 110.0, ABDUCTORS),
        ("hip_adduction_r", -30.0, 20.0, ABDUCTORS),
        ("knee_angle_r", 0.0, 120.0, RAJAGOPAL),
        ("ankle_angle_r", -40.0, 30.0, RAJAGOPAL),
    ],
)
def test_moment_arms_are_those_of_rajagopals_model(data, coordinate, low, high, model) -> None:
    """Within 5 mm, but for quadriceps beyond 60 degrees.

    There its patella leaves the measured ratio. Abductors are as Uhlrich et al. moved them.
    """
    angles = np.linspace(low, high, 12)
    ours = arms(generic_model({})[0], coordinate, angles)
    theirs = arms(read_osim(data(model)), coordinate, angles)
    for name, expected in theirs.items():
        quadriceps = coordinate == "knee_angle_r" and name.startswith(("vas", "recfem"))
        near = angles <= 60.0 if quadriceps else angles >= low
        np.testing.assert_allclose(ours[name][near], expected[near], atol=5e-3, err_msg=name)


def test_both_sides_are_mirror_images() -> None:
    model, _ = generic_model({})
    for coordinate in ("hip_flexion", "knee_angle"):
        angles = np.linspace(0.0, 110.0, 8)
        motions = [
            Motion(0.01 * np.arange(8), (f"{coordinate}_{side}",), np.radians(angles)[:, None])
            for side in "rl"
        ]
        right_motion, left_motion = motions
        right = muscle_kinematics(model, right_motion, velocities=False)
        left = muscle_kinematics(model, left_motion, velocities=False)
        for name in right.muscles:
            if name.endswith("_r"):
                other = left.moment_arm_of(f"{name[:-1]}l", f"{coordinate}_l")
                np.testing.assert_allclose(
                    right.moment_arm_of(name, f"{coordinate}_r"), other, atol=2e-4, err_msg=name
                )


def test_fibers_at_zero_are_those_of_the_table() -> None:
    model, _ = generic_model({})
    lengths = muscle_kinematics(
        model, Motion(np.zeros(1), (), np.zeros((1, 0))), velocities=False
    ).muscle_length[0]
    for muscle, length in zip(model.muscles, lengths, strict=True):
        line = architectures()[muscle.name[:-2]]
        across = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
        fiber = np.hypot(length - muscle.tendon_slack_length, across)
        assert fiber / muscle.optimal_fiber_length == pytest.approx(line.at_zero, abs=1e-9)
        assert muscle.optimal_fiber_length == pytest.approx(0.01 * line.fiber)


def test_vasti_keep_to_the_part_of_the_curve_where_fibers_pull() -> None:
    """Lai et al. 2017: in a deep squat too they are no longer than 1.3 optimal lengths."""
    model, _ = generic_model({})
    motion = Motion(np.zeros(1), ("knee_angle_r",), np.radians([[120.0]]))
    lengths = muscle_kinematics(model, motion, velocities=False).muscle_length[0]
    for name in ("vasint_r", "vaslat_r", "vasmed_r"):
        muscle = model.muscle(name)
        across = muscle.optimal_fiber_length * np.sin(muscle.pennation_at_optimal)
        fiber = np.hypot(
            lengths[model.muscle_names.index(name)] - muscle.tendon_slack_length, across
        )
        assert 1.0 < fiber / muscle.optimal_fiber_length < 1.3


def test_strength_grows_with_the_body() -> None:
    assert strength_of(75.0, 1.70) == pytest.approx(1.0)
    assert strength_of(30.0, 1.30) < 0.7
    adult = generic_model({}, None, None)[0]
    child = generic_model({}, 1.30, 30.0)[0]
    ratio = (
        child.muscle("soleus_r").max_isometric_force / adult.muscle("soleus_r").max_isometric_force
    )
    assert ratio == pytest.approx(strength_of(30.0, 1.30))


def test_a_muscle_that_the_table_lacks_is_named() -> None:
    model, _ = generic_model({})
    odd = replace(
        model, muscles=(replace(model.muscles[0], name="popliteus_r"), *model.muscles[1:])
    )
    with pytest.raises(BadData, match="'popliteus_r' is not in the table"):
        with_architecture(odd)
