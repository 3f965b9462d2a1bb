"""The embedded jump.

Real values must come out of the recording, and assumed values must be consistent.
"""

import importlib.util
from itertools import pairwise

import numpy as np
import pytest

from myomorph.core.model.errors import MissingPackage
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.motion.sync import cut, resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import center_of_mass, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.show.simulate import jump as jump_recording
from myomorph.show.simulate.jump import (
    LEG_MARKERS,
    QUIET,
    SHOULDER,
    WINDOW,
    jump_study,
    mirrored_name,
)


@pytest.fixture(scope="module")
def study():
    pytest.importorskip("biomdp")
    pytest.importorskip("myo_sim")
    return jump_study()


@pytest.fixture(scope="module")
def fit(study):
    options = InverseKinematicsOptions(marker_weights=study.marker_weights)
    return inverse_kinematics(study.model, cut(study.markers, QUIET[0], WINDOW[1]), options)


def test_the_jumper_stands_on_the_plate_with_the_models_mass(study):
    assert 76.0 < study.mass < 77.5
    assert study.model.mass == pytest.approx(study.mass)
    clock = study.trial.plate_time
    plate = study.trial.plates[0]
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    assert study.wrenches.forces[still].sum(axis=1)[:, 1].mean() == pytest.approx(
        plate.forces[still, 1].mean(), rel=0.002
    )


def test_ground_is_forward_up_right(study):
    np.testing.assert_allclose(study.model.gravity, [0.0, -9.81, 0.0], atol=1e-3)
    still = cut(study.trial.markers, *QUIET)
    forward = (still["LASI"] + still["RASI"] - still["LPSI"] - still["RPSI"]).mean(axis=0)
    right = (still["RASI"] - still["LASI"]).mean(axis=0)
    assert np.argmax(np.abs(forward)) == 0
    assert forward[0] > 0
    assert np.argmax(np.abs(right)) == 2
    assert right[2] > 0


def test_phases_of_the_jump(study):
    times = {event.label: event.time for event in study.events}
    assert list(times) == ["Start", "Lowest", "Take-off", "Landing", "Peak"]
    assert list(times.values()) == sorted(times.values())
    assert 0.6 < times["Landing"] - times["Take-off"] < 0.7
    assert study.trial.plates[0].forces[:, 1].max() == pytest.approx(6281.6, abs=20.0)


def test_the_model_is_as_long_as_the_jumper(study, fit):
    """Recorded joint centers lie where the posed model has them in quiet standing."""
    tree = compile_tree(study.model)
    motion = cut(fit.motion, *QUIET)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    still = cut(study.trial.markers, *QUIET)
    for marker, body in (("RHJC", "femur_r"), ("RKJC", "tibia_r"), ("RAJC", "talus_r")):
        place = poses.origins[:, tree.body_index[body]].mean(axis=0)
        assert np.linalg.norm(place - still[marker].mean(axis=0)) < 0.01


def test_markers_are_followed(study, fit):
    assert fit.converged.all()
    recorded = [i for i, name in enumerate(fit.marker_names) if "mirrored" not in name]
    rms = np.sqrt((fit.marker_error[:, recorded] ** 2).mean(axis=1))
    assert rms[fit.motion.time <= QUIET[1]].max() < 0.004
    assert rms.max() < 0.02
    # The shoulder moves on a trunk that neither bends sideways nor twists.
    on_bones = [i for i in recorded if fit.marker_names[i] != SHOULDER]
    assert fit.marker_error[:, on_bones].max() < 0.04


def test_quiet_standing_is_in_balance(study, fit):
    """Gravity, plate and motion leave nearly nothing for the pelvis.

    The center of mass is over the plate's center.
    """
    motion = cut(differentiate(fit.motion, study.cutoff), 2.0, 3.0)
    wrenches = resample_wrenches(study.wrenches, motion.time, study.cutoff)
    torques = inverse_dynamics(study.model, motion, wrenches)
    weight = study.mass * 9.81
    for name in ("pelvis_tx", "pelvis_ty", "pelvis_tz"):
        assert np.abs(torques[name]).max() < 0.05 * weight
    for name in ("pelvis_tilt", "pelvis_list", "pelvis_rotation"):
        assert np.abs(torques[name]).max() < 0.02 * weight
    tree = compile_tree(study.model)
    center = center_of_mass(tree, forward_kinematics(tree, tree.coordinates_of(motion)))
    assert np.abs(center[:, 0] - wrenches.points[:, 0, 0]).mean() < 0.02


def test_the_plate_confirms_equal_shares(study):
    clock = study.trial.plate_time
    still = (clock >= QUIET[0]) & (clock <= QUIET[1])
    assert study.share[still].mean() == pytest.approx(0.5, abs=0.03)


def test_mirror_images_keep_their_distances(study):
    names = list(LEG_MARKERS)
    for one, other in pairwise(names):
        right = np.linalg.norm(study.markers[one] - study.markers[other], axis=1)
        left = np.linalg.norm(
            study.markers[mirrored_name(one)] - study.markers[mirrored_name(other)], axis=1
        )
        np.testing.assert_allclose(left, right, atol=1e-12)


def test_the_left_foot_stands_where_the_right_one_does(study):
    for name in ("Right_TalonInf", "Right_Meta"):
        np.testing.assert_allclose(
            study.markers[mirrored_name(name)][:, 1], study.markers[name][:, 1], atol=1e-12
        )


def test_muscles_and_signals(study):
    assert len(study.model.muscles) == 86
    assert len(study.analog.names) == 6
    assert set(study.analog.units) == {"V"}
    assert study.analog.rate == pytest.approx(2000.0)


def test_what_is_assumed_is_said(study):
    said = " ".join(study.assumed)
    for word in ("one plate", "half", "mirror", "scaled", "arms", "EMG"):
        assert word in said
    assert all(text.endswith(".") for text in (*study.real, *study.assumed))


def test_a_missing_package_is_named(monkeypatch):
    monkeypatch.setattr(importlib.util, "find_spec", lambda name: None)
    with pytest.raises(MissingPackage, match=r"biomdp.*myomorph\[demo\]"):
        jump_recording.recording_path()
