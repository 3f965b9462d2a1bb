import base64
import json
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.functions import linear
from myomorph.core.model.model import Mesh
from myomorph.core.model.paths import MovingPathPoint, Path, PathPoint
from myomorph.core.model.series import Series
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.model.surface import Surface
from myomorph.lab.report.scene.pictures import (
    HIDDEN,
    MAX_TRIANGLES,
    frames_to_play,
    pictures,
    player,
)
from myomorph.lab.report.scene.raster import FAR, Canvas, View
from myomorph.lab.report.scene.scene import Acting, make_scene
from myomorph.lab.report.scene.shapes import coarser, normals, primitive, stick
from walker import GRAVITY, Tension, model, motion, steps

IDENTITY = Transform.identity()


def volume(surface: Surface) -> float:
    a, b, c = surface.vertices[surface.faces].transpose(1, 0, 2)
    return abs(float(np.einsum("ij,ij->", a, np.cross(b, c)))) / 6


def test_primitives_have_the_size_they_are_given() -> None:
    ball = primitive(Mesh(file="", pose=IDENTITY, scale=np.array([0.2, 0, 0]), shape="sphere"))
    box = primitive(Mesh(file="", pose=IDENTITY, scale=np.array([1.0, 2.0, 3.0]), shape="box"))
    assert ball is not None
    assert box is not None
    assert volume(ball) == pytest.approx(4 / 3 * np.pi * 0.2**3, rel=0.12)
    assert volume(box) == pytest.approx(48.0)
    for shape, size, extent in (
        ("cylinder", [0.1, 0.5, 0.0], [0.2, 0.2, 1.0]),  # MuJoCo: along z
        ("cylinder", [0.1, 0.5, 0.1], [0.2, 1.0, 0.2]),  # OpenSim: along y
        ("capsule", [0.1, 0.5, 0.0], [0.2, 0.2, 1.2]),
        ("ellipsoid", [0.1, 0.2, 0.3], [0.2, 0.4, 0.6]),
    ):
        made = primitive(Mesh(file="", pose=IDENTITY, scale=np.array(size), shape=shape))
        assert made is not None
        assert np.ptp(made.vertices, axis=0) == pytest.approx(extent, rel=0.06), shape
    assert primitive(Mesh("femur.vtp", IDENTITY, np.ones(3))) is None


def test_a_stick_reaches_from_end_to_end() -> None:
    start = np.array([0.1, 0.2, 0.3])
    end = np.array([0.1, -0.5, 0.9])
    along = (end - start) / np.linalg.norm(end - start)
    heights = (stick(start, end, 0.05).vertices - start) @ along
    assert (heights.min(), heights.max()) == pytest.approx((0.0, np.linalg.norm(end - start)))


def test_a_coarser_surface_stays_where_it_was() -> None:
    fine = primitive(Mesh(file="", pose=IDENTITY, scale=np.full(3, 0.2), shape="sphere"))
    assert fine is not None
    rough = coarser(fine, 0.1)
    assert 4 <= len(rough.faces) < len(fine.faces)
    assert np.abs(rough.vertices).max() <= 0.2
    assert volume(rough) > 0.4 * volume(fine)


def test_normals_of_a_ball_point_outwards() -> None:
    ball = primitive(Mesh(file="", pose=IDENTITY, scale=np.ones(3), shape="sphere"))
    assert ball is not None
    outward = np.einsum("ij,ij->i", normals(ball), ball.vertices)
    assert np.abs(outward[np.linalg.norm(normals(ball), axis=1) > 0]).min() > 0.95


def test_a_ball_covers_a_disk_and_what_is_nearer_hides_it() -> None:
    view = View(axes=np.eye(3), center=np.zeros(3), scale=100.0, width=120, height=100)
    canvas = Canvas(view)
    ball = primitive(Mesh(file="", pose=IDENTITY, scale=np.full(3, 0.3), shape="sphere"))
    assert ball is not None
    canvas.surface(ball.vertices, normals(ball), ball.faces, (1.0, 1.0, 1.0))
    # A disk of 30 pixels, less what the ball's 14 sides cut off.
    assert np.sum(canvas.near > FAR) == pytest.approx(
        7 * np.sin(2 * np.pi / 14) * (30 * np.sin(np.deg2rad(80))) ** 2, rel=0.01
    )
    assert canvas.near.max() == pytest.approx(30.0, rel=0.05)
    green = canvas.color.copy()
    ends = np.array([[-0.5, 0.0, -1.0], [0.5, 0.0, -1.0]])
    canvas.tubes(ends[:1], ends[1:], np.full((1, 2), 0.05), np.array([[0.0, 1.0, 0.0]]))
    assert np.array_equal(canvas.color[50, 60], green[50, 60])
    assert canvas.color[50, 15, 1] > 0
    canvas.tubes(
        ends[:1] + [0, 0, 2],
        ends[1:] + [0, 0, 2],
        np.full((1, 2), 0.05),
        np.array([[0.0, 1.0, 0.0]]),
    )
    assert canvas.color[50, 60, 0] == 0.0
    pixels = canvas.picture(2)
    assert pixels.shape == (50, 60, 4)
    assert pixels[0, 0, 3] == 0
    assert pixels[25, 30, 3] == 255


