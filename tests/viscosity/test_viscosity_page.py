"""The page on a cohort prints the tables as the paper does.

It draws its values where they belong.
"""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.interval import Interval
from myomorph.lab.report.charts.marks import Level
from myomorph.lab.report.charts.points import Cloud, xy_plot
from myomorph.lab.report.charts.rows import Beside, IntervalLook, interval_bars, interval_rows
from myomorph.lab.report.page.parts import Note
from myomorph.swings.viscosity.cohort import MEAN, SD, SPECIMENS, cohort
from myomorph.swings.viscosity.report.page import viscosity_page
from myomorph.swings.viscosity.report.specimen_report import (
    ArmError,
    ArmSpread,
    CutoffScan,
    HeldOutSwing,
    PassiveModel,
    Residual,
    SpecimenReport,
    ViscosityInput,
    specimen_report,
)
from myomorph.swings.viscosity.report.tables import (
    scientific,
    table_section,
    truth_grid,
    with_interval,
)
from swing_cohort import AXES, specimens


@pytest.fixture(scope="module")
def reports():
    return tuple(
        replace(specimen_report(one), truth=printed.values, paper=printed.values)
        for one, printed in zip(specimens(), SPECIMENS, strict=True)
    )


def given(reports, **changes):
    made = ViscosityInput("shoulder <1>", reports, notes=(Note("simulated", "made & drawn"),))
    return replace(made, **changes)


def test_tables_are_as_the_paper_prints_them(reports):
    lines = {line.quantity.name: line for line in cohort([specimen.row for specimen in reports])}
    one, two, means, *_ = table_section(reports, lines).grids
    assert one.rows[0] == ("01", "2.02E+00", "4.25E-01", "7.61E-02")
    assert one.rows[6] == ("mean", "2.02E+00", "4.33E-01", "5.33E-02")
    assert two.rows[4] == (
        "05",
        "2.66E+00",
        "5.62E-01",
        "9.36E-01",
        "4.35E-01",
        "1.52E-01",
        "2.48E+03",
    )
    assert two.rows[6][-2:] == (scientific(MEAN.total_viscosity), scientific(MEAN.muscle_viscosity))
    assert two.rows[7][-2:] == (scientific(SD.total_viscosity), scientific(SD.muscle_viscosity))
    assert two.rows[10] == ("literature: Stroeve 1999", "", "", "", "", "2.00E-01", "")
    joint = next(row for row in means.rows if row[0].startswith("Joint"))
    assert joint[1:4] == ("0.0533 ± 0.0133",) * 3
    assert joint[5].startswith("yes, off by +0.0 %")


def test_truth_paper_and_estimate_stand_side_by_side(reports):
    grid = truth_grid(reports)
    assert len(grid.rows) == 6 * 9
    row = next(row for row in grid.rows if row[0] == "05" and row[1].startswith("Muscle"))
    assert row[2:4] == ("2\u202f480", "2\u202f480")
    assert row[5:] == ("+0.0 %", "yes")
    assert truth_grid(replace(one, truth={}, paper={}) for one in reports) is None


def test_values_have_the_digits_that_their_interval_leaves():
    assert with_interval(Interval(0.076123, 0.0756, 0.0767)) == "0.0761 (0.0756 to 0.0767)"
    assert with_interval(Interval(241.3, 180.0, 400.0)) == "241 (180 to 400)"
    assert with_interval(Interval(0.765, 0.765, 0.765)) == "0.765"
    assert with_interval(None) == "–"


def test_the_page_says_first_what_is_simulated_and_what_failed(reports):
    page = viscosity_page(
        given((*reports[:3], SpecimenReport("04", failure="a wire slipped <here>")))
    )
    head = page.split("<nav")[0]
    assert "shoulder &lt;1&gt;" in head
    assert "Specimen 04 could not be done: a wire slipped &lt;here&gt;" in head
    assert "made &amp; drawn" in head
    assert "3 of them with and without muscles" in head
    assert "specimen 01: axis z hardly moved" in page
    assert "Sensitivity: specimen" not in page
    assert not re.search(r"(src|href)=\"(?!data:|#|https://doi)", page)


