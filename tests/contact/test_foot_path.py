"""Where the feet have carried a body whose place nothing shows."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

import myomorph as mm
from myomorph.core.contact.site_motion import OnlineFootPath, root_places, walked
from myomorph.core.rigid.tree import compile_tree

HOME = "rajagopal-walk-emg"


@pytest.fixture(scope="module")
def walk(data):
    """Return a recorded walk of two steps, and its model."""
    model = mm.read_model(data(f"{HOME}/subject_walk_scaled.osim"))
    motion = mm.read_motion(data(f"{HOME}/coordinates.sto"), model)
    values = compile_tree(model).coordinates_of(motion)
    return model, mm.Motion(motion.time, model.coordinate_names, values)


def hidden(model, motion, place=(0.0, 0.0, 0.0)):
    """Return the motion with its root at one position."""
    values = np.array(motion.values)
    values[:, [motion.names.index(name) for name in root_places(model)]] = place
    return replace(motion, values=values)


def test_a_walk_comes_back(walk):
    model, motion = walk
    found = walked(model, hidden(model, motion))
    duration = motion.time[-1] - motion.time[0]
    for name, tolerance in (("pelvis_tx", 0.1), ("pelvis_tz", 0.1)):
        gone = found[name][-1] - found[name][0]
        true = motion[name][-1] - motion[name][0]
        assert gone == pytest.approx(true, abs=tolerance * duration), name
    height = found["pelvis_ty"] - motion["pelvis_ty"]
    assert np.std(height) < 0.012
    joints = [name for name in motion.names if name not in root_places(model)]
    assert all(np.array_equal(found[name], motion[name]) for name in joints)


def test_neither_place_nor_heading_change_the_walk(walk):
    model, motion = walk
    found = walked(model, hidden(model, motion))
    elsewhere = walked(model, hidden(model, motion, (3.0, -1.0, 2.0)))
    np.testing.assert_allclose(elsewhere.values, found.values, atol=1e-9)
    turned = hidden(model, motion)
    values = np.array(turned.values)
    angles = [turned.names.index(f"pelvis_{name}") for name in ("tilt", "list", "rotation")]
    across = Rotation.from_euler("y", 90.0, degrees=True) * Rotation.from_euler(
        "ZXY", values[:, angles]
    )
    values[:, angles] = across.as_euler("ZXY")
    found_across = walked(model, replace(turned, values=values))
    # About y, x goes to -z.
    np.testing.assert_allclose(found_across["pelvis_ty"], found["pelvis_ty"], atol=1e-6)
    gone = found["pelvis_tx"] - found["pelvis_tx"][0]
    np.testing.assert_allclose(
        found_across["pelvis_tz"][0] - found_across["pelvis_tz"], gone, atol=1e-6
    )


def test_gaps_stay_and_are_bridged(walk):
    model, motion = walk
    values = np.array(hidden(model, motion).values)
    values[60:70] = np.nan
    found = walked(model, replace(motion, values=values))
    assert np.isnan(found.values[60:70]).all()
    assert np.isfinite(np.delete(found.values, np.s_[60:70], axis=0)).all()
    whole = walked(model, hidden(model, motion))
    assert (
        abs(
            (found["pelvis_tx"][-1] - found["pelvis_tx"][0])
            - (whole["pelvis_tx"][-1] - whole["pelvis_tx"][0])
        )
        < 0.1
    )


def test_frame_by_frame_it_goes_as_far(walk):
    model, motion = walk
    path = OnlineFootPath(model)
    still = hidden(model, motion)
    column = motion.names.index("pelvis_tx")
    gone = np.array([path.placed(row)[column] for row in still.values])
    whole = walked(model, still)["pelvis_tx"]
    assert gone[-1] - gone[0] == pytest.approx(whole[-1] - whole[0], abs=0.1)
