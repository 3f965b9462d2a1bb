"""The page of a person's muscles: fiber lengths before and after, every parameter, a summary.

Parameters have their intervals.
"""

from __future__ import annotations

from collections import Counter
from collections.abc import Sequence

import numpy as np

from myomorph.body.personalize.estimates import MuscleEstimate
from myomorph.body.personalize.personalize import Personalized
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import few
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.marks import (
    Box,
    Frame,
    dot,
    drawing,
    frame,
    grid_along,
    mark,
    rect,
    text,
)
from myomorph.lab.report.page.page import rendered
from myomorph.lab.report.page.parts import Figure, Grid, PageHead, Section
from myomorph.lab.report.trial.summary_lines import FIBER_RANGE, reserve_unit

ROW = 11.0
LEFT = 96.0
WIDTH = 430.0
PHYSIOLOGICAL = (0.5, 1.4)
PLACES = {"optimal_fiber_length": 4, "tendon_slack_length": 4}


def personalized_page(head: PageHead, person: Personalized) -> str:
    """Render the page as HTML text."""
    sections = []
    if person.before.any():
        caption = (
            "Normalized fiber lengths over the recordings, tendons at slack length: above of the"
            " generic muscle, below of the person's. The shaded range is that expected of a"
            " recording."
        )
        figure = Figure(
            fiber_ranges(person.model.muscle_names, person.before, person.after), "full", caption
        )
        legend = (("second", "generic"), ("first", "person"))
        sections.append(
            Section(key="fibers", title="Fiber lengths", lead="", legend=legend, figures=(figure,))
        )
    lead = ". ".join(personal_lines(person)) + "."
    grids = tuple(_grids(person.estimates))
    sections.append(Section("parameters", "Parameters", lead, grids=grids))
    return rendered(head, sections, ())


def fiber_ranges(names: Sequence[str], before: Array, after: Array) -> str:
    """Draw ranges of normalized fiber lengths before and after, one row per muscle.

    Parameters
    ----------
    names : of the muscles
    before, after : (muscles, 2) shortest and longest, in optimal fiber lengths

    Returns
    -------
    The chart as an `<svg>` element
    """
    height = ROW * len(names)
    low = min(0.4, float(np.min([before, after])))
    high = max(1.6, float(np.max([before, after])))
    area = frame((LEFT, 24.0), (LEFT + WIDTH, 24.0 + height), (low, high), (0.0, float(len(names))))
    marks = []
    left_limit, right_limit = PHYSIOLOGICAL
    left = float(area.x.at(left_limit))
    right = float(area.x.at(right_limit))
    marks.append(rect("spread", Box(x=left, y=24.0, width=right - left, height=height)))
    marks.append(grid_along(area, 6))
    for index, name in enumerate(names):
        y = 24.0 + ROW * (index + 0.5)
        marks.append(text(LEFT - 4.0, y + 3.0, name, "tick y"))
        marks += _range_marks(area, name, before[index], y - 2.0, "second")
        marks += _range_marks(area, name, after[index], y + 2.0, "first")
    size = (LEFT + WIDTH + 20.0, height + 50.0)
    return drawing("ranges", "Normalized fiber length", size, *marks, unit="optimal fiber lengths")


def _range_marks(area: Frame, name: str, ends: Array, y: float, style: str) -> list[str]:
    """Draw a line along a muscle's row from the shortest to the longest, a dot at its end."""
    a = float(area.x.at(ends[0]))
    b = float(area.x.at(ends[1]))
    under = f"{name}: {number(ends[0])} to {number(ends[1])}"
    line = mark("path", f"line {style}", under, d=f"M{a:.1f} {y:.1f}H{max(b, a + 1.0):.1f}")
    return [line, dot(b, y, style, 1.6, under)]


def _grids(estimates: Sequence[MuscleEstimate]) -> list[Grid]:
    """Make a table of each kind of parameter."""
    head = ("of", "generic", "person", "90 % interval", "identifiable", "")
    grids = []
    for parameter in dict.fromkeys(row.parameter for row in estimates):
        shown = []
        for row in estimates:
            if row.parameter != parameter:
                continue
            places = PLACES.get(parameter, 3)
            known = np.isfinite(row.low)
            span = f"{row.low:.{places}f} to {row.high:.{places}f}" if known else ""
            if row.kept:
                remark = "generic kept"
            elif row.bound:
                remark = f"at its {row.bound} bound"
            else:
                remark = ""
            values = (f"{row.generic:.{places}f}", f"{row.person:.{places}f}")
            shown.append((row.of, *values, span, row.identifiable, remark))
        title = parameter.replace("_", " ").capitalize() + (" [m]" if parameter in PLACES else "")
        grids.append(Grid(head, tuple(shown), title, folded=len(shown) > 12))
    return grids