def test_trust_is_drawn_where_it_is_given(reports):
    time = np.linspace(0.0, 1.0, 50)
    swing = np.sin(time)[:, None] * np.ones(3)
    full = replace(
        reports[0],
        models=(
            PassiveModel(
                condition="without",
                terms="viscosity",
                values="0.076 Nms/rad",
                viscosity=0.076,
                aic=0.0,
                bic=0.0,
                angle_error=0.01,
                wrench_error=0.1,
                chosen=True,
            ),
        ),
        held_out=(
            HeldOutSwing(
                condition="without",
                time=time,
                axes=AXES,
                measured=swing,
                predicted={"viscosity": 1.1 * swing},
            ),
        ),
        cutoff=CutoffScan(
            cutoffs=np.array([4.0, 8.0]),
            chosen=6.0,
            values={"joint_viscosity": np.array([0.07, 0.08])},
            reason="Chosen so.",
        ),
        arms=ArmSpread(
            errors=np.array([0.0, 0.1]),
            low=np.array([240.0, 200.0]),
            median=np.array([240.0, 239.0]),
            high=np.array([240.0, 290.0]),
            draws=20,
            kinds=(
                ArmError(
                    kind="one factor",
                    size="10 %",
                    sd=0.2,
                    bias=-0.05,
                    low=200.0,
                    median=239.0,
                    high=290.0,
                ),
            ),
        ),
        calibration=(Residual(what="plate", value=0.4, unit="mm", detail="8 placements"),),
    )
    page = viscosity_page(given((full,)))
    for told in (
        "Held-out swing without muscles, axis z",
        "viscosity (chosen)",
        "Change with the cut-off, without muscles",
        "Chosen so.",
        "−5.0 %",
        "8 placements",
    ):
        assert told in page
    assert len(re.findall("<svg", page)) == len(re.findall("</svg>", page))


def test_a_specimen_with_one_condition_is_drawn(reports):
    half = replace(
        reports[0],
        intact=None,
        muscles=None,
        row={"joint_viscosity": reports[0].row["joint_viscosity"]},
    )
    page = viscosity_page(given((half,)))
    assert "Angles without muscles" in page
    assert "Angles with muscles" not in page


def test_points_lie_where_their_values_are():
    drawn = xy_plot(
        "T",
        "N",
        "x",
        [
            Cloud(
                x=np.array([0.0, 1.0, 2.0]),
                y=np.array([0.0, 1.0, 4.0]),
                style="first",
                label="c",
                dotted=True,
            )
        ],
    )
    x, y = np.array(re.findall(r'cx="([\d.]+)" cy="([\d.]+)"', drawn), dtype=float).T
    assert np.diff(x) == pytest.approx([x[1] - x[0]] * 2, abs=0.11)
    assert (y[0] - y[2]) / (y[0] - y[1]) == pytest.approx(4.0, abs=0.02)


def test_bars_reach_their_values_and_intervals_beyond_the_chart_are_cut():
    values = [Interval(1.0, 0.5, 1.5), Interval(2.0, 1.0, 50.0), None]
    drawn = interval_bars(
        "T",
        "N",
        ["a", "b", "c"],
        values,
        IntervalLook(
            beside=[Beside("t", "truth", np.array([1.0, np.nan, 3.0]))],
            levels=[Level(value=1.5, label="l", style="mean", spread=0.5)],
        ),
    )
    heights = [float(one) for one in re.findall(r'class="bar[^>]*height="([\d.]+)"', drawn)]
    assert heights[1] == pytest.approx(2.0 * heights[0], abs=0.2)
    assert len(re.findall('class="tack', drawn)) == 2
    low = min(float(one) for one in re.findall(r"V([\d.]+)M", drawn))
    assert low >= 26.0
    assert "c: t 3.00 N" in drawn


def test_rows_place_dots_in_proportion():
    drawn = interval_rows(
        "T",
        "N",
        ["a", "b"],
        [Interval(1.0, 0.5, 1.5), Interval(2.0, 1.5, 2.5)],
        IntervalLook(levels=[Level(1.0, "<l>", "mean")]),
    )
    dots = [float(one) for one in re.findall(r'cx="([\d.]+)"', drawn)]
    line = float(re.search(r'class="level [^>]*M([\d.]+) ', drawn).group(1))
    assert line == pytest.approx(dots[0], abs=0.11)
    assert "&lt;l&gt;" in drawn
