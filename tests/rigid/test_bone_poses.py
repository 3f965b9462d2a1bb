"""Poses of bones and paths of muscles are those that the computations use."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.model.model import Marker
from walker import model, motion


@pytest.fixture(scope="module")
def walker() -> mm.Model:
    return replace(model(), markers=(Marker("knee", "tibia_r", np.array([0.03, -0.1, 0.02])),))


def test_points_of_a_body_are_where_its_markers_are(walker: mm.Model) -> None:
    moving = motion(walker, 12)
    poses = mm.viewer.bone_poses(walker, moving)
    assert poses.bodies == ("ground", *walker.body_names)
    marker = walker.markers[0]
    points = poses.points(marker.body, marker.location[None])
    assert points == pytest.approx(mm.marker_positions(walker, moving).values)


def test_paths_are_as_long_as_their_muscles(walker: mm.Model) -> None:
    moving = motion(walker, 12)
    paths = mm.viewer.muscle_paths(walker, moving)
    lengths = mm.muscle_kinematics(walker, moving, velocities=False).muscle_length
    for index, name in enumerate(paths.muscles):
        line = paths.line(name)
        steps = np.linalg.norm(np.diff(line, axis=1), axis=2)
        assert np.nansum(steps, axis=1) == pytest.approx(lengths[:, index])


def test_where_a_coordinate_is_not_known_nothing_is(walker: mm.Model) -> None:
    moving = motion(walker, 4)
    values = np.array(moving.values)
    values[2, 0] = np.nan
    gap = replace(moving, values=values)
    assert np.isnan(mm.viewer.bone_poses(walker, gap).origins[2, 1:]).any()
    paths = mm.viewer.muscle_paths(walker, gap)
    assert np.isnan(paths.positions[2]).all()
    assert np.isfinite(paths.positions[3]).any()


def test_unknown_names_are_answered(walker: mm.Model) -> None:
    moving = motion(walker, 2)
    with pytest.raises(mm.UnknownName, match="body 'tibia'"):
        mm.viewer.bone_poses(walker, moving).points("tibia", np.zeros((1, 3)))
    with pytest.raises(mm.UnknownName, match="muscle 'soleus'"):
        mm.viewer.muscle_paths(walker, moving).line("soleus")
    assert mm.viewer.muscle_paths(replace(walker, muscles=()), moving).positions.shape == (2, 0, 3)