def personal_lines(personalized: Personalized) -> list[str]:
    """Summarize the fit: its data, held-out torques, and what the recordings show."""
    lines = []
    if personalized.mapped is not None:
        before = float(np.nanmax(personalized.mapped.before))
        after = float(np.nanmax(personalized.mapped.after))
        mapped = f"{len(personalized.mapped.muscles)} muscles mapped from the generic model"
        apart = f"{after:.3f} (root mean square over poses; {before:.3f} before)"
        lines.append(f"{mapped}: normalized fiber lengths differ by at most {apart}")
    if personalized.recordings:
        count = (
            f"{personalized.frames[1]} frames that count as {personalized.frames[0]:.0f}"
            " independent ones"
        )
        torques = f"torques of {len(personalized.coordinates)} coordinates"
        lines.append(f"{', '.join(personalized.recordings)}: {count}, {torques}")
    if personalized.held_out is not None:
        held_out = personalized.held_out
        generic = float(np.sqrt(np.nanmean(held_out.left_generic**2)))
        fitted = float(np.sqrt(np.nanmean(held_out.left**2)))
        better = "better" if held_out.score < held_out.score_generic else "NO better"
        if better == "better" and fitted > generic:
            better = (
                "better by the score, which includes EMG and the prior, but with larger torque"
                " residuals"
            )
        scores = f"score {held_out.score:.2f}, generic {held_out.score_generic:.2f}"
        told = f"{scores}; torque left {fitted:.2f}, generic {generic:.2f} N m"
        lines.append(
            f"{', '.join(held_out.recordings)}, held out: {better} than generic muscles ({told})"
        )
    elif personalized.recordings:
        lines.append(
            "no recording was held out: whether these muscles are better than generic ones is"
            " unknown"
        )
    further = (_torque_line(personalized), _parameter_line(personalized), _fiber_line(personalized))
    return [*lines, *(line for line in further if line)]


def _torque_line(personalized: Personalized) -> str:
    """Name the coordinate whose torques are known worst."""
    errors = np.asarray(personalized.torque_errors, float)
    if not len(errors) or not np.isfinite(errors).any():
        return ""
    worst = int(np.nanargmax(errors))
    unit = reserve_unit(personalized.model, personalized.coordinates[worst])
    middle = f"{float(np.nanmedian(errors)):.2g}"
    where = f"{personalized.coordinates[worst]} {errors[worst]:.2g} {unit}"
    return f"torques fitted to {middle} N m (median SD), worst {where}"


def _parameter_line(personalized: Personalized) -> str:
    """How many parameters the recordings show, and which end at what is physiological."""
    if not personalized.recordings:
        return ""
    counts = Counter(estimate.identifiable for estimate in personalized.estimates)
    bound = [
        f"{each.of} {each.parameter.replace('_', ' ')}"
        for each in personalized.estimates
        if each.bound
    ]
    ends = "none at a physiological limit"
    if bound:
        ends = f"{len(bound)} at a physiological limit ({few(bound, 2)})"
    told = (
        f"{counts['yes']} identifiable, {counts['partly']} partly, {counts['no']} as in the prior"
    )
    return f"of {len(personalized.estimates)} parameters {told}; {ends}"


def _fiber_line(personalized: Personalized) -> str:
    """Where fibers work in the recordings, against the range in which they pull."""
    after = np.asarray(personalized.after, float)
    if not after.size or not np.isfinite(after).any():
        return ""
    names = personalized.model.muscle_names
    low, high = FIBER_RANGE
    shortest = int(np.nanargmin(after[:, 0]))
    longest = int(np.nanargmax(after[:, 1]))
    with np.errstate(invalid="ignore"):
        outside = int(((after[:, 0] < low) | (after[:, 1] > high)).sum())
    verdict = (
        f"within {low:g} to {high:g}"
        if not outside
        else f"{outside} muscles outside {low:g} to {high:g}"
    )
    ends = (
        f"{after[shortest, 0]:.2f} ({names[shortest]}) to {after[longest, 1]:.2f} optimal lengths"
        f" ({names[longest]})"
    )
    return f"fibers work from {ends}: {verdict} (Zajac 1989)"
