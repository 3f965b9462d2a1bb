"""Bones that are matched without landmarks.

Exact affine copies, a smooth deformation, and how certain the match is.
"""

from __future__ import annotations

import numpy as np
import pytest
from benchmarks.accuracy.morph.correspondence import BEND, Deformation, bone, carried, deformed

from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.registration.affine import affine_ways, hull_moments, rotation_grid
from myomorph.bones.morph.transfer.body_transfer import Transfer
from myomorph.bones.morph.transfer.points import put_on_surface
from myomorph.core.surfaces.linear_maps import procrustes
from myomorph.core.surfaces.surface_points import Shape


class Exact:
    """A deformation as a map."""

    def __init__(self, change: Deformation):
        self.apply = change


@pytest.fixture(autouse=True)
def _needs_data(data):
    data("bones-opensim-rajagopal")
    data("rajagopal-walk-emg")


def test_moments_of_a_hull_follow_an_affine_map():
    points = np.random.default_rng(0).normal(size=(60, 3))
    matrix = np.array([[1.2, 0.3, 0.0], [-0.2, 0.7, 0.1], [0.0, 0.5, 1.5]])
    offset = np.array([3.0, -1.0, 2.0])
    middle, second = hull_moments(points)
    moved, grown = hull_moments(points @ matrix.T + offset)
    np.testing.assert_allclose(moved, matrix @ middle + offset, atol=1e-12)
    np.testing.assert_allclose(grown, matrix @ second @ matrix.T, atol=1e-12)
    cube = np.array(np.meshgrid(*[[0.0, 1.0]] * 3)).reshape(3, -1).T
    np.testing.assert_allclose(hull_moments(cube)[1], np.eye(3) / 12.0, atol=1e-12)


def test_no_rotation_is_far_from_the_grid():
    grid = rotation_grid(800)
    asked = rotation_grid(97)
    cosines = 0.5 * (np.einsum("aij,bij->ab", asked, grid) - 1.0)
    assert np.degrees(np.arccos(cosines.max(axis=1))).max() < 30.0


@pytest.mark.parametrize("body", ["tibia_r", "patella_r", "pelvis"])
def test_an_affine_copy_is_found_from_its_shape_alone(body):
    surface, points, _ = bone(body)
    change = Deformation(surface, 20, 0.0)
    size = 1.0 / change.length
    target = deformed(surface, change)
    ours = Shape(type(surface)(size * surface.vertices, surface.faces))
    goal = Shape(type(surface)(size * target.vertices, target.faces))
    best = affine_ways(ours, goal)[0]
    apart = best.affine.apply(size * points) / size - change(points)
    assert np.abs(apart).max() < 1e-4


def test_attachments_on_a_bent_bone_lie_within_their_intervals():
    surface, points, _ = bone("femur_r")
    change = Deformation(surface, 21, BEND)
    places, within = carried("femur_r", surface, deformed(surface, change), points)
    apart = np.linalg.norm(places - change(points), axis=1)
    assert np.median(apart) < 1e-3
    assert apart.max() < 4e-3
    assert np.mean(apart <= within) > 0.7
    assert np.median(apart) < np.median(within) < 3e-3


@pytest.mark.parametrize("body", ["tibia_r", "pelvis", "calcn_r"])
def test_where_the_map_is_right_no_point_is_moved(body):
    """Through the true deformation every point goes to its place, beside edges of the bone too."""
    surface, points, _ = bone(body)
    for seed in (20, 22, 24):
        change = Deformation(surface, seed, BEND)
        target = deformed(surface, change)
        whole = procrustes(surface.vertices, change(surface.vertices), True)
        true = BoneMap(
            body=body,
            target_body=body,
            map=Exact(change),
            whole=whole,
            basis="given",
            source=surface,
            target=target,
        )
        put = put_on_surface(Transfer(true, body), points, 0.02)
        # Flat triangles of the target are cut off from what they were bent from.
        assert np.linalg.norm(put.points - change(points), axis=1).max() < 0.003 * change.length


def test_a_shaft_slides_to_its_place():
    surface, points, _ = bone("tibia_r")
    change = Deformation(surface, 101, BEND)
    places, _ = carried("tibia_r", surface, deformed(surface, change), points)
    assert np.linalg.norm(places - change(points), axis=1).max() < 8e-3
