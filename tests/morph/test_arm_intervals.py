"""Intervals of moment arms follow from those of points: laws on a leg of two boxes."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from boxed_leg import BONES, LENGTH, grown, leg, morph_of
from myomorph.bones.morph.arm_intervals import with_arm_intervals
from myomorph.bones.morph.checks.checks import check_morph
from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.morphed import Morph
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.paths import WrapObject
from myomorph.core.model.spatial import Transform

SIZE = 1.1


def unsure(radius: float, model=None) -> Morph:
    """Return a leg that grew, with points known within a radius [m].

    One joint is mapped by the maps.
    """
    source = leg() if model is None else model
    morph = morph_of(source, grown(source, SIZE), SIZE)
    bones = {}
    for name, bone in morph.bones.items():
        places = BONES[name].vertices
        names = tuple(str(k) for k in range(len(places)))
        features = FeaturePoints(
            names=names,
            source=places,
            target=SIZE * places,
            weights=None,
            radii=np.full(len(places), radius),
        )
        bones[name] = replace(bone, features=features)
    points = tuple(replace(one, within=radius) for one in morph.points)
    joints = tuple(replace(one, method="mapped") for one in morph.joints)
    return replace(morph, bones=bones, points=points, joints=joints)


def _widths(morph: Morph) -> np.ndarray:
    (arms,) = with_arm_intervals(morph, check_morph(morph)).arms
    assert arms.within is not None
    return np.asarray(arms.within)


def test_points_that_are_known_exactly_make_moment_arms_exact():
    np.testing.assert_allclose(_widths(unsure(0.0)), 0.0, atol=1e-12)


def test_intervals_grow_with_those_of_the_points():
    small = _widths(unsure(2e-5))
    large = _widths(unsure(2e-4))
    assert small.min() > 0.0
    np.testing.assert_allclose(large, 10.0 * small, rtol=0.05)


def test_a_moment_arm_is_about_as_sure_as_its_points():
    radius = 1e-3
    found = _widths(unsure(radius))
    # Both points beside the knee and its center move by one standard deviation of an axis, more or
    # less together.
    sd = radius / 2.5
    assert 0.3 * half_width(sd) < np.median(found) < 3.0 * half_width(sd)


def test_a_muscle_with_a_point_that_is_not_known_has_no_interval():
    morph = unsure(1e-3)
    lost = tuple(
        replace(one, within=np.nan) if (one.owner, one.name) == ("flexor", "flexor-P3") else one
        for one in morph.points
    )
    (arms,) = with_arm_intervals(replace(morph, points=lost), check_morph(morph)).arms
    known = np.isfinite(arms.within).all(axis=0)
    assert dict(zip(arms.muscles, known.tolist(), strict=True)) == {
        "extensor": True,
        "flexor": False,
    }


def test_where_nothing_is_known_nothing_is_said():
    source = leg()
    morph = morph_of(source, grown(source, SIZE), SIZE)
    checks = check_morph(morph)
    assert with_arm_intervals(morph, checks) is checks


@pytest.mark.parametrize(("body", "count"), [("thigh", 1), ("ground", 0)])
def test_wrap_objects_on_matched_bones_have_intervals(body, count):
    around = WrapObject(
        name="knee",
        body=body,
        kind="cylinder",
        pose=Transform(np.eye(3), np.array([0.0, -LENGTH, 0.0])),
        size=(0.02, 0.05),
    )
    radius = 1e-3
    morph = unsure(radius, replace(leg(), wrap_objects=(around,)))
    checks = with_arm_intervals(morph, check_morph(morph))
    assert len(checks.wraps) == count
    for one in checks.wraps:
        assert 0.2 * radius < one.within < 1.5 * radius
        assert 0.0 < one.size < radius
