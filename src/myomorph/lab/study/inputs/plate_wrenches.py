"""Forces of a recording's plates, on the bodies that stand on them."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.contact.assign import assign_bodies, heel_and_ball
from myomorph.core.contact.plates import wrenches_from_plates
from myomorph.core.contact.undetermined import undetermined_loads
from myomorph.core.model.causes import PLATES
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import Finding
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Motion, Trial, Wrenches
from myomorph.lab.study.inputs.reading import PosesBy

MARGIN = 1.0  # Time before and after a motion that its forces keep, for filters [s].

NOISE = 0.03  # Share of the weight that a foot on a plate puts down at least.


def recorded_wrenches(trial: Trial, bodies: Sequence[str] | None = None) -> Wrenches:
    """Return forces of a recording's plates on the bodies that stand on them.

    Parameters
    ----------
    trial : recording with plates
    bodies : in the plates' order, "" for a plate that is left out; None for all plates, whose
        bodies are not known

    Returns
    -------
    external forces

    Raises
    ------
    BadData : there are fewer plates than bodies, or no plate has a body
    """
    if bodies is None:
        return wrenches_from_plates(trial.plates, trial.plate_time)
    names = ", ".join(f"'{plate.name}'" for plate in trial.plates) or "none"
    if len(bodies) > len(trial.plates):
        raise BadData(
            f"{trial.source}: {len(bodies)} bodies are given for its plates, but the plates are"
            f" {names}"
        )
    used = [(plate, body) for plate, body in zip(trial.plates, bodies, strict=False) if body]
    if not used:
        raise BadData(f"{trial.source}: no body is given for any of its plates ({names})")
    wrenches = wrenches_from_plates([plate for plate, _ in used], trial.plate_time)
    return replace(wrenches, bodies=tuple(body for _, body in used))


def nearest_feet(
    wrenches: Wrenches, model: Model, motion: Motion, checked: bool = True
) -> Wrenches:
    """Put each force on the foot that is nearest to its center of pressure, step by step.

    A force without a foot, such as that of a plate that nobody steps on, is left out with a note.

    Parameters
    ----------
    wrenches : external forces, "" for the bodies that are not known
    model, motion : whose feet carry the forces
    checked : report where the forces do not show what acts on a foot

    Returns
    -------
    forces that all have a body

    Raises
    ------
    BadData : the model has no foot, or forces and motion have no time in common
    """
    feet = feet_of(model)
    if not feet:
        raise BadData(
            f"no body of model '{model.name}' is named as a foot: name the bodies that forces act"
            " on:"
            " those of a table as prefix=body (--bodies), those of plates in order (--plates)"
        )
    inside = (wrenches.time >= motion.time[0]) & (wrenches.time <= motion.time[-1])
    if not inside.any():
        raise BadData(
            f"the forces run from {wrenches.time[0]:g} to {wrenches.time[-1]:g} s, the motion from"
            f" {motion.time[0]:g} to {motion.time[-1]:g} s: they have no time in common; are they"
            " of one recording, on one clock?"
        )
    # As long before and after the motion as filters reach.
    near = (wrenches.time >= motion.time[0] - MARGIN) & (wrenches.time <= motion.time[-1] + MARGIN)
    wrenches = _without_noise(wrenches.frames(near), model, motion)
    poses = PosesBy(model, motion)
    places = {}
    for foot in feet:
        rotations, origins = poses(foot, wrenches.time)
        places[foot] = origins[:, None] + heel_and_ball(model, foot) @ rotations.swapaxes(1, 2)
    named = [index for index, body in enumerate(wrenches.bodies) if body]
    unnamed = [index for index, body in enumerate(wrenches.bodies) if not body]
    found = assign_bodies(wrenches.columns(unnamed), places)
    carried = _carried(wrenches.columns(named).and_others(found.wrenches), found.warnings)
    if not checked:
        return carried
    inside = (carried.time >= motion.time[0]) & (carried.time <= motion.time[-1])
    during = {foot: place[inside] for foot, place in places.items()}
    unknown = undetermined_loads(carried.frames(inside), during, model.weight, np.asarray(model.up))
    return replace(carried, findings=(*carried.findings, *unknown))


def _without_noise(wrenches: Wrenches, model: Model, motion: Motion) -> Wrenches:
    """Set forces to zero that have no body and are noise while the motion lasts.

    They are those of a plate that nobody steps on.
    """
    inside = (wrenches.time >= motion.time[0]) & (wrenches.time <= motion.time[-1])
    size = np.nan_to_num(np.linalg.norm(wrenches.forces[inside], axis=2))
    unnamed = np.array([not body for body in wrenches.bodies], np.bool_)
    noise = (unnamed & (size.max(axis=0, initial=0.0) < NOISE * model.weight))[None, :, None]
    return replace(
        wrenches,
        forces=np.where(noise, 0.0, wrenches.forces),
        torques=np.where(noise, 0.0, wrenches.torques),
    )


def _carried(wrenches: Wrenches, warnings: Sequence[Message]) -> Wrenches:
    """Keep the forces that act on a body, with a note on those that never act."""
    kept = [index for index, body in enumerate(wrenches.bodies) if body]
    idle = ", ".join(
        name for name, body in zip(wrenches.names, wrenches.bodies, strict=True) if not body
    )
    findings = wrenches.findings
    if idle:
        text = PLATES.message(
            f"{idle} not loaded during the motion: left out", severity="good to know"
        )
        findings = (*findings, Finding("idle plate", idle, text, repaired=True))
        warnings = (*warnings, text)
    notes = (*wrenches.notes, *warnings)
    return replace(wrenches.columns(kept), notes=notes, findings=findings)
