"""Inverse kinematics near a known motion.

On a recorded drop jump whose arms come near a singular pose.
"""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion
from myomorph.core.motion.ik import inverse_kinematics, poses_near
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.study.inputs.reading import read_motion
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.drawn_inputs import drawn_markers
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import Sources

HOME = "opencap-subject4-multitask"


@pytest.fixture(scope="module")
def jump(data: Callable[[str], Path]) -> tuple[Model, Motion, Markers]:
    model = read_model(data(f"{HOME}/models/manually_scaled.osim"))
    given = read_motion(data(f"{HOME}/ik_manual_scaling/DJ1_ik.mot"), model)
    tree = compile_tree(model)
    values = tree.coordinates_of(given)[50:110]
    motion = Motion(given.time[50:110], model.coordinate_names, values)
    bodies = np.array([tree.body_number(one.body) for one in model.markers], np.int64)
    places = forward_kinematics(tree, values).points(
        bodies, np.array([one.location for one in model.markers])
    )
    return model, motion, Markers(motion.time, model.marker_names, places)


def free(model: Model) -> list[int]:
    driven = {one.dependent for one in model.couplers}
    named = [
        (j, one)
        for j, one in enumerate(model.coordinates)
        if not one.locked and one.name not in driven
    ]
    return [j for j, one in named if not one.name.startswith(("pro_sup", "mtp"))]


def test_it_is_the_solution_of_inverse_kinematics(jump: tuple[Model, Motion, Markers]) -> None:
    """From the solution of the same markers nothing moves.

    From one nearby the same solution is found.
    """
    model, _, markers = jump
    found = inverse_kinematics(model, markers).motion
    np.testing.assert_allclose(poses_near(model, markers, found).values, found.values, atol=1e-5)
    off = Motion(found.time, found.names, found.values + 0.02)
    again = poses_near(model, markers, off).values
    np.testing.assert_allclose(again[:, free(model)], found.values[:, free(model)], atol=1e-4)


def test_angles_of_a_raised_arm_stay_near(jump: tuple[Model, Motion, Markers]) -> None:
    """Markers that move on skin: no draw ends in other angles of the same pose."""
    model, motion, markers = jump
    base = poses_near(model, markers, motion)
    normals = Normals(10)
    for number in range(10):
        moved = drawn_markers(model, markers, Draw(number, Sources(), normals), {})
        errors = poses_near(model, moved, base).values - base.values
        assert np.abs(errors[:, free(model)]).max() < 0.8


def test_hidden_frames_stay_unknown_and_other_times_are_refused(
    jump: tuple[Model, Motion, Markers],
) -> None:
    model, motion, markers = jump
    values = np.array(markers.values)
    values[4:6] = np.nan
    found = poses_near(model, Markers(markers.time, markers.names, values), motion).values
    assert np.isnan(found[4:6]).all()
    assert np.isfinite(found[[3, 6]]).all()
    with pytest.raises(BadData, match="same times"):
        poses_near(model, markers, Motion(motion.time + 0.5, motion.names, motion.values))
