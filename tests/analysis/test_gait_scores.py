"""Scores of gait: known differences from a norm give known scores, with their intervals."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.errors import BadData
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.gait_curves import (
    ANGLES,
    KEYS,
    SAMPLES,
    SIDES,
    GaitCurves,
    joined_curves,
)
from myomorph.lab.analysis.gait_scores import (
    GaitNorm,
    LogScores,
    ScoreScale,
    control_norm,
    gait_scores,
)

USUAL = 20.0 * np.sin(np.linspace(0.0, 2.0 * np.pi, SAMPLES))[:, None] + np.arange(len(KEYS))


def curves(right, left):
    """Strides (n, samples, variables) of both sides."""
    return GaitCurves(Cycles(KEYS, right), Cycles(KEYS, left), dict.fromkeys(SIDES, ()))


def norm(mean=USUAL, **more):
    made = GaitNorm(mean=mean, deviation=np.ones_like(mean), persons=30, source="made")
    return replace(made, **more)


def test_the_norm_itself_scores_nothing():
    scores = gait_scores(curves(USUAL[None], USUAL[None]), norm())
    assert scores.score["both"].value == 0.0
    assert scores.variables == ANGLES


def test_offsets_are_their_own_score():
    offsets = np.arange(1.0, len(KEYS) + 1.0)
    scores = gait_scores(curves((USUAL + offsets)[None], USUAL[None]), norm())
    for index, key in enumerate(KEYS[:ANGLES]):
        assert scores.profile["right", key].value == pytest.approx(offsets[index])
    assert scores.score["right"].value == pytest.approx(np.sqrt(np.mean(offsets[:ANGLES] ** 2)))
    # Of both sides the pelvis counts once, by the left: fifteen variables (Baker et al. 2009).
    assert scores.score["both"].value == pytest.approx(
        np.sqrt(np.sum(offsets[3:ANGLES] ** 2) / 15.0)
    )
    assert not scores.scaled


def test_offsets_of_other_definitions_do_not_count():
    there = GaitNorm(
        mean=USUAL, deviation=np.ones_like(USUAL), persons=30, source="made", same_definitions=False
    )
    scores = gait_scores(curves((USUAL + 20.0)[None], (1.2 * USUAL + 20.0)[None]), there)
    assert scores.score["right"].value == pytest.approx(0.0, abs=1e-9)
    assert 2.0 < scores.score["left"].value < 4.0


def test_variables_that_the_norm_lacks_take_no_part():
    mean = np.array(USUAL)
    mean[:, :5] = np.nan
    scores = gait_scores(curves((USUAL + 2.0)[None], (USUAL + 2.0)[None]), norm(mean))
    assert scores.variables == 4
    assert scores.score["right"].value == pytest.approx(2.0)
    assert ("right", KEYS[0]) not in scores.profile


def test_intervals_of_strides_and_of_draws():
    rng = np.random.default_rng(1)
    strides = USUAL + 5.0 + rng.standard_normal((8, 1, 1))
    scores = gait_scores(curves(strides, strides), norm())
    assert scores.score["right"].low < scores.score["right"].value < scores.score["right"].high
    assert not scores.drawn
    errors = {
        side: np.broadcast_to(rng.standard_normal((400, 1, 1)), (400, SAMPLES, len(KEYS)))
        for side in SIDES
    }
    drawn = gait_scores(curves(strides, strides), norm(), errors)
    half = 1.645  # Of a normal error of one degree that all variables share.
    assert drawn.drawn
    assert drawn.score["right"].value == scores.score["right"].value
    # On the scale of squares, to which the error's own adds: reflected, (2 v^2 - s^2)^(1/2).
    value = drawn.score["right"].value
    reach = np.sqrt(2.0 * value**2 - (value - half) ** 2)
    assert drawn.score["right"].high == pytest.approx(reach, abs=0.25)


def test_no_interval_goes_below_zero():
    # Two strides that differ much: Student's t of their own scores, 1 and 9 degrees, reaches far
    # below 0.
    strides = USUAL + np.array([1.0, 9.0])[:, None, None]
    log_scores = LogScores(np.log(4.0), 0.3)
    group = norm(scale=ScoreScale(side=log_scores, both=log_scores))
    scores = gait_scores(curves(strides, strides), group)
    for estimate in (*scores.score.values(), *scores.profile.values()):
        assert 0.0 < estimate.low < estimate.value < estimate.high
        assert estimate.low * estimate.high == pytest.approx(estimate.value**2)
    assert all(np.isfinite([index.low, index.high]).all() for index in scores.scaled.values())
    errors = {side: np.full((50, SAMPLES, len(KEYS)), -5.0) for side in SIDES}
    drawn = gait_scores(curves(strides, strides), group, errors)
    assert all(estimate.low >= 0.0 for estimate in (*drawn.score.values(), *drawn.profile.values()))


def test_a_control_group_scales_its_own_people_to_a_hundred():
    rng = np.random.default_rng(2)
    people = []
    for _ in range(30):
        person = USUAL + 4.0 * rng.standard_normal(len(KEYS))
        people.append(curves(person[None], (person + rng.standard_normal(len(KEYS)))[None]))
    group = control_norm(people, "made")
    assert group.persons == 30
    indices = [gait_scores(person, group).scaled[side].value for person in people for side in SIDES]
    # Their own scores are a little low, for they are part of the mean.
    assert 100.0 < np.mean(indices) < 105.0
    assert 8.0 < np.std(indices) < 12.0
    far = gait_scores(curves((USUAL + 25.0)[None], (USUAL + 25.0)[None]), group)
    assert far.scaled["right"].value < 85.0
    assert np.mean(group.deviation[0]) == pytest.approx(np.hypot(4.0, np.sqrt(0.5)), abs=0.4)


@pytest.mark.parametrize("stride_sd", [1.0, 2.0, 3.0])
def test_healthy_people_score_a_hundred_however_their_strides_differ(stride_sd):
    """Mean curves of controls beside strides of patients gave 99, 95 and 89."""
    rng = np.random.default_rng(3)

    def person(strides):
        own = 4.0 * rng.standard_normal((2, 1, len(KEYS)))
        sides = [
            USUAL + each + stride_sd * rng.standard_normal((strides, 1, len(KEYS))) for each in own
        ]
        return curves(*sides)

    found = []
    both = []
    for _ in range(12):
        group = control_norm([person(8) for _ in range(10)], "made")
        for strides in (3, 8, 20, 8):
            scaled = gait_scores(person(strides), group).scaled
            found += [scaled[side].value for side in SIDES]
            both.append(scaled["both"].value)
    assert np.mean(found) == pytest.approx(100.0, abs=4.0 * 10.0 / np.sqrt(len(found)))
    assert np.mean(both) == pytest.approx(100.0, abs=4.0 * 10.0 / np.sqrt(len(both)))


def test_a_scale_is_of_the_same_variables_alone():
    rng = np.random.default_rng(4)
    people = [curves(*(USUAL + 4.0 * rng.standard_normal((2, 1, 1, len(KEYS))))) for _ in range(6)]
    group = control_norm(people, "made")
    scores = gait_scores(people[0], group)
    assert scores.is_gait_profile_score
    assert set(scores.scaled) == {*SIDES, "both"}
    without = np.array(people[0].right.values)
    without[..., 5] = np.nan
    few = gait_scores(curves(without, without), group)
    assert not few.is_gait_profile_score
    assert not few.scaled
    of_shape = gait_scores(people[0], replace(group, same_definitions=False))
    assert not of_shape.is_gait_profile_score
    assert not of_shape.scaled


def test_few_controls_are_no_norm():
    person = curves(USUAL[None], USUAL[None])
    with pytest.raises(BadData, match="2 persons with strides"):
        control_norm([person, person], "made")
    assert control_norm([person] * 3, "made").scale is None
    assert joined_curves([person, person]).right.values.shape[0] == 2
