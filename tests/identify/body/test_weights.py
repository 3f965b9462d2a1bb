import functools

import numpy as np
import pytest
from scipy import sparse

from made_bodies import filled, random_links
from myomorph.body.shape.points import Links
from myomorph.body.shape.weights import (
    bone_weights,
    checked_weights,
    cog_weights,
    links_with_mass,
    nearest_weights,
)
from myomorph.core.io.formats import read_model
from myomorph.core.model.errors import BadData


@pytest.fixture(scope="module")
def cloud():
    return filled(0.05), random_links(6)


def distances(points, links):
    return np.linalg.norm(points[:, None] - links.centers, axis=2)


def test_w_d_is_equation_3_14(cloud):
    points, links = cloud
    inverse = distances(points, links) ** -4.0
    expected = inverse / inverse.sum(axis=1, keepdims=True)
    assert np.allclose(
        cog_weights(points, links, smallest=0.0).toarray(), expected, rtol=1e-12, atol=0.0
    )


def test_small_shares_are_dropped_and_the_rest_made_whole(cloud):
    points, links = cloud
    whole = cog_weights(points, links, smallest=0.0).toarray()
    cut = cog_weights(points, links, smallest=1e-2).toarray()
    assert cut[whole < 1e-2].max() == 0.0
    assert np.allclose(cut.sum(axis=1), 1.0, atol=1e-14)
    kept = np.where(whole >= 1e-2, whole, 0.0)
    assert np.allclose(cut, kept / kept.sum(axis=1, keepdims=True), atol=1e-14)


def test_the_default_cut_hardly_moves_the_mass_of_a_link(cloud):
    points, links = cloud
    whole = cog_weights(points, links, **({"smallest": 0.0})).sum(axis=0)
    cut = cog_weights(points, links, **({})).sum(axis=0)
    assert np.abs(cut / whole - 1.0).max() < 1e-3


@pytest.mark.parametrize("exponent", [2.0, 3.0, 7.5])
def test_any_exponent(cloud, exponent):
    points, links = cloud
    inverse = distances(points, links) ** -exponent
    weights = cog_weights(points, links, exponent=exponent, smallest=0.0).toarray()
    assert np.allclose(weights, inverse / inverse.sum(axis=1, keepdims=True), rtol=1e-10)


def test_w_n_is_equation_3_15_and_the_limit_of_w_d(cloud):
    points, links = cloud
    weights = nearest_weights(points, links)
    assert weights.nnz == len(points)
    assert np.array_equal(weights.indices, distances(points, links).argmin(axis=1))
    assert np.allclose(
        weights.toarray(), cog_weights(points, links, exponent=2e4, smallest=0.5).toarray()
    )


def test_w_b_is_by_the_distance_to_the_nearest_piece_of_bone():
    links = Links(
        names=("long", "short"),
        rotations=np.stack([np.eye(3)] * 2),
        origins=np.zeros((2, 3)),
        centers=np.zeros((2, 3)),
        bones=np.array([[[0.0, 0, 0], [0, 1, 0]], [[0, 1, 0], [0, 2, 0]], [[3, 0, 0], [3, 0, 0]]]),
        bone_links=np.array([0, 0, 1]),
    )
    points = np.array(
        [[1.0, 0.5, 0.0], [1.0, 1.7, 0.0], [1.0, 3.0, 0.0], [2.0, 0.0, 0.0], [0.0, 0.5, 0.0]]
    )
    to_long = np.array([1.0, 1.0, np.sqrt(2.0), 2.0, 1e-12])
    to_short = np.linalg.norm(points - [3.0, 0.0, 0.0], axis=1)
    share = to_short**4 / (to_long**4 + to_short**4)
    assert np.allclose(bone_weights(points, links, smallest=0.0).toarray()[:, 0], share, atol=1e-14)


