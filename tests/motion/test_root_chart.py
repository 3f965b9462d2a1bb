"""A body that turns over: derivatives do not depend on the angles in which its root is written."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from scipy.spatial.transform import Rotation
from tests.motion.test_ik import walker

from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.root_chart import root_chart
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

ORDERS = {"steady": "XZY", "singular": "ZXY"}
AXES = dict(zip("XYZ", np.eye(3), strict=True))
TURNS = ("root_rx", "root_ry", "root_rz")


def _with_root(order: str):
    """Turn the root of the walker about axes in this order."""
    model = walker()
    root = model.joints[0]
    turning = [axis for axis in root.axes if axis.kind == "rotation"]
    names = [axis.coordinates[0] for axis in turning]
    others = [axis for axis in root.axes if axis.kind != "rotation"]
    changed = [
        replace(axis, vector=AXES[letter]) for axis, letter in zip(turning, order, strict=True)
    ]
    joints = (replace(root, axes=(*others, *changed)), *model.joints[1:])
    return replace(model, joints=joints), names


def _cartwheel(order: str, frames: int = 161):
    """Make a motion that turns over about x once, a little inclined, and bends a hip meanwhile."""
    model, names = _with_root(order)
    t = np.linspace(0.0, 1.6, frames)
    share = t / t[-1]
    whole = 2.0 * np.pi * (10 * share**3 - 15 * share**4 + 6 * share**5)
    lean = 0.09 * np.sin(3.0 * t + 0.4)
    turn = 0.08 * np.cos(2.0 * t)
    rotations = Rotation.from_euler("XZY", np.stack([whole, lean, turn], axis=1))
    angles = np.unwrap(rotations.as_euler(order), axis=0)
    values = np.tile(compile_tree(model).defaults, (frames, 1))
    for name, column in zip(names, angles.T, strict=True):
        values[:, model.coordinate_names.index(name)] = column
    values[:, model.coordinate_names.index("hip_z_r")] = 0.5 * np.sin(4.0 * t)
    values[:, model.coordinate_names.index("root_ty")] += 0.2 * np.sin(np.pi * share)
    return model, Motion(t, model.coordinate_names, values)


def _torques(model, motion, charted: bool):
    if charted:
        chart = root_chart(model, motion)
        motion = chart.back(differentiate(chart.motion, 6.0))
    else:
        motion = differentiate(motion, 6.0)
    return motion, inverse_dynamics(model, motion)


def test_torques_do_not_depend_on_how_the_root_is_written():
    found = {}
    for key, order in ORDERS.items():
        model, motion = _cartwheel(order)
        assert bool(root_chart(model, motion).pairs) == (key == "singular")
        found[key] = _torques(model, motion, charted=True)[1]["hip_z_r"]
    largest = np.abs(found["steady"]).max()
    np.testing.assert_allclose(found["singular"], found["steady"], atol=0.01 * largest)


def test_without_other_angles_they_do():
    found = {}
    for key, order in ORDERS.items():
        model, motion = _cartwheel(order)
        found[key] = _torques(model, motion, charted=False)[1]["hip_z_r"]
    assert np.abs(found["singular"] - found["steady"]).max() > np.abs(found["steady"]).max()


def test_the_pose_stays_and_rates_are_those_of_the_angles():
    model, motion = _cartwheel(ORDERS["singular"], frames=16001)
    chart = root_chart(model, motion)
    back = chart.back(differentiate(chart.motion, None))
    np.testing.assert_allclose(back.values, motion.values, atol=1e-9)
    rates = np.gradient(motion.values, motion.time, axis=0)
    inside = slice(5, -5)
    scale = np.abs(rates).max(axis=0)
    np.testing.assert_allclose(back.velocities[inside], rates[inside], atol=2e-3 * max(scale))
    changes = np.gradient(back.velocities, motion.time, axis=0)
    np.testing.assert_allclose(
        back.accelerations[inside], changes[inside], atol=5e-3 * np.abs(changes).max()
    )
    poses = forward_kinematics(compile_tree(model), back.values)
    same = forward_kinematics(compile_tree(model), motion.values)
    np.testing.assert_allclose(poses.rotations, same.rotations, atol=1e-9)


@pytest.mark.parametrize("frame", [0, 70])
def test_gaps_stay_gaps(frame):
    model, motion = _cartwheel(ORDERS["singular"])
    values = np.array(motion.values)
    values[frame : frame + 4] = np.nan
    gapped = replace(motion, values=values)
    chart = root_chart(model, gapped)
    assert np.isnan(chart.motion.values[frame : frame + 4]).all()
    assert np.isfinite(np.delete(chart.motion.values, np.s_[frame : frame + 4], axis=0)).all()


def test_an_upright_body_keeps_its_angles():
    model, motion = _cartwheel(ORDERS["steady"])
    chart = root_chart(model, motion)
    assert chart.motion is motion
    assert chart.back(motion) is motion
