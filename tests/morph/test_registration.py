"""Bones registered to bones: laws, and scans made of the real bones of the models.

Wrong picks and mirrored bones are named.
"""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity, fit_points, procrustes
from myomorph.core.surfaces.rigid_registration import SurfaceOptions, register_surface
from scans import ScanQuality, made_scan, sharper

GEOMETRY = "shoulder-thoracoscapular/model_cmc/Geometry"
POINTS = np.array(
    [[0.0, 0, 0], [0.3, 0.02, 0.0], [0.28, -0.03, 0.02], [0.02, 0.03, 0.01], [0.01, -0.02, 0.03]]
)
NAMES = ("head", "lateral", "medial", "greater", "lesser")


def a_similarity(scale: float = 1.03) -> Similarity:
    return Similarity(rotation_from_euler_xyz((0.4, -1.0, 2.2)), np.array([0.1, -0.5, 0.2]), scale)


def test_there_and_back():
    one = a_similarity()
    np.testing.assert_allclose(one.inverse().apply(one.apply(POINTS)), POINTS, atol=1e-14)
    np.testing.assert_allclose(one.scale * one.rigid.apply(POINTS), one.apply(POINTS), atol=1e-14)


@pytest.mark.parametrize("scale", [False, True])
def test_procrustes_is_exact(scale):
    truth = a_similarity(1.03 if scale else 1.0)
    found = procrustes(POINTS, truth.apply(POINTS), scale)
    np.testing.assert_allclose(found.rotation, truth.rotation, atol=1e-12)
    np.testing.assert_allclose(found.translation, truth.translation, atol=1e-12)
    assert found.scale == pytest.approx(truth.scale, abs=1e-12)


def test_procrustes_never_mirrors_and_is_the_least():
    random = np.random.default_rng(0)
    target = POINTS * [-1, 1, 1] + 0.01 * random.normal(size=POINTS.shape)
    found = procrustes(POINTS, target, True)
    assert np.linalg.det(found.rotation) == pytest.approx(1.0)
    least = np.sum((found.apply(POINTS) - target) ** 2)
    for _ in range(50):
        turn = rotation_from_euler_xyz(1e-3 * random.normal(size=3)) @ found.rotation
        other = Similarity(
            turn,
            found.translation + 1e-4 * random.normal(size=3),
            found.scale * (1 + 1e-3 * random.normal()),
        )
        assert np.sum((other.apply(POINTS) - target) ** 2) > least


def test_three_points_are_enough_unless_they_lie_on_a_line():
    truth = a_similarity(1.0)
    np.testing.assert_allclose(
        procrustes(POINTS[:3], truth.apply(POINTS[:3])).rotation, truth.rotation, atol=1e-9
    )
    with pytest.raises(BadData, match="lie on a line"):
        procrustes(POINTS[:1] + np.outer([0, 1, 2], [0.1, 0, 0]), POINTS[:3])
    with pytest.raises(BadData, match="at least three pairs"):
        procrustes(POINTS[:2], POINTS[:2])


def test_a_wrong_pick_is_named():
    random = np.random.default_rng(1)
    target = a_similarity().apply(POINTS) + 0.0005 * random.normal(size=POINTS.shape)
    assert not fit_points(NAMES, POINTS, target, True).notes
    target[2] += [0.012, 0.0, 0.005]
    found = fit_points(NAMES, POINTS, target, True)
    assert "picked point 'medial' lies" in found.notes[0]
    assert found.left_out[2] > 0.01


def test_swapped_picks_do_not_pass():
    target = a_similarity(1.0).apply(POINTS)[[0, 2, 1, 3, 4]]
    found = fit_points(NAMES, POINTS, target)
    assert found.rms > 0.01


def test_picks_on_a_bone_of_the_other_side_are_named():
    target = a_similarity(1.0).apply(POINTS * [1, 1, -1])
    assert "better mirrored" in fit_points(NAMES, POINTS, target).notes[0]


