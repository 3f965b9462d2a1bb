"""Paired subjects: the test is exact, intervals and effect sizes are those of textbooks."""

from __future__ import annotations

import itertools

import numpy as np
import pytest
from scipy import stats

from myomorph.core.model.errors import BadData
from myomorph.lab.analysis.conditions import Condition, compare_conditions
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.groups import Animal, Group, GroupOptions, compare_groups, compare_paired
from myomorph.lab.analysis.permutations import (
    effect_interval,
    effect_size,
    p_floor,
    permutation_test,
    signs,
)

FAMILY = "joint angle [°]"


def subject(name, speed, shift=0.0, rng=None):
    percent = np.linspace(0.0, 1.0, 101)
    noise = 0.0 if rng is None else 0.2 * rng.standard_normal()
    knee = np.sin(2.0 * np.pi * percent) + noise + shift * np.exp(-(((percent - 0.7) / 0.05) ** 2))
    hip = np.cos(2.0 * np.pi * percent) + noise
    curves = {FAMILY: Cycles(("knee", "hip"), np.stack([knee, hip], axis=1)[None])}
    return Animal(name=name, scalars={"speed [m/s]": np.array([speed])}, curves=curves, strides=3)


def test_every_way_to_turn_differences_round_is_taken_once():
    rows, exact = signs(5)
    assert exact
    assert {tuple(row) for row in rows} == set(itertools.product((-1.0, 1.0), repeat=5))
    assert (rows[0] == 1.0).all()
    drawn, exact = signs(20, most=500)
    assert (exact, drawn.shape) == (False, (500, 20))
    assert (drawn[0] == 1.0).all()


def test_one_number_is_tested_as_scipy_does():
    rng = np.random.default_rng(3)
    for count in (3, 6, 9):
        differences = 0.6 + rng.standard_normal(count)
        theirs = stats.permutation_test(
            (differences,),
            lambda x, axis: stats.ttest_1samp(x, 0.0, axis=axis).statistic,
            permutation_type="samples",
            n_resamples=np.inf,
        )
        own = permutation_test(differences)
        assert own.exact
        assert own.p == pytest.approx(theirs.pvalue, abs=1e-12)
        assert own.statistic == pytest.approx(
            stats.ttest_1samp(differences, 0.0).statistic, rel=1e-9
        )
    assert p_floor(6) == 2 / 64
    # Drawn ways alone: no p is less than one of them.
    assert p_floor(20, most=1000) == 1 / 1000


def test_curves_are_corrected_for_all_that_is_looked_at():
    rng = np.random.default_rng(0)
    false = 0
    for _ in range(200):
        noise = np.cumsum(rng.standard_normal((7, 3, 40)), axis=2)
        false += np.nanmin(permutation_test(noise).p) < 0.05
    # At 5 % of 200, beyond 20 by chance only once in a thousand.
    assert false <= 20
    with pytest.raises(BadData, match="3 or more"):
        permutation_test(np.ones((2, 4)))


def test_the_interval_of_the_effect_covers_it():
    rng = np.random.default_rng(1)
    inside = 0
    for _ in range(400):
        differences = 0.8 + rng.standard_normal(5)
        low, high = effect_interval(effect_size(differences))
        inside += low < 0.8 < high
    assert stats.binomtest(inside, 400, 0.95).pvalue > 0.001


def test_two_subjects_are_described_without_an_effect_size():
    """One degree of freedom has no unbiased effect size."""
    slow = Group("a", tuple(subject(f"s{k}", k * (1.0 + 0)) for k in (1, 3)))
    fast = Group("b", tuple(subject(f"s{k}", k * (1.0 + 1)) for k in (1, 3)))
    found = compare_paired(fast, slow).scalars[0]
    assert np.isfinite([found.difference, found.low, found.high]).all()
    assert np.isnan([found.g, found.g_low, found.g_high, found.p]).all()


def test_subjects_beside_themselves():
    rng = np.random.default_rng(2)
    base = [(f"s{k}", 1.0 + 0.5 * rng.standard_normal()) for k in range(8)]
    slow = Group("slow", tuple(subject(name, speed, 0.0, rng) for name, speed in base))
    fast = Group(
        "fast",
        tuple(
            subject(name, speed + 0.2 + 0.02 * rng.standard_normal(), 1.0, rng)
            for name, speed in base
        ),
    )
    found = compare_paired(fast, slow)
    (speed,) = found.scalars
    values = np.array(
        [[one.scalar("speed [m/s]") for one in group.animals] for group in (fast, slow)]
    )
    theirs = stats.ttest_rel(*values).confidence_interval()
    np.testing.assert_allclose((speed.low, speed.high), theirs, rtol=1e-9)
    assert speed.p == pytest.approx(2 / 256)
    knee = next(one for one in found.curves if one.name == "knee")
    assert all(60.0 <= start <= stop <= 80.0 for start, stop in knee.regions)
    assert knee.regions
    # What differs between subjects hides the same difference where they are taken for two groups.
    renamed = Group("slow", tuple(subject(f"other {name}", one) for name, one in base))
    assert compare_groups(fast, renamed).scalars[0].p > 0.2


def test_subjects_of_one_condition_only_are_left_out_by_name():
    first = Group("a", tuple(subject(name, 1.0) for name in ("s1", "s2", "only here")))
    second = Group("b", tuple(subject(name, 2.0) for name in ("s2", "s1")))
    found = compare_paired(first, second)
    assert (
        [name for name, _ in found.animals[0]]
        == [name for name, _ in found.animals[1]]
        == ["s1", "s2"]
    )
    assert any("only here" in one for one in found.notes)
    assert not found.tested
    with pytest.raises(BadData, match="no subject has both"):
        compare_paired(first, Group("b", (subject("s9", 1.0),)))


def condition(name, subjects, cycle="stride"):
    return Condition(
        name=name,
        subjects=tuple(subjects),
        trials=len(subjects),
        cycle=cycle,
        unit="subjects",
        curves={},
    )


def test_every_pair_of_conditions_is_compared_at_its_share_of_the_error():
    rng = np.random.default_rng(4)
    both = [f"s{k}" for k in range(4)]
    a = condition("a", [subject(name, 1.0, rng=rng) for name in both])
    b = condition("b", [subject(name, 1.0, rng=rng) for name in both])
    c = condition("c", [subject(f"t{k}", 1.0, rng=rng) for k in range(4)])
    found = compare_conditions([a, b, c], GroupOptions(alpha=0.06))
    assert [(one.names, one.paired) for one in found] == [
        (("a", "b"), True),
        (("a", "c"), False),
        (("b", "c"), False),
    ]
    assert {one.options.alpha for one in found} == {0.02}
    # One subject with both among many is no reason to compare within subjects.
    mixed = condition("m", [*c.subjects, subject("s0", 1.0)])
    (one,) = compare_conditions([a, mixed])
    assert not one.paired
    assert any("s0" in note for note in one.notes)
    # A percent of a stride is not a percent of a trial.
    (one,) = compare_conditions([a, condition("w", a.subjects, "trial")])
    assert one.curves == ()
    assert one.scalars
