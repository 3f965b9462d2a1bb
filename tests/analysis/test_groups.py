"""Comparison of two groups.

False positives at the stated rate, true differences found, small groups only described.
"""

from __future__ import annotations

from itertools import combinations

import numpy as np
import pytest
from scipy import stats

import myomorph as mm
from myomorph.core.model.errors import BadData
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.groups import Animal, Group, GroupOptions, compare_groups
from myomorph.lab.analysis.permutations import (
    benjamini_hochberg,
    effect_interval,
    effect_size,
    holm,
    labellings,
    p_floor,
    permutation_test,
)
from myomorph.lab.report.page.parts import PageHead
from myomorph.lab.report.study.group_page import group_page

PERCENT = np.linspace(0.0, 100.0, 101)


def smooth(rng, count, curves=1):
    """Random curves of about four independent parts."""
    base = np.array([np.cos(k * np.pi * PERCENT / 100.0) for k in range(4)])
    return np.einsum("nck,ks->ncs", rng.standard_normal((count, curves, 4)), base)


def animals(prefix, rng, count, shift=0.0, strides=8):
    found = []
    for k in range(count):
        own = smooth(rng, 1, 2)[0] + shift * np.exp(-(((PERCENT - 60.0) / 12.0) ** 2)) * np.array(
            [[1.0], [0.0]]
        )
        cycles = own[None] + 0.5 * smooth(rng, strides, 2)
        duty = (
            0.6 + 0.02 * rng.standard_normal() + 0.01 * rng.standard_normal(strides) + 0.03 * shift
        )
        length = 60.0 + 3.0 * rng.standard_normal() + rng.standard_normal(strides)
        found.append(
            Animal(
                name=f"{prefix}{k}",
                scalars={"duty factor": duty, "stride length [mm]": length},
                curves={"angle [°]": Cycles(("knee", "ankle"), np.moveaxis(cycles, 1, 2))},
                strides=strides,
            )
        )
    return tuple(found)


def welch_p(first, second):
    """Welch's p, which orders relabellings as their normal deviates do."""
    return stats.ttest_ind(first, second, equal_var=False).pvalue


def test_exact_p_is_counted_by_hand():
    one = np.array([3.0, 4.0, 5.0, 9.0])
    other = np.array([1.0, 2.0, 2.5])
    both = np.concatenate([one, other])
    chances = [
        welch_p(both[list(rows)], np.delete(both, rows)) for rows in combinations(range(7), 4)
    ]
    test = permutation_test(one, other)
    assert test.exact
    assert test.relabellings == 35
    assert float(test.p) == pytest.approx(np.mean(np.array(chances) <= welch_p(one, other) + 1e-9))
    theirs = stats.ttest_ind(one, other, equal_var=False)
    assert float(test.statistic) == pytest.approx(theirs.statistic)


def test_a_difference_in_spread_alone_is_called_no_difference_of_means():
    """Pooled variance calls 20 % and more; so many studies are not above 5 % by chance."""
    rng = np.random.default_rng(11)
    repeats = 200
    numbers = curves = 0
    for _ in range(repeats):
        few = 3.0 * rng.standard_normal(5)
        numbers += permutation_test(few, rng.standard_normal(15), most=400).p <= 0.05
        wide = 3.0 * smooth(rng, 5, 2)
        curves += np.nanmin(permutation_test(wide, smooth(rng, 15, 2), most=200).p) <= 0.05
    assert numbers <= stats.binom.ppf(0.999, repeats, 0.05)
    assert curves <= stats.binom.ppf(0.999, repeats, 0.05)


def test_effects_and_differences_hold_zero_together():
    rng = np.random.default_rng(12)
    for _ in range(20):
        one = 1.5 + 3.0 * rng.standard_normal(4)
        other = rng.standard_normal(9)
        low, high = effect_interval(effect_size(one, other))
        ends = stats.ttest_ind(one, other, equal_var=False).confidence_interval()
        assert (low < 0.0 < high) == (ends.low < 0.0 < ends.high)


def test_against_scipy_with_many_relabellings():
    rng = np.random.default_rng(0)
    one = rng.normal(0.8, 1.0, 12)
    other = rng.normal(0.0, 1.0, 12)
    ours = permutation_test(one, other, most=5000)
    theirs = stats.permutation_test(
        (one, other),
        lambda a, b, axis: stats.ttest_ind(a, b, axis=axis, equal_var=False).statistic,
        n_resamples=5000,
        rng=1,
    )
    assert not ours.exact
    assert float(ours.p) == pytest.approx(theirs.pvalue, abs=0.01)


@pytest.mark.parametrize(
    ("n", "m", "floor"), [(3, 3, 0.1), (3, 4, 1 / 35), (4, 4, 2 / 70), (5, 5, 2 / 252)]
)
def test_no_p_below_what_the_groups_can_reach(n, m, floor):
    assert p_floor(n, m) == pytest.approx(floor)
    test = permutation_test(100.0 + np.arange(n), np.arange(m))
    assert float(test.p) == pytest.approx(floor)


def test_every_relabelling_once():
    rows, exact = labellings(4, 3)
    assert exact
    assert len(np.unique(rows, axis=0)) == 35
    assert rows[0].tolist() == [True] * 4 + [False] * 3
    rows, exact = labellings(10, 10, most=500)
    assert not exact
    assert (rows.sum(axis=1) == 10).all()
    assert rows[0, :10].all()


def test_false_calls_along_curves_are_as_rare_as_said():
    rng = np.random.default_rng(4)
    repeats = 250
    called = sum(
        np.nanmin(permutation_test(smooth(rng, 5, 3), smooth(rng, 5, 3)).p) < 0.05
        for _ in range(repeats)
    )
    # Exact level of 5 against 5: the largest multiple of 2/252 below 0.05.
    assert stats.binomtest(called, repeats, 12 / 252).pvalue > 0.001


