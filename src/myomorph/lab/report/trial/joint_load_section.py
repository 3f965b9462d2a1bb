"""Forces in joints: whole, at contact points, within what statics allow, with their intervals."""

from __future__ import annotations

from collections.abc import Iterator, Mapping

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.segments import joint_labels
from myomorph.core.model.series import Series
from myomorph.core.model.sides import split_side
from myomorph.core.rigid.leg_angles import leg_angles
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.core.tension.load_quantities import JOINT_CONTACT_LOAD, JOINT_REACTION
from myomorph.lab.analysis.cycles import band, over_cycles
from myomorph.lab.analysis.joint_loads import own_strides, stride_loads
from myomorph.lab.report.charts.axis import number
from myomorph.lab.report.charts.curves import CycleCurve, Line, TimeLook, cycle_chart, time_plot
from myomorph.lab.report.page.parts import Figure, Grid, Section
from myomorph.lab.report.trial.figures import ORDINAL, limits_of
from myomorph.lab.report.trial.prepared import Prepared

STATICS = "statics"
"""Style of forces that statics allow."""
WHOLE = "whole joint"
PEAK_HEAD = ("Joint", "Greatest force, body weights", "90 % interval", "By statics there", "at")
LOAD_HEAD = ("Force", "Stride", "From", "to", "Peak", "Peak, body weights", "at", "Impulse")
SHOWN = 12
"""Rows above which the table of strides is folded away."""
LOADS = frozenset({"joint_contact_force", "joint_reaction", "muscle_force"})
"""Quantities whose causes of warnings are named beside the forces."""


