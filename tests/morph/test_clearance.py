"""Paths moved out of bones.

Made bones of known thickness, muscles with and without something that can be moved.
"""

from dataclasses import replace

import numpy as np
import pytest
import trimesh

from myomorph.bones.morph.checks.clearance import clear_paths, cleared, watched_with, without_worse
from myomorph.bones.morph.checks.moment_arms import compared_coordinates
from myomorph.bones.morph.checks.path_changes import (
    ChangeCost,
    Ground,
    PathEnd,
    WayOut,
    least_move,
    path_changes,
    point_effect,
)
from myomorph.bones.morph.checks.penetration import range_poses
from myomorph.bones.morph.checks.warnings import CheckOptions
from myomorph.bones.morph.maps.fields import BoneMap
from myomorph.bones.morph.morphed import TransferredPoint
from myomorph.core.model.functions import linear
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint, PathWrap, WrapObject
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity

LENGTH = 0.4
THIN = 0.02
THICK = 0.026
STILL = Transform.identity()


def shaft(radius, size=1.0):
    """Make a closed tube along z, from end to end `LENGTH` long, times a size."""
    made = trimesh.creation.cylinder(radius, LENGTH * size, sections=48).subdivide_loop(0)
    return Surface(made.vertices, made.faces)


def model(muscle, wraps=(), pose=STILL):
    """One body on a pin about z that hardly turns; `pose` of the pin in ground."""
    body = Body(name="femur", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3) * 0.01)
    pin = Joint(
        name="pin",
        kind="PinJoint",
        parent="ground",
        child="femur",
        parent_frame=pose,
        child_frame=STILL,
        axes=(
            Axis(
                kind="rotation",
                vector=[0.0, 0.0, 1.0],
                function=linear(1.0, 0.0),
                coordinates=("q",),
            ),
        ),
        coordinates=("q",),
    )
    turn = Coordinate("q", range=(-0.1, 0.1))
    return Model(
        name="made",
        bodies=(body,),
        joints=(pin,),
        coordinates=(turn,),
        gravity=[0, -9.81, 0],
        muscles=(muscle,),
        wrap_objects=wraps,
    )


def muscle(*places, wraps=()):
    points = tuple(PathPoint(f"P{i}", "femur", place) for i, place in enumerate(places))
    return Muscle(
        name="m",
        kind="Thelen2003Muscle",
        path=Path(points, wraps),
        max_isometric_force=100.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.1,
    )


def bone_of(thickness=THICK, size=1.0):
    same = AffineMap(np.eye(3), np.zeros(3))
    whole = Similarity(np.eye(3), np.zeros(3))
    return BoneMap(
        body="femur",
        target_body="femur",
        map=same,
        whole=whole,
        basis="given",
        source=shaft(THIN * size, size),
        target=shaft(thickness, size),
    )


def ground(one, thickness=THICK, size=1.0):
    found = Ground.of(
        one, one, [bone_of(thickness, size)], compared_coordinates(one, one), CheckOptions()
    )
    assert found is not None
    return found


ALONG = ([0.03, 0.0, -0.15], [0.023, 0.0, 0.0], [0.03, 0.0, 0.15])


def test_a_via_point_comes_out_by_what_the_bone_is_thicker():
    one = model(muscle(*ALONG))
    found = clear_paths(one, ground(one))
    assert found.before["m"] == pytest.approx(
        THICK - 0.023 - CheckOptions().deeper * LENGTH, abs=3e-4
    )
    assert not found.after
    first_point, via_point, last_point = found.model.muscle("m").path.points
    first = first_point.location
    via = via_point.location
    last = last_point.location
    np.testing.assert_array_equal([first, last], [ALONG[0], ALONG[2]])
    assert np.hypot(via[0], via[1]) > THICK - 2 * CheckOptions().deeper * LENGTH
    assert found.shifts["m", "P1"] == pytest.approx(np.linalg.norm(via - ALONG[1]))


