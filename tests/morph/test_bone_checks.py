"""Bones that cannot be what they are said to be are refused by name; what can be repaired is, and said."""

from __future__ import annotations

import numpy as np
import pytest
import trimesh

from myomorph.io.mesh import read_mesh
from myomorph.model.errors import BadData
from myomorph.model.spatial import rotation_from_euler_xyz
from myomorph.model.surface import Surface, border_of, distinct_faces, signed_volume
from myomorph.morph.maps.linear import Similarity
from myomorph.morph.registration.bone_checks import bone_length, check_bone, mirrored_surface, repaired_bone
from scans import joined, sharper

EMPTY = Surface(np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64))
BONE = sharper(EMPTY)
HERE = Similarity(np.eye(3), np.zeros(3))


def grown(factor: float) -> Surface:
    return Surface(factor * BONE.vertices, BONE.faces)


def moved(surface: Surface, angles=(0.0, 0.0, 0.0), shift=(0.0, 0.0, 0.0)) -> Surface:
    return Surface(surface.vertices @ rotation_from_euler_xyz(angles).T + shift, surface.faces)


def test_a_sound_bone_passes_unchanged():
    found = check_bone("femur_r", BONE, BONE)
    assert found.notes == ()
    np.testing.assert_array_equal(found.surface.faces, BONE.faces)
    np.testing.assert_array_equal(found.surface.vertices, BONE.vertices)
    assert found.whole is not None
    np.testing.assert_allclose(found.whole.rotation, np.eye(3), atol=1e-3)
    assert found.residual < 1e-3
    assert not found.mirrored


@pytest.mark.parametrize(
    ("factor", "told"),
    [
        (1000.0, "as if in millimeters: divide its coordinates by 1000 to give meters"),
        (100.0, "as if in centimeters: divide its coordinates by 100 "),
        (0.001, "as if in kilometers: divide its coordinates by 0.001"),
        (6.0, "is it another bone, or another species"),
    ],
)
def test_other_units_are_named(factor, told):
    with pytest.raises(BadData, match=f"the bone of 'femur_r' is .* long, and the source's bone is .*{told}"):
        check_bone("femur_r", grown(factor), BONE)
    if factor > 10.0:
        with pytest.raises(BadData, match=r"no bone is longer than 3 m: give it in meters; .* in millimeters"):
            check_bone("femur_r", grown(factor), None)


def test_another_species_is_told_by_its_size():
    with pytest.raises(BadData, match="another species"):
        check_bone("femur_r", grown(0.05), BONE)
    assert check_bone("femur_r", grown(0.05), BONE, start=HERE, expected_scale=0.05).notes == ()
    with pytest.raises(BadData, match="millimeters"):
        check_bone("femur_r", grown(50.0), BONE, expected_scale=0.05)


def test_a_bone_of_the_other_side_is_refused_or_said():
    other = moved(mirrored_surface(BONE), (0.3, 1.0, -2.0))
    with pytest.raises(BadData, match=r"fits the mirrored bone of the source better .* one of the other side"):
        check_bone("femur_r", other, BONE)
    found = check_bone("femur_r", other, BONE, allow_mirror=True)
    assert found.mirrored
    assert any("other side" in note for note in found.notes)
    assert not check_bone("femur_r", moved(BONE, (0.3, 1.0, -2.0)), BONE).mirrored


def test_mirroring_twice_changes_nothing_and_keeps_the_outside_outside():
    mirror = mirrored_surface(BONE)
    assert signed_volume(mirror.vertices, mirror.faces) == pytest.approx(signed_volume(BONE.vertices, BONE.faces))
    again = mirrored_surface(mirror)
    np.testing.assert_array_equal(again.vertices, BONE.vertices)
    np.testing.assert_array_equal(again.faces, BONE.faces)


def test_a_scanner_s_frame_is_said():
    found = check_bone("femur_r", moved(BONE, (2.0, 0.3, 0.1), (0.0, 0.0, 0.9)), BONE)
    assert "lies turned by" in found.notes[0]
    assert "takes over the frame of the file" in found.notes[0]
    far = moved(BONE, shift=(0.0, 0.0, 0.9))
    assert "0.9 m from" in check_bone("femur_r", far, BONE).notes[0]


def test_flipped_triangles_are_turned_and_said():
    inward = Surface(BONE.vertices, BONE.faces[:, ::-1])
    found = check_bone("femur_r", inward, BONE, start=HERE)
    assert found.notes == ("the bone of 'femur_r': all triangles looked inward and were turned outward",)
    some = BONE.faces.copy()
    chosen = np.random.default_rng(0).choice(len(some), 40, replace=False)
    some[chosen] = some[chosen, ::-1]
    found = check_bone("femur_r", Surface(BONE.vertices, some), BONE, start=HERE)
    assert found.notes == (f"the bone of 'femur_r': 40 of {len(some)} triangles looked inward and were turned outward",)
    volume = signed_volume(found.surface.vertices, found.surface.faces)
    assert volume == pytest.approx(signed_volume(BONE.vertices, BONE.faces))