def test_a_long_segment_keeps_its_ends_by_bone_but_not_by_center():
    """A thigh of 0.4 m between a pelvis and a shank, with centers 0.1 m beyond the joint."""
    thigh = np.array([[0.0, 0.4, 0.0], [0.0, 0.0, 0.0]])
    bones = np.array([[[0.0, 0.6, 0.0], thigh[0]], thigh, [thigh[1], [0.0, -0.2, 0.0]]])
    links = Links(
        names=("pelvis", "thigh", "shank"),
        rotations=np.stack([np.eye(3)] * 3),
        origins=bones[:, 0],
        centers=bones.mean(axis=1),
        bones=bones,
        bone_links=np.arange(3),
    )
    random = np.random.default_rng(0)
    flesh = random.uniform([-0.07, 0.0, -0.07], [0.07, 0.4, 0.07], (4000, 3))
    by_center = cog_weights(flesh, links).sum(axis=0)[1] / len(flesh)
    by_bone = bone_weights(flesh, links).sum(axis=0)[1] / len(flesh)
    assert by_center < 0.75
    assert by_bone > by_center + 0.1


@pytest.mark.parametrize("weigh", [cog_weights, nearest_weights, bone_weights])
def test_phantoms_can_be_left_out(cloud, weigh):
    points, links = cloud
    taking = np.array([True, False, True, True, False, True])
    weights = weigh(points, links, taking=taking)
    assert not weights.toarray()[:, ~taking].any()
    assert np.allclose(weights.sum(axis=1), 1.0, atol=1e-14)


def test_phantoms_are_told_by_their_density(data):
    """Ribs of 0.1 g with a radius of gyration of 1 m, beside kneecaps of 86 g."""
    model = read_model(data("fullbody-many-muscles/cyclistFullBodyMuscle.osim"))
    real = {
        name for name, kept in zip(model.body_names, links_with_mass(model), strict=True) if kept
    }
    assert {
        "pelvis",
        "patella_r",
        "talus_l",
        "toes_r",
        "lumbar3",
        "thoracic12",
        "head_neck",
        "hand_l",
    } <= real
    assert not real & {"sacrum", "Abdomen", "rib7_R", "sternum", "scapula_L", "Abd_L_L1"}


def test_weights_do_not_change_when_points_and_links_move_together(cloud):
    points, links = cloud
    R = links.rotations[0]
    p = np.array([4.0, -2.0, 1.0])
    moved = Links(
        names=links.names,
        rotations=R @ links.rotations,
        origins=links.origins @ R.T + p,
        centers=links.centers @ R.T + p,
        bones=links.bones @ R.T + p,
        bone_links=links.bone_links,
    )
    for weigh in (cog_weights, bone_weights):
        assert np.allclose(
            weigh(points @ R.T + p, moved).toarray(), weigh(points, links).toarray(), atol=1e-11
        )


def test_a_map_of_the_users_own_is_checked(cloud):
    points, links = cloud
    uniform = np.full((len(points), 6), 1.0 / 6.0)
    assert np.allclose(checked_weights(uniform, points, links).toarray(), uniform)
    negative = uniform.copy()
    short = uniform.copy()
    negative[7, :2] += [-1.0, 1.0]
    short[3] *= 0.9
    for wrong, words in (
        (negative, "negative or not finite"),
        (short, "point 3 sum to 0.9"),
        (uniform.T, "shape"),
    ):
        with pytest.raises(BadData, match=words):
            checked_weights(sparse.csr_array(wrong), points, links)


def test_bad_input_is_named(cloud):
    points, links = cloud
    bare = Links(
        names=links.names, rotations=links.rotations, origins=links.origins, centers=links.centers
    )
    for weigh, words in (
        (functools.partial(cog_weights, exponent=-1.0), "exponent"),
        (functools.partial(cog_weights, taking=np.zeros(6, bool)), "leave at least one in"),
        (functools.partial(nearest_weights, taking=[True]), "6 links"),
    ):
        with pytest.raises(BadData, match=words):
            weigh(points, links)
    with pytest.raises(BadData, match="'link0' has no bone"):
        bone_weights(points, bare)
    with pytest.raises(BadData, match="not finite"):
        cog_weights(np.full((3, 3), np.nan), links)
    assert cog_weights(np.zeros((0, 3)), links).shape == (0, 6)