@pytest.mark.parametrize(
    ("within", "told"),
    [
        (0.01, None),
        (0.001, "by more than their intervals"),
        (np.nan, "where maps give no interval"),
    ],
)
def test_what_goes_further_than_its_interval_is_told(within, told):
    one = model(muscle(*ALONG))
    points = [
        TransferredPoint(
            owner="m",
            name=f"P{i}",
            body="femur",
            target_body="femur",
            source=at,
            target=at,
            within=within,
        )
        for i, at in enumerate(ALONG)
    ]
    _, after, notes = cleared(one, one, [bone_of()], points)
    assert [point.cleared > 0.0 for point in after] == [False, True, False]
    assert np.linalg.norm(after[1].target - ALONG[1]) == pytest.approx(after[1].cleared)
    assert len(notes) == (1 if told is None else 2)
    assert told is None or (told in notes[1] and "'m' (P1)" in notes[1])


def test_a_path_that_is_outside_stays_as_it_is():
    one = model(muscle([0.03, 0.0, -0.15], [0.028, 0.0, 0.0], [0.03, 0.0, 0.15]))
    found = clear_paths(one, ground(one))
    assert found.model is one
    assert not found.notes


def test_what_runs_through_the_source_may_run_through_the_target():
    one = model(muscle([0.03, 0.0, -0.15], [-0.03, 0.0, 0.15]))
    assert not clear_paths(one, ground(one, THIN)).before


def test_origin_and_insertion_stay_and_what_cannot_be_helped_is_told():
    one = model(muscle([0.022, 0.0, -0.15], [0.022, 0.0, 0.15]))
    found = clear_paths(one, ground(one))
    assert found.model is one
    assert found.after == found.before
    assert "1 muscles still do" in found.notes[0]


@pytest.mark.parametrize("length", [1.0, np.inf])
def test_a_wrap_object_grows_until_the_path_is_out(length):
    around = WrapObject(
        name="shaft", body="femur", kind="cylinder", pose=STILL, size=(0.021, length)
    )
    across = ([0.03, -0.05, 0.0], [0.03, 0.05, 0.0])
    one = model(muscle(*across, wraps=(PathWrap("shaft"),)), (around,))
    hidden = model(
        muscle([0.0, -0.05, 0.0], [0.004, 0.05, 0.0], wraps=(PathWrap("shaft"),)), (around,)
    )
    assert not clear_paths(one, ground(one)).before
    found = clear_paths(hidden, ground(hidden))
    assert found.before["m"] > 0.003
    assert not found.after
    assert found.model.wrap_objects[0].size[1] == length
    assert found.grown["shaft"] == pytest.approx(THICK / 0.021, abs=0.05)


def test_a_via_point_that_cannot_clear_the_bone_goes_back():
    one = model(muscle(*ALONG))
    found = clear_paths(one, ground(one, 0.06))
    assert not found.shifts
    assert found.model.muscle("m") == one.muscle("m")
    assert found.after == found.before


def test_a_via_point_is_not_moved_further_than_a_share_of_the_bone():
    one = model(muscle([0.06, 0.0, -0.15], [0.023, 0.0, 0.0], [0.06, 0.0, 0.15]))
    found = clear_paths(one, ground(one, 0.042))
    assert 0.0 < found.after["m"] < 0.5 * found.before["m"]
    assert found.shifts["m", "P1"] == pytest.approx(0.04 * LENGTH)


def test_a_wrap_object_grows_by_half_at_most():
    around = WrapObject(name="shaft", body="femur", kind="cylinder", pose=STILL, size=(0.02, 1.0))
    one = model(
        muscle([0.0, -0.08, 0.0], [0.004, 0.08, 0.0], wraps=(PathWrap("shaft"),)), (around,)
    )
    found = clear_paths(one, ground(one, 0.045))
    assert found.after
    assert found.grown["shaft"] == pytest.approx(1.5)


def test_a_deep_place_beside_a_via_point_moves_it_by_its_lever():
    """Deepest halfway between origin and via point, the via point moves twice as far."""
    one = model(muscle([0.03, 0.02, -0.15], [0.03, -0.03, 0.0], [0.03, -0.03, 0.15]))
    found = clear_paths(one, ground(one, 0.034))
    assert found.before["m"] > 0.001
    assert not found.after
    assert 2.0 * found.before["m"] < found.shifts["m", "P1"] < 5.0 * found.before["m"]
    assert found.model.muscle("m").path.points[1].location[0] > 0.03 + found.before["m"]


