"""Dense correspondence: known deformations of real bones, and laws.

Also thin bones, parts, and persons of a shape model.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from benchmarks.accuracy.morph.shapes import mean_shape
from made_bones import deformed, errors, made_target, real_bone

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.nonrigid import PlacedBone, match_surfaces, place_bone
from myomorph.bones.morph.registration.smooth import MatchOptions, onto, spread_points
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import rotation_from_euler_xyz
from myomorph.core.model.surface import Surface
from myomorph.core.surfaces.linear_maps import Similarity, procrustes
from myomorph.core.surfaces.surface_points import Shape

QUICK = MatchOptions(match_points=800)


def placed(bone: Surface, size: float = 1.0) -> PlacedBone:
    """Where a made target's bone lies, as landmarks would tell."""
    return PlacedBone(procrustes(bone.vertices, deformed(bone.vertices, bone, size), scale=True))


def _rms(points: np.ndarray) -> float:
    return float(np.sqrt(np.mean(np.sum(points**2, axis=1))))


@pytest.mark.parametrize(
    ("name", "slid"), [("humerus", 1e-3), ("scapula", 1e-3), ("r_pelvis", 1.5e-3)]
)
def test_a_known_deformation_is_found(name, slid):
    bone = real_bone(name, 0.01)
    target = made_target(bone)
    truth = deformed(bone.vertices, bone)
    found = match_surfaces(bone, target, None, QUICK, placed(bone))
    off, along = errors(found.points, truth, target)
    affine = np.column_stack([bone.vertices, np.ones(len(bone.vertices))])
    left = _rms(affine @ np.linalg.lstsq(affine, truth, rcond=None)[0] - truth)
    assert off < 1e-9
    assert along < slid
    assert along < 0.5 * left
    assert found.quality.coverage > 0.99
    assert found.quality.inverted < 0.002
    assert _rms(deformed(found.pairs.source, bone) - found.pairs.target) < 2.0 * slid


def test_a_similar_bone_is_found_to_a_tenth_of_a_millimeter_from_its_shape_alone():
    bone = real_bone("humerus", 0.01)
    target = made_target(bone, 0.0)
    found = match_surfaces(bone, target)
    off, along = errors(found.points, deformed(bone.vertices, bone, 0.0), target)
    assert off < 1e-9
    assert along < 1e-4
    assert found.notes == ()
    assert found.placed.mirrored > 2.0


def test_both_frames_and_both_sizes_do_not_matter():
    bone = real_bone("humerus", 0.01)
    target = made_target(bone, 0.5)
    begin = placed(bone, 0.5)
    plain = match_surfaces(bone, target, None, QUICK, begin).points
    turn = Similarity(rotation_from_euler_xyz((0.3, 1.0, -2.0)), np.array([0.5, -3.0, 1.0]))
    after = PlacedBone(
        Similarity(
            turn.rotation @ begin.similarity.rotation,
            turn.apply(begin.similarity.translation),
            begin.similarity.scale,
        )
    )
    moved = Surface(turn.apply(target.vertices), target.faces)
    again = turn.inverse().apply(match_surfaces(bone, moved, None, QUICK, after).points)
    assert _rms(again - plain) < 5e-5
    size = 0.033
    small = Surface(size * target.vertices, target.faces)
    begin = PlacedBone(
        Similarity(
            begin.similarity.rotation,
            size * begin.similarity.translation,
            size * begin.similarity.scale,
        )
    )
    assert _rms(match_surfaces(bone, small, None, QUICK, begin).points / size - plain) < 5e-5


