"""Load of the knees over the strides, in body weights."""

from __future__ import annotations

from dataclasses import replace
from typing import cast

import numpy as np

from myomorph.core.model.cycle_samples import SAMPLES
from myomorph.core.model.model import Model
from myomorph.core.model.segments import joint_labels
from myomorph.core.model.series import Series
from myomorph.lab.analysis.cycles import over_cycles
from myomorph.lab.analysis.gait_curves import KEYS, SIDES, GaitCurves, joint_coordinate
from myomorph.lab.report.trial.answer.answer_curve import AnswerCurve, SideCurve
from myomorph.lab.report.trial.answer.sentence import Side
from myomorph.lab.report.trial.prepared import Prepared

KNOWN = 0.98
"""Share of a stride in which the load must be known."""


def knee_load_curve(prepared: Prepared, gait: GaitCurves) -> AnswerCurve | None:
    """Return the size of the force in each knee over the strides whose foot stood on plates.

    Where tensions of a leg are not known, as its load was not measured, a stride is left out.

    Parameters
    ----------
    prepared : with the forces in joints
    gait : of the same strides

    Returns
    -------
    the curve [body weights], None where no stride shows a knee
    """
    model = prepared.results.model
    forces = prepared.results.dynamics.joint_force
    weight = prepared.weight
    if model is None or forces is None or not weight:
        return None
    sides = []
    for side in SIDES:
        name = _knee(model, side)
        measured = np.isfinite(gait.of(side)[:, :, KEYS.index("knee_moment")]).any(axis=1)
        spans = [
            (stride.start, stride.stop)
            for stride, stood in zip(gait.strides[side], np.atleast_1d(measured), strict=True)
            if stood
        ]
        if name not in forces.names or not spans:
            continue
        series = Series(forces.time, (side,), forces[name][:, None] / weight)
        cycles = over_cycles(series, spans, SAMPLES).values[:, :, 0]
        known = cycles[np.isfinite(cycles).mean(axis=1) >= KNOWN]
        if len(known):
            curve = SideCurve(side=cast(Side, side), label=side, cycles=known)
            sides.append(replace(curve, mark=curve.highest))
    if not sides:
        return None
    return AnswerCurve(
        title="Knee load",
        unit="body weights",
        sides=tuple(sides),
        at=np.linspace(0.0, 100.0, SAMPLES),
        digits=1,
    )


def _knee(model: Model, side: str) -> str:
    """Return the plain name of a knee among the forces in joints, "" where there is none."""
    coordinate = joint_coordinate(model, "knee_flexion", side)
    joint = next((one for one in model.joints if coordinate in one.coordinates), None)
    return joint_labels(model)[joint.name] if coordinate and joint is not None else ""