def arm(second):
    """Make a muscle from the ground over a via point of a body to a second body.

    Hinges rotate the bodies, the first along z.
    """
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3) * 0.01)
        for name in ("upper", "lower")
    )
    joints = tuple(
        Joint(
            name=child,
            kind="PinJoint",
            parent=parent,
            child=child,
            parent_frame=pose,
            child_frame=STILL,
            axes=(
                Axis(kind="rotation", vector=axis, function=linear(1.0, 0.0), coordinates=(child,)),
            ),
            coordinates=(child,),
        )
        for child, parent, pose, axis in (
            ("upper", "ground", STILL, [0.0, 0.0, 1.0]),
            ("lower", "upper", Transform(np.eye(3), np.array([0.0, -0.3, 0.0])), second),
        )
    )
    turns = tuple(Coordinate(name, range=(-0.8, 1.2)) for name in ("upper", "lower"))
    points = (
        PathPoint("from", "ground", [0.06, 0.05, 0.01]),
        PathPoint("via", "upper", [0.05, -0.15, 0.02]),
        PathPoint("to", "lower", [0.04, -0.05, 0.0]),
    )
    bent = Muscle(
        name="m",
        kind="Thelen2003Muscle",
        path=Path(points, ()),
        max_isometric_force=100.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.1,
    )
    return Model(
        name="arm",
        bodies=bodies,
        joints=joints,
        coordinates=turns,
        gravity=[0, -9.81, 0],
        muscles=(bent,),
    )


def posed(one):
    names = one.coordinate_names
    return range_poses(one, names, [np.linspace(-0.8, 1.2, 9)] * len(names))


def shifted(one, by):
    points = list(one.muscles[0].path.points)
    points[1] = replace(points[1], location=points[1].location + by)
    return replace(one, muscles=(replace(one.muscles[0], path=Path(tuple(points), ())),))


@pytest.mark.parametrize("second", [[0.0, 0.0, 1.0], [0.6, 0.0, 0.8]])
def test_effects_tell_what_a_small_move_changes(second):
    one = arm(second)
    poses = posed(one)
    by = np.array([3e-5, -2e-5, 5e-5])
    effect = point_effect(one, one.muscles[0], 1, poses) @ by
    change = path_changes(one, shifted(one, by), poses)["m"]
    assert np.linalg.norm(effect) == pytest.approx(np.hypot(change.length, change.arm), rel=0.01)
    assert change.length > 1e-7


def test_of_moves_as_far_out_the_one_found_changes_least():
    """With all weight on change, no other direction gets the point out with less change."""
    one = arm([0.6, 0.0, 0.8])
    out = np.array([0.6, 0.48, 0.64])
    poses = posed(one)
    ends = [PathEnd(0.8, 1)]
    moves = {
        weight: least_move(one, one.muscles[0], ends, WayOut(out, 1e-3), ChangeCost(poses, weight))
        for weight in (0.0, 10.0, 1e6)
    }
    for move in moves.values():
        assert out @ move.by == pytest.approx(1e-3 / 0.8)
    np.testing.assert_allclose(moves[0.0].by, 1e-3 / 0.8 * out, atol=1e-12)

    def changed(by):
        change = path_changes(one, shifted(one, by), poses)["m"]
        return np.hypot(change.length, change.arm)

    by_weight = [changed(move.by) for move in moves.values()]
    assert by_weight == sorted(by_weight, reverse=True)
    across = np.linalg.svd(out[None])[2][1:]
    for angle in np.linspace(0.0, 2.0 * np.pi, 7):
        other = moves[1e6].by + 2e-4 * (np.cos(angle) * across[0] + np.sin(angle) * across[1])
        assert changed(other) > by_weight[2]
    sizes = [np.linalg.norm(move.by) for move in moves.values()]
    assert sizes == sorted(sizes)


