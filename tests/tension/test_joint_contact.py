"""Forces at contact points of joints.

Known pushes are recovered, points lift off, what is left is reported.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.mesh import read_surfaces
from myomorph.core.io.osim.read import read_osim
from myomorph.core.model.errors import BadData, BadModel, UnknownName
from myomorph.core.model.model import GROUND
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.joint_contact import ContactPoint, joint_contact_forces, shared_force
from myomorph.core.tension.knee_points import HALF_SPACING, knee_points
from trees import random_rotation, random_tree

DOWN = np.array([0.0, -1.0, 0.0])
PAIR = np.array([[0.0, 0.0, -0.02], [0.0, 0.0, 0.026]])
GEOMETRY = "bones-opensim-rajagopal/Geometry"


def wrench_of(pushes, points, normals, center):
    """Force and moment about a center of pushes (frames, points) at points along normals."""
    forces = pushes[..., None] * normals
    return forces.sum(axis=1), np.cross(points - center[:, None], forces).sum(axis=1)


def unit(vectors):
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


@pytest.mark.parametrize("count", [1, 2, 3])
@pytest.mark.parametrize("tilt", [0.0, 0.15])
def test_known_pushes_come_back(count, tilt):
    rng = np.random.default_rng(count)
    points = rng.normal(scale=0.03, size=(7, count, 3))
    normals = unit(np.array([0.1, -1.0, 0.2]) + tilt * rng.normal(size=(7, count, 3)))
    pushes = rng.uniform(100.0, 2000.0, (7, count))
    center = rng.normal(scale=0.1, size=(7, 3))
    force, moment = wrench_of(pushes, points, normals, center)
    found, shear, pulled, left = shared_force(force, moment, center, points, normals)
    assert np.abs(found - pushes).max() < 1e-6 * pushes.max()
    assert pulled.max() == 0.0
    assert left.max() < 1e-6
    if tilt == 0.0:
        assert shear.max() < 1e-9 * pushes.max()


def test_two_points_balance_the_moment_across_their_line_and_nothing_else():
    """Winby et al. 2009, equation of the medial force.

    It is the moment about the lateral point over the distance.
    """
    rng = np.random.default_rng(5)
    points = np.broadcast_to(PAIR, (9, 2, 3))
    normals = np.broadcast_to(DOWN, (9, 2, 3))
    force = np.column_stack(
        [rng.normal(scale=50.0, size=9), -rng.uniform(800, 2000, 9), rng.normal(scale=50.0, size=9)]
    )
    moment = rng.normal(scale=4.0, size=(9, 3))
    found, shear, _, left = shared_force(force, moment, np.zeros((9, 3)), points, normals)
    about_lateral = moment[:, 0] + PAIR[1, 2] * force[:, 1]
    medial = about_lateral / (PAIR[1, 2] - PAIR[0, 2]) * -1.0
    assert found[:, 0] == pytest.approx(medial, rel=1e-9)
    assert found.sum(axis=1) == pytest.approx(-force[:, 1], rel=1e-9)
    assert shear == pytest.approx(np.hypot(force[:, 0], force[:, 2]), rel=1e-12)
    assert left.max() < 1e-8


def test_a_point_that_would_pull_lifts_off_and_its_moment_is_left():
    """1000 N beyond the lateral point by 10 mm: all of it there, and 10 N m are left."""
    force = np.array([[0.0, -1000.0, 0.0]])
    at = PAIR[1] + [0.0, 0.0, 0.01]
    found, _, pulled, left = shared_force(
        force, np.cross(at, force), np.zeros((1, 3)), PAIR[None], np.tile(DOWN, (1, 2, 1))
    )
    assert found[0] == pytest.approx([0.0, 1000.0], abs=1e-3)
    assert left[0] == pytest.approx(10.0, rel=1e-6)
    assert pulled[0] == 0.0


def test_bodies_that_are_pulled_apart_have_no_contact_force():
    force = np.array([[0.0, 300.0, 40.0]])
    found, shear, pulled, _ = shared_force(
        force, np.zeros((1, 3)), np.zeros((1, 3)), PAIR[None], np.tile(DOWN, (1, 2, 1))
    )
    assert found[0] == pytest.approx([0.0, 0.0], abs=1e-9)
    assert (shear[0], pulled[0]) == pytest.approx((40.0, 300.0))


def test_equal_ways_share_evenly():
    corners = np.array([[[x, 0.0, z] for x in (-0.02, 0.02) for z in (-0.03, 0.03)]])
    found, *_ = shared_force(
        np.array([[0.0, -800.0, 0.0]]),
        np.zeros((1, 3)),
        np.zeros((1, 3)),
        corners,
        np.tile(DOWN, (1, 4, 1)),
    )
    assert found[0] == pytest.approx(np.full(4, 200.0), rel=1e-4)


def test_frames_do_not_matter():
    rng = np.random.default_rng(2)
    points = rng.normal(scale=0.03, size=(4, 3, 3))
    normals = unit(DOWN + 0.2 * rng.normal(size=(4, 3, 3)))
    force = np.tile([50.0, -900.0, 30.0], (4, 1))
    moment = rng.normal(scale=20.0, size=(4, 3))
    center = rng.normal(scale=0.05, size=(4, 3))
    R = random_rotation(rng)
    move = rng.normal(size=3)
    here = shared_force(force, moment, center, points, normals)
    there = shared_force(
        force @ R.T, moment @ R.T, center @ R.T + move, points @ R.T + move, normals @ R.T
    )
    for one, other in zip(here, there, strict=True):
        assert one == pytest.approx(other, rel=1e-7, abs=1e-6)


def test_gaps_stay_gaps():
    force = np.array([[0.0, -1000.0, 0.0], [np.nan] * 3])
    found, *_ = shared_force(
        force,
        np.zeros((2, 3)),
        np.zeros((2, 3)),
        np.tile(PAIR, (2, 1, 1)),
        np.tile(DOWN, (2, 2, 1)),
    )
    assert np.isfinite(found[0]).all()
    assert np.isnan(found[1]).all()


def test_normals_against_each_other_are_refused():
    normals = np.stack([DOWN, -DOWN])[None]
    with pytest.raises(BadData, match="against each other"):
        shared_force(np.zeros((1, 3)), np.zeros((1, 3)), np.zeros((1, 3)), PAIR[None], normals)


def test_loads_on_a_body_come_back_at_the_joint_that_holds_it():
    """A body without gravity, pushed at two points: its joint pushes back at the same points."""
    model = replace(random_tree(4), gravity=np.zeros(3))
    joint = model.joints[-1]
    c = np.random.default_rng(4).normal(scale=0.5, size=(3, len(model.coordinates)))
    motion = Motion(
        time=np.arange(3.0),
        names=model.coordinate_names,
        values=c,
        velocities=np.zeros_like(c),
        accelerations=np.zeros_like(c),
    )
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    turn = poses.rotations[:, tree.body_index[joint.child]]
    origin = poses.origins[:, tree.body_index[joint.child], None]
    pushes = np.array([700.0, 300.0])
    normal = (0.3, -0.9, 0.1)
    direction = turn @ unit(np.array(normal))
    wrenches = Wrenches(
        time=motion.time,
        names=("one", "other"),
        bodies=(joint.child,) * 2,
        forces=-pushes[:, None] * direction[:, None],
        points=origin + np.einsum("fij,pj->fpi", turn, PAIR),
        torques=np.zeros((3, 2, 3)),
    )
    points = [
        ContactPoint(
            joint=joint.name, name=name, frame=joint.child, point=tuple(place), normal=normal
        )
        for name, place in zip("ab", PAIR, strict=True)
    ]
    found = joint_contact_forces(model, motion, None, wrenches, points)
    assert found.joint_contact_force == pytest.approx(np.tile(pushes, (3, 1)), rel=1e-7)
    assert found.of(joint.name, "b") == pytest.approx(np.full(3, 300.0))
    assert found.joint_contact_total[:, 0] == pytest.approx(np.full(3, 1000.0))
    assert found.table().names[:3] == (f"total_{joint.name}", f"a_{joint.name}", f"b_{joint.name}")
    grounded = [replace(one, frame=GROUND) for one in points]
    assert joint_contact_forces(
        model, motion, None, wrenches, grounded
    ).joint_contact_total == pytest.approx(found.joint_contact_total)


def test_wrong_points_are_named():
    model = replace(random_tree(4), gravity=np.zeros(3))
    joint = model.joints[-1]
    c = np.zeros((1, len(model.coordinates)))
    motion = Motion(
        time=np.zeros(1), names=model.coordinate_names, values=c, velocities=c, accelerations=c
    )
    point = ContactPoint(
        joint=joint.name, name="a", frame="", point=(0.0, 0.0, 0.0), normal=(0.0, -1.0, 0.0)
    )

    def solve(*points):
        return joint_contact_forces(model, motion, None, None, points)

    with pytest.raises(BadData, match="no contact points"):
        solve()
    with pytest.raises(UnknownName, match="kneee"):
        solve(replace(point, joint="kneee"))
    with pytest.raises(BadData, match="unknown frame 'nowhere'"):
        solve(replace(point, frame="nowhere"))
    with pytest.raises(BadData, match="two contact points 'a'"):
        solve(point, point)
    with pytest.raises(BadData, match="no direction"):
        solve(replace(point, normal=(0.0, 0.0, 0.0)))
    last = next(
        one for one in model.joints if all(other.parent != one.child for other in model.joints)
    )
    with pytest.raises(BadData, match="no normal, and no joint follows"):
        solve(ContactPoint(joint=last.name, name="a", frame="", point=(0.0, 0.0, 0.0)))


@pytest.fixture(scope="module")
def walker(data):
    return read_osim(data("rajagopal-walk-emg/subject_walk_scaled.osim")), data(GEOMETRY)


def test_points_of_knees_lie_under_the_condyles(walker):
    """Medial inside, lateral outside, right and left mirrored, some 46 mm apart in a man."""
    model, bones = walker
    found = knee_points(model, read_surfaces(model, [bones])[0])
    assert found.notes == ()
    places = {(one.joint, one.name): np.array(one.point) for one in found.points}
    for side, sign in (("r", 1.0), ("l", -1.0)):
        medial = places[f"walker_knee_{side}", "medial"]
        lateral = places[f"walker_knee_{side}", "lateral"]
        assert 0.040 < sign * (lateral - medial)[2] < 0.056
        assert sign * medial[2] < 0.0 < sign * lateral[2]
    mirror = np.array([1.0, 1.0, -1.0])
    assert places["walker_knee_l", "medial"] == pytest.approx(
        mirror * places["walker_knee_r", "medial"], abs=1e-3
    )
    assert places["walker_knee_l", "lateral"] == pytest.approx(
        mirror * places["walker_knee_r", "lateral"], abs=1e-3
    )


def test_a_missing_bone_is_the_other_sides_or_a_distance_and_told(walker):
    model, bones = walker
    surfaces = read_surfaces(model, [bones])[0]
    left = next(one.file for one in model.body("femur_l").meshes if one.file in surfaces)
    whole = knee_points(model, surfaces)
    mirrored = knee_points(model, {name: one for name, one in surfaces.items() if name != left})
    assert "mirrored" in mirrored.notes[0]
    for one, other in zip(whole.points, mirrored.points, strict=True):
        assert np.array(one.point) == pytest.approx(other.point, abs=1e-3)
    bare = knee_points(model, {})
    assert len(bare.notes) == 2
    assert "no mesh of 'femur_r'" in bare.notes[0]
    knee = next(one for one in model.joints if one.name == "walker_knee_r")
    hip = next(one for one in model.joints if one.child == "femur_r")
    length = np.linalg.norm(knee.parent_frame.translation - hip.child_frame.translation)
    medial, lateral = bare.points[:2]
    medial = np.array(medial.point)
    lateral = np.array(lateral.point)
    assert np.linalg.norm(lateral - medial) == pytest.approx(2.0 * HALF_SPACING * length)
    assert 0.5 * (medial + lateral) == pytest.approx(knee.child_frame.translation, abs=1e-12)
    # What the bone says is near: the constant was measured on it.
    assert 2.0 * HALF_SPACING * length == pytest.approx(
        np.linalg.norm(np.subtract(whole.points[1].point, whole.points[0].point)), rel=0.1
    )


def test_parts_of_an_implant_that_are_welded_to_the_bones_change_no_point(walker):
    """The points of both knees, where one femur and tibia carry a part each, turned against it."""
    model, _ = walker
    turned = random_rotation(np.random.default_rng(2))
    knee = next(one for one in model.joints if one.name == "walker_knee_r")
    weld = replace(
        knee,
        name="component_weld",
        kind="WeldJoint",
        child="femoral_component_r",
        child_frame=Transform(turned, np.array([0.01, 0.02, 0.03])),
        axes=(),
        coordinates=(),
    )
    moved = replace(knee, parent="femoral_component_r", parent_frame=weld.child_frame)
    part = replace(model.body("patella_r"), name="femoral_component_r", mass=0.0, meshes=())
    joints = tuple(joint for one in model.joints for joint in _with_part(one, weld, moved))
    at = 1 + model.body_names.index("femur_r")
    bodies = (*model.bodies[:at], part, *model.bodies[at:])
    parted = replace(model, bodies=bodies, joints=joints)
    for found, plain in zip(
        knee_points(parted, {}).points, knee_points(model, {}).points, strict=True
    ):
        assert found.point == pytest.approx(plain.point, abs=1e-9)


def _with_part(joint, weld, knee):
    """Put its weld before a knee."""
    return (weld, knee) if joint.name == knee.name else (joint,)


def test_a_knee_without_a_side_in_its_name_is_on_the_side_that_the_other_leaves(
    walker, tmp_path, data
):
    text = data("rajagopal-walk-emg/subject_walk_scaled.osim").read_text(encoding="utf-8")
    bare = tmp_path / "bare.osim"
    bare.write_text(
        text.replace("tibia_r<", "tibia<")
        .replace('"tibia_r"', '"tibia"')
        .replace("walker_knee_r", "walker_knee"),
        encoding="utf-8",
    )
    points = knee_points(read_osim(bare), {}).points
    for found, plain in zip(points, knee_points(walker[0], {}).points, strict=True):
        assert found.point == pytest.approx(plain.point, abs=1e-12)


def test_a_model_without_knees_is_told_so():
    with pytest.raises(BadModel, match="has no knee"):
        knee_points(random_tree(1), {})


@pytest.mark.parametrize(("opposed", "refused"), [(0.95, True), (0.5, False)])
def test_normals_that_nearly_cancel_are_refused(opposed, refused):
    """Of eight points the mean normal is judged, not their sum.

    A sum of 0.4 is refused, one of 4 is not.
    """
    normals = np.tile([0.0, 1.0, 0.0], (1, 8, 1))
    normals[0, :, 1] = np.where(np.arange(8) % 2, 1.0, 1.0 - 2.0 * opposed)
    normals[0, :, 0] = np.sqrt(1.0 - normals[0, :, 1] ** 2) * np.where(
        np.arange(8) % 4 < 2, 1.0, -1.0
    )
    points = np.random.default_rng(0).uniform(-0.02, 0.02, (1, 8, 3))
    given = np.array([[0.0, 500.0, 0.0]]), np.zeros((1, 3)), np.zeros((1, 3)), points, normals
    if refused:
        with pytest.raises(BadData, match="point against each other"):
            shared_force(*given)
    else:
        assert np.isfinite(shared_force(*given)[0]).all()
