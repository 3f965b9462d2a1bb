"""Landmarks found by rules.

The same position on a bone that was rotated, moved, resized and smoothly deformed.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from myomorph.bones.morph.registration.alignment import automatic_landmarks
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity
from scans import ScanQuality, made_scan


def thorny() -> Surface:
    """Make a bone: an ellipsoid with thorns, of which none is another's mirror image."""
    mesh = trimesh.creation.icosphere(subdivisions=3)
    size = np.ones(len(mesh.vertices))
    for direction, height in (
        ((1, 0, 0.1), 0.3),
        ((-1, 0.1, 0), 0.4),
        ((0.4, 1, 0.3), 0.9),
        ((-0.3, -0.2, 1), 0.8),
    ):
        size += height * np.exp(
            60.0 * (mesh.vertices @ (np.array(direction) / np.linalg.norm(direction)) - 1.0)
        )
    return Surface(mesh.vertices * size[:, None] * [0.1, 0.04, 0.03], mesh.faces)


BONE = thorny()
THERE = Similarity(rotation_from_euler_xyz((0.4, -1.0, 2.2)), np.array([0.1, -0.5, 0.2]), 0.9)
LENGTH = float(np.linalg.norm(np.ptp(BONE.vertices, axis=0)))


def test_a_similarity_carries_them_over():
    found = automatic_landmarks(BONE, Surface(THERE.apply(BONE.vertices), BONE.faces), THERE)
    assert len(found) >= 3
    np.testing.assert_allclose(found.target, THERE.apply(found.source), atol=1e-9)
    assert len(set(found.names)) == len(found)


def test_they_do_not_depend_on_where_the_target_lies():
    """With the start turned along, they are the same points of the bone."""
    bent = BONE.vertices + 0.004 * np.sin(30.0 * BONE.vertices[:, [1, 2, 0]])
    here = automatic_landmarks(BONE, Surface(bent, BONE.faces), Similarity(np.eye(3), np.zeros(3)))
    there = automatic_landmarks(BONE, Surface(THERE.apply(bent), BONE.faces), THERE)
    assert here.names == there.names
    np.testing.assert_allclose(there.target, THERE.apply(here.target), atol=1e-6)


def test_they_follow_a_deformation_whose_truth_is_known():
    bend = lambda x: x + 0.03 * x[:, :1] * x[:, [1, 0, 0]] / 0.15  # noqa: E731
    found = automatic_landmarks(BONE, Surface(bend(BONE.vertices), BONE.faces))
    apart = np.linalg.norm(found.target - bend(found.source), axis=1)
    assert len(found) >= 3
    assert np.median(apart) < 0.01 * LENGTH
    assert apart.max() < 0.03 * LENGTH


def test_a_ball_has_no_ends():
    """Every direction ends flat, and every way of lying is as good: nothing is made up."""
    ball = trimesh.creation.icosphere(3, 0.03)
    surface = Surface(ball.vertices, ball.faces)
    found = automatic_landmarks(surface, surface, Similarity(np.eye(3), np.zeros(3)), rounds=False)
    assert len(found) == 0
    with pytest.raises(BadData, match="landmarks cannot be found by rules"):
        automatic_landmarks(surface, surface)


def test_head_and_ends_of_a_femur(data):
    """The scan is the same bone turned, 2 % smaller, with 0.3 mm of noise and another mesh."""
    femur = read_mesh(data("bones-opensim-rajagopal/Geometry/r_femur.vtp"))
    scan, back = made_scan(femur, quality=ScanQuality(refine=1))
    found = automatic_landmarks(femur, scan)
    apart = np.linalg.norm(back.apply(found.target) - found.source, axis=1)
    assert len(found) >= 5
    assert apart.max() < 4e-3
    heads = [k for k, name in enumerate(found.names) if name.startswith("head")]
    nearest = min(np.linalg.norm(found.source[k]) for k in heads)
    assert nearest < 1e-3
