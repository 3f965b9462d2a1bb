"""Paths brought out of bones: made bones of known thickness, muscles with and without something that can be moved."""

import numpy as np
import pytest
import trimesh

from myomorph.model.functions import linear
from myomorph.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.model.paths import Muscle, Path, PathPoint, PathWrap, WrapObject
from myomorph.model.spatial import Transform
from myomorph.model.surface import Surface
from myomorph.morph.checks.clearance import Ground, clear_paths
from myomorph.morph.checks.moment_arms import compared_coordinates
from myomorph.morph.checks.warnings import CheckOptions
from myomorph.morph.maps.fields import BoneMap
from myomorph.morph.maps.linear import AffineMap, Similarity

LENGTH = 0.4
THIN, THICK = 0.02, 0.026


def shaft(radius):
    """A closed tube along z, from end to end `LENGTH` long."""
    made = trimesh.creation.cylinder(radius, LENGTH, sections=48).subdivide_loop(0)
    return Surface(made.vertices, made.faces)


def model(muscle, wraps=()):
    """One body on a pin about z that hardly turns."""
    body = Body("femur", 1.0, np.zeros(3), np.eye(3) * 0.01)
    pin = Joint(
        "pin", "PinJoint", "ground", "femur", Transform.identity(), Transform.identity(),
        (Axis("rotation", [0.0, 0.0, 1.0], linear(1.0, 0.0), ("q",)),), ("q",),
    )  # fmt: skip
    turn = Coordinate("q", range=(-0.1, 0.1))
    return Model("made", (body,), (pin,), (turn,), [0, -9.81, 0], muscles=(muscle,), wrap_objects=wraps)


def muscle(*places, wraps=()):
    points = tuple(PathPoint(f"P{i}", "femur", place) for i, place in enumerate(places))
    return Muscle("m", "Thelen2003Muscle", Path(points, wraps), 100.0, 0.1, 0.1)


def ground(one, thickness=THICK):
    same = AffineMap(np.eye(3), np.zeros(3))
    bone = BoneMap("femur", "femur", same, Similarity(np.eye(3), np.zeros(3)), "given", shaft(THIN), shaft(thickness))
    found = Ground.of(one, one, [bone], compared_coordinates(one, one), CheckOptions())
    assert found is not None
    return found


ALONG = ([0.03, 0.0, -0.15], [0.023, 0.0, 0.0], [0.03, 0.0, 0.15])


def test_a_via_point_comes_out_by_what_the_bone_is_thicker():
    one = model(muscle(*ALONG))
    found = clear_paths(one, one, ground(one))
    assert found.before["m"] == pytest.approx(THICK - 0.023 - CheckOptions().deeper * LENGTH, abs=3e-4)
    assert not found.after
    first, via, last = (point.location for point in found.model.muscle("m").path.points)
    np.testing.assert_array_equal([first, last], [ALONG[0], ALONG[2]])
    assert np.hypot(via[0], via[1]) > THICK - 2 * CheckOptions().deeper * LENGTH
    assert found.shifts["m", "P1"] == pytest.approx(np.linalg.norm(via - ALONG[1]))


def test_a_path_that_is_outside_stays_as_it_is():
    one = model(muscle([0.03, 0.0, -0.15], [0.028, 0.0, 0.0], [0.03, 0.0, 0.15]))
    found = clear_paths(one, one, ground(one))
    assert found.model is one
    assert not found.notes


def test_what_runs_through_the_source_may_run_through_the_target():
    one = model(muscle([0.03, 0.0, -0.15], [-0.03, 0.0, 0.15]))
    assert not clear_paths(one, one, ground(one, THIN)).before


def test_origin_and_insertion_stay_and_what_cannot_be_helped_is_told():
    one = model(muscle([0.022, 0.0, -0.15], [0.022, 0.0, 0.15]))
    found = clear_paths(one, one, ground(one))
    assert found.model is one
    assert found.after == found.before
    assert "1 muscles still do" in found.notes[0]


def test_a_wrap_object_grows_until_the_path_is_out():
    around = WrapObject("shaft", "femur", "cylinder", Transform.identity(), (0.021, 1.0))
    across = ([0.03, -0.05, 0.0], [0.03, 0.05, 0.0])
    one = model(muscle(*across, wraps=(PathWrap("shaft"),)), (around,))
    hidden = model(muscle([0.0, -0.05, 0.0], [0.004, 0.05, 0.0], wraps=(PathWrap("shaft"),)), (around,))
    assert not clear_paths(one, one, ground(one)).before
    found = clear_paths(hidden, hidden, ground(hidden))
    assert found.before["m"] > 0.003
    assert not found.after
    assert found.grown["shaft"] == pytest.approx(THICK / 0.021, abs=0.05)


def test_a_via_point_is_not_moved_without_end():
    one = model(muscle(*ALONG))
    found = clear_paths(one, one, ground(one, 0.06))
    assert found.after
    assert max(found.shifts.values(), default=0.0) <= 0.04 * LENGTH + 1e-12
