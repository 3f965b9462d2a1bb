"""Differences of values with their errors on the page of a study."""

from __future__ import annotations

from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.study.study_input import StudyInput, ValueDifference
from myomorph.lab.report.study.study_page import study_page

NAN = float("nan")


def difference(quantity, means, half, whole, sd):
    middle = means[0] - means[1]
    return ValueDifference(
        first="slow",
        second="fast",
        step="id",
        quantity=quantity,
        unit="N m",
        paired=True,
        unit_of="subjects",
        count=(4, 4),
        means=means,
        low=middle - half,
        high=middle + half,
        measured_sd=sd,
        low_all=middle - whole,
        high_all=middle + whole,
    )


def test_what_is_largest_beside_its_interval_comes_first():
    small = difference("knee_angle_r_moment, maximum", (30.0, 31.0), 2.0, 3.0, 1.5)
    large = difference("ankle_angle_r_moment, minimum", (-90.0, -110.0), NAN, 6.0, 3.0)
    page = study_page(
        StudyInput(name="walks", date="2026", version="0", trials=(), differences=(small, large))
    )
    assert page.index("ankle_angle_r_moment") < page.index("knee_angle_r_moment")
    assert f"{number(14.0)} to {number(26.0)}" in page
    assert "Differences with their errors" in page
    assert "slow minus fast" in page


def test_without_draws_nothing_is_said():
    assert "Differences with their errors" not in study_page(
        StudyInput(name="walks", date="2026", version="0", trials=())
    )


def test_differences_without_any_width_are_no_table():
    same = difference("duration", (0.6, 0.6), 0.0, 0.0, 0.0)
    assert "Differences with their errors" not in study_page(
        StudyInput(name="walks", date="2026", version="0", trials=(), differences=(same,))
    )
