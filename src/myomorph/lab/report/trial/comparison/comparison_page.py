"""The page on two sessions of walking: same axes, curves with their spread, differences."""

from __future__ import annotations

from collections.abc import Sequence

from myomorph import __version__
from myomorph.lab.analysis.gait_curves import KEYS, SIDES, VARIABLES, GaitVariable
from myomorph.lab.analysis.stride_spread import MIN_STRIDES
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.page.page import page_text
from myomorph.lab.report.page.parts import Grid
from myomorph.lab.report.trial.answer.first_screen import STYLES
from myomorph.lab.report.trial.answer.judgement import USES, Use
from myomorph.lab.report.trial.comparison.session_difference import (
    DEGREES,
    SHARE,
    SessionDifference,
    session_differences,
)
from myomorph.lab.report.trial.comparison.walk_session import WalkSession
from myomorph.lab.report.trial.gait.gait_axis import AXES
from myomorph.lab.report.trial.gait.gait_chart import StrideLine, gait_chart
from myomorph.lab.report.trial.gait.gait_page import KINDS, foot_off, short_title
from myomorph.lab.report.trial.gait.gait_tables import spread_words
from myomorph.lab.report.trial.gait.gait_title import gait_title

RULE = (
    "Larger: than the larger standard deviation between strides of both sessions, and of angles"
    f" than {DEGREES:g}°, of moments, powers and forces than {100.0 * SHARE:g} % of the larger"
    f" value. It is stated for sides with {MIN_STRIDES} or more strides in each session. No"
    " statistical test."
)


def comparison_page(first: WalkSession, second: WalkSession, notes: Sequence[str] = ()) -> str:
    """Return the page as HTML text that needs nothing else.

    Parameters
    ----------
    first, second : sessions, in the order in which they are compared
    notes : on the sessions, one sentence each
    """
    use = stricter(first.use, second.use)
    variables = [each for each in VARIABLES if each.kind in KINDS[use]]
    differences = session_differences(first, second, variables)
    said = [each for each in differences if each.is_larger]
    charts = [chart for each in variables for chart in _charts(each, first, second) if chart]
    return page_text(
        "comparison.html.j2",
        version=__version__,
        sessions=(first, second),
        titles=[gait_title(session.curves.strides) for session in (first, second)],
        use=USES[use],
        judgement_style=STYLES[use],
        charts=charts,
        said=difference_grid(said, first, second, "Larger than spread and limit"),
        every=difference_grid(differences, first, second, "All differences"),
        judged=sum(each.is_larger is not None for each in differences),
        notes=[RULE, *notes],
    )


def stricter(first: Use, second: Use) -> Use:
    """Return what both verdicts allow."""
    order = list(USES)
    return order[max(order.index(first), order.index(second))]


def _charts(variable: GaitVariable, first: WalkSession, second: WalkSession) -> list[str]:
    """Return a chart for each side, with both sessions in it."""
    index = KEYS.index(variable.key)
    charts = []
    for side in SIDES:
        lines = [
            StrideLine(
                strides=session.curves.of(side)[:, :, index],
                style=style,
                label=session.name,
                count_label="n",
                foot_off=foot_off(session.curves, side),
            )
            for session, style in ((first, "first"), (second, side))
        ]
        title = f"{short_title(variable)}, {side}"
        charts.append(gait_chart(title, variable.unit, AXES[variable.key], lines))
    return charts


def difference_grid(
    differences: Sequence[SessionDifference], first: WalkSession, second: WalkSession, title: str
) -> Grid | None:
    """Return differences as a table; None where there are none."""
    if not differences:
        return None
    head = (
        "Of each stride",
        "Side",
        f"{first.name}, mean ± SD (n)",
        f"{second.name}, mean ± SD (n)",
        "Difference",
        "Larger than spread and limit",
    )
    return Grid(head, tuple(map(_row, differences)), title)


def _row(each: SessionDifference) -> tuple[str, ...]:
    """Return the cells of a difference."""
    sign = "+" if each.difference > 0.0 else ""
    if each.is_larger is None:
        said = "few strides"
    else:
        said = "yes" if each.is_larger else "no"
    return (
        f"{each.quantity} [{each.unit}]",
        each.side,
        spread_words(each.first),
        spread_words(each.second),
        f"{sign}{number(each.difference)}",
        said,
    )