def test_samples_alone_call_too_often():
    rng = np.random.default_rng(4)
    called = [
        np.nanmin(permutation_test(smooth(rng, 5, 3), smooth(rng, 5, 3)).alone) < 0.05
        for _ in range(60)
    ]
    assert np.mean(called) > 0.2


def test_a_difference_is_found_where_it_is():
    rng = np.random.default_rng(5)
    found = compare_groups(
        Group("mutant", animals("m", rng, 7, 6.0)), Group("control", animals("c", rng, 7))
    )
    knee, ankle = found.curves
    assert knee.regions
    start = knee.regions[0][0]
    stop = knee.regions[-1][1]
    assert 35.0 < start < 60.0 < stop < 90.0
    assert not ankle.regions
    assert knee.difference[60] == pytest.approx(6.0, abs=1.5)
    assert knee.low[60] < 6.0 < knee.high[60]
    duty = next(one for one in found.scalars if one.name == "duty factor")
    length = next(one for one in found.scalars if one.name == "stride length [mm]")
    assert duty.holm < 0.05
    assert duty.g_low > 0.0
    assert length.holm > 0.05
    assert found.animals[0] == tuple((f"m{k}", 8) for k in range(7))


def test_more_strides_are_not_more_animals():
    rng = np.random.default_rng(6)
    few = animals("m", rng, 4, 0.0, 4)
    many = animals("c", rng, 4, 0.0, 400)
    found = compare_groups(Group("m", few), Group("c", many))
    assert [one.first[2] for one in found.scalars] == [4, 4]
    assert found.floor == pytest.approx(2 / 70)


def test_small_groups_are_described():
    rng = np.random.default_rng(7)
    found = compare_groups(Group("m", animals("m", rng, 2, 5.0)), Group("c", animals("c", rng, 3)))
    assert not found.tested
    assert all(np.isnan(one.p) for one in found.scalars)
    assert all(not one.regions and np.isnan(one.p).all() for one in found.curves)
    assert any("described, not tested" in one for one in found.notes)
    single = compare_groups(Group("m", animals("m", rng, 1)), Group("c", animals("c", rng, 1)))
    assert np.isfinite(single.scalars[0].difference)
    assert np.isnan(single.scalars[0].g)
    three = compare_groups(Group("m", animals("m", rng, 3)), Group("c", animals("c", rng, 3)))
    assert any("cannot reach a p below 0.1" in one for one in three.notes)
    for one in (found, single, three):
        assert "<html" in group_page(one, PageHead(title="groups"))


def test_gaps_and_what_not_all_have_are_left_out():
    rng = np.random.default_rng(8)
    own = list(animals("m", rng, 3))
    values = np.array(own[0].curves["angle [°]"].values)
    values[:, 20:30, 0] = np.nan
    own[0] = Animal(
        name="m0",
        scalars={"duty factor": own[0].scalars["duty factor"]},
        curves={"angle [°]": Cycles(("knee", "ankle"), values)},
        strides=8,
    )
    found = compare_groups(Group("m", tuple(own)), Group("c", animals("c", rng, 3)))
    assert [one.name for one in found.scalars] == ["duty factor"]
    assert any("stride length [mm]" in one for one in found.notes)
    assert np.isnan(found.curves[0].p[20:30]).all()
    assert np.isfinite(found.curves[0].p[40:]).all()
    assert np.isfinite(found.curves[1].p).all()


def test_corrections():
    p = np.array([0.01, 0.04, 0.03, np.nan, 0.005])
    np.testing.assert_allclose(holm(p), [0.03, 0.06, 0.06, np.nan, 0.02])
    np.testing.assert_allclose(
        benjamini_hochberg(p)[[0, 1, 2, 4]], stats.false_discovery_control(p[[0, 1, 2, 4]])
    )


def test_effect_size_is_unbiased_and_its_interval_holds():
    rng = np.random.default_rng(9)
    one = rng.normal(0.8, 1.0, (6, 20000))
    other = rng.normal(0.0, 1.0, (5, 20000))
    assert np.mean(effect_size(one, other).g) == pytest.approx(0.8, abs=0.02)
    held = []
    for k in range(200):
        low, high = effect_interval(effect_size(one[:, k], other[:, k]))
        held.append(low < 0.8 < high)
    assert stats.binomtest(sum(held), 200, 0.95).pvalue > 0.001


def test_what_is_wrong_is_named():
    rng = np.random.default_rng(1)
    some = animals("m", rng, 3)
    with pytest.raises(BadData, match="has no animals"):
        compare_groups(Group("m", ()), Group("c", some))
    with pytest.raises(BadData, match="in both groups"):
        compare_groups(Group("m", some), Group("c", some))
    with pytest.raises(BadData, match="needs 3 or more"):
        permutation_test(np.zeros(2), np.zeros(5))
    with pytest.raises(BadData, match="alpha"):
        GroupOptions(alpha=0.0)


def test_a_member_has_each_curve_over_its_own_strides():
    time = np.linspace(0.0, 4.0, 401)
    values = np.stack([np.sin(np.pi * time), np.cos(np.pi * time)], axis=1)
    angles = mm.Series(time, ("knee_angle_r", "knee_angle_l"), values)
    curves = angles.strides({"right": [0.0, 2.0, 4.0], "left": [1.0, 3.0]})
    animal = mm.groups.member("s01", {"angle": curves}, {"speed": 1.2})
    assert animal.scalar("speed") == 1.2
    for name in angles.names:
        np.testing.assert_allclose(animal.curve("angle", name), curves.mean(name))
