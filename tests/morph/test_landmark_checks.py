"""Landmarks in another unit, order, frame or of another bone or side are named."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.bone_checks import check_landmarks
from myomorph.core.io.landmarks import read_landmarks
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity
from scans import sharper

BONE = sharper(Surface(np.zeros((1, 3)), np.zeros((0, 3), dtype=np.int64)))
THERE = Similarity(rotation_from_euler_xyz((0.4, -1.0, 2.2)), np.array([0.1, -0.5, 0.2]), 0.9)
OTHER = Surface(THERE.apply(BONE.vertices), BONE.faces)
CHOSEN = np.random.default_rng(4).choice(len(BONE.vertices), 9, replace=False)
NAMES = tuple("abcdefghi")


def _pairs(
    source: np.ndarray | None = None, target: np.ndarray | None = None, noise: float = 1e-3
) -> FeaturePoints:
    ours = BONE.vertices[CHOSEN] if source is None else source
    theirs = THERE.apply(BONE.vertices[CHOSEN]) + noise * np.random.default_rng(0).normal(
        size=(9, 3)
    )
    return FeaturePoints(NAMES, ours, theirs if target is None else target)


def test_good_landmarks_pass_and_tell_how_the_bones_lie():
    found, notes = check_landmarks("femur_r", _pairs(), BONE, OTHER)
    assert notes == []
    assert found is not None
    np.testing.assert_allclose(found.rotation, THERE.rotation, atol=0.03)
    assert found.scale == pytest.approx(0.9, rel=0.03)


@pytest.mark.parametrize(("factor", "unit"), [(1000.0, "millimeters"), (100.0, "centimeters")])
@pytest.mark.parametrize("side", ["source", "target"])
def test_units_of_one_side_are_named(factor, unit, side):
    grown = {side: factor * getattr(_pairs(), side)}
    with pytest.raises(
        BadData,
        match=f"the {side} landmarks of 'femur_r' fit its bone .* divided by {factor:g}: .* {unit}",
    ):
        check_landmarks("femur_r", _pairs(**grown), BONE, OTHER)
    with pytest.raises(
        BadData, match=f"the target landmarks of 'femur_r' spread over .* as if .*in {unit}"
    ):
        check_landmarks("femur_r", _pairs(**grown))


def test_sizes_of_other_species_are_refused():
    small = _pairs(target=0.05 * _pairs().target)
    with pytest.raises(BadData, match="spread over"):
        check_landmarks("femur_r", small)


def test_two_interchanged_landmarks_are_named():
    target = _pairs().target.copy()
    target[[2, 5]] = target[[5, 2]]
    with pytest.raises(BadData, match=r"2 of 9 interchanged .*'c' where 'f' is, 'f' where 'c' is"):
        check_landmarks("femur_r", _pairs(target=target), BONE, OTHER)


def test_a_table_in_another_order_is_named():
    with pytest.raises(BadData, match="in another order on the target: with 9 of 9 interchanged"):
        check_landmarks("femur_r", _pairs(target=np.roll(_pairs().target, 1, axis=0)), BONE, OTHER)


def test_landmarks_of_the_other_side_are_named():
    source = _pairs().source * [1.0, 1.0, -1.0]
    with pytest.raises(BadData, match="when mirrored: are they of the other side"):
        check_landmarks("femur_r", _pairs(source=source))


def test_landmarks_in_another_frame_or_of_another_bone_are_named():
    away = _pairs(target=_pairs().target + [0.0, 0.4, 0.0])
    with pytest.raises(
        BadData,
        match=r"the target landmarks of 'femur_r' lie .* another frame than the target's surface",
    ):
        check_landmarks("femur_r", away, BONE, OTHER)
    box = np.random.default_rng(1).uniform(-1, 1, (9, 3)) * 0.05
    with pytest.raises(BadData, match=r"do not fit: .* of another bone"):
        check_landmarks("femur_r", _pairs(target=box))


def test_a_wrong_pick_and_one_off_the_bone_are_notes():
    target = _pairs().target.copy()
    target[3] += [0.0, 0.0, 0.08]
    _, notes = check_landmarks("femur_r", _pairs(target=target), BONE, OTHER)
    assert any("picked point 'd' lies" in note for note in notes)
    assert any(
        "target landmarks of 'femur_r' lie up to" in note and "'d'" in note for note in notes
    )


def test_few_landmarks_say_little():
    full = _pairs()
    two = FeaturePoints(NAMES[:2], full.source[:2], full.target[:2])
    assert check_landmarks("femur_r", two)[0] is None
    line = FeaturePoints(
        NAMES[:3], np.outer([0, 1, 2], [0.1, 0, 0]), np.outer([0, 1, 2], [0, 0.1, 0])
    )
    assert "lie on a line" in check_landmarks("femur_r", line)[1][0]


@pytest.fixture
def femurs(data):
    """Twenty landmarks of a generic femur, the same of a subject's, and the generic surface."""
    folder = "bones-landmarks-leg/Geometry"
    ours = read_landmarks(data(f"{folder}/femur_r_warp.landmarks.csv"))
    theirs = read_landmarks(data(f"{folder}/subject_femur_r.landmarks.csv"))
    assert set(ours) == set(theirs)
    points = FeaturePoints(
        tuple(ours), np.array(list(ours.values())), np.array([theirs[name] for name in ours])
    )
    return points, read_mesh(data(f"{folder}/femur_r.obj"))


def test_real_landmarks_pass_and_their_faults_are_named(femurs):
    points, surface = femurs
    assert check_landmarks("femur_r", points, surface)[1] == []
    target = points.target.copy()
    target[[2, 7]] = target[[7, 2]]
    with pytest.raises(BadData, match="'landmark_10' where 'landmark_15' is"):
        check_landmarks("femur_r", FeaturePoints(points.names, points.source, target), surface)
    order = np.random.default_rng(0).permutation(20)
    with pytest.raises(BadData, match="20 of 20 interchanged"):
        check_landmarks(
            "femur_r", FeaturePoints(points.names, points.source, points.target[order]), surface
        )
    with pytest.raises(BadData, match="when mirrored"):
        check_landmarks(
            "femur_r",
            FeaturePoints(points.names, points.source, points.target * [-1, 1, 1]),
            surface,
        )


def test_landmarks_of_a_pelvis_on_a_femur(femurs, data):
    points, surface = femurs
    pelvis = np.array(
        list(read_landmarks(data("bones-landmarks-leg/Geometry/pelvis.landmarks.csv")).values())
    )
    names = tuple(f"p{k}" for k in range(len(pelvis)))
    with pytest.raises(
        BadData, match=r"the source landmarks of 'femur_r' lie .* from its bone|do not fit"
    ):
        check_landmarks(
            "femur_r", FeaturePoints(names, pelvis, points.target[: len(pelvis)]), surface
        )
