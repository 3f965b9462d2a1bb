"""The part of the page on a motion that identification did not see, [D] figure 3.3."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.report.charts.chart import Line, Panel, number, time_plot
from myomorph.report.page.section import Figure, Grid, Section
from myomorph.report.trial.identification_tables import WrenchError, wrench_errors
from myomorph.report.trial.identified import COMPONENTS, UNITS, WrenchCheck

STYLES = ("first", "second", "third", "fourth", "left", "middle")
"""Of the methods' lines, in their order."""

FORCE_FIRST = (3, 4, 5, 0, 1, 2)
LONGEST = 10.0
"""Charts show so much of a motion that is twice as long, or longer [s]."""


def validation_section(check: WrenchCheck, styles: Mapping[str, str], order: int = 0) -> Section | None:
    """Six components of the base wrench, measured and by every method, and their errors.

    Parameters
    ----------
    styles : of each method's line
    order : of the motion among those that were not used, 0 for the first
    """
    if not len(check.time) or not check.predicted:
        return None
    styles = {name: styles.get(name, STYLES[i % len(STYLES)]) for i, name in enumerate(check.predicted)}
    span = _busiest(check)
    seen = int(np.isfinite(check.measured).all(axis=1).sum())
    lead = (
        f"The wrench on the base link, {check.trial or 'a motion that was not used'}: {number(seen, 1.0)} frames. "
        "Errors are predicted less measured. Moments are about the base link's origin, in ground axes."
    )
    if span[1] - span[0] < float(check.time[-1] - check.time[0]) - 1e-9:
        lead += f" Charts show the {number(span[1] - span[0])} s in which it changes most; the tables cover all of it."
    return Section(
        f"cross-validation-{order + 1}" if order else "cross-validation",
        f"Cross-validation: {check.trial or order + 1}" if order else "Cross-validation",
        lead,
        (("measured", "measured"), *((style, name) for name, style in styles.items())),
        tuple(Figure(_chart(check, k, styles, span)) for k in FORCE_FIRST),
        _grids(check),
    )


def _chart(check: WrenchCheck, k: int, styles: Mapping[str, str], span: tuple[float, float]) -> str:
    lines = [Line(check.time, check.measured[:, k], "measured", "measured")]
    # The first method is drawn last, over the others.
    for name in reversed(list(check.predicted)):
        lines.append(Line(check.time, check.predicted[name][:, k], styles[name], name))
    return time_plot(Panel(COMPONENTS[k], UNITS[k], lines, span, height=200))


def _grids(check: WrenchCheck) -> tuple[Grid, ...]:
    methods = tuple(check.predicted)
    errors = {(one.component, one.method): one for one in wrench_errors(check)}

    def grid(title: str, of: str, folded: bool = False, percent: bool = False) -> Grid:
        def told(one: WrenchError | None) -> str:
            return "–" if one is None else number(float(getattr(one, of))) + (" %" if percent else "")

        rows = []
        for k in FORCE_FIRST:
            name = COMPONENTS[k] if percent else f"{COMPONENTS[k]} [{UNITS[k]}]"
            rows.append((name, *(told(errors.get((COMPONENTS[k], method))) for method in methods)))
        return Grid(("Component", *methods), tuple(rows), title, folded)

    return (
        grid("Error, root mean square", "rms"),
        grid("Error, mean of its size", "mean_absolute"),
        grid("Error, mean", "mean", folded=True),
        grid("Error, largest", "peak", folded=True),
        grid("Error, root mean square, over body weight (moments: × 1 m)", "share", folded=True, percent=True),
    )


def _busiest(check: WrenchCheck) -> tuple[float, float]:
    """The whole time, or of a long motion the part in which the measured wrench changes most [s]."""
    time = check.time
    if time[-1] - time[0] <= 2.0 * LONGEST:
        return float(time[0]), float(time[-1])
    measured = np.nan_to_num(check.measured)
    size = np.maximum(np.abs(measured).max(axis=0), 1e-12)
    change = np.concatenate([[0.0], np.abs(np.diff(measured / size, axis=0)).sum(axis=1).cumsum()])
    last = np.minimum(np.searchsorted(time, time + LONGEST), len(time) - 1)
    start = int(np.argmax(np.where(time + LONGEST <= time[-1], change[last] - change, -1.0)))
    return float(time[start]), float(time[start] + LONGEST)
