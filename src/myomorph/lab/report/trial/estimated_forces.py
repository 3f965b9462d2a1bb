"""Estimated contact forces: which they are, what acts beside them, and what they leave over."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.contact.shared import group_bodies
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import ContactForces, Site
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Series, Wrenches
from myomorph.lab.analysis.contact_states import Limb, limb_of, row_label
from myomorph.lab.analysis.selection import Subject
from myomorph.lab.report.page.parts import Quantity, Verdict
from myomorph.lab.report.trial.figures import ORDINAL
from myomorph.lab.report.trial.plate_comparison import PlateComparison, plate_comparisons
from myomorph.lab.report.trial.report_input import ReportInput, Situation
from myomorph.lab.report.trial.tables import judged_residual

SITUATIONS: Mapping[Situation, str] = {
    "measured": "Plates measured every contact force ([D] chapter 4, first situation).",
    "shared": (
        "There are fewer plates than contacts: what a plate measured is shared among the sites that"
        " touch it ([D] chapter 4, second situation)."
    ),
    "sound": "Forces of impacts come from their sound ([D] chapter 4, third situation).",
    "unknown": (
        "Forces that no plate measured are solved together with the muscle tensions ([D] chapter 4,"
        " fourth situation)."
    ),
}
BETWEEN = "between"


def situation_of(results: ReportInput) -> Situation:
    """How the contact forces of a recording are known, "" where there are none."""
    if results.contacts.situation:
        return results.contacts.situation
    if results.contacts.forces is None:
        return (
            "measured"
            if results.dynamics.wrenches is not None and len(results.dynamics.wrenches.names)
            else ""
        )
    touches = results.contacts.touches
    heard = touches is not None and any(
        interval.source == "sound" for interval in touches.intervals
    )
    return "sound" if heard else "unknown"


def acting_forces(results: ReportInput) -> Wrenches | None:
    """Choose the forces to be drawn: contact forces as estimated.

    Measured ones are drawn while nothing is estimated in their place.
    """
    forces = results.contacts.forces
    if forces is None or not len(forces) or not forces.sites:
        return results.dynamics.wrenches
    estimated = group_forces(forces)
    measured = results.dynamics.wrenches
    if measured is None or not len(measured.names):
        return estimated
    instead = _instead(forces, measured, results.model)
    if instead.all():
        return estimated
    time = estimated.time
    measured_forces = np.nan_to_num(_at(time, measured.time, measured.forces))
    others = Wrenches(
        time=time,
        names=measured.names,
        bodies=measured.bodies,
        forces=np.where(instead[..., None], 0.0, measured_forces),
        points=_at(time, measured.time, measured.points),
        torques=_at(time, measured.time, measured.torques),
    )
    return estimated.and_others(others)


def _instead(forces: ContactForces, measured: Wrenches, model: Model | None) -> np.ndarray:
    """(frames, wrenches) whether contacts were estimated then where a wrench was measured."""
    bodies = _bodies(forces, model)
    result = np.zeros((len(forces), len(measured.names)), dtype=bool)
    for column, site in enumerate(forces.sites):
        on = forces.contact_activation[:, column] > 0.0
        for j, body in enumerate(measured.bodies):
            if not body or body in bodies[site.group]:
                result[on, j] = True
    return result


def _bodies(forces: ContactForces, model: Model | None) -> Mapping[str, set[str]]:
    """Find the bodies of every group of sites.

    With a model those a joint away count too, as forces on a foot are put on any of it.
    """
    if model is not None:
        return group_bodies(model, forces.sites)
    names = {site.group for site in forces.sites}
    return {name: {site.body for site in forces.sites if site.group == name} for name in names}


def group_forces(forces: ContactForces) -> Wrenches:
    """Sum forces to one per group of sites, at its center of pressure.

    It counts whatever bodies the sites are on; its opposite acts on the other body.
    """
    first = {site.group: site.body for site in reversed(forces.sites)}
    sites = tuple(replace(site, body=first[site.group]) for site in forces.sites)
    return replace(forces, sites=sites).wrenches("group")


def _at(time: Array, clock: Array, values: Array) -> Array:
    """Columns (samples, n, 3) at other times, by the straight line between samples; NaN outside."""
    flat = values.reshape(len(values), -1)
    columns = [np.interp(time, clock, column, left=np.nan, right=np.nan) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(time), *values.shape[1:])


@read_only
class Group:
    """Contact forces of one group of sites."""

    name: str
    label: str
    # whose groups it stands with: a subject's name, "" for the only one, `BETWEEN` where two bodies
    # touch
    block: str
    style: str  # of the style sheet, its own in its block
    against: str  # what is touched
    forces: Array  # (frames, 3) as estimated [N]
    estimated: np.ndarray  # (frames,) whether it might carry force
    # (frames, 3) as plates measured it while no other contact was on them, NaN else; None where
    # they never did
    measured: Array | None


def compared_with_plates(results: ReportInput) -> tuple[PlateComparison, ...]:
    """Estimated forces of the contacts on each plate together, beside what it measured."""
    forces = results.contacts.forces
    if forces is None:
        return ()
    standing = {site.group for site in forces.sites if site.against == GROUND}
    near = _bodies(forces, results.model)
    bodies = {group: names for group, names in near.items() if group in standing}
    wrenches = results.dynamics.wrenches
    return plate_comparisons(forces, results.contacts.on_plates, wrenches, bodies)


def groups_of(
    forces: ContactForces,
    comparisons: Sequence[PlateComparison] = (),
    who: Sequence[Subject] = (),
) -> tuple[Group, ...]:
    """Collect estimated forces by group, each beside what plates measured of it alone.

    Of two bodies it is the force on the first.
    """
    alone = {each.groups[0]: each.measured for each in comparisons if len(each.groups) == 1}
    members = grouped((site.group, index) for index, site in enumerate(forces.sites))
    first = {name: forces.sites[indices[0]] for name, indices in members.items()}
    limbs = {name: _limb_of(name, site, who) for name, site in first.items()}
    blocks = {
        name: limbs[name].subject if site.against == GROUND else BETWEEN
        for name, site in first.items()
    }
    groups = []
    for name, member in members.items():
        beside = [other for other in members if blocks[other] == blocks[name]]
        style = _style(beside.index(name), [limbs[other].side for other in beside])
        against = first[name].against
        label = row_label(name, who) + (
            f" on {row_label(against, who).lower()}" if against != GROUND else ""
        )
        ready = np.asarray((forces.contact_activation[:, member] > 0.0).any(axis=1))
        force = forces.contact_force[:, member].sum(axis=1)
        groups.append(
            Group(
                name=name,
                label=label,
                block=blocks[name],
                style=style,
                against=against,
                forces=force,
                estimated=ready,
                measured=alone.get(name),
            )
        )
    return tuple(groups)


def _limb_of(name: str, first: Site, who: Sequence[Subject]) -> Limb:
    """Find the limb of a group by its name, or where that has no side, by its first body."""
    return limb_of(name if limb_of(name, who).side else first.body, who)


def _style(place: int, sides: Sequence[str]) -> str:
    """Choose the style of a group's line: its side where no other of the block has it."""
    side = sides[place]
    return side if side and sides.count(side) == 1 else ORDINAL[place % len(ORDINAL)]