def test_the_walker_looks_along_x() -> None:
    body = model()
    scene = make_scene(body, motion(body), [0, 50])
    assert scene.forward == pytest.approx([1, 0, 0], abs=1e-9)
    assert scene.right == pytest.approx([0, 0, 1], abs=1e-9)
    assert scene.size == pytest.approx(0.9, abs=0.1)
    assert len(scene.muscles) == len(body.muscles)


def test_a_turned_laboratory_turns_the_view() -> None:
    """Everything of the scene turns with the ground frame."""
    body = model()
    turn = Transform(axis_rotation((1, 0, 0), np.pi / 2), np.zeros(3))
    root, *rest = body.joints
    turned = replace(
        body,
        joints=(replace(root, parent_frame=turn @ root.parent_frame), *rest),
        gravity=turn.rotation @ body.gravity,
    )
    plain = make_scene(body, motion(body), [0, 50])
    other = make_scene(turned, motion(body), [0, 50])
    assert other.up == pytest.approx(turn.rotation @ plain.up, abs=1e-12)
    assert other.forward == pytest.approx(turn.rotation @ plain.forward, abs=1e-9)
    for one, two in zip(plain.muscles, other.muscles, strict=True):
        assert two.points == pytest.approx(turn.apply(one.points), abs=1e-12)


def test_points_that_come_and_go_and_points_that_move() -> None:
    body = model()
    first = body.muscles[0]
    conditional = PathPoint(
        name="c", body="femur_r", location=np.zeros(3), coordinate="knee_angle_r", range=(-0.5, 2.0)
    )
    moving = MovingPathPoint(
        name="m",
        body="femur_r",
        functions=(linear(0.1), linear(0.0, 0.2), linear(0.0)),
        coordinates=("knee_angle_r", "", ""),
    )
    path = Path((first.path.points[0], conditional, moving))
    changed = replace(body, muscles=(replace(first, path=path),))
    movement = motion(body)
    scene = make_scene(changed, movement, range(len(movement)))
    knee = movement["knee_angle_r"]
    points = scene.muscles[0].points
    count = np.isfinite(points[..., 0]).sum(axis=1)
    # As in OpenSim, a range is a little wider than it says.
    clear = np.abs(knee + 0.5) > 1e-4
    assert np.array_equal(count[clear] == 2, knee[clear] < -0.5)
    assert set(count) == {2, 3}
    thigh = body.body_names.index("femur_r") + 1
    last = points[np.arange(len(points)), count - 1]
    local = np.einsum("fji,fj->fi", scene.rotations[:, thigh], last - scene.origins[:, thigh])
    assert local == pytest.approx(
        np.stack([0.1 * knee, 0.2 + 0 * knee, 0 * knee], axis=1), abs=1e-12
    )


def test_meshes_take_the_place_of_sticks() -> None:
    body = model()
    shape = Surface(np.eye(3), np.array([[0, 1, 2]]))
    mesh = Mesh(
        "femur.vtp", Transform(np.eye(3), np.array([0.0, -0.1, 0.0])), np.array([2.0, 1.0, 1.0])
    )
    bodies = tuple(
        replace(one, meshes=(mesh,)) if one.name == "femur_r" else one for one in body.bodies
    )
    dressed = replace(body, bodies=bodies)
    number = body.body_names.index("femur_r") + 1
    found = [
        one
        for one in make_scene(dressed, motion(body), [0], {"femur.vtp": shape}).solids
        if one.body == number
    ]
    assert [one.surface.vertices.tolist() for one in found] == [
        [[2.0, -0.1, 0.0], [0.0, 0.9, 0.0], [0.0, -0.1, 1.0]]
    ]
    bare = [one for one in make_scene(dressed, motion(body), [0], {}).solids if one.body == number]
    assert len(bare) == 1
    assert len(bare[0].surface.faces) > 20


