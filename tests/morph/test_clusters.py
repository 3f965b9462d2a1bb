"""Balls of marker clusters in a scan: apart, grown together, noisy, half visible.

Also which marker each of them is.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.clusters import find_balls, fit_ball, name_cluster, surface_parts
from scans import ball, cluster, grown_together, joined

CENTERS = np.array([[0.0, 0.0, 0.0], [0.03, 0.005, 0.0], [0.01, 0.025, 0.0]])
NAMES = ("hum1", "hum2", "hum3")
DISTANCES = np.linalg.norm(CENTERS[:, None] - CENTERS[None], axis=2)


def _nearest(balls) -> np.ndarray:
    """Centers of balls in the order of CENTERS."""
    found = np.array([one.center for one in balls])
    return found[[int(np.argmin(np.linalg.norm(found - center, axis=1))) for center in CENTERS]]


def test_a_sphere_comes_back_exactly_and_outliers_do_not_pull():
    random = np.random.default_rng(0)
    points = random.normal(size=(300, 3))
    points = 0.0045 * points / np.linalg.norm(points, axis=1, keepdims=True) + [1.0, 2.0, 3.0]
    found = fit_ball(points)
    np.testing.assert_allclose(found.center, [1, 2, 3], atol=1e-12)
    assert found.radius == pytest.approx(0.0045, abs=1e-12)
    assert found.covered > 0.95
    strayed = np.concatenate(
        [points, np.array([1.006, 2.0, 3.0]) + 0.0005 * random.normal(size=(30, 3))]
    )
    np.testing.assert_allclose(fit_ball(strayed).center, [1, 2, 3], atol=2e-5)
    with pytest.raises(BadData, match="four points"):
        fit_ball(points[:3])


def test_half_a_ball_is_enough_and_says_how_much_is_seen():
    half = ball(np.zeros(3), 0.009, np.random.default_rng(0), 5e-5, lambda points: points[:, 2] > 0)
    used = np.unique(half.faces)
    found = fit_ball(half.vertices[used], 0.0045)
    np.testing.assert_allclose(found.center, 0, atol=5e-5)
    assert 0.4 < found.covered < 0.65


def test_parts_are_told_apart_even_where_every_corner_is_written_thrice():
    surface = cluster(CENTERS)
    torn = Surface(
        surface.vertices[surface.faces].reshape(-1, 3),
        np.arange(3 * len(surface.faces)).reshape(-1, 3),
    )
    assert sorted(len(part.faces) for part in surface_parts(torn)) == sorted(
        len(part.faces) for part in surface_parts(surface)
    )
    assert len(surface_parts(surface)) == 5


@pytest.mark.parametrize(("noise", "within"), [(0.0, 1e-6), (1e-4, 3e-5), (3e-4, 1e-4)])
def test_balls_that_stand_alone_are_found_beside_plate_and_pin(noise, within):
    turn = rotation_from_euler_xyz((0.3, -1.0, 2.0))
    shift = np.array([0.1, -0.2, 0.3])
    surface = cluster(CENTERS, noise=noise)
    found = find_balls(Surface(surface.vertices @ turn.T + shift, surface.faces))
    assert len(found) == 3
    np.testing.assert_allclose(
        nearest_to(found, CENTERS @ turn.T + shift), CENTERS @ turn.T + shift, atol=within
    )


def nearest_to(balls, wanted):
    found = np.array([one.center for one in balls])
    return found[[int(np.argmin(np.linalg.norm(found - center, axis=1))) for center in wanted]]


@pytest.mark.parametrize(("noise", "within"), [(0.0, 2e-5), (3e-4, 2.5e-4)])
def test_balls_that_have_grown_together_with_their_plate_are_found(noise, within):
    surface = grown_together(CENTERS)
    random = np.random.default_rng(0)
    rough = Surface(
        surface.vertices + noise * random.normal(size=surface.vertices.shape), surface.faces
    )
    assert len(surface_parts(surface)) == 1
    found = find_balls(rough)
    assert len(found) == 3
    np.testing.assert_allclose(_nearest(found), CENTERS, atol=within)


def test_balls_of_another_size_are_not_markers():
    assert not find_balls(cluster(CENTERS, diameter=0.014))
    assert len(find_balls(cluster(CENTERS, diameter=0.014), diameter=0.014)) == 3


def test_markers_are_named_by_their_distances():
    balls = find_balls(cluster(CENTERS[[2, 0, 1]]))
    found = name_cluster(balls, NAMES, DISTANCES)
    for name, center in zip(NAMES, CENTERS, strict=True):
        np.testing.assert_allclose(found.centers[name], center, atol=5e-5)
    assert found.misfit < 5e-5
    assert not found.notes


def test_markers_are_named_by_picked_points():
    balls = find_balls(cluster(CENTERS))
    picked = {name: center + 0.003 for name, center in zip(NAMES, CENTERS, strict=True)}
    found = name_cluster(balls, NAMES, None, picked)
    np.testing.assert_allclose(found.centers["hum2"], CENTERS[1], atol=5e-5)
    assert np.isnan(found.misfit)


def test_swapped_markers_are_named():
    balls = find_balls(cluster(CENTERS))
    swapped = {"hum1": CENTERS[1], "hum2": CENTERS[0], "hum3": CENTERS[2]}
    found = name_cluster(balls, NAMES, DISTANCES, swapped)
    assert "hum1, hum2 seem exchanged" in found.notes[0]


def test_what_cannot_be_told_apart_or_is_lacking_is_refused():
    balls = find_balls(cluster(CENTERS))
    with pytest.raises(BadData, match="nothing distinguishes the markers hum1, hum2, hum3"):
        name_cluster(balls, NAMES)
    with pytest.raises(BadData, match="2 markers were found in the cluster's surface, expected 3"):
        name_cluster(balls[:2], NAMES, DISTANCES)
    turns = 2 * np.pi * np.arange(3) / 3
    even = 0.02 * np.column_stack((np.cos(turns), np.sin(turns), np.zeros(3)))
    sides = np.linalg.norm(even[:, None] - even[None], axis=2)
    with pytest.raises(BadData, match="triangle of equal sides"):
        name_cluster(find_balls(cluster(even)), NAMES, sides)


def test_another_cluster_than_the_recordings_is_named():
    balls = find_balls(cluster(1.2 * CENTERS))
    assert "another cluster" in name_cluster(balls, NAMES, DISTANCES).notes[0]


def test_more_balls_than_markers_are_no_trouble():
    extra = joined(
        [cluster(CENTERS), ball(np.array([0.06, 0.06, 0.0]), 0.009, np.random.default_rng(3), 5e-5)]
    )
    found = name_cluster(find_balls(extra), NAMES, DISTANCES)
    np.testing.assert_allclose([found.centers[name] for name in NAMES], CENTERS, atol=5e-5)
