"""Laws of the maps of bones: what they reproduce, their derivatives, their symmetries."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.bones.morph.maps.fields import (
    FeaturePoints,
    MapOptions,
    PointMap,
    feature_warnings,
    fit_map,
    inverted,
)
from myomorph.bones.morph.maps.interpolating import fit_radial
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.spatial import axis_rotation
from myomorph.core.surfaces.linear_maps import AffineMap, fit_affine, fit_whole, procrustes

BENDING = [
    MapOptions(),
    MapOptions(exponent=2.5),
    MapOptions(map="rbf"),
    MapOptions(map="rbf", kernel="r3"),
]
AFFINE = [*BENDING, MapOptions(map="affine")]

TURN = axis_rotation(np.array([0.6, 0.0, 0.8]), 0.7)
SKEWED = AffineMap(
    TURN @ np.array([[1.2, 0.1, 0.0], [0.0, 0.9, 0.05], [0.0, -0.1, 1.05]]),
    np.array([0.3, -0.1, 0.7]),
)


def _bone(count: int, seed: int = 0) -> Array:
    """Points over something long and thin, as a femur is [m]."""
    return np.random.default_rng(seed).normal(size=(count, 3)) * np.array([0.02, 0.12, 0.03]) + 0.4


def _around(count: int = 200) -> Array:
    """Points on and off the bone, centimeters away [m]."""
    return np.random.default_rng(9).normal(size=(count, 3)) * np.array([0.06, 0.2, 0.06]) + 0.4


def _bent(points: Array) -> Array:
    """Apply a known smooth deformation."""
    x, y, z = (np.asarray(points) - 0.4).T
    return (
        np.column_stack(
            [1.1 * x + 0.8 * y**2, 0.95 * y - 0.1 * z, 1.05 * z + 0.2 * x + 1.5 * y * z]
        )
        + 0.1
    )


def _features(source: Array, target: Array) -> FeaturePoints:
    return FeaturePoints(tuple(str(k) for k in range(len(source))), source, target)


@pytest.mark.parametrize("options", AFFINE)
@pytest.mark.parametrize("count", [5, 12, 400])
def test_an_affine_map_is_reproduced(options: MapOptions, count: int) -> None:
    source = _bone(count)
    found = fit_map(_features(source, SKEWED.apply(source)), options)
    np.testing.assert_allclose(found.apply(_around()), SKEWED.apply(_around()), rtol=0, atol=1e-10)
    np.testing.assert_allclose(
        found.jacobian(_around()), np.tile(SKEWED.matrix, (200, 1, 1)), rtol=0, atol=1e-9
    )


@pytest.mark.parametrize("options", [MapOptions(map="rbf"), MapOptions(map="affine")])
def test_four_features_make_an_affine_map(options: MapOptions) -> None:
    source = _bone(4)
    found = fit_map(_features(source, SKEWED.apply(source)), options)
    np.testing.assert_allclose(found.apply(_around()), SKEWED.apply(_around()), rtol=0, atol=1e-10)


def test_four_features_are_too_few_to_tell_stretch_from_errors() -> None:
    source = _bone(4)
    given = _features(source, SKEWED.apply(source))
    assert "pick a fifth" in feature_warnings(given)[0]
    whole = fit_whole(source, given.target)
    nearest = procrustes(source, given.target, True)
    np.testing.assert_allclose(whole.apply(_around()), nearest.apply(_around()), rtol=0, atol=1e-12)
    np.testing.assert_allclose(fit_map(given).apply(source), given.target, rtol=0, atol=1e-12)


@pytest.mark.parametrize("options", [*AFFINE, MapOptions(map="similarity")])
def test_flat_features_reproduce_a_similarity(options: MapOptions) -> None:
    source = _bone(8)
    source[:, 2] = 0.4 + 0.3 * (source[:, 0] - 0.4)
    target = 1.3 * source @ TURN.T + 0.2
    found = fit_map(_features(source, target), options)
    np.testing.assert_allclose(
        found.apply(_around()), 1.3 * _around() @ TURN.T + 0.2, rtol=0, atol=1e-9
    )
    assert "plane" in feature_warnings(_features(source, target))[0]


@pytest.mark.parametrize("options", BENDING)
@pytest.mark.parametrize("count", [6, 24, 500])
def test_the_map_goes_through_every_feature(options: MapOptions, count: int) -> None:
    source = _bone(count)
    found = fit_map(_features(source, _bent(source)), options)
    np.testing.assert_allclose(found.apply(source), _bent(source), rtol=0, atol=1e-10)


def _differences(found: PointMap, points: Array, step: float = 1e-5) -> Array:
    """Jacobians by central differences."""
    sides = [
        found.apply(points + step * axis) - found.apply(points - step * axis) for axis in np.eye(3)
    ]
    return np.stack(sides, axis=-1) / (2 * step)


@pytest.mark.parametrize("options", BENDING)
def test_the_jacobian_is_the_derivative(options: MapOptions) -> None:
    source = _bone(24)
    found = fit_map(_features(source, _bent(source)), options)
    np.testing.assert_allclose(
        found.jacobian(_around(40)), _differences(found, _around(40)), rtol=0, atol=1e-7
    )
    near = source + [0.0, 1e-3, 1e-3]
    np.testing.assert_allclose(
        found.jacobian(near), _differences(found, near, 1e-6), rtol=0, atol=1e-6
    )


@pytest.mark.parametrize("options", [MapOptions(), MapOptions(map="rbf", kernel="r3")])
def test_the_jacobian_is_the_derivative_at_features(options: MapOptions) -> None:
    source = _bone(24)
    found = fit_map(_features(source, _bent(source)), options)
    np.testing.assert_allclose(
        found.jacobian(source), _differences(found, source, 1e-6), rtol=0, atol=1e-7
    )
    beside = source + 1e-9
    np.testing.assert_allclose(found.jacobian(beside), found.jacobian(source), rtol=0, atol=1e-6)


@pytest.mark.parametrize("options", BENDING)
def test_rigid_motions_of_both_bones_change_nothing(options: MapOptions) -> None:
    source = _bone(12)
    found = fit_map(_features(source, _bent(source)), options)
    before = axis_rotation((0.0, 0.6, 0.8), 1.9)
    after = axis_rotation((1.0, 0.0, 0.0), -0.8)
    moved = fit_map(_features(source @ before.T + 0.3, _bent(source) @ after.T - 0.2), options)
    goal = found.apply(_around()) @ after.T - 0.2
    np.testing.assert_allclose(moved.apply(_around() @ before.T + 0.3), goal, rtol=0, atol=1e-10)
    turned = after @ found.jacobian(_around()) @ before.T
    np.testing.assert_allclose(
        moved.jacobian(_around() @ before.T + 0.3), turned, rtol=0, atol=1e-8
    )


@pytest.mark.parametrize("options", BENDING)
@pytest.mark.parametrize("size", [0.03, 40.0])
def test_sizes_of_both_bones_change_nothing(options: MapOptions, size: float) -> None:
    source = _bone(12)
    found = fit_map(_features(source, _bent(source)), options)
    other = fit_map(_features(size * source, 2.0 * _bent(source)), options)
    np.testing.assert_allclose(
        other.apply(size * _around()), 2.0 * found.apply(_around()), rtol=0, atol=1e-10
    )


@pytest.mark.parametrize("options", BENDING)
def test_the_other_side_is_the_mirrored_one(options: MapOptions) -> None:
    source = _bone(12)
    mirror = np.array([1.0, 1.0, -1.0])
    found = fit_map(_features(source, _bent(source)), options)
    other = fit_map(_features(source * mirror, _bent(source) * mirror), options)
    np.testing.assert_allclose(
        other.apply(_around() * mirror), found.apply(_around()) * mirror, rtol=0, atol=1e-10
    )


def test_there_and_back_of_an_affine_map_and_a_similarity() -> None:
    np.testing.assert_allclose(
        SKEWED.inverse().apply(SKEWED.apply(_around())), _around(), rtol=0, atol=1e-12
    )
    similarity = procrustes(_bone(6), 1.2 * _bone(6) @ TURN.T, True)
    np.testing.assert_allclose(
        AffineMap.from_similarity(similarity).apply(_around()),
        similarity.apply(_around()),
        rtol=0,
        atol=1e-14,
    )
    with pytest.raises(BadData, match="singular"):
        AffineMap(np.diag([1.0, 1.0, 0.0]), np.zeros(3)).inverse()


@pytest.mark.parametrize("options", BENDING)
def test_a_fold_is_found(options: MapOptions) -> None:
    source = np.array(
        [[x, y, z] for x in (0.0, 0.1, 0.2, 0.3) for y in (0.0, 0.05) for z in (0.0, 0.05)]
    )
    target = source.copy()
    target[4:8] = source[8:12]
    target[8:12] = source[4:8]
    found = fit_map(_features(source, target), options)
    between = np.array([[0.15, 0.025, 0.025]])
    assert inverted(found, between)[0]
    assert not inverted(fit_map(_features(source, source), options), between)[0]


@pytest.mark.parametrize("options", AFFINE)
def test_a_mirrored_target_is_inside_out(options: MapOptions) -> None:
    source = _bone(12)
    found = fit_map(_features(source, source * [1.0, 1.0, -1.0]), options)
    assert inverted(found, _around()).all()


@pytest.mark.parametrize("options", AFFINE)
def test_features_at_one_place_are_one(options: MapOptions) -> None:
    source = np.vstack([_bone(12), _bone(12)[:3]])
    target = _bent(source)
    target[12:] += [0.002, 0.0, 0.0]
    found = fit_map(_features(source, target), options)
    if options.map != "affine":
        np.testing.assert_allclose(
            found.apply(source[:3]), _bent(source[:3]) + [0.001, 0, 0], rtol=0, atol=1e-10
        )
    assert feature_warnings(_features(source, target)) == (
        "3 of 15 feature points have the same position: merged",
    )


@pytest.mark.parametrize(
    "options", [MapOptions(), MapOptions(map="rbf"), MapOptions(map="rbf", kernel="r3")]
)
def test_smoothing_passes_by_so_far(options: MapOptions) -> None:
    source = _bone(60)
    noisy = _bent(source) + 0.002 * np.random.default_rng(3).normal(size=source.shape)
    passed = []
    errors = []
    for smoothing in (0.0, 0.001, 0.002):
        found = fit_map(_features(source, noisy), replace(options, smoothing=smoothing))
        passed.append(np.sqrt(np.mean(np.sum((found.apply(source) - noisy) ** 2, axis=1))))
        errors.append(np.linalg.norm(found.apply(source) - _bent(source), axis=1).mean())
    np.testing.assert_allclose(passed, [0.0, 0.001, 0.002], rtol=2e-3, atol=1e-9)
    assert errors[0] > errors[1] > errors[2]


@pytest.mark.parametrize(
    "options", [MapOptions(), MapOptions(map="rbf"), MapOptions(map="rbf", kernel="r3")]
)
def test_smoothing_leaves_an_affine_map_alone(options: MapOptions) -> None:
    source = _bone(12)
    found = fit_map(_features(source, SKEWED.apply(source)), replace(options, smoothing=0.003))
    np.testing.assert_allclose(found.apply(_around()), SKEWED.apply(_around()), rtol=0, atol=1e-10)


def test_much_smoothing_ends_at_the_affine_map() -> None:
    source = _bone(60)
    given = _features(source, _bent(source))
    smooth = fit_map(given, MapOptions(map="rbf", smoothing=1.0))
    affine = fit_map(given, MapOptions(map="affine"))
    np.testing.assert_allclose(smooth.apply(_around()), affine.apply(_around()), rtol=0, atol=1e-12)


def test_a_few_picks_are_not_read_as_shear() -> None:
    """Six landmarks picked with errors of 2 mm on a bone that only grew."""

    def wrong(found: AffineMap) -> float:
        return float(np.linalg.norm(found.apply(_around()) - 1.1 * _around(), axis=1).mean())

    errors = []
    for seed in range(20):
        source = _bone(6, seed)
        picked = 1.1 * source + 0.002 * np.random.default_rng(100 + seed).normal(size=source.shape)
        errors.append((wrong(fit_whole(source, picked)), wrong(fit_affine(source, picked))))
    cautious, affine = np.median(errors, axis=0)
    assert cautious < 0.8 * affine


def test_the_far_field_stays_near_the_whole_bone_s_map() -> None:
    source = _bone(24)
    found = fit_map(_features(source, _bent(source)))
    far = 0.4 + 5.0 * (_around() - 0.4)
    assert not inverted(found, far).any()


@pytest.mark.parametrize("kind", ["ssd", "rbf", "affine", "similarity", "rigid"])
def test_too_few_points_are_named(kind: str) -> None:
    options = MapOptions(map=kind)  # type: ignore[arg-type]
    with pytest.raises(BadData, match="at least three"):
        fit_map(_features(_bone(2), _bone(2)), options)
    line = np.outer(np.arange(4.0), [0.1, 0.0, 0.0])
    with pytest.raises(BadData, match="on a line"):
        fit_map(_features(line, line), options)
    same = np.tile(_bone(1), (5, 1))
    with pytest.raises(BadData):
        fit_map(_features(same, same), options)


@pytest.mark.parametrize(("width", "enough"), [(0.0195, False), (0.0205, True)])
def test_points_are_on_a_line_up_to_a_fiftieth_of_their_length(width: float, enough: bool) -> None:
    """A cross of four points: its lengths are the singular values over the root of two."""
    cross = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, width, 0.0], [0.0, -width, 0.0]])
    wide = np.array([[1.0, 0.0, 0.0], [-1.0, 0.0, 0.0], [0.0, 1.0, 0.0], [0.0, -1.0, 0.0]])
    for source, target in ((cross, wide), (wide, cross)):
        if enough:
            assert np.isfinite(procrustes(source @ TURN.T, target).rotation).all()
        else:
            with pytest.raises(BadData, match="on a line"):
                procrustes(source @ TURN.T, target)


@pytest.mark.parametrize("side", [0, 1])
def test_a_point_that_is_not_finite_is_refused_on_either_side(side: int) -> None:
    pair = [_bone(5), _bone(5)]
    pair[side] = np.where(np.arange(5)[:, None] == 2, np.nan, pair[side])
    with pytest.raises(BadData, match="not finite"):
        procrustes(*pair)


@pytest.mark.parametrize("kind", ["ssd", "rbf", "affine"])
def test_three_points_move_as_a_similarity_across_their_plane(kind: str) -> None:
    source = _bone(3)
    target = 1.1 * source @ TURN.T
    found = fit_map(_features(source, target), MapOptions(map=kind))  # type: ignore[arg-type]
    np.testing.assert_allclose(found.apply(_around()), 1.1 * _around() @ TURN.T, rtol=0, atol=1e-9)


@pytest.mark.parametrize("kernel", ["r", "r3"])
def test_what_no_affine_part_is_given_for_is_found_by_the_radial_map(kernel):
    """Shifts that are linear in position are reproduced everywhere.

    The affine map that the fit begins with does not matter.
    """
    random = np.random.default_rng(4)
    source = random.normal(size=(12, 3)) * 0.1
    others = random.normal(size=(20, 3)) * 0.3
    matrix = np.eye(3) + 0.2 * random.normal(size=(3, 3))
    offset = np.array([0.1, -0.2, 0.3])
    found = fit_radial(
        source, source @ matrix.T + offset, AffineMap(np.eye(3), np.zeros(3)), kernel
    )
    np.testing.assert_allclose(found.apply(others), others @ matrix.T + offset, atol=1e-8)
