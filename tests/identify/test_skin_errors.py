"""Skin that carries markers: what it does to rows, against inverse kinematics of moved markers."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.body.identify.base_parameters import base_parameters, held_in
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.parts import parts_of
from myomorph.body.identify.skin_errors import skin_errors
from myomorph.core.io.formats import read_model
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.series import Markers, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.regressor import base_regressor, base_wrench, reference_points
from myomorph.core.rigid.tree import compile_tree

GAIT = "opensim-gait-subject01/ref_id"
SHIFT = 1e-3
MOVED = "femur_r"


@pytest.fixture(scope="module")
def walk(data):
    model = read_model(data(f"{GAIT}/subject01.osim"))
    table = read_sto(data(f"{GAIT}/subject01_walk1_ik.mot"))
    motion = differentiate(motion_from_table(table, model), 6.0)
    wrench = base_regressor(model, motion) @ inertial_parameters(model).ravel()
    wrenches = Wrenches(
        time=motion.time,
        names=("plate",),
        bodies=(model.body_names[0],),
        forces=wrench[:, None, 3:],
        points=reference_points(model, motion)[:, None],
        torques=wrench[:, None, :3],
    )
    return model, Recording(motion=motion, wrenches=wrenches)


def test_a_shift_of_a_thighs_markers_pulls_as_found(walk):
    """Markers of the right thigh moved by a millimeter in the body, and inverse kinematics anew."""
    model, recording = walk
    motion = recording.motion
    base = base_parameters(model, held=held_in(model, [motion]))
    parts = parts_of(model, [recording], base)
    off = wrench_found(model, recording, SHIFT) - wrench_found(model, recording, 0.0)
    rows = base_regressor(model, motion)[:, :, base.columns]
    expected = np.stack(
        [np.einsum("fin,fi->n", rows[:, part], off[:, part]) for part in (np.s_[:3], np.s_[3:])]
    )
    own = sum(marker.body == MOVED for marker in model.markers)
    sd = SHIFT * np.sqrt(3.0) / np.sqrt(0.5 + 0.5 / own)
    pulls = skin_errors(model, [recording], parts, sd).pulls.sum(axis=0)
    # One of the patterns is that shift: along y, constant.
    away = np.linalg.norm((pulls - expected[..., None]), axis=1).sum(axis=0)
    assert away.min() < 0.2 * np.linalg.norm(expected, axis=1).sum()


def wrench_found(model, recording, shift):
    """Find the wrench that masses must explain after inverse kinematics of shifted markers."""
    motion = recording.motion
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    places = poses.markers(model.markers)
    own = [i for i, marker in enumerate(model.markers) if marker.body == MOVED]
    places[:, own] += shift * poses.rotations[:, tree.body_index[MOVED], :, 1][:, None]
    names = tuple(marker.name for marker in model.markers)
    moved = differentiate(
        inverse_kinematics(model, Markers(motion.time, names, places)).motion, 6.0
    )
    needed = base_regressor(model, moved) @ inertial_parameters(model).ravel()
    return needed - base_wrench(model, moved, recording.wrenches)


def test_a_model_without_markers_has_none(walk):
    model, recording = walk
    base = base_parameters(model, held=held_in(model, [recording.motion]))
    parts = parts_of(model, [recording], base)
    bare = model.with_markers(())
    assert skin_errors(bare, [recording], parts, 0.006).pulls.shape[3] == 0
