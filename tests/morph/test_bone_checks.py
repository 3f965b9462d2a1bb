"""Bones that cannot be what their names say are refused by name.

What can be repaired is repaired and reported.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from myomorph.bones.morph.registration.bone_checks import (
    bone_length,
    check_bone,
    check_exchange,
    check_units,
    repaired_bone,
)
from myomorph.bones.morph.registration.nonrigid import place_bone
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface, border_of, distinct_faces, signed_volume
from scans import joined, sharper

EMPTY = Surface(np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64))
BONE = sharper(EMPTY)


def grown(factor: float) -> Surface:
    return Surface(factor * BONE.vertices, BONE.faces)


def moved(surface: Surface, angles=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)) -> Surface:
    return Surface(surface.vertices @ rotation_from_euler_xyz(angles).T + shift, surface.faces)


def repaired(surface: Surface) -> tuple[Surface, list[str]]:
    notes: list[str] = []
    return repaired_bone(surface, "the bone", notes), notes


def test_a_sound_bone_passes_unchanged():
    found, notes = repaired(BONE)
    assert notes == check_bone("femur_r", BONE, BONE) == []
    np.testing.assert_array_equal(found.faces, BONE.faces)
    np.testing.assert_array_equal(found.vertices, BONE.vertices)


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1000.0, "as if in millimeters: divide coordinates by 1000 to give meters"),
        (100.0, "as if in centimeters: divide coordinates by 100 "),
        (0.001, "as if in kilometers: divide coordinates by 0.001"),
        (1.0 / 0.0254, "as if in inches: divide coordinates by 39.37"),
        (6.0, "is it another bone, or another species"),
    ],
)
def test_other_units_are_named(factor, told):
    with pytest.raises(
        BadData, match=f"the bone of 'femur_r' is .* long, and the source's .*{told}"
    ):
        check_bone("femur_r", grown(factor), BONE)
    if factor > 10.0:
        with pytest.raises(
            BadData, match=r"no bone is longer than 3 m: give it in meters; .* in millimeters"
        ):
            check_bone("femur_r", grown(factor), None)


def test_units_are_judged_by_all_bones():
    """A person's small bone in inches alone would pass for a giant's in centimeters."""
    sizes = np.array([0.55, 0.95, 1.0, 1.1]) / 0.0254
    with pytest.raises(
        BadData, match=r"the bones are 38.* \(median of 4\), as if in inches: divide .* by 39.37 "
    ):
        check_units([(0.4 * size, 0.4) for size in sizes])
    check_units([(0.5, 0.4), (0.1, 0.4), (0.3, 0.4)])
    check_units([])


def test_a_bone_like_another_of_the_source_is_refused():
    bones = {"femur_r": BONE, "tibia_r": Surface(BONE.vertices * [1.0, 1.0, 0.4], BONE.faces)}
    with pytest.raises(
        BadData, match="the bone of 'femur_r' looks like the source's 'tibia_r', which leaves "
    ):
        check_exchange("femur_r", moved(bones["tibia_r"], shift=(0.1, 0.0, 0.0)), bones)
    check_exchange("femur_r", moved(BONE, shift=(0.1, 0.0, 0.0)), bones)


def test_another_species_is_told_by_its_size():
    with pytest.raises(BadData, match="another species"):
        check_bone("femur_r", grown(0.05), BONE)


def test_a_scanner_s_frame_is_said():
    notes = check_bone("femur_r", moved(BONE, (2.0, 0.3, 0.1), (0.0, 0.0, 0.9)), BONE)
    assert "lies turned by" in notes[0]
    assert "gets the frame of the file" in notes[0]
    far = moved(BONE, shift=(0.0, 0.0, 0.9))
    assert "0.9 m from" in check_bone("femur_r", far, BONE)[0]


def test_flipped_triangles_are_turned_and_said():
    inward = Surface(BONE.vertices, BONE.faces[:, ::-1])
    assert repaired(inward)[1] == ["the bone: all triangles pointed inward and were turned outward"]
    some = BONE.faces.copy()
    chosen = np.random.default_rng(0).choice(len(some), 40, replace=False)
    some[chosen] = some[chosen, ::-1]
    found, notes = repaired(Surface(BONE.vertices, some))
    assert notes == [
        f"the bone: 40 of {len(some)} triangles pointed inward and were turned outward"
    ]
    volume = signed_volume(found.vertices, found.faces)
    assert volume == pytest.approx(signed_volume(BONE.vertices, BONE.faces))


def test_repeated_vertices_and_empty_triangles_go():
    corners = Surface(
        BONE.vertices[BONE.faces].reshape(-1, 3), np.arange(3 * len(BONE.faces)).reshape(-1, 3)
    )
    found, notes = repaired(corners)
    assert len(found.vertices) == len(np.unique(BONE.faces))
    assert not len(border_of(found.faces))
    assert "duplicate vertices were merged" in notes[0]
    doubled = Surface(BONE.vertices, np.concatenate([BONE.faces, BONE.faces[:5], [[0, 0, 1]]]))
    assert repaired(doubled)[1] == [
        "the bone: 6 triangles without area or given twice are left out"
    ]


def test_islands_and_marrow_go_but_other_bones_stay():
    small = moved(grown(0.02), shift=(0.1, 0.0, 0.0))
    beside = moved(grown(0.6), shift=(0.08, 0.0, 0.0))
    found, notes = repaired(joined([BONE, small, beside]))
    assert notes == ["the bone: 1 loose islands of triangles are left out"]
    assert len(found.faces) == 2 * len(BONE.faces)
    hollow = joined([_sphere(1.0), _sphere(0.8)])
    found, notes = repaired(hollow)
    assert notes == ["the bone: 1 surfaces inside of it, as of marrow, are left out"]
    assert np.linalg.norm(found.vertices, axis=1).min() > 0.9


def _sphere(radius: float) -> Surface:
    ball = trimesh.creation.icosphere(2, radius)
    return Surface(ball.vertices, ball.faces)


def test_open_bones_are_said_and_laid_on_the_whole():
    """A cut bone must not shrink the whole one into it."""
    low = np.median(BONE.vertices[:, 1])
    cut = Surface(BONE.vertices, BONE.faces[(BONE.vertices[BONE.faces, 1] < low).all(axis=1)])
    found, notes = repaired(moved(cut, shift=(0.0, 0.01, 0.0)))
    assert "is open" in notes[0]
    placed = place_bone(BONE, found)
    assert placed.similarity.scale == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(placed.similarity.translation, [0.0, 0.01, 0.0], atol=2e-3)
    assert (
        check_bone("femur_r", found, BONE, start=placed.similarity)
        == check_bone("femur_r", found, BONE)
        == []
    )


@pytest.mark.parametrize(
    ("surface", "told"),
    [
        (EMPTY, "has no extent"),
        (Surface(np.zeros((3, 3)), [[0, 1, 2]]), "has no extent"),
        (Surface([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], [[0, 1, 2]]), "has no area"),
    ],
)
def test_what_is_no_surface_is_refused(surface, told):
    with pytest.raises(BadData, match=told):
        repaired(surface)


def test_length_does_not_depend_on_the_frame():
    assert bone_length(moved(BONE, (0.5, -1.0, 2.0), (1.0, 2.0, 3.0))) == pytest.approx(
        bone_length(BONE), rel=1e-9
    )


def test_meshes_with_inverted_faces(data):
    """The left tibia has 47 of its triangles inverted.

    Its twin shows which, but for the few where three meet an edge.
    """
    inverted = read_mesh(data("bones-opensim-rajagopal/Geometry/l_tibia_SOMEINVERTEDFACES.vtp"))
    sound = read_mesh(data("bones-opensim-rajagopal/Geometry/l_tibia.vtp"))

    def differing(one: Surface, other: Surface) -> int:
        turned = [
            np.array([np.roll(face, -np.argmin(face)) for face in distinct_faces(mesh.faces)])
            for mesh in (one, other)
        ]
        return int((turned[0] != turned[1]).any(axis=1).sum())

    assert differing(inverted, sound) == 47
    found, notes = repaired(inverted)
    assert differing(found, sound) <= 7
    assert any(
        "54 of 374 triangles pointed inward and were turned outward" in note for note in notes
    )
    assert any("is open" in note for note in notes)


@pytest.mark.long
def test_the_same_side_of_a_person_passes_in_meters(data):
    right = read_mesh(data("bones-opensim-rajagopal/Geometry/r_femur.vtp"))
    scan = read_mesh(data("bones-mri-two-adults/MC22/femur_r.ply"))
    with pytest.raises(BadData, match="as if in millimeters"):
        check_bone("femur_r", scan, right)
    notes = check_bone("femur_r", Surface(1e-3 * scan.vertices, scan.faces), right)
    assert not any("another shape" in note for note in notes)
