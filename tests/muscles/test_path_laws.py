"""Laws that hold whatever the model.

Slopes, rigid motion, reversal, virtual work, and what geometry gives.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.functions import linear, polynomial
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Coupler, Joint, Model
from myomorph.core.model.paths import (
    MovingPathPoint,
    Muscle,
    Path,
    PathPoint,
    PathWrap,
    TendonWrap,
    WrapObject,
)
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.muscles.kinematics import muscle_kinematics
from myomorph.core.muscles.model_paths import compile_paths

STEP = 1e-6
HERE = Transform.identity()
ROOT = ("rx", "ry", "rz", "tx", "ty", "tz")
HIP = ("hip", "out")
KNEE = ("knee", "glide")


def at(x, y, z, rotation=None):
    return Transform(np.eye(3) if rotation is None else rotation, np.array([x, y, z]))


def muscle(name, points, wraps=(), divisors=()):
    return Muscle(
        name=name,
        kind="Thelen2003Muscle",
        path=Path(tuple(points), tuple(wraps), tuple(divisors)),
        max_isometric_force=1.0,
        optimal_fiber_length=0.1,
        tendon_slack_length=0.2,
    )


def leg(muscles=None):
    """Make a free trunk, a thigh on a hinge and a shank.

    The shank rotates and glides, as a knee with a coupler does.
    """
    coordinates = (*ROOT, *HIP, *KNEE)
    return Model(
        name="leg",
        bodies=tuple(
            Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3))
            for name in ("trunk", "thigh", "shank")
        ),
        joints=(root_joint(), hip_joint(), knee_joint()),
        coordinates=tuple(Coordinate(name, range=(-2.0, 2.0)) for name in coordinates),
        gravity=np.array([0.0, -9.81, 0.0]),
        muscles=ways() if muscles is None else muscles,
        wrap_objects=surfaces(),
        couplers=(
            Coupler(
                name="glide",
                dependent="glide",
                function=polynomial([0.0, 0.03, -0.01]),
                independents=("knee",),
            ),
        ),
    )


def moving_axis(kind, direction, coordinate, function=None):
    """Make an axis along x, y or z that moves by its coordinate, or by a function of it."""
    return Axis(
        kind=kind,
        vector=np.eye(3)["xyz".index(direction)],
        function=linear(1.0) if function is None else function,
        coordinates=(coordinate,),
    )


def root_joint():
    """Make the joint of the trunk, which moves freely."""
    kinds = ("rotation",) * 3 + ("translation",) * 3
    return Joint(
        name="root",
        kind="CustomJoint",
        parent=GROUND,
        child="trunk",
        parent_frame=HERE,
        child_frame=HERE,
        axes=tuple(map(moving_axis, kinds, "xyzxyz", ROOT)),
        coordinates=ROOT,
    )


def hip_joint():
    """Make a joint with two hinges."""
    return Joint(
        name="hip",
        kind="CustomJoint",
        parent="trunk",
        child="thigh",
        parent_frame=at(0.0, -0.1, 0.0),
        child_frame=HERE,
        axes=(moving_axis("rotation", "z", "hip"), moving_axis("rotation", "x", "out")),
        coordinates=HIP,
    )


def knee_joint():
    """Make a hinge that moves forward as it rotates, and glides."""
    return Joint(
        name="knee",
        kind="CustomJoint",
        parent="thigh",
        child="shank",
        parent_frame=at(0.0, -0.4, 0.0),
        child_frame=HERE,
        axes=(
            moving_axis("translation", "x", "knee", polynomial([0.0, 0.01, 0.02])),
            moving_axis("translation", "y", "glide"),
            moving_axis("rotation", "z", "knee"),
        ),
        coordinates=KNEE,
    )


def surfaces():
    """Make a cylinder, a sphere and an ellipsoid on the thigh."""
    below = at(0.0, -0.38, 0.01)
    return (
        WrapObject(
            name="shaft", body="thigh", kind="cylinder", pose=at(0.0, -0.4, 0.0), size=(0.04, 1.0)
        ),
        WrapObject(name="ball", body="thigh", kind="sphere", pose=below, size=(0.04,)),
        WrapObject(name="egg", body="thigh", kind="ellipsoid", pose=below, size=(0.03, 0.05, 0.06)),
    )


def ways():
    high = PathPoint("high", "thigh", (0.06, -0.1, 0.0))
    low = PathPoint("low", "shank", (0.05, -0.15, 0.0))
    top = PathPoint("top", "trunk", (0.05, 0.05, 0.02))
    sliding = MovingPathPoint(
        name="sliding",
        body="shank",
        functions=(polynomial([0.05, 0.02]), linear(-0.03, -0.05), polynomial([0.0])),
        coordinates=("knee", "knee", ""),
    )
    side = PathPoint("side", "shank", (0.03, -0.1, 0.03))
    return (
        muscle("straight", (top, side)),
        muscle("via", (top, high, PathPoint("deep", "shank", (0.02, -0.3, 0.01)))),
        muscle("moving", (high, sliding)),
        muscle("moving_then_fixed", (top, sliding, side)),
        muscle("to_ground", (PathPoint("anchor", GROUND, (0.3, 0.2, 0.1)), side)),
        muscle("around_shaft", (high, low), (PathWrap("shaft"),)),
        muscle("around_ball", (high, side), (PathWrap("ball"),)),
        muscle("around_egg", (high, low), (PathWrap("egg", "midpoint"),)),
        muscle("tendon", (top, high, side), (TendonWrap("ball", 1),), (1.0, 2.0)),
    )


def poses(count=25, seed=0, knee=(0.1, 1.4)):
    """Coordinates (count, 10), bent so that the paths at the back of the knee wrap."""
    rng = np.random.default_rng(seed)
    values = rng.uniform(-0.6, 0.6, (count, 10))
    values[:, 8] = -rng.uniform(*knee, count)
    return values


EXACT = [name for name in (one.name for one in ways()) if name != "around_egg"]


@pytest.mark.parametrize("name", EXACT)
def test_moment_arm_is_the_slope_of_length(name):
    model = leg()
    paths = compile_paths(model)
    values = poses()
    m = model.muscle_names.index(name)
    arms = muscle_kinematics(
        model, Motion(np.arange(25.0), model.coordinate_names, values), velocities=False
    ).dense()
    for j, coordinate in enumerate(model.coordinate_names):
        if coordinate == "glide":
            continue
        shift = np.zeros(10)
        shift[j] = STEP
        slope = (paths.evaluate(values + shift)[0] - paths.evaluate(values - shift)[0])[:, m] / (
            2.0 * STEP
        )
        np.testing.assert_allclose(arms[:, m, j], -slope, atol=2e-8, err_msg=coordinate)


def test_surfaces_are_in_the_way():
    """The laws above would hold without any surface, so make sure that the paths touch them."""
    model = leg()
    bare = replace(
        model,
        muscles=tuple(replace(one, path=replace(one.path, wraps=())) for one in model.muscles),
    )
    longer = compile_paths(model).evaluate(poses())[0] - compile_paths(bare).evaluate(poses())[0]
    for name in ("around_shaft", "around_ball", "around_egg", "tendon"):
        assert (longer[:, model.muscle_names.index(name)] > 1e-5).sum() > 5


def test_velocity_is_the_rate_of_length():
    model = leg()
    paths = compile_paths(model)
    values = poses(seed=3)
    speeds = np.random.default_rng(4).normal(size=(25, 10))
    ahead = paths.evaluate(values + STEP * speeds)[0]
    behind = paths.evaluate(values - STEP * speeds)[0]
    rates = paths.evaluate(values, speeds)[1]
    kept = [model.muscle_names.index(name) for name in EXACT]
    np.testing.assert_allclose(
        rates[:, kept], ((ahead - behind) / (2.0 * STEP))[:, kept], atol=1e-7
    )


def test_dependent_speeds_are_not_read():
    values = poses()
    speeds = np.ones((25, 10))
    other = speeds.copy()
    other[:, 9] = 77.0
    paths = compile_paths(leg())
    np.testing.assert_array_equal(
        paths.evaluate(values, speeds)[1], paths.evaluate(values, other)[1]
    )


def test_dependent_coordinate_has_the_moment_arm_of_what_it_follows():
    """With d = f(q), a torque on d does the work of g times the torque on q: r_d = r_q / g."""
    model = leg()
    values = poses()
    found = muscle_kinematics(
        model, Motion(np.arange(25.0), model.coordinate_names, values), velocities=False
    )
    slope = 0.03 - 0.02 * values[:, 8]
    for name in model.muscle_names:
        np.testing.assert_allclose(
            found.moment_arm_of(name, "glide") * slope,
            found.moment_arm_of(name, "knee"),
            atol=1e-12,
        )


def test_moving_the_whole_body_changes_nothing():
    model = leg()
    paths = compile_paths(model)
    values = poses()
    moved = values.copy()
    moved[:, :6] += np.random.default_rng(8).uniform(-1.0, 1.0, (25, 6))
    internal = [m for m, name in enumerate(model.muscle_names) if name != "to_ground"]
    lengths, _, arms = paths.evaluate(values)
    moved_lengths, _, moved_arms = paths.evaluate(moved)
    np.testing.assert_allclose(lengths[:, internal], moved_lengths[:, internal], atol=1e-13)
    inside = np.isin(paths.arm_muscle, internal)
    np.testing.assert_allclose(arms[:, inside], moved_arms[:, inside], atol=1e-12)
    assert paths.arm_coordinate[inside].min() >= 6, (
        "no coordinate of the root can move a muscle inside the body"
    )


def test_reversed_paths_are_as_long():
    model = leg()
    turned = replace(
        model,
        muscles=tuple(
            replace(one, path=replace(one.path, points=one.path.points[::-1]))
            for one in model.muscles
            if one.name != "tendon"
        ),
    )
    straight = compile_paths(model).evaluate(poses())[0]
    back = compile_paths(turned).evaluate(poses())[0]
    np.testing.assert_allclose(straight[:, :-1], back, atol=1e-12)


def test_unit_tension_does_the_work_that_shortening_takes():
    """Sum of r dq over a small change equals the shortening, all coordinates together."""
    model = leg()
    paths = compile_paths(model)
    values = poses(seed=5)
    change = 1e-5 * np.random.default_rng(6).normal(size=values.shape)
    before, _, _ = paths.evaluate(values - change)
    after, _, _ = paths.evaluate(values + change)
    _, _, arms = paths.evaluate(values)
    free = paths.arrays.arm[:, 1] == 1
    work = np.zeros(before.shape)
    for k in np.flatnonzero(free):
        work[:, paths.arm_muscle[k]] += 2.0 * arms[:, k] * change[:, paths.arm_coordinate[k]]
    kept = [model.muscle_names.index(name) for name in EXACT]
    np.testing.assert_allclose(work[:, kept], (before - after)[:, kept], atol=1e-11)


@pytest.mark.parametrize("kind", ["shaft", "ball"])
@pytest.mark.parametrize("rule", ["OpenSim", "MuJoCo"])
def test_length_around_a_circle(kind, rule):
    """Two tangents and an arc around a circle.

    l = 2 sqrt(d^2 - R^2) + R (angle between the points - 2 acos(R / d)).
    """
    radius = 0.04
    distance = 0.1
    angle = 2.4
    ends = [
        distance * np.array([np.sin(side * angle / 2), np.cos(angle / 2), 0.0]) for side in (-1, 1)
    ]
    center = np.array([0.0, -0.4, 0.0] if kind == "shaft" else [0.0, -0.38, 0.01])
    wrap = PathWrap(kind) if rule == "OpenSim" else TendonWrap(kind, 0)
    points = [PathPoint(str(i), "thigh", center + end) for i, end in enumerate(ends)]
    model = leg((muscle("one", points, (wrap,)),))
    expected = 2.0 * np.sqrt(distance**2 - radius**2) + radius * (
        angle - 2.0 * np.arccos(radius / distance)
    )
    assert compile_paths(model).evaluate(poses(3))[0] == pytest.approx(expected, abs=1e-12)


def test_conditional_points_follow_their_range():
    low = PathPoint("a", "thigh", (0.0, -0.1, 0.0))
    high = PathPoint("b", "shank", (0.0, -0.1, 0.0))
    bend = PathPoint(
        name="c", body="thigh", location=(0.1, -0.3, 0.0), coordinate="knee", range=(-0.5, 0.2)
    )
    values = np.zeros((5, 10))
    values[:, 8] = (-0.6, -0.500009, -0.3, 0.20000999, 0.3)
    both = leg((muscle("one", (low, bend, high)), muscle("two", (low, high))))
    lengths = compile_paths(both).evaluate(values)[0]
    np.testing.assert_array_equal(
        lengths[:, 0] > lengths[:, 1] + 1e-3, [False, True, True, True, False]
    )


def test_moving_points_stop_at_the_end_of_the_range():
    values = np.zeros((2, 10))
    values[:, 8] = 2.0, 2.5
    sliding = MovingPathPoint(
        name="s",
        body="thigh",
        functions=(linear(0.1), linear(0.2), linear(0.0)),
        coordinates=("knee", "knee", "knee"),
    )
    model = leg((muscle("one", (PathPoint("a", "trunk", (0.0, 0.0, 0.0)), sliding)),))
    lengths, _, arms = compile_paths(model).evaluate(values)
    assert lengths[0, 0] == lengths[1, 0]
    knee = model.coordinate_names.index("knee")
    assert arms[1, list(compile_paths(model).arm_coordinate).index(knee)] == 0.0


def test_gaps_of_a_tendon_have_no_length():
    a = PathPoint("a", "thigh", (0.0, 0.0, 0.0))
    b = PathPoint("b", "thigh", (0.3, 0.0, 0.0))
    c = PathPoint("c", "thigh", (0.3, 0.4, 0.0))
    model = leg((muscle("one", (a, b, c, a), (), (2.0, 0.0, 4.0)),))
    assert compile_paths(model).evaluate(poses(1))[0] == pytest.approx(0.3 / 2.0 + 0.5 / 4.0)


def test_sparse_and_dense_agree():
    model = leg()
    motion = Motion(
        time=np.arange(25.0),
        names=model.coordinate_names,
        values=poses(),
        velocities=np.ones((25, 10)),
    )
    found = muscle_kinematics(model, motion)
    dense = found.moment_arm
    values, muscles, coordinates = found.independent()
    np.testing.assert_array_equal(dense[:, muscles, coordinates], values)
    dense[:, muscles, coordinates] = 0.0
    dense[:, :, model.coordinate_names.index("glide")] = 0.0
    assert not dense.any()
    np.testing.assert_array_equal(found.dense(slice(3, 5)), found.moment_arm[3:5])
    assert found.muscle_velocity is not None
    np.testing.assert_allclose(
        found.muscle_velocity, -found.dense()[:, :, :9].sum(axis=2), atol=1e-12
    )


def test_bad_input_is_named():
    model = leg()
    motion = Motion(np.zeros(1), model.coordinate_names, np.zeros((1, 10)))
    with pytest.raises(BadData, match="differentiate"):
        muscle_kinematics(model, motion)
    with pytest.raises(BadData, match="not finite"):
        muscle_kinematics(model, replace(motion, values=np.full((1, 10), np.nan)), velocities=False)
    with pytest.raises(BadData, match=r"\(1, 10\)"):
        compile_paths(model).evaluate(np.zeros((1, 3)))
    with pytest.raises(BadData, match="moment_arms"):
        muscle_kinematics(model, motion, velocities=False, moment_arms=False).dense()
    with pytest.raises(UnknownName, match="around_egg"):
        muscle_kinematics(model, motion, velocities=False).moment_arm_of("around_eg", "knee")
    point = PathPoint("a", "thigh", np.zeros(3))
    for path, error, what in (
        (Path((point,)), BadModel, "1 points"),
        (Path((point, point), (PathWrap("shaft"), TendonWrap("ball", 0))), BadModel, "mixes"),
        (Path((point, point), (PathWrap("shoft"),)), UnknownName, "shaft"),
        (Path((point, point), (TendonWrap("ball", 1),)), BadModel, "after point 1 of 2"),
        (Path((point, replace(point, body="thihg"))), UnknownName, "thigh"),
    ):
        with pytest.raises(error, match=what):
            compile_paths(
                leg(
                    (
                        Muscle(
                            name="one",
                            kind="x",
                            path=path,
                            max_isometric_force=1.0,
                            optimal_fiber_length=0.1,
                            tendon_slack_length=0.2,
                        ),
                    )
                )
            )


def test_turned_surface_is_the_same_surface():
    """A cylinder turned about its own axis, and a sphere turned anyhow, wrap as before."""
    model = leg()
    turned = replace(
        model,
        wrap_objects=tuple(
            (
                replace(
                    one,
                    pose=Transform(
                        one.pose.rotation @ axis_rotation((0, 0, 1), 0.7), one.pose.translation
                    ),
                )
                if one.kind != "ellipsoid"
                else one
            )
            for one in model.wrap_objects
        ),
    )
    np.testing.assert_allclose(
        compile_paths(model).evaluate(poses())[0],
        compile_paths(turned).evaluate(poses())[0],
        atol=1e-12,
    )


@pytest.mark.parametrize(("way", "wraps"), [(0, False), (1, True)])
def test_a_path_wraps_an_ellipsoid_between_it_and_not_where_both_ends_are_on_one_ray(way, wraps):
    """One end on x; the other slides along x or, at a right angle to the middle, along y."""
    axis = Axis(
        kind="translation", vector=np.eye(3)[way], function=linear(1.0), coordinates=("out",)
    )
    joint = Joint(
        name="slider",
        kind="SliderJoint",
        parent=GROUND,
        child="block",
        parent_frame=HERE,
        child_frame=HERE,
        axes=(axis,),
        coordinates=("out",),
    )
    path = Path(
        (PathPoint("a", GROUND, np.array([0.046, 0.0, 0.0])), PathPoint("b", "block", np.zeros(3))),
        (PathWrap("egg"),),
    )
    model = Model(
        name="egg",
        bodies=(Body(name="block", mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3)),),
        joints=(joint,),
        coordinates=(Coordinate("out", "translational"),),
        gravity=np.zeros(3),
        muscles=(
            Muscle(
                name="m",
                kind="Thelen2003Muscle",
                path=path,
                max_isometric_force=1.0,
                optimal_fiber_length=0.1,
                tendon_slack_length=0.2,
            ),
        ),
        wrap_objects=(
            WrapObject(
                name="egg", body=GROUND, kind="ellipsoid", pose=HERE, size=(0.04, 0.045, 0.05)
            ),
        ),
    )
    out = np.linspace(0.05, 0.09, 9)
    motion = Motion(np.arange(9.0), ("out",), out[:, None])
    lengths = muscle_kinematics(model, motion, velocities=False, moment_arms=False).muscle_length[
        :, 0
    ]
    straight = np.hypot(0.046, out) if wraps else out - 0.046
    assert (
        (lengths > straight + 1e-7).all() if wraps else np.allclose(lengths, straight, atol=1e-12)
    )
