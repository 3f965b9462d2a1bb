"""Mean and population SD of a cohort, against the paper's printed tables and against samples."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.interval import Interval
from myomorph.swings.viscosity.cohort import MEAN, QUANTITIES, SD, SPECIMENS, cohort, specimen_row
from swing_cohort import published_row, specimens


@pytest.mark.parametrize(
    "name", ["joint_viscosity", "total_viscosity", "muscle_viscosity", "estimated_muscle_mass"]
)
def test_the_papers_own_figures_give_its_mean_and_population_sd(name):
    line = next(
        one
        for one in cohort([published_row(one) for one in SPECIMENS])
        if one.quantity.name == name
    )
    assert f"{line.mean:.2E}" == f"{getattr(MEAN, name):.2E}"
    assert f"{line.sd:.2E}" == f"{getattr(SD, name):.2E}"
    assert line.count == 6


def test_rows_carry_what_was_identified():
    for printed, found in zip(SPECIMENS, specimens(), strict=True):
        row = specimen_row(found)
        assert list(row) != []
        assert {name: one.value for name, one in row.items()} == {
            one.name: getattr(printed, one.name) for one in QUANTITIES
        }


def test_the_interval_of_the_mean_holds_it_as_often_as_it_says():
    random = np.random.default_rng(0)
    truth = np.array([1.0, 2.0, 5.0])
    spread = np.array([0.1, 0.3, 0.2])
    held = 0
    for _ in range(2000):
        drawn = truth + spread * random.normal(size=3)
        rows = [
            {"mass_intact": Interval(v, v - 1.96 * s, v + 1.96 * s)}
            for v, s in zip(drawn, spread, strict=True)
        ]
        (line,) = cohort(rows)
        held += line.low <= truth.mean() <= line.high
    assert 0.935 < held / 2000 < 0.965


def test_what_a_specimen_lacks_is_not_counted():
    lines = {
        one.quantity.name: one
        for one in cohort(
            [{"mass_intact": Interval(2.0, 2.0, 2.0)}, {"com_intact": Interval(0.4, 0.4, 0.4)}, {}]
        )
    }
    assert {name: one.count for name, one in lines.items()} == {"mass_intact": 1, "com_intact": 1}
    assert lines["mass_intact"].sd == 0.0
    assert lines["mass_intact"].low == lines["mass_intact"].high == 2.0


def test_unknown_intervals_stay_unknown():
    line, *_ = cohort([published_row(SPECIMENS[0]), published_row(SPECIMENS[1])])
    assert np.isnan(line.low)
    assert np.isnan(line.high)


def test_the_estimated_muscles_are_the_difference_of_the_printed_masses_as_rounded():
    for one in SPECIMENS:
        assert (
            abs(one.mass_intact - one.mass_muscles_removed - one.estimated_muscle_mass)
            <= 0.005 + 0.005 + 0.0005 + 1e-12
        )