def test_a_move_goes_no_further_than_the_path_has_to():
    one = model(muscle(*ALONG))
    held = ground(one)
    found = clear_paths(one, held)
    via = one.muscle("m").path.points[1]
    back = found.model.muscle("m").path.points[1].location - via.location
    points = list(one.muscle("m").path.points)
    points[1] = replace(via, location=via.location + 0.8 * back)
    less = replace(one, muscles=(replace(one.muscle("m"), path=Path(tuple(points), ())),))
    assert held.excess(less, ("m",))
    assert not held.excess(found.model, ("m",))


@pytest.mark.parametrize("size", [0.05, 20.0])
def test_a_mouse_is_cleared_as_a_man(size):
    one = model(muscle(*ALONG))
    other = model(muscle(*(np.array(ALONG) * size)))
    found = clear_paths(one, ground(one))
    again = clear_paths(other, ground(other, THICK * size, size))
    assert again.before["m"] == pytest.approx(size * found.before["m"], rel=1e-6)
    assert again.shifts["m", "P1"] == pytest.approx(size * found.shifts["m", "P1"], rel=1e-6)


def test_where_the_body_stands_does_not_matter():
    pose = Transform(rotation_from_euler_xyz([0.4, -1.1, 2.0]), np.array([0.3, -0.2, 0.9]))
    one = model(muscle(*ALONG))
    moved = model(muscle(*ALONG), pose=pose)
    found = clear_paths(one, ground(one))
    again = clear_paths(moved, ground(moved))
    places = [each.model.muscle("m").path.points[1].location for each in (found, again)]
    np.testing.assert_allclose(*places, atol=1e-6)


def deeper_by(change):
    """Return what is left of a model whose path got deeper by this change.

    Its wrap object grew and its via point moved.
    """
    around = WrapObject(name="shaft", body="femur", kind="cylinder", pose=STILL, size=(0.02, 1.0))
    before = model(muscle(*ALONG, wraps=(PathWrap("shaft"),)), (around,))
    points = tuple(
        PathPoint(f"P{i}", "femur", np.array(place) * 1.1) for i, place in enumerate(ALONG)
    )
    path = Path(points, (PathWrap("shaft"),))
    after = replace(
        before,
        muscles=(replace(before.muscle("m"), path=path),),
        wrap_objects=(replace(around, size=(0.025, 1.0)),),
    )
    return before, after, without_worse(before, after, {"m": 0.003}, {"m": 0.003 + change})


@pytest.mark.parametrize("change", [-1e-3, 0.0, 0.5e-7])
def test_what_makes_no_path_deeper_stays(change):
    _, after, (found, worse) = deeper_by(change)
    assert found is after
    assert worse == frozenset()


def test_a_wrap_object_that_makes_its_path_deeper_goes_back_alone():
    before, after, (found, worse) = deeper_by(1e-5)
    assert worse == {"shaft"}
    assert found.wrap_objects == before.wrap_objects
    assert found.muscle("m") is after.muscle("m")


def test_a_path_that_no_wrap_object_made_deeper_goes_back_itself():
    before = model(muscle(*ALONG))
    after = model(muscle(*(np.array(ALONG) * 1.1)))
    found, worse = without_worse(before, after, {}, {"m": 1e-5})
    assert worse == {"m"}
    assert found.muscle("m") is before.muscle("m")


def test_what_runs_around_a_wrap_object_that_grows_is_watched_too():
    around = WrapObject(name="shaft", body="femur", kind="cylinder", pose=STILL, size=(0.021, 1.0))
    own = muscle([0.0, -0.05, 0.0], [0.004, 0.05, 0.0], wraps=(PathWrap("shaft"),))
    beside = replace(
        own,
        name="beside",
        path=replace(own.path, points=muscle([0.03, -0.05, 0.1], [0.03, 0.05, 0.1]).path.points),
    )
    apart = replace(muscle(*ALONG), name="apart")
    one = replace(model(own, (around,)), muscles=(own, beside, apart))
    assert watched_with(one, {"m"}) == ("m", "beside")
    assert watched_with(one, {"apart"}) == ("apart",)