def test_activations_outside_the_solution_are_unknown() -> None:
    body = model()
    movement = motion(body)
    tension = Tension(body, movement.time[50:100])
    series = Series(tension.time, tension.muscles, tension.activation)
    scene = make_scene(body, movement, [0, 60, 150], acting=Acting(activations=series))
    active = scene.muscles[0].activation
    assert np.isnan(active[[0, 2]]).all()
    assert active[1] == pytest.approx(tension.activation[10, 0])


def test_pictures_share_one_scale() -> None:
    body = model()
    movement = motion(body)
    scene = make_scene(
        body, movement, [20, 90], acting=Acting(wrenches=steps(movement.time, body.mass * GRAVITY))
    )
    found = pictures(scene, (120, 420))
    assert [(one.frame, one.view) for one in found] == [
        (0, "side"),
        (1, "side"),
        (0, "front"),
        (1, "front"),
    ]
    assert len({(one.width, one.height) for one in found if one.view == "side"}) == 1
    assert all(one.image.startswith(b"\x89PNG") for one in found)


def _decoded(text: str, kind: str) -> np.ndarray:
    return np.frombuffer(base64.b64decode(text), kind)


def test_the_player_holds_the_scene() -> None:
    body = replace(model(), muscles=(replace(model().muscles[0], name="</script><b>"),))
    movement = motion(body)
    scene = make_scene(body, movement, range(0, 200, 10))
    text = player(scene)
    assert "</script" not in text
    told = json.loads(text)
    assert told["names"] == ["</script><b>"]
    points = _decoded(told["points"], "<i2").reshape(20, -1, 3)
    assert points.min() > HIDDEN
    assert np.array(told["middle"]) + points * told["step"] == pytest.approx(
        scene.muscles[0].points, abs=1.01 * told["step"]
    )
    poses = _decoded(told["poses"], "<f4").reshape(20, told["poseCount"], 12)
    assert poses[:, 0, 9:] == pytest.approx(scene.origins[:, 1], abs=1e-6)
    assert max(told["bodies"]) < told["poseCount"]
    solid = told["solids"][0]
    vertices = (
        np.array(solid["low"]) + _decoded(solid["vertices"], "<i2").reshape(-1, 3) * solid["step"]
    )
    assert np.ptp(vertices, axis=0) == pytest.approx(
        np.ptp(scene.solids[0].surface.vertices, axis=0), rel=0.05
    )
    assert _decoded(solid["faces"], "<u2").max() < len(vertices)


def test_the_player_keeps_to_its_budget() -> None:
    assert frames_to_play(36000, 520 * 8, 90) * (6 * 520 * 8 + 48 * 90) <= 2_600_000
    assert frames_to_play(50, 100, 10) == 50
    body = model()
    grid = np.stack(
        np.meshgrid(np.linspace(0, 0.4, 120), np.linspace(0, 0.4, 120), [0.0]), axis=-1
    ).reshape(-1, 3)
    corner = np.array([i * 120 + j for i in range(119) for j in range(119)])
    dense = Surface(
        grid,
        np.concatenate(
            [
                np.stack([corner, corner + 1, corner + 120], 1),
                np.stack([corner + 1, corner + 121, corner + 120], 1),
            ]
        ),
    )
    mesh = Mesh("dense.stl", IDENTITY, np.ones(3))
    heavy = replace(body, bodies=tuple(replace(one, meshes=(mesh,)) for one in body.bodies))
    told = json.loads(player(make_scene(heavy, motion(body), [0], {"dense.stl": dense})))
    total = sum(len(_decoded(one["faces"], "<u2")) for one in told["solids"]) / 3
    assert 1000 < total <= MAX_TRIANGLES


@pytest.mark.parametrize("side", [1.0, -1.0])
def test_a_mirrored_mesh_keeps_its_outside(side: float) -> None:
    corners = np.array([[0.0, 0.0, 0.0], [1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, 0.0, 1.0]])
    outward = Surface(corners, np.array([[0, 2, 1], [0, 1, 3], [0, 3, 2], [1, 2, 3]]))
    bone = replace(
        model().bodies[0], meshes=(Mesh("bone.obj", IDENTITY, np.array([1.0, 1.0, side])),)
    )
    drawn = replace(model(), bodies=(bone, *model().bodies[1:]))
    solid = make_scene(drawn, motion(drawn), [0], {"bone.obj": outward}).solids[0].surface
    a, b, c = solid.vertices[solid.faces].transpose(1, 0, 2)
    assert np.einsum("ij,ij->", a, np.cross(b, c)) / 6 == pytest.approx(1 / 6)