def test_repeated_vertices_and_empty_triangles_go():
    corners = Surface(BONE.vertices[BONE.faces].reshape(-1, 3), np.arange(3 * len(BONE.faces)).reshape(-1, 3))
    notes: list[str] = []
    repaired = repaired_bone(corners, "the bone", notes)
    assert len(repaired.vertices) == len(np.unique(BONE.faces))
    assert not len(border_of(repaired.faces))
    assert "vertices that lie on others became one" in notes[0]
    doubled = Surface(BONE.vertices, np.concatenate([BONE.faces, BONE.faces[:5], [[0, 0, 1]]]))
    notes = []
    repaired_bone(doubled, "the bone", notes)
    assert notes == ["the bone: 6 triangles without area or given twice are left out"]


def test_islands_and_marrow_go_but_other_bones_stay():
    small = moved(grown(0.02), shift=(0.1, 0.0, 0.0))
    beside = moved(grown(0.6), shift=(0.08, 0.0, 0.0))
    notes: list[str] = []
    repaired = repaired_bone(joined([BONE, small, beside]), "the bone", notes)
    assert notes == ["the bone: 1 loose islands of triangles are left out"]
    assert len(repaired.faces) == 2 * len(BONE.faces)
    hollow = joined([_sphere(1.0), _sphere(0.8)])
    notes = []
    repaired = repaired_bone(hollow, "the bone", notes)
    assert notes == ["the bone: 1 surfaces inside of it, as of marrow, are left out"]
    assert np.linalg.norm(repaired.vertices, axis=1).min() > 0.9


def _sphere(radius: float) -> Surface:
    ball = trimesh.creation.icosphere(2, radius)
    return Surface(ball.vertices, ball.faces)


def test_open_bones_are_said_and_laid_on_the_whole():
    """A cut bone must not shrink the whole one into it."""
    low = np.median(BONE.vertices[:, 1])
    cut = Surface(BONE.vertices, BONE.faces[(BONE.vertices[BONE.faces, 1] < low).all(axis=1)])
    found = check_bone("femur_r", moved(cut, shift=(0.0, 0.01, 0.0)), BONE)
    assert "is open" in found.notes[0]
    assert found.whole is not None
    assert found.whole.scale == pytest.approx(1.0, abs=0.02)
    np.testing.assert_allclose(found.whole.translation, [0.0, 0.01, 0.0], atol=2e-3)


@pytest.mark.parametrize(
    ("surface", "told"),
    [
        (EMPTY, "has no triangles"),
        (Surface(np.zeros((3, 3)), [[0, 1, 2]]), "has no extent"),
        (Surface([[0.0, 0, 0], [0.1, 0, 0], [0.2, 0, 0]], [[0, 1, 2]]), "has no area"),
    ],
)
def test_what_is_no_surface_is_refused(surface, told):
    with pytest.raises(BadData, match=told):
        check_bone("femur_r", surface, None)


def test_length_does_not_depend_on_the_frame():
    assert bone_length(moved(BONE, (0.5, -1.0, 2.0), (1.0, 2.0, 3.0))) == pytest.approx(bone_length(BONE), rel=1e-9)


def test_meshes_with_inverted_faces(data):
    """The left tibia has 47 of its triangles turned; its twin tells which, but for the few where three meet an edge."""
    inverted = read_mesh(data("bones-opensim-rajagopal/Geometry/l_tibia_SOMEINVERTEDFACES.vtp"))
    sound = read_mesh(data("bones-opensim-rajagopal/Geometry/l_tibia.vtp"))

    def differing(one: Surface, other: Surface) -> int:
        turned = [
            np.array([np.roll(face, -np.argmin(face)) for face in distinct_faces(mesh.faces)]) for mesh in (one, other)
        ]
        return int((turned[0] != turned[1]).any(axis=1).sum())

    assert differing(inverted, sound) == 47
    found = check_bone("tibia_l", inverted, sound, start=HERE)
    assert differing(found.surface, sound) <= 7
    assert any("54 of 374 triangles looked inward and were turned outward" in note for note in found.notes)
    assert any("is open" in note for note in found.notes)


@pytest.mark.long
def test_the_other_side_of_a_person_is_refused(data):
    right = read_mesh(data("bones-opensim-rajagopal/Geometry/r_femur.vtp"))
    left = read_mesh(data("bones-opensim-rajagopal/Geometry/l_femur.vtp"))
    scan = read_mesh(data("bones-mri-two-adults/MC22/femur_r.ply"))
    with pytest.raises(BadData, match="as if in millimeters"):
        check_bone("femur_r", scan, right)
    scan = Surface(1e-3 * scan.vertices, scan.faces)
    with pytest.raises(BadData, match="of the other side"):
        check_bone("femur_l", scan, left)
    found = check_bone("femur_r", scan, right)
    assert found.residual < 0.01
    assert [note for note in found.notes if "other side" in note] == []
