"""Spheres and cylinders: laws, made surfaces with noise and little cover.

Also heads and sockets of real bones.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.bones.morph.shapes.articular import (
    ExpectedCylinder,
    articular_cylinder,
    articular_sphere,
    spherical_patches,
    warning_of,
)
from myomorph.bones.morph.shapes.quadrics import _bent, fit_cylinder, fit_sphere
from myomorph.core.io.landmarks import read_landmarks
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface

CENTER = np.array([0.3, -0.2, 0.9])
AXIS = np.array([2.0, 9.0, -4.0]) / np.sqrt(101.0)
ONES = np.ones(600)


def _on_sphere(share: float, count: int = 600, seed: int = 0) -> np.ndarray:
    """Directions (n, 3) spread over a cap with that share of the sphere."""
    random = np.random.default_rng(seed)
    height = 1.0 - 2.0 * share * random.random(count)
    angle = 2.0 * np.pi * random.random(count)
    level = np.sqrt(1.0 - height**2)
    return np.stack([level * np.cos(angle), level * np.sin(angle), height], axis=1)


def _around_axis(turn: float, count: int = 600, seed: int = 0) -> tuple[np.ndarray, np.ndarray]:
    """Directions (n, 3) across the axis over a share of the turn, and places along it."""
    random = np.random.default_rng(seed)
    across = np.linalg.svd(AXIS[None])[2][1:]
    angle = 2.0 * np.pi * turn * random.random(count)
    direction = np.outer(np.cos(angle), across[0]) + np.outer(np.sin(angle), across[1])
    return direction, 0.04 * random.random(count) - 0.02


def _ball(radius: float, center: np.ndarray, rings: int = 24) -> Surface:
    """Make a closed sphere."""
    heights = np.linspace(0, np.pi, rings)
    angles = np.linspace(0, 2 * np.pi, 2 * rings, endpoint=False)
    grid = np.stack(
        [
            np.outer(np.sin(heights), np.cos(angles)),
            np.outer(np.sin(heights), np.sin(angles)),
            np.outer(np.cos(heights), np.ones(len(angles))),
        ],
        axis=-1,
    )
    number = np.arange(grid[..., 0].size).reshape(grid.shape[:2])
    a = number[:-1]
    b = number[1:]
    right = np.roll(a, -1, axis=1)
    far = np.roll(b, -1, axis=1)
    faces = np.concatenate(
        [np.stack([a, b, right], -1).reshape(-1, 3), np.stack([right, b, far], -1).reshape(-1, 3)]
    )
    return Surface(center + radius * grid.reshape(-1, 3), faces)


@pytest.mark.parametrize("share", [1.0, 0.4, 0.1])
def test_a_sphere_is_recovered_exactly(share):
    direction = _on_sphere(share)
    found = fit_sphere(CENTER + 0.023 * direction, direction, ONES)
    np.testing.assert_allclose(found.center, CENTER, atol=1e-9)
    assert found.radius == pytest.approx(0.023, abs=1e-9)
    assert found.rms < 1e-10
    assert not found.hollow


def test_spheres_do_not_depend_on_frame_or_size():
    random = np.random.default_rng(3)
    looks = _on_sphere(0.3)
    points = 0.02 * looks + 3e-4 * random.normal(size=(600, 3))
    turn = rotation_from_euler_xyz((0.4, -1.0, 2.2))
    shift = np.array([3.0, -5.0, 0.7])
    area = np.full(600, 2e-6)
    one = fit_sphere(points, looks, area)
    other = fit_sphere(0.1 * points @ turn.T + shift, looks @ turn.T, 0.01 * area)
    np.testing.assert_allclose(other.center, 0.1 * turn @ one.center + shift, atol=1e-9)
    assert other.radius == pytest.approx(0.1 * one.radius, rel=1e-6)
    np.testing.assert_allclose(
        other.covariance, 0.01 * turn @ one.covariance @ turn.T, rtol=1e-4, atol=1e-15
    )


@pytest.mark.parametrize(("share", "within"), [(0.6, 1.0e-4), (0.3, 2.5e-4), (0.15, 6e-4)])
def test_a_sphere_with_noise_and_wrong_points(share, within):
    """A third of a millimeter of noise, a seventh of the points elsewhere.

    Normals are off by 8 degrees.
    """
    for seed in range(10):
        random = np.random.default_rng(seed)
        direction = _on_sphere(share, seed=seed)
        points = CENTER + direction * (0.023 + 3e-4 * random.normal(size=600))[:, None]
        points[::7] += 0.008 * random.normal(size=points[::7].shape)
        looks = direction + 0.15 * random.normal(size=(600, 3))
        looks /= np.linalg.norm(looks, axis=1)[:, None]
        area = np.full(600, 4 * np.pi * 0.023**2 * share / 600)
        found = fit_sphere(points, looks, area)
        assert np.linalg.norm(found.center - CENTER) < min(within, 4 * found.deviation)
        assert found.coverage == pytest.approx(share, rel=0.2)
        assert found.rms == pytest.approx(3e-4, rel=0.2)


@pytest.mark.parametrize(
    ("radii", "bent"), [((1.0, 1.0, 1.0), 1.0), ((1.0, 2.0, 4.0), 0.25), ((1.0, -1.0, 2.0), 0.0)]
)
def test_how_bent_normals_say_a_surface_is_does_not_depend_on_where_it_is(radii, bent):
    """Normals that are a linear map of positions, of one over the radii.

    The result is the direction of least curvature, or none for a saddle.
    """
    places = _on_sphere(0.6)
    for shift in (np.zeros(3), np.array([4.0, -7.0, 2.0])):
        assert _bent(places + shift, places / radii, np.ones(len(places))) == pytest.approx(
            bent, abs=1e-6
        )


@pytest.mark.parametrize(
    "weights", [np.ones(7), np.ones((600, 1)), np.zeros(600), -np.ones(600), np.full(600, np.nan)]
)
def test_weights_that_are_none_are_refused(weights):
    with pytest.raises(BadData, match="weights that are not negative"):
        fit_sphere(_on_sphere(0.4), _on_sphere(0.4), weights)


def test_a_socket_is_told_from_a_head():
    direction = _on_sphere(0.4)
    assert fit_sphere(CENTER + direction, -direction, ONES).hollow
    assert not fit_sphere(CENTER + direction, direction, ONES).hollow


@pytest.mark.parametrize("turn", [1.0, 0.5, 0.2])
def test_a_cylinder_is_recovered_exactly(turn):
    direction, along = _around_axis(turn)
    points = CENTER + np.outer(along, AXIS) + 0.02 * direction
    found = fit_cylinder(points, direction, ONES, AXIS + [0.1, 0.0, 0.1])
    assert abs(found.axis @ AXIS) == pytest.approx(1.0, abs=1e-12)
    beside = found.point - CENTER
    np.testing.assert_allclose(beside - beside @ AXIS * AXIS, 0.0, atol=1e-9)
    assert found.radius == pytest.approx(0.02, abs=1e-9)
    assert found.length == pytest.approx(np.ptp(along), abs=1e-9)


@pytest.mark.parametrize(("turn", "off"), [(0.35, 4e-4), (0.2, 1.5e-3)])
def test_a_cylinder_with_noise_and_wrong_points(turn, off):
    for seed in range(50):
        random = np.random.default_rng(seed)
        direction, along = _around_axis(turn, seed=seed)
        points = (
            CENTER
            + np.outer(along, AXIS)
            + direction * (0.02 + 3e-4 * random.normal(size=600))[:, None]
        )
        points[::7] += 0.008 * random.normal(size=points[::7].shape)
        found = fit_cylinder(points, direction, ONES, AXIS)
        beside = found.point - CENTER
        assert np.linalg.norm(beside - beside @ AXIS * AXIS) < off
        assert np.arccos(min(1.0, abs(found.axis @ AXIS))) < np.radians(1.0)


@pytest.mark.parametrize("axis", [(), ([0.0, 0.0, 1.0],)])
def test_what_determines_nothing_is_refused(axis):
    def fit(points):
        looks = np.tile([0.0, 0.0, 1.0], (len(points), 1))
        return (fit_cylinder if axis else fit_sphere)(points, looks, np.ones(len(points)), *axis)

    random = np.random.default_rng(0)
    flat = random.random((50, 3)) * [1.0, 1.0, 0.0]
    with pytest.raises(BadData, match="do not determine a"):
        fit(flat)
    with pytest.raises(BadData, match=r"points \(n, 3\) or more"):
        fit(flat[:3])
    with pytest.raises(BadData, match="distinct points"):
        fit(np.ones((20, 3)))
    with pytest.raises(BadData, match="finite"):
        fit(np.full((20, 3), np.nan))


def test_a_head_is_found_from_a_rough_start():
    """A ball on a shaft: the shaft and the neck do not count."""
    shaft = _ball(0.01, np.zeros(3))
    shaft = Surface(shaft.vertices * [1.0, 1.0, 20.0] - [0.0, 0.0, 0.22], shaft.faces)
    head = _ball(0.024, np.array([0.01, 0.0, 0.0]))
    bone = Surface(
        np.concatenate([shaft.vertices, head.vertices]),
        np.concatenate([shaft.faces, head.faces + len(shaft.vertices)]),
    )
    for shift in 0.006 * np.vstack([np.eye(3), -np.eye(3)]):
        found = articular_sphere(bone, np.array([0.01, 0.0, 0.0]) + shift, 0.02)
        np.testing.assert_allclose(found.center, [0.01, 0.0, 0.0], atol=1e-5)
        assert found.radius == pytest.approx(0.024, rel=1e-3)
        assert warning_of(found) == ""
    best = spherical_patches(bone)[0]
    np.testing.assert_allclose(best.center, [0.01, 0.0, 0.0], atol=1e-4)


def test_a_shaft_is_no_sphere():
    """A short stretch of a cylinder lies near a sphere, but bends one way only."""
    direction, along = _around_axis(1.0)
    found = fit_sphere(np.outer(0.4 * along, AXIS) + 0.02 * direction, direction, ONES)
    assert found.rms < 0.05 * found.radius
    assert "as a shaft is" in warning_of(found)
    assert fit_sphere(0.02 * _on_sphere(0.2), _on_sphere(0.2), ONES).bent == pytest.approx(1.0)


def test_where_nothing_is_round_it_is_said():
    box = Surface(
        [[x, y, z] for x in (0, 1) for y in (0, 1) for z in (0, 1)],
        [
            [0, 1, 3],
            [0, 3, 2],
            [4, 6, 7],
            [4, 7, 5],
            [0, 4, 5],
            [0, 5, 1],
            [2, 3, 7],
            [2, 7, 6],
            [0, 2, 6],
            [0, 6, 4],
        ],
    )
    with pytest.raises(BadData, match=r"vertices of the surface are round|do not determine"):
        articular_sphere(box, [0.5, 0.5, 0.5], 0.5)
    with pytest.raises(BadData, match="no part of the surface lies within"):
        articular_sphere(box, [9.0, 9.0, 9.0], 0.5)
    with pytest.raises(BadData, match="no cylinder was found near"):
        articular_cylinder(box, ExpectedCylinder([0.5, 0.5, 0.5], [0, 0, 1], 0.4))
    assert spherical_patches(box) == ()


def test_the_head_of_a_femur_is_the_origin_of_its_body(data):
    """OpenSim puts a femur's origin at the center of the hip."""
    femur = read_mesh(data("bones-opensim-rajagopal/Geometry/r_femur.vtp"))
    found = articular_sphere(femur, [0.005, -0.004, 0.006], 0.02)
    assert np.linalg.norm(found.center) < 1e-3
    assert 0.022 < found.radius < 0.025
    head = spherical_patches(femur)[0]
    np.testing.assert_allclose(head.center, found.center, atol=1e-4)


