"""The section on forces at contact points of joints: over the stride, or over time; peaks and impulses by stride."""

from __future__ import annotations

import numpy as np

from myomorph.analysis.cycles import band, over_cycles
from myomorph.analysis.joint_loads import own_strides, stride_loads
from myomorph.analysis.strides import Strides
from myomorph.model.series import Series
from myomorph.report.charts.axis import number
from myomorph.report.charts.curves import CycleCurve, Line, cycle_chart, time_plot
from myomorph.report.page.parts import Figure, Grid, Section
from myomorph.report.trial.prepared import Prepared
from myomorph.tension.joint_contact import JointContactForces

STYLES = ("first", "second", "third", "fourth")
HEAD = ("Force", "Stride", "From", "to", "Peak", "Peak, body weights", "at", "Impulse")


def joint_contact_section(prepared: Prepared) -> Section | None:
    """Whole force of each joint and the force at each of its contact points, in body weights."""
    forces = prepared.results.joint_contacts
    if forces is None or not len(forces) or not np.isfinite(forces.totals).any():
        return None
    strides = prepared.strides
    figures = tuple(Figure(_chart(prepared, forces, joint, strides), "medium") for joint in forces.joints)
    lead = (
        "The force that the joint transmits as a whole, and the pushes of its contact points along their normals, "
        "which balance the force along them and the moment across them. Forces across the normals (ligaments, "
        "friction) are part of the whole only."
    )
    if any(own_strides(joint, strides) for joint in forces.joints):
        lead += " Over the stride: thin lines are strides, the thick one their mean."
    rest = _left(forces)
    legend = [("first", "whole joint")]
    names = dict.fromkeys(forces.points)
    legend += list(zip(STYLES[1:], list(names)[: len(STYLES) - 1], strict=False))
    rows = tuple(
        (
            load.load,
            str(load.stride) if load.stride else "recording",
            f"{number(load.start, 0.001)} s",
            f"{number(load.stop, 0.001)} s",
            f"{number(load.peak)} N",
            number(load.peak / forces.weight),
            f"{load.peak_percent:.0f} %",
            f"{number(load.impulse)} N·s",
        )
        for load in stride_loads(forces.loads(), strides)
    )
    grid = Grid(HEAD, rows, "Peaks and impulses by stride", len(rows) > 12)
    return Section("joint_contacts", "Forces in joints", lead + rest, tuple(legend), figures, (grid,))


def _left(forces: JointContactForces) -> str:
    """What the points do not carry, joint by joint, as sentences; "" where that is nothing."""
    texts = []
    for j, joint in enumerate(forces.joints):
        moment = float(np.nanmax(forces.unbalanced_moments[:, j]))
        pull = float(np.nanmax(forces.unbalanced_forces[:, j]))
        if moment > 0.1:
            texts.append(f"where a point of {joint} lifts off, a moment of up to {number(moment)} N·m is left")
        if pull > 1.0:
            texts.append(f"{joint} is under tension of up to {number(pull)} N, which no contact point can transmit")
    text = "; ".join(texts)
    return f" {text[0].upper()}{text[1:]}." if text else ""


def _chart(prepared: Prepared, forces: JointContactForces, joint: str, strides: Strides | None) -> str:
    points = [index for index, name in enumerate(forces.joint_of) if name == joint]
    names = ("whole joint", *(forces.points[point] for point in points))
    columns = [forces.of(joint), *(forces.forces[:, point] for point in points)]
    loads = Series(forces.time, names, np.stack(columns, axis=1) / forces.weight)
    steps = own_strides(joint, strides)
    styles = (STYLES * (1 + len(names) // len(STYLES)))[: len(names)]
    if not steps:
        lines = [Line(forces.time, loads[name], style, name) for name, style in zip(names, styles, strict=True)]
        return time_plot(joint, "body weights", lines, prepared.span, prepared.events, low=0.0)
    cycles = over_cycles(loads, [(step.start, step.stop) for step in steps]).values
    curves = [
        CycleCurve(band(cycles[:, :, index]).mean, style, name, each=cycles[:, :, index])
        for index, (name, style) in enumerate(zip(names, styles, strict=True))
    ]
    return cycle_chart(joint, "body weights", curves, [cycles[np.isfinite(cycles)], np.zeros(1)])