def pose_error(
    found: Similarity, truth: Similarity, surface: Surface
) -> tuple[float, float, float]:
    """Root mean square error of the places [mm], angle [degrees] and share of size."""
    apart = np.linalg.norm(found.apply(surface.vertices) - truth.apply(surface.vertices), axis=1)
    angle = np.arccos(np.clip(0.5 * (np.trace(found.rotation.T @ truth.rotation) - 1), -1, 1))
    return (
        1e3 * float(np.sqrt(np.mean(apart**2))),
        float(np.degrees(angle)),
        found.scale / truth.scale - 1,
    )


def test_a_shape_without_noise_comes_back_exactly():
    bone = sharper(Surface(np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64)))
    scan, truth = made_scan(bone, quality=ScanQuality(noise=0.0, refine=0))
    found = register_surface(scan, bone)
    place, angle, size = pose_error(found.similarity, truth, scan)
    assert place < 1e-2
    assert angle < 1e-2
    assert abs(size) < 1e-4
    assert found.rms < 1e-5
    assert found.converged


@pytest.mark.parametrize(
    ("name", "cut"),
    [("rhumerus", 0.0), ("rhumerus", 0.4), ("rscapula", 0.3), ("rulna", 0.0), ("rclavicle", 0.0)],
)
def test_scans_of_real_bones_find_their_place_without_picks(data: object, name: str, cut: float):
    """Turned anywhere, 2 % smaller, 0.3 mm of noise, another mesh, part of the bone."""
    bone = read_mesh(data(f"{GEOMETRY}/{name}.vtp"))
    scan, truth = made_scan(bone, quality=ScanQuality(cut=cut))
    found = register_surface(scan, bone, options=SurfaceOptions(mirror=False))
    place, angle, size = pose_error(found.similarity, truth, scan)
    assert place < 0.3
    assert angle < 0.5
    assert abs(size) < 0.005
    assert 1e-4 < found.rms < 4e-4
    assert found.percentile(95) < 1e-3
    assert found.distances.shape == (len(scan.vertices),)


def test_a_bone_of_the_package_finds_its_place():
    myo_sim = pytest.importorskip("myo_sim")
    bone = read_mesh(Path(myo_sim.MODELS_DIR) / "meshes" / "humerus.stl")
    scan, truth = made_scan(bone, seed=4, quality=ScanQuality(cut=0.2))
    found = register_surface(scan, bone, options=SurfaceOptions(mirror=False))
    assert pose_error(found.similarity, truth, scan)[0] < 0.3


def test_a_coarser_scan_with_a_start_stays_there(data: object):
    """The scan has fewer triangles than the model; the start is 5 degrees and 10 mm off."""
    bone = read_mesh(data(f"{GEOMETRY}/rscapula.vtp"))
    fine, _ = made_scan(bone, scale=1.0, seed=2, quality=ScanQuality(noise=0.0, refine=1))
    model, _ = made_scan(bone, scale=1.0, seed=3, quality=ScanQuality(noise=0.0, refine=2))
    coarse, truth = made_scan(bone, seed=5, quality=ScanQuality(refine=0))
    off = Similarity(
        rotation_from_euler_xyz((0.05, -0.05, 0.05)) @ truth.rotation,
        truth.translation + 0.006,
        truth.scale,
    )
    found = register_surface(coarse, bone, off)
    assert pose_error(found.similarity, truth, coarse)[0] < 0.3
    assert len(fine.faces) < len(model.faces)


def test_a_mirrored_bone_is_named(data: object):
    bone = read_mesh(data(f"{GEOMETRY}/rscapula.vtp"))
    left = Surface(bone.vertices * [-1, 1, 1], bone.faces[:, ::-1])
    scan, _ = made_scan(left, quality=ScanQuality(refine=1))
    found = register_surface(scan, bone)
    assert any("fits better mirrored" in line for line in found.notes)


def test_bad_options_and_surfaces_are_named():
    with pytest.raises(BadData, match=r"kept is 0\.1"):
        SurfaceOptions(kept=0.1)
    flat = Surface(np.zeros((3, 3)), np.array([[0, 1, 2]]))
    with pytest.raises(BadData, match="no area"):
        register_surface(flat, flat)
