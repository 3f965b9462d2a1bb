"""What is transferred with a bone, part by part.

Functions of coordinates, wrap objects, points of surfaces, and centers.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
import trimesh
from given_maps import given, similar

from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, fit_map
from myomorph.bones.morph.morphed import MorphOptions, TransferredPoint
from myomorph.bones.morph.transfer.body_transfer import Transfer, scaled_map
from myomorph.bones.morph.transfer.joints import CenterFinder, transferred_joints
from myomorph.bones.morph.transfer.model import MorphTarget, morph_model
from myomorph.bones.morph.transfer.moving_points import reparametrized, translated_path
from myomorph.bones.morph.transfer.paths import (
    points_left_outside,
    surface_points,
    transferred_wrap,
)
from myomorph.bones.morph.transfer.points import combined, put_on_surface
from myomorph.bones.morph.transfer.virtual_links import bones_around
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData
from myomorph.core.model.functions import (
    SineProduct,
    constant,
    linear,
    piecewise_linear,
    polynomial,
    simm_spline,
)
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.paths import Muscle, Path, PathPoint, PathWrap, WrapObject, surface_level
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.kinematics import forward_kinematics, standing_poses
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity, procrustes

X = np.linspace(-2.0, 2.0, 41)
SPLINE = simm_spline([-1.0, -0.3, 0.4, 1.2], [0.1, 0.4, -0.2, 0.3])
FUNCTIONS = {
    "constant": constant(0.3),
    "line": linear(-0.4, 0.1),
    "polynomial": polynomial([0.1, -0.2, 0.3]),
    "broken": piecewise_linear([-0.5, 0.2, 1.0], [0.0, 1.0, -1.0]),
    "spline": SPLINE,
    "other spline": simm_spline([-1.5, 0.0, 0.7, 1.0], [0.3, -0.4, 0.2, 0.1]),
}
STILL = Transform.identity()
TOGETHER = MorphTarget(together=True)


def test_what_slides_goes_further_and_what_turns_does_not():
    """A slider that also rotates, on bones half as large again.

    1.5 of the slide and equal rotations put all 1.5 as far.
    """
    axes = (
        Axis(
            kind="rotation",
            vector=np.array([0.0, 0.6, 0.8]),
            function=linear(1.0),
            coordinates=("turn",),
        ),
        Axis(
            kind="translation",
            vector=np.array([1.0, 0.0, 0.0]),
            function=linear(1.0),
            coordinates=("slide",),
        ),
    )
    at = Transform(rotation_from_euler_xyz((0.3, 0.2, 0.1)), np.array([0.1, -0.2, 0.05]))
    joints = (
        Joint(
            name="base",
            kind="WeldJoint",
            parent="ground",
            child="thigh",
            parent_frame=STILL,
            child_frame=STILL,
        ),
        Joint(
            name="knee",
            kind="CustomJoint",
            parent="thigh",
            child="shank",
            parent_frame=at,
            child_frame=STILL,
            axes=axes,
            coordinates=("turn", "slide"),
        ),
    )
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=0.01 * np.eye(3))
        for name in ("thigh", "shank")
    )
    coordinates = (
        Coordinate("turn", range=(-1.0, 2.0)),
        Coordinate("slide", "translational", range=(-0.1, 0.2)),
    )
    model = Model(
        name="slider",
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        gravity=np.array([0.0, -9.81, 0.0]),
    )
    bones = {"ground": given("ground", 1.5 * np.eye(3), np.zeros(3)), **similar(model, 1.5)}
    carriers = {name: Transfer(bone, name) for name, bone in bones.items()}
    found = transferred_joints(model, carriers, CenterFinder(carriers, fitted=False, together=True))
    assert dict(found.travel) == {"slide": pytest.approx(1.5)}
    turn, slide = found.skeleton.coordinates
    assert turn.range == (-1.0, 2.0)
    assert slide.range == pytest.approx((-0.15, 0.3))
    before = forward_kinematics(compile_tree(model), np.array([(0.7, 0.1)])).origins[0]
    after = forward_kinematics(compile_tree(found.skeleton), np.array([(0.7, 0.15)])).origins[0]
    np.testing.assert_allclose(after, 1.5 * before, atol=1e-12)


def test_sizes_of_bodies_without_bones_are_positive_numbers():
    np.testing.assert_array_equal(scaled_map("link", 0.5).apply(np.ones((1, 3))), [[0.5, 0.5, 0.5]])
    for size in (-1.0, 0.0, np.inf, np.nan):
        with pytest.raises(BadData, match="the size of 'link' would be"):
            scaled_map("link", size)


def test_a_virtual_link_needs_two_bones_that_have_maps():
    model, bones = _hip(_femur(1.0, np.zeros(3)), _femur(1.2, np.zeros(3)), np.zeros(3))
    ours = {"pelvis": bones["pelvis"]}
    assert bones_around(model, bones, {"femur": ("pelvis", "femur")}) == {
        "femur": ("pelvis", "femur")
    }
    for around, known in ((("pelvis",), bones), ((), bones), (("pelvis", "femur"), ours)):
        with pytest.raises(BadData, match="virtual link 'femur' needs at least two bones"):
            bones_around(model, known, {"femur": around})


def test_functions_of_one_coordinate_add_up():
    rng = np.random.default_rng(0)
    names = list(FUNCTIONS)
    for _ in range(20):
        chosen = [FUNCTIONS[names[i]] for i in rng.integers(0, len(names), 3)]
        factors = rng.uniform(-1.0, 1.0, 3)
        offset = rng.uniform(-1.0, 1.0)
        expected = sum(a * f(X) for a, f in zip(factors, chosen, strict=True)) + offset
        np.testing.assert_allclose(combined(chosen, factors, offset)(X), expected, atol=1e-12)


@pytest.mark.parametrize("factor", [1.0, 0.5, -2.0])
@pytest.mark.parametrize("name", [*FUNCTIONS, "sine"])
def test_a_function_of_another_models_coordinate(name, factor):
    function = FUNCTIONS.get(
        name,
        SineProduct(factor=0.3, frequencies=np.array([1.7]), phases=np.array([0.2]), offset=0.1),
    )
    # Where pieces meet without being continuous the side counts: keep off the breaks.
    x = X + 0.0123
    np.testing.assert_allclose(
        reparametrized(function, factor, 0.3)(factor * x + 0.3), function(x), atol=1e-12
    )


def test_conditional_points_follow_the_other_models_coordinates():
    points = [PathPoint(str(i), "femur", np.array([0.1 * i, 0.0, 0.0])) for i in range(5)]
    points[1] = replace(points[1], coordinate="knee", range=(-1.0, -0.5))
    points[2] = replace(points[2], coordinate="toe", range=(0.2, 0.5))
    points[3] = replace(points[3], coordinate="toe", range=(-0.1, 0.1))
    path = Path(
        tuple(points), (PathWrap("roller", first=3, last=5), PathWrap("roller", first=4, last=4))
    )
    found, lost = translated_path(path, {"knee": ("stifle", -2.0, 0.1)}, {"knee": 0.0, "toe": 0.0})
    assert [one.name for one in found.points] == ["0", "1", "3", "4"]
    assert found.points[1].coordinate == "stifle"
    assert found.points[1].range == pytest.approx((1.1, 2.1))
    assert found.points[2].coordinate == ""
    assert lost == ["toe", "toe"]
    assert [(one.first, one.last) for one in found.wraps] == [(3, 4), (3, 3)]


WRAPS = (
    ("cylinder", (0.03, 0.1)),
    ("sphere", (0.02,)),
    ("ellipsoid", (0.02, 0.03, 0.05)),
    ("torus", (0.01, 0.02)),
)


@pytest.mark.parametrize(("kind", "size"), WRAPS)
def test_a_wrap_object_of_a_larger_twin(kind, size):
    rng = np.random.default_rng(1)
    pose = Transform(rotation_from_euler_xyz(rng.uniform(-1, 1, 3)), rng.uniform(-0.1, 0.1, 3))
    turn = rotation_from_euler_xyz((0.7, -0.3, 1.1))
    offset = np.array([0.2, 0.1, -0.3])
    wrap = WrapObject(name="one", body="femur", kind=kind, pose=pose, size=size, quadrant="-x")
    found = transferred_wrap(wrap, Transfer(given("femur", 0.6 * turn, offset), "thigh"))
    np.testing.assert_allclose(found.size, 0.6 * np.array(size), rtol=1e-12)
    np.testing.assert_allclose(found.pose.rotation, turn @ pose.rotation, atol=1e-12)
    np.testing.assert_allclose(
        found.pose.translation, 0.6 * turn @ pose.translation + offset, atol=1e-12
    )
    assert (found.body, found.quadrant) == ("thigh", "-x")


def test_a_stretched_cylinder_stays_along_the_bones_line():
    pose = Transform(rotation_from_euler_xyz((0.4, 0.2, 0.0)), np.zeros(3))
    matrix = np.array([[1.2, 0.3, 0.0], [0.0, 0.9, 0.1], [0.0, 0.0, 1.0]])
    found = transferred_wrap(
        WrapObject(name="one", body="femur", kind="cylinder", pose=pose, size=(0.02, 0.1)),
        Transfer(given("femur", matrix, np.zeros(3)), "femur"),
    )
    line = matrix @ pose.rotation[:, 2]
    np.testing.assert_allclose(found.pose.rotation[:, 2], line / np.linalg.norm(line), atol=1e-12)
    assert found.size[1] == pytest.approx(0.1 * np.linalg.norm(line))
    points = found.pose.inverse().apply(
        pose.apply(
            surface_points(
                WrapObject(name="one", body="femur", kind="cylinder", pose=pose, size=(0.02, 0.1)),
                1.0,
            )
        )
        @ matrix.T
    )
    assert np.linalg.norm(points[:, :2], axis=1).mean() == pytest.approx(found.size[0])


def test_an_ellipsoid_stretched_along_its_axes_is_exact():
    growth = np.array([1.3, 0.8, 1.1])
    wrap = WrapObject(
        name="one",
        body="femur",
        kind="ellipsoid",
        pose=STILL,
        size=(0.02, 0.03, 0.05),
        quadrant="+z",
    )
    found = transferred_wrap(wrap, Transfer(given("femur", np.diag(growth), np.zeros(3)), "femur"))
    np.testing.assert_allclose(found.size, growth * wrap.size, rtol=1e-12)
    np.testing.assert_allclose(found.pose.rotation, np.eye(3), atol=1e-12)


def test_a_point_outside_a_wrap_object_is_left_outside():
    before = WrapObject(name="roller", body="femur", kind="cylinder", pose=STILL, size=(0.03, 0.1))
    after = replace(before, size=(0.04, 0.12))
    places = np.array([[0.036, 0.0, 0.0], [0.0, 0.01, 0.0]])
    points = tuple(PathPoint(str(i), "femur", place) for i, place in enumerate(places))
    muscle = Muscle(
        name="one",
        kind="RigidTendonMuscle",
        path=Path(points, (PathWrap("roller"),)),
        max_isometric_force=1.0,
        optimal_fiber_length=1.0,
        tendon_slack_length=1.0,
    )
    carried = [
        TransferredPoint(
            owner="one", name=str(i), body="femur", target_body="femur", source=place, target=place
        )
        for i, place in enumerate(places)
    ]
    found, notes = points_left_outside([muscle], carried, {"roller": (before, after)})
    assert surface_level(found["roller"][1], places[:1]) == pytest.approx(1.05)
    assert "'roller' to 86 %" in notes[0]
    assert points_left_outside([muscle], carried, {"roller": (before, before)})[1] == []


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.asarray(mesh.vertices), np.asarray(mesh.faces))


def ball(radius: float, center=(0.0, 0.0, 0.0), subdivisions: int = 4) -> Surface:
    mesh = trimesh.creation.icosphere(subdivisions=subdivisions, radius=radius)
    return Surface(mesh.vertices + np.asarray(center), mesh.faces)


def test_points_come_back_onto_the_surface_at_their_height():
    """A map that misses the target's surface by up to 3 mm.

    Points at 0 and 1 mm come to lie at 0 and 1.1 mm.
    """
    source = ball(0.1)
    target = ball(0.11)
    rng = np.random.default_rng(0)
    features = ball(0.1, subdivisions=1).vertices
    moved = 1.1 * features + 0.003 * rng.uniform(-1, 1, features.shape)
    noisy = FeaturePoints(tuple(map(str, range(len(features)))), features, moved)
    bone = BoneMap(
        body="ball",
        target_body="ball",
        map=fit_map(noisy),
        whole=procrustes(features, noisy.target, True),
        basis="bone",
        source=source,
        target=target,
    )
    along = rng.standard_normal((200, 3))
    along /= np.linalg.norm(along, axis=1, keepdims=True)
    for height in (0.0, 0.001):
        points = (0.1 + height) * along
        found = put_on_surface(Transfer(bone, "ball"), points, 0.02)
        missed = np.linalg.norm(bone.map.apply(points), axis=1) - 0.11
        assert np.abs(missed).max() > 0.001
        np.testing.assert_allclose(found.depth_target, 1.1 * height, atol=4e-4)
        assert found.lifted.max() < 0.004
    far = put_on_surface(Transfer(bone, "ball"), 0.15 * along, 0.02)
    assert not far.lifted.any()


def test_exact_maps_move_no_point_of_the_surface():
    source = surface_of(trimesh.creation.capsule(height=0.3, radius=0.02))
    matrix = np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.0], [0.0, 0.2, 1.1]])
    offset = np.array([0.1, 0.2, 0.3])
    target = Surface(source.vertices @ matrix.T + offset, source.faces)
    bone = given("femur", matrix, offset, source=source, target=target)
    rng = np.random.default_rng(3)
    chosen = rng.integers(0, len(source.vertices), 100)
    points = source.vertices[chosen] + 0.002 * rng.uniform(-1.0, 1.0, (100, 3))
    found = put_on_surface(Transfer(bone, "femur"), points, 0.02)
    np.testing.assert_allclose(found.points, points @ matrix.T + offset, atol=1e-9 * 0.3)


def test_a_point_stays_on_its_side_of_a_thin_bone():
    """A blade 2 mm thick, mapped 4 mm across: its upper points come to lie on its upper side."""
    blade = trimesh.creation.box(extents=(0.1, 0.002, 0.1)).subdivide().subdivide().subdivide()
    source = surface_of(blade)
    bone = given("scapula", np.eye(3), np.array([0.0, -0.004, 0.0]), source=source, target=source)
    points = np.column_stack([np.linspace(-0.03, 0.03, 7), np.full(7, 0.0013), np.zeros(7)])
    found = put_on_surface(Transfer(bone, "scapula"), points, 0.02)
    np.testing.assert_allclose(found.points, points, atol=1e-9)
    np.testing.assert_allclose(found.lifted, 0.004, atol=1e-9)
    np.testing.assert_allclose(found.depth_target, 0.0003, atol=1e-9)


def test_what_the_target_lacks_is_not_looked_for():
    """Half of the bone is missing: points of that half stay where the map puts them."""
    source = surface_of(trimesh.creation.capsule(height=0.3, radius=0.02).subdivide())
    middle = source.vertices[source.faces].mean(axis=1)[:, 2]
    target = Surface(source.vertices, source.faces[middle < np.median(middle)])
    bone = given("femur", np.eye(3), np.zeros(3), source=source, target=target)
    points = source.vertices[np.abs(source.vertices[:, 2] - source.vertices[:, 2].max()) < 0.01]
    found = put_on_surface(Transfer(bone, "femur"), points, 0.02)
    assert found.beyond.all()
    assert not found.lifted.any()


def _hip(head: Surface, other: Surface, offset: np.ndarray) -> tuple[Model, dict[str, BoneMap]]:
    """Make a ball joint at a femur's head, and a map that misses the target's head by an offset."""
    axes = tuple(
        Axis(kind="rotation", vector=np.eye(3)[i], function=linear(1.0), coordinates=(f"q{i}",))
        for i in range(3)
    )
    joints = (
        Joint(
            name="base",
            kind="WeldJoint",
            parent="ground",
            child="pelvis",
            parent_frame=STILL,
            child_frame=STILL,
        ),
        Joint(
            name="hip",
            kind="CustomJoint",
            parent="pelvis",
            child="femur",
            parent_frame=Transform(np.eye(3), np.array([0.0, -0.1, 0.08])),
            child_frame=STILL,
            axes=axes,
            coordinates=("q0", "q1", "q2"),
        ),
    )
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=0.01 * np.eye(3))
        for name in ("pelvis", "femur")
    )
    coordinates = tuple(Coordinate(f"q{i}", range=(-1.0, 1.0)) for i in range(3))
    model = Model(
        name="hip",
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        gravity=np.array([0.0, -9.81, 0.0]),
    )
    bone = given("femur", 1.2 * np.eye(3), offset, source=head, target=other)
    return model, {"femur": bone, "pelvis": given("pelvis", np.eye(3), np.zeros(3))}


def _femur(size: float, center: np.ndarray) -> Surface:
    """Make a head 24 mm in radius next to a shaft."""
    head = trimesh.creation.icosphere(subdivisions=4, radius=0.024)
    shaft = trimesh.creation.cylinder(
        radius=0.012, segment=([0.03, -0.04, 0.0], [0.06, -0.3, 0.0]), sections=24
    )
    whole = trimesh.util.concatenate([head, shaft.subdivide().subdivide()])
    return Surface(size * whole.vertices + center, whole.faces)


def test_a_ball_joint_is_centered_in_the_targets_head():
    center = np.array([0.01, 0.02, -0.03])
    missed = np.array([0.003, -0.002, 0.004])
    model, bones = _hip(_femur(1.0, np.zeros(3)), _femur(1.2, center), center + missed)
    joint = morph_model(model, bones).joints[1]
    assert joint.method == "sphere"
    np.testing.assert_allclose(joint.in_child, center, atol=3e-4)
    assert joint.moved == pytest.approx(np.linalg.norm(missed), abs=3e-4)
    mapped = morph_model(model, bones, MorphOptions(joints="mapped")).joints[1]
    assert mapped.method == "mapped"
    np.testing.assert_allclose(mapped.in_child, center + missed, atol=1e-12)


def test_bones_in_one_frame_take_the_center_of_the_bone_that_holds_it():
    center = np.array([0.0, -0.1, 0.08])
    missed = np.array([0.001, 0.002, -0.001])
    head = _femur(1.0, np.zeros(3))
    model, bones = _hip(head, Surface(head.vertices + center, head.faces), center + missed)
    bones["femur"] = replace(bones["femur"], map=AffineMap(np.eye(3), center + missed))
    joint = morph_model(model, bones, MorphOptions(joints="mapped"), TOGETHER).joints[1]
    assert joint.gap == pytest.approx(np.linalg.norm(missed))
    for found in (joint.in_parent, joint.in_child):
        np.testing.assert_allclose(found, center + missed, atol=1e-12)
    fitted = morph_model(model, bones, target=TOGETHER).joints[1]
    np.testing.assert_allclose(fitted.in_parent, center, atol=3e-4)


class Twist:
    """Rotations about y by an angle along y: none at the top end, 0.3 rad 0.4 m below."""

    def apply(self, points):
        x, y, z = np.moveaxis(np.asarray(points, dtype=np.float64), -1, 0)
        angle = -0.75 * y
        return np.stack(
            [np.cos(angle) * x + np.sin(angle) * z, y, np.cos(angle) * z - np.sin(angle) * x],
            axis=-1,
        )

    def jacobian(self, points):
        raise NotImplementedError


def test_a_hinge_follows_a_twisted_end_and_a_ball_joint_the_whole_bone():
    model, bones = _hip(_femur(1.0, np.zeros(3)), _femur(1.0, np.zeros(3)), np.zeros(3))
    knee = Transform(np.eye(3), np.array([0.0, -0.4, 0.0]))
    flexion = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=("flexion",),
    )
    model = replace(
        model,
        bodies=(
            *model.bodies,
            Body(name="tibia", mass=1.0, mass_center=np.zeros(3), inertia=0.01 * np.eye(3)),
        ),
        joints=(
            *model.joints,
            Joint(
                name="knee",
                kind="PinJoint",
                parent="femur",
                child="tibia",
                parent_frame=knee,
                child_frame=STILL,
                axes=(flexion,),
                coordinates=("flexion",),
            ),
        ),
        coordinates=(*model.coordinates, Coordinate("flexion", range=(-2.0, 0.0))),
    )
    bones["femur"] = replace(bones["femur"], map=Twist(), whole=Similarity(np.eye(3), np.zeros(3)))
    bones["tibia"] = given("tibia", np.eye(3), np.zeros(3))
    hip_joint, knee_joint = morph_model(model, bones, MorphOptions(joints="mapped")).model.joints[
        1:
    ]
    np.testing.assert_allclose(hip_joint.child_frame.rotation, np.eye(3), atol=1e-12)
    np.testing.assert_allclose(
        knee_joint.parent_frame.rotation, rotation_from_euler_xyz((0.0, 0.3, 0.0)), atol=2e-3
    )
    np.testing.assert_allclose(knee_joint.child_frame.rotation, np.eye(3), atol=1e-12)


def test_a_joint_away_from_the_sources_head_is_mapped():
    model, bones = _hip(
        _femur(1.0, np.array([0.0, 0.015, 0.0])),
        _femur(1.2, np.array([0.0, 0.018, 0.0])),
        np.zeros(3),
    )
    assert morph_model(model, bones).joints[1].method == "mapped"


def test_declared_virtual_links_of_a_real_model(data):
    """The abdominal wall of the 520-muscle model is on bodies without bones.

    Declared as virtual links, they grow with those around.
    """
    model = read_osim(data("fullbody-many-muscles/cyclistFullBodyMuscle.osim"))
    links = [body.name for body in model.bodies if body.name.startswith("Abd")]
    around = ("pelvis", "lumbar5", "lumbar1", "thoracic12")
    bones = {name: bone for name, bone in similar(model, 1.2, seed=1).items() if name not in links}
    morph = morph_model(model, bones, target=MorphTarget(surrounding=dict.fromkeys(links, around)))
    assert all(morph.bones[link].basis == "surrounding" for link in links)
    before = standing_poses(model)
    after = standing_poses(morph.model)
    root = after["pelvis"] @ Transform(
        bones["pelvis"].whole.rotation, bones["pelvis"].whole.translation
    )
    for one in morph.points:
        if one.body in links:
            seen = before["pelvis"].inverse().apply(before[one.body].apply(one.source))
            there = root.inverse().apply(after[one.target_body].apply(one.target))
            np.testing.assert_allclose(there, 1.2 * seen, atol=1e-9)


def trunk_with_a_link() -> Model:
    """Return a torso that slides on a pelvis, with a massless link and a muscle between them."""
    slide = Axis(
        kind="translation",
        vector=np.array([0.0, 1.0, 0.0]),
        function=linear(1.0),
        coordinates=("lift",),
    )
    joints = (
        Joint(
            name="base",
            kind="WeldJoint",
            parent="ground",
            child="pelvis",
            parent_frame=STILL,
            child_frame=STILL,
        ),
        Joint(
            name="lumbar",
            kind="WeldJoint",
            parent="pelvis",
            child="link",
            parent_frame=Transform(np.eye(3), np.array([0.0, 0.1, 0.0])),
            child_frame=STILL,
        ),
        Joint(
            name="chest",
            kind="SliderJoint",
            parent="link",
            child="torso",
            parent_frame=Transform(np.eye(3), np.array([0.0, 0.1, 0.0])),
            child_frame=STILL,
            axes=(slide,),
            coordinates=("lift",),
        ),
    )
    bodies = tuple(
        Body(name=name, mass=mass, mass_center=np.zeros(3), inertia=mass * 0.01 * np.eye(3))
        for name, mass in (("pelvis", 1.0), ("link", 0.0), ("torso", 1.0))
    )
    path = Path(
        (
            PathPoint("a", "pelvis", np.zeros(3)),
            PathPoint("b", "link", np.array([0.05, 0.02, 0.01])),
            PathPoint("c", "torso", np.zeros(3)),
        )
    )
    return Model(
        name="trunk",
        bodies=bodies,
        joints=joints,
        coordinates=(Coordinate("lift", "translational", range=(-0.1, 0.1)),),
        gravity=np.array([0.0, -9.81, 0.0]),
        muscles=(
            Muscle(
                name="one",
                kind="RigidTendonMuscle",
                path=path,
                max_isometric_force=1.0,
                optimal_fiber_length=0.1,
                tendon_slack_length=0.1,
            ),
        ),
    )


def test_a_virtual_link_follows_the_bones_around_it():
    """Two bones that grow apart move the points of the massless link between them.

    The position of its own frame does not matter.
    """
    model = trunk_with_a_link()
    corners = 0.04 * np.array(np.meshgrid(*[[-1.0, 1.0]] * 3)).reshape(3, -1).T
    turn = rotation_from_euler_xyz((0.4, 1.0, -0.3))

    def bone(body: str, matrix: np.ndarray) -> BoneMap:
        made = FeaturePoints(tuple(map(str, range(8))), corners, corners @ matrix.T)
        return replace(given(body, matrix, np.zeros(3)), features=made, basis="bone")

    morph = morph_model(
        model, {"pelvis": bone("pelvis", 1.2 * turn), "torso": bone("torso", 1.2 * np.eye(3))}
    )
    link = morph.bones["link"]
    assert link.basis == "surrounding"
    assert any("virtual link 'link'" in note for note in morph.notes)
    before = standing_poses(model)
    after = standing_poses(morph.model)
    place = next(one for one in morph.points if one.body == "link")
    np.testing.assert_allclose(
        after["link"].apply(place.target), 1.2 * before["link"].apply(place.source), atol=1e-9
    )
