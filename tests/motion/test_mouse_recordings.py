"""A real mouse through calibration, inverse kinematics and inverse dynamics.

Millimeters, strides, and a paw on a plate.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.lengths import length_unit
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.cycles import band
from truths.mouse_motion import (
    TRACKING,
    alone,
    held_out,
    lengths_of,
    motion_of,
    mouse,
    rms,
    strides_of,
)

NAME = "1R_12_01_26"
GAP = 10  # Frames at 200 Hz


@pytest.fixture(scope="module")
def folder(data):
    data("mouse-hindlimb-muscles/mouse_hindlimb.json")
    return data("mouse-gait-c3d-force").parent


def hidden_again_and_again(values, columns):
    """Frames of gaps of `GAP`, 25 apart, in and beside which all these markers were seen."""
    seen = np.isfinite(values[:, columns]).all(axis=(1, 2))
    frames = []
    frame = 20
    while frame < len(values) - GAP - 3:
        if seen[frame - 3 : frame + GAP + 3].all():
            frames += range(frame, frame + GAP)
            frame += GAP + 25
        else:
            frame += 1
    return np.array(frames)


def test_residuals_are_those_of_skin_on_a_mouse(folder):
    """About a millimetre on legs of 4 cm, in frames that the calibration saw and in others."""
    one = mouse(folder, NAME)
    assert 0.9 < one.calibration.size < 1.3
    assert rms(one.fit) < 1.3e-3 < 2e-3 < rms(one.generic)
    assert rms(one.fit, ("Right_Knee", "Left_Knee")) < 0.8e-3
    assert held_out(folder, NAME) < 1.6e-3
    assert one.fit.converged[one.shown].mean() > 0.99
    assert length_unit(compile_tree(one.model)) == pytest.approx(0.09, abs=0.02)


def test_what_is_not_shown_is_not_told(folder):
    one = mouse(folder, NAME)
    assert np.isnan(one.fit.motion.values[~one.shown]).all()
    inside = np.zeros(len(one.used), bool)
    for start, end in one.spans:
        inside |= (one.used.time >= start) & (one.used.time <= end)
    assert not one.shown[~inside].any()
    # Angles stay those of one turn through gaps and crossings.
    pitch = one.fit.motion["PelvisToGround_Rz"][one.shown]
    assert np.abs(pitch).max() < 1.2


def test_strides_of_a_trotting_mouse(folder):
    strides = strides_of(folder, NAME)
    assert strides.ground_speed == pytest.approx(0.0)
    for limb in ("Foot_r", "Foot_l"):
        own = strides.of(limb)
        assert len(own) >= 6
        assert np.median([one.duration for one in own]) == pytest.approx(0.28, abs=0.04)
        assert np.median([one.length for one in own]) == pytest.approx(0.078, abs=0.01)
    assert np.nanmedian(strides.phases["Foot_l"]) == pytest.approx(0.5, abs=0.1)


def test_muscles_lengthen_against_each_other(folder):
    """Hip flexors and hamstrings in turn, both sides alike."""
    analysis = lengths_of(folder, NAME)
    flexor = band(analysis.curves("ILI")).mean
    extensor = band(analysis.curves("SM")).mean
    assert np.corrcoef(flexor, extensor)[0, 1] < -0.8
    for name in ("ILI", "SM", "BFP_cranial"):
        assert (
            np.corrcoef(band(analysis.curves(name)).mean, band(analysis.curves(f"{name}_l")).mean)[
                0, 1
            ]
            > 0.9
        )
    assert len(analysis.ranges) == 84


def test_a_paw_that_is_alone_on_the_plate(folder):
    """Torques of force times lever, and muscles that give them."""
    found = alone(folder, NAME)
    assert found is not None
    assert found.side == "l"
    force = found.wrenches.forces[:, 0, 1]
    assert 0.02 < force.min() < force.max() < 0.2
    legs = 0.05
    for joint in ("Hip_flexion", "Knee_extension", "Ankle_flexion"):
        assert np.abs(found.torques[f"{joint}_l"]).max() < 0.2 * legs
    assert found.active.optimal.all()
    given = found.active.actuator_force[
        :, found.active.reserve_names.index("reserve_Ankle_flexion_l")
    ]
    # Reserves within a twentieth of the torque, as Hicks et al. 2015 ask of them.
    assert np.abs(given).max() < 0.05 * np.abs(found.torques["Ankle_flexion_l"]).max()
    assert motion_of(folder, NAME).accelerations is not None


@pytest.mark.parametrize("side", ["Left", "Right"])
def test_hidden_markers_are_nearer_with_gaps_bridged(folder, side):
    """Knee and ankle are hidden for 50 ms again and again.

    Where their markers were is nearer to the bridged pose than to the one of each frame by itself.
    """
    one = mouse(folder, NAME)
    columns = [one.used.names.index(f"{side}_{joint}") for joint in ("Knee", "Ankle")]
    hidden = hidden_again_and_again(one.used.values, columns)
    values = one.used.values.copy()
    values[np.ix_(hidden, columns)] = np.nan
    missed = {}
    for assumed in ("default", "upright"):
        fit = inverse_kinematics(
            one.model,
            replace(one.used, values=values),
            replace(TRACKING, untracked_coordinates=assumed),
        )
        tree = compile_tree(one.model)
        by_name = {marker.name: marker for marker in one.model.markers}
        markers = [by_name[one.used.names[column]] for column in columns]
        places = forward_kinematics(tree, fit.motion.values[hidden]).points(
            np.array([tree.body_number(marker.body) for marker in markers]),
            np.array([marker.location for marker in markers]),
        )
        apart = np.linalg.norm(places - one.used.values[np.ix_(hidden, columns)], axis=2)
        missed[assumed] = float(np.sqrt(np.nanmean(apart**2)))
    assert missed["upright"] < 0.7 * missed["default"]
