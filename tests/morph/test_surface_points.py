"""Which side of a surface points lie on, beside sharp edges and corners too."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.surface_points import Boxes, Shape

SLOPE = np.tan(np.radians(8.0))


def wedge() -> Surface:
    """Make a wedge with an edge of 16 degrees along z, in small triangles."""
    ends = [(x, y, z) for z in (0.0, 1.0) for x, y in ((0.0, 0.0), (-1.0, SLOPE), (-1.0, -SLOPE))]
    mesh = trimesh.convex.convex_hull(np.array(ends)).subdivide().subdivide()
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def test_two_faces_back_to_back_have_no_side():
    """A box with a fin without thickness, and a membrane in it."""
    box = trimesh.creation.box((1.0, 1.0, 1.0)).subdivide()
    more = np.array([[0.5, 0.2, 0.2], [0.5, -0.2, 0.2], [0.9, 0.0, 0.2], [0.1, 0.0, 0.2]])
    n = len(box.vertices)
    fins = np.array([(0, 1, 2), (0, 2, 1), (0, 1, 3), (0, 3, 1)]) + n
    surface = Surface(np.vstack([box.vertices, more]), np.vstack([box.faces, fins]))
    points = np.random.default_rng(0).uniform((0.0, -0.3, 0.1), (1.0, 0.3, 0.3), (2000, 3))
    inside = points[:, 0] < 0.5
    np.testing.assert_array_equal(Shape(surface).signed(points) < 0.0, inside)


def test_what_a_box_and_a_ball_hold():
    """Of points all over their bounding box; the ball's triangles lie up to 1 % inside of it."""
    points = np.random.default_rng(1).uniform(-1.2, 1.2, (2000, 3))
    for mesh, far in (
        (trimesh.creation.box((2.0, 2.0, 2.0)), np.abs(points).max(axis=1)),
        (trimesh.creation.icosphere(subdivisions=3), np.linalg.norm(points, axis=1)),
    ):
        clear = np.abs(far - 1.0) > 0.01
        inside = Boxes(np.array(mesh.vertices), np.array(mesh.faces)).holds(points)
        np.testing.assert_array_equal(inside[clear], far[clear] < 1.0)
    assert not Boxes(np.array(mesh.vertices), np.array(mesh.faces)).holds(points[:0]).size


@pytest.mark.parametrize("apart", [False, True])
@pytest.mark.parametrize("inward", [False, True])
def test_points_beside_a_sharp_edge_are_outside(apart, inward):
    surface = wedge()
    if apart:  # as an STL file has them
        surface = Surface(
            surface.vertices[surface.faces].reshape(-1, 3),
            np.arange(surface.faces.size).reshape(-1, 3),
        )
    if inward:
        surface = Surface(surface.vertices, surface.faces[:, ::-1])
    x, y, z = np.random.default_rng(0).uniform((-0.2, -0.2, -0.2), (0.3, 0.2, 1.2), (4000, 3)).T
    inside = (x < 0.0) & (np.abs(y) < -x * SLOPE) & (z > 0.0) & (z < 1.0)
    assert inside.sum() > 50
    distances = Shape(surface).signed(np.column_stack([x, y, z]))
    np.testing.assert_array_equal(distances < 0.0, inside)
    beyond = (x > np.abs(y) * SLOPE) & (z > 0.0) & (z < 1.0)
    np.testing.assert_allclose(distances[beyond], np.hypot(x, y)[beyond], rtol=1e-9)