def contact_verdicts(results: ReportInput, height: float) -> list[Verdict]:
    """Hold what still supports the root once contacts carry against the limits on residuals.

    Source: Hicks et al. 2015.
    """
    if results.contacts.forces is None or not len(results.contacts.forces):
        return []
    rows: list[Verdict] = []
    acting = acting_forces(results)
    total = np.zeros((1, 3)) if acting is None else np.nan_to_num(acting.forces).sum(axis=1)
    peak = float(np.linalg.norm(total, axis=1).max(initial=0.0))
    residuals = results.contacts.residuals
    if residuals is not None and peak > 0.0:
        detail = f" left with contact forces; F = {peak:.4g} N"
        for what, scale in (("force", peak), ("moment", peak * height)):
            verdicts = _judged_contacts(what, residuals, scale)
            rows += [replace(row, detail=row.detail + detail) for row in verdicts]
    lost = results.contacts.infeasible
    first, relaxation = (lost[0].time, lost[0].relaxation) if lost else (None, "")
    unit = f"of {len(results.contacts.forces)}"
    rows.append(
        Verdict(
            quantity=Quantity.INFEASIBLE_CONTACT,
            value=float(len(lost)),
            unit=unit,
            limit=0.0,
            time=first,
            detail=relaxation,
        )
    )
    return rows


def _judged_contacts(what: str, residuals: Series, scale: float) -> list[Verdict]:
    """Judge the residual "force" or "moment" beside contacts; [] where it is not known."""
    names = [name.removeprefix("residual_") for name in residuals.names]
    columns = [index for index, name in enumerate(names) if name.startswith(what[0].upper())]
    values = np.linalg.norm(residuals.values[:, columns], axis=1)
    if not (columns and np.isfinite(scale) and scale > 0.0 and np.isfinite(values).any()):
        return []
    judged = judged_residual(what, values, residuals.time, scale, contacts=True)
    return [row for row, _ in judged]
