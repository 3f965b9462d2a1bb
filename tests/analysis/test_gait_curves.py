"""Curves of clinical gait analysis.

Invariance under the direction of walking, and comparison with another program's curves.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.bones.morph.mirror.model import mirrored, mirrored_motion
from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.join import renamed_model
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.lab.analysis.gait_curves import ANGLES, KEYS, SIDES, WalkLoads, gait_curves
from myomorph.lab.analysis.gait_extremes import gait_extremes
from myomorph.lab.analysis.gait_parameters import gait_parameters
from myomorph.lab.analysis.walking import walking_strides


@pytest.fixture(scope="module")
def walk(data):
    home = data("opensim-gait-subject01") / "ref_id"
    model = read_model(home / "subject01.osim")
    motion = differentiate(
        motion_from_table(read_sto(home / "subject01_walk1_ik.mot"), model), cutoff=6.0
    )
    return model, motion


def turned(model, degrees):
    """Rotate the model's ground about its vertical."""
    a = np.radians(degrees)
    turn = np.array([[np.cos(a), 0.0, np.sin(a)], [0.0, 1.0, 0.0], [-np.sin(a), 0.0, np.cos(a)]])
    root = model.joints[0]
    frame = Transform(turn @ root.parent_frame.rotation, turn @ root.parent_frame.translation)
    return replace(model, joints=(replace(root, parent_frame=frame), *model.joints[1:]))


def curves_of(model, motion):
    strides = walking_strides(model, motion)
    return strides, gait_curves(model, motion, strides)


@pytest.mark.parametrize("degrees", [37.0, 90.0, -160.0])
def test_curves_do_not_know_which_way_the_laboratory_lies(walk, degrees):
    model, motion = walk
    strides, curves = curves_of(model, motion)
    other = gait_curves(
        turned(model, degrees), motion, walking_strides(turned(model, degrees), motion)
    )
    assert len(strides.strides) >= 2
    # On a belt the direction is found from the feet's own ways, whose outer tenth depends on the
    # axes.
    for side in SIDES:
        np.testing.assert_allclose(other.of(side), curves.of(side), atol=0.2)


def test_right_and_left_change_places_in_a_mirror(walk):
    model, motion = walk
    motion = Motion(motion.time, motion.names, motion.values)
    _, curves = curves_of(model, motion)
    image = mirrored(model)
    _, other = curves_of(image, mirrored_motion(image, motion))
    for side, opposite in (("right", "left"), ("left", "right")):
        np.testing.assert_allclose(
            other.mean(side)[:, :ANGLES], curves.mean(opposite)[:, :ANGLES], atol=0.3
        )


def test_angles_are_what_a_clinician_expects(walk):
    _, curves = curves_of(*walk)
    for side in SIDES:
        mean = dict(zip(KEYS, curves.mean(side).T, strict=True))
        percent = np.linspace(0.0, 100.0, 51)
        assert 45.0 < mean["knee_flexion"].max() < 80.0
        assert 65.0 < percent[mean["knee_flexion"].argmax()] < 80.0
        assert np.ptp(mean["hip_flexion"]) > 30.0
        assert 40.0 < percent[mean["hip_flexion"].argmin()] < 60.0
        # In stance the pelvis is up on the side that bears, and goes forward with the leg in swing.
        assert mean["pelvic_obliquity"][5:10].mean() > mean["pelvic_obliquity"][30:37].mean()
        assert mean["pelvic_rotation"][0] > mean["pelvic_rotation"][25]
        assert abs(mean["foot_progression"]).max() < 40.0


def test_parameters_of_a_walk_at_a_known_speed(walk):
    model, motion = walk
    table = gait_parameters(walking_strides(model, motion))
    for side in SIDES:
        value = {
            name: estimates[side].mean for name, estimates in table.items() if side in estimates
        }
        assert value["Walking speed"] == pytest.approx(
            value["Stride length"] / value["Stride time"], rel=0.05
        )
        assert 55.0 < value["Stance"] < 70.0
        assert 10.0 < value["Double support"] < 40.0
    steps = [table["Step length"][side].mean for side in SIDES]
    assert sum(steps) == pytest.approx(
        np.mean([table["Stride length"][side].mean for side in SIDES]), rel=0.1
    )


def test_a_model_without_the_names_of_the_field_has_none(walk):
    model, motion = walk
    other = renamed_model(model, lambda name: name.replace("knee_angle", "kn"))
    moved = Motion(
        motion.time, tuple(name.replace("knee_angle", "kn") for name in motion.names), motion.values
    )
    strides = walking_strides(other, moved)
    assert gait_curves(other, moved, strides) is None


def test_peaks_of_the_force_are_those_measured_between_samples(walk):
    """A spike of 4 ms, which no sample of the curve meets, is the largest value of its stride."""
    model, motion = walk
    strides = walking_strides(model, motion)
    time = np.arange(motion.time[0], motion.time[-1], 0.001)
    force = np.full((len(time), 2), 0.8 * model.weight)
    bodies = ("calcn_r", "calcn_l")
    # Half way between two of the 51 samples.
    spikes = {}
    for column, side in enumerate(SIDES):
        limb = next(name for name in strides.strikes if name.endswith(f"_{side[0]}"))
        stride = strides.of(limb)[0]
        at = stride.start + 0.11 * stride.duration
        force[:, column] += 0.9 * model.weight * np.exp(-(((time - at) / 0.002) ** 2))
        spikes[side] = force[:, column].max() / model.weight
    measured = Series(time, bodies, force)
    curves = gait_curves(model, motion, strides, WalkLoads(measured=measured))
    for side in SIDES:
        known = curves.peak_force[side]
        assert known[0] == pytest.approx(spikes[side], rel=1e-9)
        largest = gait_extremes(curves, side)["vertical_force", "largest"]
        assert largest.mean == pytest.approx(np.nanmean(known))
        assert curves.of(side)[0, :, KEYS.index("vertical_force")].max() < 0.9 * spikes[side]