def test_the_head_of_a_femur_where_an_anatomist_put_it(data):
    femur = read_mesh(data("bones-landmarks-leg/Geometry/femur_r.obj"))
    marks = read_landmarks(data("bones-landmarks-leg/Geometry/femur_r.landmarks.csv"))
    head = spherical_patches(femur)[0]
    assert np.linalg.norm(head.center - marks["femur_r_head_center"]) < 1e-3


def meters(path) -> Surface:
    surface = read_mesh(path)
    return Surface(1e-3 * surface.vertices, surface.faces)


@pytest.mark.long
def test_head_and_socket_of_a_hip_share_their_center(data):
    """Of the man in MRI, where both bones are in one frame.

    Only cartilage and the segmentation are between them.
    """
    head = spherical_patches(meters(data("bones-mri-two-adults/ICL_MRI/femur_r.ply")))[0]
    pelvis = meters(data("bones-mri-two-adults/ICL_MRI/pelvis_no_sacrum.ply"))
    socket = articular_sphere(pelvis, head.center, 1.15 * head.radius, hollow=True)
    assert np.linalg.norm(head.center - socket.center) < 2.5e-3
    assert head.radius < socket.radius < 1.3 * head.radius


@pytest.mark.long
def test_the_trochlea_of_a_talus_is_a_cylinder(data):
    """From starts off by 2 mm, 5 degrees and a tenth of the radius it is the same."""
    talus = meters(data("bones-mri-two-adults/ICL_MRI/talus_r.ply"))
    start = ExpectedCylinder(talus.vertices.mean(axis=0), [1.0, -0.4, 0.0], 0.022)
    first = articular_cylinder(talus, start)
    assert warning_of(first) == ""
    assert first.rms < 0.03 * first.radius
    for shift in (np.array([0.0, 0.002, 0.0]), np.array([0.001, 0.0, -0.0017])):
        turned = first.axis + 0.087 * np.cross(first.axis, shift / np.linalg.norm(shift))
        near = ExpectedCylinder(first.point + shift, turned, 1.1 * first.radius)
        again = articular_cylinder(talus, near)
        assert abs(again.axis @ first.axis) > np.cos(np.radians(1.0))
        assert np.linalg.norm(np.cross(again.point - first.point, first.axis)) < 5e-4
        assert again.radius == pytest.approx(first.radius, rel=0.02)