def test_landmarks_pull():
    bone = real_bone("humerus", 0.01)
    target = made_target(bone, 0.5)
    truth = deformed(bone.vertices, bone, 0.5)
    corners = np.array([0, 300, 700, 1100])
    slid = Similarity(np.eye(3), np.array([0.0, 0.01, 0.0]))
    marks = FeaturePoints(("a", "b", "c", "d"), bone.vertices[corners], slid.apply(truth[corners]))
    free = match_surfaces(bone, target, None, QUICK, placed(bone, 0.5)).points[corners]
    near = match_surfaces(
        bone, target, marks, replace(QUICK, landmark_error=0.002), placed(bone, 0.5)
    ).points[corners]
    assert _rms(near - marks.target) < _rms(free - marks.target) - 0.001


def test_a_bone_that_is_cut_off_is_matched_where_it_is():
    bone = real_bone("humerus", 0.01)
    whole = made_target(bone, 0.5)
    long = np.linalg.svd(whole.vertices - whole.vertices.mean(axis=0), full_matrices=False)[2][0]
    along = whole.vertices @ long
    kept = (along > np.quantile(along, 0.3))[whole.faces].all(axis=1)
    used, faces = np.unique(whole.faces[kept], return_inverse=True)
    part = Surface(whole.vertices[used], faces.reshape(-1, 3))
    found = match_surfaces(bone, part, None, QUICK, placed(bone, 0.5))
    truth = deformed(found.pairs.source, bone, 0.5)
    assert _rms(found.pairs.target - truth) < 0.003
    assert 0.4 < len(found.pairs) / QUICK.match_points < 0.95
    assert (truth @ long).min() > np.quantile(along, 0.3) - 0.01


def test_a_thin_bone_keeps_its_sides():
    bone = real_bone("scapula", 0.01)
    shape = Shape(bone)
    samples = shape.samples(2000)
    inside = samples.points - 0.004 * samples.normals
    found = onto(shape, inside, samples.normals)
    wrong = np.einsum("ij,ij->i", shape.nearest(inside, fine=True).normals, samples.normals) < 0
    assert np.mean(wrong) > 0.3
    assert np.mean(np.einsum("ij,ij->i", found.normals, samples.normals) > 0) > 0.98


def test_points_are_spread_evenly():
    shape = Shape(real_bone("humerus", 0.01))
    points = spread_points(shape, 300)
    apart = np.linalg.norm(points[:, None] - points, axis=2) + np.eye(300)
    assert apart.min(axis=1).max() < 2.5 * apart.min()


def test_a_patella_that_might_lie_upside_down_is_doubted(data):
    shapes = persons(data)["patella"]
    mean = mean_shape(np.delete(shapes.nodes, 12, axis=0))
    source = Surface(mean, shapes.faces)
    target = Surface(shapes.nodes[12], shapes.faces)
    assert any("fits nearly as well turned by" in line for line in place_bone(source, target).notes)


def test_wrong_options_are_named():
    with pytest.raises(BadData, match="20 to 5000"):
        MatchOptions(feature_count=3)
    with pytest.raises(BadData, match=r"match_tolerance is 0\.5"):
        MatchOptions(match_tolerance=0.5)
    with pytest.raises(BadData, match="stiffness"):
        MatchOptions(stiffness=0.0)


def persons(data):
    data("bones-shape-model-llp26/shape_models/LLP26_rigid.npz")
    from truths.leg_shapes import leg_shapes

    return leg_shapes()


# Of the patellas of persons 3 and 11 the match is worse than the similarity: that of person 3 is
# far from the mean.
@pytest.mark.parametrize(("bone", "pair"), [("femur", (3, 11)), ("patella", (5, 11))])
def test_a_match_is_nearer_than_a_similarity_between_persons_of_the_shape_model(data, bone, pair):
    shapes = persons(data)[bone]
    source, target = pair
    source = Surface(shapes.nodes[source], shapes.faces)
    target = Surface(shapes.nodes[target], shapes.faces)
    begin = procrustes(source.vertices, target.vertices, scale=True)
    found = match_surfaces(source, target, None, QUICK, PlacedBone(begin))
    assert _rms(found.points - target.vertices) < _rms(
        begin.apply(source.vertices) - target.vertices
    )
