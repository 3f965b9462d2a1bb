"""The section that sets an estimate beside the truth of a simulated capture."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.series import Series
from myomorph.report.charts.chart import number
from myomorph.report.charts.columns import Comparison, compared
from myomorph.report.page.section import Grid, Section
from myomorph.report.trial.prepared import Prepared


def truth_section(prepared: Prepared) -> Section | None:
    """Estimate beside truth, for captures that were simulated."""
    given = prepared.given
    truth = given.recorded.truth
    if truth is None:
        return None
    grids = []
    model = given.model
    turning = {one.name for one in model.coordinates if one.motion == "rotational"} if model else set()
    if truth.motion is not None and given.kinematics.motion is not None:
        grids.append(
            _compared_grid(
                "Angles and translations", compared(given.kinematics.motion, truth.motion), turning, "°", "m"
            )
        )
    if truth.torques is not None and given.dynamics.torques is not None:
        grids.append(
            _compared_grid("Joint moments", compared(given.dynamics.torques, truth.torques), turning, "N·m", "N")
        )
    if truth.activations is not None and given.tension is not None:
        series = Series(given.tension.time, given.tension.muscles, given.tension.activations)
        grids.append(_compared_grid("Activations", compared(series, truth.activations), set(), "", ""))
    shown = tuple(grid for grid in grids if grid.rows)
    if not shown:
        return None
    summary = "; ".join(f"{grid.title.lower()}: {grid.rows[0][1]} RMS in all" for grid in shown)
    return Section(
        "truth",
        "Estimate and truth",
        "The capture was simulated, so the true values are known and drawn dashed above. "
        f"{summary[:1].upper()}{summary[1:]}.",
        (),
        (),
        shown,
    )


def _compared_grid(title: str, rows: Sequence[Comparison], turning: set[str], unit: str, other: str) -> Grid:
    def told(value: float, name: str) -> str:
        if unit == "°" and name in turning:
            return f"{number(float(np.rad2deg(value)))} °"
        return f"{number(value)} {unit if name in turning or not other else other}".strip()

    def group(text: str, chosen: list[Comparison], name: str) -> tuple[str, ...]:
        rms = float(np.sqrt(np.mean([one.rmse**2 for one in chosen])))
        return text, told(rms, name), told(max(one.worst for one in chosen), name), "", ""

    turned = [one for one in rows if one.name in turning] or list(rows)
    lines = [group("all" if len(turned) == len(rows) else "all rotations", turned, turned[0].name)] if rows else []
    for one in rows:
        lines.append(
            (
                one.name,
                told(one.rmse, one.name),
                told(one.worst, one.name),
                told(one.span, one.name),
                number(one.correlation),
            )
        )
    return Grid(
        ("", "RMS difference", "largest", "range of the truth", "correlation"), tuple(lines), title, len(lines) > 14
    )
