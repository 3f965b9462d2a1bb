"""The map of a bone, through landmarks and matched surfaces.

What cannot be a bone's counterpart is named.
"""

from __future__ import annotations

import numpy as np
import pytest
import trimesh
from made_bones import deformed, made_target, real_bone

from myomorph.bones.morph.maps.fields import FeaturePoints, MapOptions
from myomorph.bones.morph.registration.alignment import align_bones, turned_by
from myomorph.bones.morph.registration.map_bone import WRONG_SIDE, BoneMapOptions, map_bone
from myomorph.bones.morph.registration.nonrigid import place_bone
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadData
from myomorph.core.model.surface import Surface
from scans import joined

QUICK = MatchOptions(match_points=800, feature_count=400)
CORNERS = np.array([0, 250, 500, 800, 1100])


def marks(bone: Surface, size: float = 0.5) -> FeaturePoints:
    source = bone.vertices[CORNERS]
    return FeaturePoints(tuple("abcde"), source, deformed(source, bone, size))


@pytest.fixture(scope="module")
def bone() -> Surface:
    return real_bone("humerus", 0.01)


@pytest.mark.parametrize("options", [MapOptions(), MapOptions(map="rbf")])
def test_the_map_goes_where_the_bone_went(bone, options):
    found = map_bone(
        "humerus",
        bone,
        made_target(bone, 0.5),
        marks(bone),
        BoneMapOptions(map=options, match=QUICK),
    )
    random = np.random.default_rng(0)
    beside = bone.vertices[::20] + 0.005 * random.normal(size=bone.vertices[::20].shape)
    apart = np.linalg.norm(found.map.apply(beside) - deformed(beside, bone, 0.5), axis=1)
    assert np.sqrt(np.mean(apart**2)) < 0.0015
    np.testing.assert_allclose(found.map.apply(marks(bone).source), marks(bone).target, atol=1e-6)
    assert found.basis == "bone"
    assert found.measures["map inverted"] == 0.0
    assert found.measures["residual [m]"] < 0.001
    assert np.linalg.det(found.whole.rotation) == pytest.approx(1.0)


def test_a_landmark_that_contradicts_the_surface_does_not_fold_the_map(bone):
    given = marks(bone)
    wrong = given.target + [0.0, 0.0, 0.006] * np.array([[1.0], [0], [0], [0], [0]])
    found = map_bone(
        "humerus",
        bone,
        made_target(bone, 0.5),
        FeaturePoints(given.names, given.source, wrong),
        BoneMapOptions(match=QUICK),
    )
    np.testing.assert_allclose(found.map.apply(given.source), wrong, atol=1e-6)
    assert found.measures["map inverted"] < 0.002


def test_landmarks_are_found_by_rules_where_none_are_given(bone):
    found = map_bone(
        "humerus",
        bone,
        made_target(bone, 0.5),
        options=BoneMapOptions(match=MatchOptions(features="landmarks")),
    )
    assert found.basis == "landmarks"
    assert any("found by rules" in note for note in found.notes)
    points = found.features
    apart = np.linalg.norm(points.target - deformed(points.source, bone, 0.5), axis=1)
    assert len(points) >= 5
    assert np.median(apart) < 0.02 * np.ptp(points.target, axis=0).max()


@pytest.mark.parametrize("seed", range(3))
def test_of_ways_that_fit_alike_one_that_keeps_the_frame_is_taken(seed):
    rng = np.random.default_rng(seed)
    block = trimesh.creation.box((0.03, 0.02, 0.05)).subdivide_to_size(0.006)
    ours = Surface(block.vertices + rng.normal(0.0, 2e-4, block.vertices.shape), block.faces)
    theirs = Surface(block.vertices + rng.normal(0.0, 2e-4, block.vertices.shape), block.faces)
    found = align_bones(ours, theirs)
    assert turned_by(found.similarity) < 5.0
    assert "landmarks would determine" in found.warnings()[0]


def test_landmarks_alone(bone):
    for surfaces, match in (
        ((None, None), MatchOptions()),
        ((bone, made_target(bone, 0.5)), MatchOptions(features="landmarks")),
    ):
        options = BoneMapOptions(map=MapOptions(map="affine"), match=match, target_body="arm")
        found = map_bone("humerus", *surfaces, marks(bone), options)
        assert found.basis == "landmarks"
        assert found.target_body == "arm"
        assert len(found.features) == len(CORNERS)
        assert "residual [m]" not in found.measures


def test_the_size_does_not_matter(bone):
    size = 0.9
    target = made_target(bone, 0.5)
    shrunk = map_bone(
        "humerus",
        bone,
        Surface(size * target.vertices, target.faces),
        landmarks_of(bone, size),
        BoneMapOptions(match=QUICK),
    )
    plain = map_bone("humerus", bone, target, landmarks_of(bone, 1.0), BoneMapOptions(match=QUICK))
    np.testing.assert_allclose(
        shrunk.map.apply(bone.vertices) / size, plain.map.apply(bone.vertices), atol=3e-4
    )


def landmarks_of(bone: Surface, size: float) -> FeaturePoints:
    given = marks(bone)
    return FeaturePoints(given.names, given.source, size * given.target)


@pytest.mark.long
def test_two_parts_are_one_bone():
    shank = joined([real_bone("r_tibia", 0.012), real_bone("r_fibula", 0.012)])
    target = made_target(shank, 0.5)
    found = map_bone("tibia_r", shank, target)
    apart = np.linalg.norm(
        found.map.apply(shank.vertices) - deformed(shank.vertices, shank, 0.5), axis=1
    )
    assert np.sqrt(np.mean(apart**2)) < 0.004


def test_what_is_no_counterpart_is_named(bone):
    target = made_target(bone, 0.5)
    with pytest.raises(BadData, match="millimeters"):
        map_bone("humerus", bone, Surface(1e3 * target.vertices, target.faces), marks(bone))
    with pytest.raises(BadData, match="of the other side"):
        map_bone("humerus", bone, Surface(target.vertices * [1, 1, -1], target.faces[:, ::-1]))
    with pytest.raises(BadData, match="has no surface of this bone"):
        map_bone("humerus", bone, None)
    with pytest.raises(BadData, match="no extent"):
        map_bone("humerus", bone, Surface(np.zeros((3, 3)), [[0, 1, 2]]), marks(bone))


def test_a_small_bone_of_another_person_is_not_taken_for_one_of_the_other_side(data):
    """Both ways leave about the same distance.

    The likelihoods of the two deformations differ a thousandfold.
    """
    ours = read_mesh(data("bones-opensim-rajagopal/Geometry/r_talus.vtp"))
    scan = read_mesh(data("bones-mri-two-adults/ICL_MRI/talus_r.ply"))
    placed = place_bone(ours, Surface(1e-3 * scan.vertices, scan.faces))
    assert WRONG_SIDE < placed.mirrored < 1.5