@read_only
class JointLoad:
    """Force of one joint over time, in body weights.

    Attributes
    ----------
    name : with its side, as the model or its plain name has it
    whole : (frames,) size of the force
    points : push of each contact point (frames,), by its name
    statics : least and greatest force that statics allow (frames,), None where not known
    interval : low and high of the whole force by draws (frames,), None where nothing was drawn
    """

    name: str
    whole: Array
    points: Mapping[str, Array]
    statics: tuple[Array, Array] | None
    interval: tuple[Array, Array] | None

    @property
    def title(self) -> str:
        """Heading of its chart, as "Knee, right"."""
        base, side = split_side(self.name)
        words = base.replace("_", " ")
        return f"{words[:1].upper()}{words[1:]}, {side}" if side else words

    @property
    def columns(self) -> dict[str, Array]:
        """All curves (frames,), by what the reading under the pointer says."""
        found = {WHOLE: self.whole, **self.points}
        if self.statics is not None:
            found["least by statics"] = self.statics[0]
            found["greatest by statics"] = self.statics[1]
        return found

    @property
    def styles(self) -> tuple[str, ...]:
        """Style of each curve."""
        own = 1 + len(self.points)
        repeated = ORDINAL * (1 + own // len(ORDINAL))
        return (*repeated[:own], *(STATICS,) * (0 if self.statics is None else 2))


@read_only
class JointLoads:
    """Forces of joints over time.

    Attributes
    ----------
    time : (frames,) [s]
    weight : of the body [N]
    loads : joint by joint
    """

    time: Array
    weight: float
    loads: tuple[JointLoad, ...]

    @property
    def table(self) -> Series:
        """Whole forces and pushes of contact points (frames, loads) [N]."""
        names: list[str] = []
        columns: list[Array] = []
        for load in self.loads:
            own = {"total": load.whole, **load.points}
            names += [f"{part}_{load.name}" for part in own]
            columns += [self.weight * values for values in own.values()]
        return Series(self.time, tuple(names), np.stack(columns, axis=1))


def joint_load_section(prepared: Prepared) -> Section | None:
    """Show forces of hips, knees and ankles, and of every joint with contact points."""
    found = joint_loads(prepared)
    if found is None:
        return None
    figures = tuple(Figure(_chart(prepared, found, load), "medium") for load in found.loads)
    rows = tuple(_stride_rows(prepared, found))
    points = dict.fromkeys(name for load in found.loads for name in load.points)
    legend = [("first", WHOLE), *zip(ORDINAL[1:], points, strict=False)]
    if any(load.statics is not None for load in found.loads):
        legend.append((STATICS, "by statics"))
    return Section(
        key="joint_contacts",
        title="Forces in joints",
        lead=_lead(prepared, found),
        legend=tuple(legend),
        figures=figures,
        grids=(
            Grid(head=PEAK_HEAD, rows=tuple(_peak_rows(prepared, found)), title="Greatest forces"),
            Grid(
                head=LOAD_HEAD,
                rows=rows,
                title="Peaks and impulses by stride",
                folded=len(rows) > SHOWN,
            ),
        ),
    )


def joint_loads(prepared: Prepared) -> JointLoads | None:
    """Return the forces that the page shows; None where no joint's force is known."""
    contacts = prepared.results.joint_contacts
    if contacts is not None and len(contacts):
        return _found(prepared, contacts, contacts.time, contacts.weight)
    sizes = prepared.results.dynamics.joint_force
    if sizes is not None and len(sizes) and prepared.weight:
        return _found(prepared, None, sizes.time, prepared.weight)
    return None


def _found(
    prepared: Prepared, contacts: JointContactForces | None, time: Array, weight: float
) -> JointLoads | None:
    """Collect the forces of legs' joints, then of others with contact points.

    Parameters
    ----------
    contacts : forces at contact points, None for none
    time : (frames,) [s]
    weight : of the body [N]
    """
    model = prepared.results.model
    labels = {} if model is None else joint_labels(model)
    names = [] if model is None else list(_leg_joints(model))
    if contacts is not None:
        names += contacts.joints
    loads = tuple(
        load
        for joint in dict.fromkeys(names)
        for load in _load(prepared, joint, labels.get(joint, joint), contacts, weight)
        if len(load.whole) == len(time) and np.isfinite(load.whole).any()
    )
    return JointLoads(time=time, weight=weight, loads=loads) if loads else None


def _leg_joints(model: Model) -> tuple[str, ...]:
    """Hips, then knees, then ankles, by their names."""
    legs = leg_angles(model)
    return tuple(
        angle.joint.name
        for kind in ("hip", "knee", "ankle")
        for angle in (getattr(leg, kind) for leg in legs)
        if angle is not None
    )


def _load(
    prepared: Prepared,
    joint: str,
    label: str,
    contacts: JointContactForces | None,
    weight: float,
) -> Iterator[JointLoad]:
    """Force of a joint; none where it is not known.

    Parameters
    ----------
    joint, label : the model's name and the plain one
    contacts : forces at contact points, None for none
    weight : of the body [N]
    """
    results = prepared.results
    sizes = results.dynamics.joint_force
    points: Mapping[str, Array] = FrozenMap({})
    spreads = results.uncertainty.spreads
    low, high = limits_of(spreads.get(JOINT_REACTION.name), [f"{label}_force"], 1.0 / weight)
    if contacts is not None and joint in contacts.joints:
        whole = contacts.of(joint)
        points = FrozenMap(
            {
                point: contacts.joint_contact_force[:, column] / weight
                for column, (point, owner) in enumerate(
                    zip(contacts.points, contacts.joint_of, strict=True)
                )
                if owner == joint
            }
        )
        drawn = limits_of(spreads.get(JOINT_CONTACT_LOAD.name), [f"total_{joint}"], 1.0 / weight)
        low, high = drawn if drawn[0] is not None else (low, high)
    elif sizes is not None and label in sizes.names:
        whole = sizes[label]
    else:
        return
    yield JointLoad(
        name=label,
        whole=whole / weight,
        points=points,
        statics=_statics(results.static_loads, joint, len(whole), weight),
        interval=None if low is None or high is None else (low, high),
    )


def _statics(
    found: tuple[Series, Series] | None, joint: str, frames: int, weight: float
) -> tuple[Array, Array] | None:
    """Least and greatest force of a joint by statics (frames,) [body weights]; None for none."""
    if found is None or joint not in found[0].names or len(found[0]) != frames:
        return None
    low, high = found
    return low[joint] / weight, high[joint] / weight


def _lead(prepared: Prepared, found: JointLoads) -> str:
    """Say what is drawn, what it does not hold, and which warnings touch it."""
    text = "Sizes of the forces that bones press on each other with, muscles included."
    if any(load.points for load in found.loads):
        text += (
            " Contact points push along their normals, and balance force along and moment across"
            " them. Forces across (ligaments, friction) are part of the whole only."
        )
    if any(load.statics is not None for load in found.loads):
        text += (
            " Dashed: least and greatest force that the joint's torque requires, with published"
            " moment arms, without opposing muscles and those of two joints, which add to it."
        )
    if any(load.interval is not None for load in found.loads):
        text += " Bands hold 90 % of the draws."
    if any(own_strides(load.name, prepared.strides) for load in found.loads):
        text += " Over the stride: thin lines are strides, the thick one their mean."
    causes = dict.fromkeys(
        warning.cause_title
        for warning in prepared.results.head.warnings
        if warning.severity != "good to know" and LOADS & set(warning.cause.quantities)
    )
    if causes:
        text += f" Caution, see the warnings: {'; '.join(causes)}."
    return text + _not_carried(prepared.results.joint_contacts)


def _not_carried(forces: JointContactForces | None) -> str:
    """Say what the points do not carry, joint by joint; "" where that is nothing."""
    texts = []
    if forces is None:
        return ""
    for place, joint in enumerate(forces.joints):
        moment = _greatest(forces.joint_contact_unbalanced_moment[:, place])
        pull = _greatest(forces.joint_contact_unbalanced_force[:, place])
        if moment > 0.1:
            texts.append(
                f"where a point of {joint} lifts off, a moment of up to {number(moment)} N·m is"
                " left"
            )
        if pull > 1.0:
            texts.append(
                f"{joint} is under tension of up to {number(pull)} N, which no contact point can"
                " transmit"
            )
    text = "; ".join(texts)
    return f" {text[0].upper()}{text[1:]}." if text else ""


def _greatest(values: Array) -> float:
    """Return the greatest of values (frames,), 0 where none is known."""
    return float(np.nanmax(values)) if np.isfinite(values).any() else 0.0


def _peak_rows(prepared: Prepared, found: JointLoads) -> Iterator[tuple[str, ...]]:
    """Greatest force of each joint, with its interval and range there."""
    for load in found.loads:
        whole = np.where(_sure(prepared, found.time), load.whole, np.nan)
        steps = own_strides(load.name, prepared.strides)
        if steps:
            # Where strides end, filters and plates do as well.
            within = [(found.time >= one.start) & (found.time <= one.stop) for one in steps]
            whole = np.where(np.any(within, axis=0), whole, np.nan)
        if not np.isfinite(whole).any():
            continue
        top = int(np.nanargmax(whole))
        yield (
            load.title,
            f"{load.whole[top]:.2f}",
            _ends(load.interval, top),
            _ends(load.statics, top),
            f"{number(float(found.time[top]), 0.001)} s",
        )


def _sure(prepared: Prepared, time: Array) -> NDArray[np.bool_]:
    """Flag the times (frames,) at which accelerations are as sure as anywhere."""
    sure = np.ones(len(time), bool)
    for start, stop in prepared.results.dynamics.less_sure:
        sure &= (time < start - 1e-6) | (time > stop + 1e-6)
    return sure


def _ends(pair: tuple[Array, Array] | None, frame: int) -> str:
    """Both ends of a range at a frame, as text."""
    if pair is None or not np.isfinite([pair[0][frame], pair[1][frame]]).all():
        return "–"
    return f"{pair[0][frame]:.2f} to {pair[1][frame]:.2f}"


def _stride_rows(prepared: Prepared, found: JointLoads) -> Iterator[tuple[str, ...]]:
    """One row for each load and stride; the whole recording where it has no strides."""
    for load in stride_loads(found.table, prepared.strides):
        yield (
            load.load,
            str(load.stride) if load.stride else "recording",
            f"{number(load.start, 0.001)} s",
            f"{number(load.stop, 0.001)} s",
            f"{number(load.peak)} N",
            number(load.peak / found.weight),
            f"{load.peak_percent:.0f} %",
            f"{number(load.impulse)} N·s" if np.isfinite(load.impulse) else "–",
        )


def _chart(prepared: Prepared, found: JointLoads, load: JointLoad) -> str:
    """Draw forces of a joint over its leg's strides, else over time."""
    columns = load.columns
    steps = own_strides(load.name, prepared.strides)
    if steps:
        spans = [(step.start, step.stop) for step in steps]
        return _over_strides(found.time, load, spans)
    lines = []
    for place, (name, values) in enumerate(columns.items()):
        low, high = load.interval if place == 0 and load.interval is not None else (None, None)
        lines.append(
            Line(
                time=found.time,
                values=values,
                style=load.styles[place],
                label=name,
                low=low,
                high=high,
            )
        )
    return time_plot(
        load.title,
        "body weights",
        lines,
        prepared.detail,
        TimeLook(events=prepared.events, low=0.0),
    )


def _over_strides(time: Array, load: JointLoad, spans: list[tuple[float, float]]) -> str:
    """Curves of a joint over the stride.

    Parameters
    ----------
    time : (frames,) [s]
    load : of the joint
    spans : start and end of each stride [s]
    """
    columns = load.columns
    values = np.stack(list(columns.values()), axis=1)
    cycles = over_cycles(Series(time, tuple(columns), values), spans).values
    interval = None
    shown = [cycles[np.isfinite(cycles)], np.zeros(1)]
    if load.interval is not None:
        ends = Series(time, ("low", "high"), np.stack(load.interval, axis=1))
        means = band(over_cycles(ends, spans).values).mean
        interval = (means[:, 0], means[:, 1])
        shown.append(means[np.isfinite(means)])
    curves = [
        CycleCurve(
            mean=band(cycles[:, :, place]).mean,
            style=style,
            label=name,
            interval=interval if name == WHOLE else None,
            each=() if style == STATICS else cycles[:, :, place],
        )
        for place, (name, style) in enumerate(zip(columns, load.styles, strict=True))
    ]
    return cycle_chart(load.title, "body weights", curves, shown)
