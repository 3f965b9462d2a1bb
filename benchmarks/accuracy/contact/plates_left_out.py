"""Forces of plates that are left out, or shared, by foot and by phase of contact.

Of each recording one foot's plate is left out, or one plate measures both feet together; the
plate's force is the truth. Two recordings are simulated persons on a step, whose foot MuJoCo knows.
Errors stand beside those of doing nothing (no force) and of the generic way: the force that gravity
and motion need of the whole body, less what is known, or the plate's force on the nearer foot.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from numpy.typing import NDArray

import myomorph as mm
from benchmarks.accuracy.contact.hidden_plates import summed
from benchmarks.errors import rms
from benchmarks.hidden_plates import CASES, Hidden, feet_of, opened
from benchmarks.results import Row
from myomorph.body.tension.task import added_reserves, tension_task
from myomorph.core.contact.found_supports import find_supports
from myomorph.core.contact.missing_wrench import missing_wrench
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.series import Wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.tension.contact_setting import Measurements
from myomorph.core.tension.tension import TensionOptions
from myomorph.core.tension.terms.contacts import ContactOptions
from truths.stepped_performer import stepped

USED = (
    "walk, Rajagopal",
    "walk, OpenCap",
    "run, 2 m/s",
    "drop jump, OpenCap",
    "sit to stand, OpenCap",
)
STEPS = (("foot on a step", 0.25, 901), ("step up", 0.18, 902))
"""Plans of simulated persons, heights of steps [m], and seeds that were not used before."""
LOADED = 0.05
"""Share of the weight from which a foot counts as in contact."""
EDGE = 0.2
"""Of a contact at its beginning and at its end."""
SIDES = {"right": "_r", "left": "_l"}


@dataclass(frozen=True, eq=False)
class Recording:
    """Motion and force of every foot.

    Attributes
    ----------
    name : in the table
    model : of the person
    recorded, motion : before the filter, and filtered with rates
    measured : one force for each foot, at the motion's times
    use : (frames,) that are compared
    cutoff : of the filter [Hz]
    on_step : whether feet stand on a step, which no plate measures
    """

    name: str
    model: mm.Model
    recorded: mm.Motion
    motion: mm.Motion
    measured: Wrenches
    use: NDArray[np.bool_]
    cutoff: float
    on_step: bool = False


def measure(folder: Path) -> Iterator[Row]:
    """Rows by recording, what is left out, foot and phase."""
    for recording in _recordings(folder):
        for left_out, foot in _ways(recording):
            found = _estimated(recording, foot, left_out == "shared by both feet")
            generic = _generic(recording, foot, left_out == "shared by both feet")
            for side in SIDES if not foot else (foot,):
                for phase, frames in _phases(recording, side).items():
                    yield {
                        "recording": recording.name,
                        "plate": left_out,
                        "foot": side,
                        "phase": phase,
                        "frames": int(frames.sum()),
                        **_errors(recording, side, frames, found, generic),
                    }


def _recordings(folder: Path) -> Iterator[Recording]:
    """Yield real recordings, and simulated ones on steps."""
    for case in CASES:
        if case.name in USED:
            hidden = opened(folder, case)
            yield Recording(
                name=case.name,
                model=hidden.model,
                recorded=hidden.motion,
                motion=hidden.motion,
                measured=_by_foot(hidden),
                use=hidden.use,
                cutoff=hidden.cutoff,
            )
    for plan, height, seed in STEPS:
        made = stepped(plan, height, seed)
        yield Recording(
            name=f"{plan}, simulated",
            model=made.model,
            recorded=made.recorded,
            motion=made.motion,
            measured=made.wrenches,
            use=(made.motion.time > 0.3) & (made.motion.time < made.motion.time[-1] - 0.3),
            cutoff=6.0,
            on_step=True,
        )


def _by_foot(hidden: Hidden) -> Wrenches:
    """Sum the measured forces of each foot, each with its moment about the ground's origin."""
    feet = {side: (force, moment) for side, force, moment in feet_of(hidden)}
    center = np.zeros((len(hidden.motion), len(feet), 3))
    force = np.stack([feet[side][0] for side in feet], axis=1)
    moment = np.stack([feet[side][1] for side in feet], axis=1)
    firm = np.abs(force[..., 1]) > 1.0
    vertical = np.where(firm, force[..., 1], 1.0)
    center[..., 0] = np.where(firm, moment[..., 2] / vertical, 0.0)
    center[..., 2] = np.where(firm, -moment[..., 0] / vertical, 0.0)
    return Wrenches(
        time=hidden.motion.time,
        names=tuple(feet),
        bodies=tuple(f"calcn{SIDES[side]}" for side in feet),
        forces=force,
        points=center,
        torques=moment - np.cross(center, force),
    )


def _ways(recording: Recording) -> Iterator[tuple[str, str]]:
    """Yield what is left out, and the foot that is compared, "" for both."""
    if recording.on_step:
        yield "none under the step", ""
        return
    for body in recording.measured.bodies:
        side = "right" if body.endswith("_r") else "left"
        yield f"{side} foot's left out", side
    if len(recording.measured.bodies) == 2:
        yield "shared by both feet", ""


def _known(recording: Recording, foot: str, shared: bool) -> Wrenches:
    """Return the forces that the estimate is given."""
    measured = recording.measured
    if recording.on_step:
        low = (measured.points[..., 1] < 0.02)[..., None]
        return mm.Wrenches(
            time=measured.time,
            names=measured.names,
            bodies=measured.bodies,
            forces=low * measured.forces,
            points=measured.points,
            torques=low * measured.torques,
        )
    if shared:
        return summed(measured)
    others = [
        column for column, body in enumerate(measured.bodies) if not body.endswith(SIDES[foot])
    ]
    return measured.columns(others)


def _estimated(recording: Recording, foot: str, shared: bool) -> dict[str, Array]:
    """Estimate the forces of both feet by the library's defaults; (frames, 3) by side [N]."""
    model = recording.model
    motion = recording.motion
    known = _known(recording, foot, shared)
    plan = ContactPlan(measured="shared" if shared else "exact")
    if recording.on_step:
        supports = find_supports(model, motion, known)
        plan = ContactPlan(supports=replace(supports, alone=True))
    options = TensionOptions()
    task = tension_task(
        model,
        motion,
        inverse_dynamics(model, motion, None if shared else known),
        options,
        added_reserves(model, options),
        Measurements(
            recorded=recording.recorded,
            wrenches=known,
            plates=PlateForces(known) if shared else None,
            cutoff=recording.cutoff,
        ),
        plan,
        ContactOptions(),
    )
    tension, _ = task.solved(lambda frames: None)
    table = task.contact_groups(tension)
    given = {side: _given(known, ending) for side, ending in SIDES.items()}
    return {
        side: np.stack([table[f"foot{ending}_f{axis}"] for axis in "xyz"], axis=1) + given[side]
        for side, ending in SIDES.items()
    }


def _given(known: Wrenches, ending: str) -> Array:
    """Sum the known forces on a foot; (frames, 3) [N]."""
    columns = [column for column, body in enumerate(known.bodies) if body.endswith(ending)]
    return np.asarray(known.forces[:, columns].sum(axis=1))


def _generic(recording: Recording, foot: str, shared: bool) -> dict[str, Array]:
    """Give what is not known to one foot: that which is left out, or the nearer one.

    Returns
    -------
    (frames, 3) by side [N]
    """
    known = _known(recording, foot, shared)
    if not shared:
        missing = missing_wrench(recording.model, recording.motion, known).force
        given = {side: _given(known, ending) for side, ending in SIDES.items()}
        if foot:
            return given | {foot: missing}
        # Nobody knows which foot is on the step: the one without a force on a plate.
        sizes = {side: np.linalg.norm(force, axis=1) for side, force in given.items()}
        low = LOADED * recording.model.weight
        off = {side: sizes[side] < low for side in SIDES}
        both = np.where(off["right"] & off["left"], 0.5, 1.0)
        return {
            side: given[side] + np.where(off[side], both, 0.0)[:, None] * missing for side in SIDES
        }
    measured = recording.measured
    center = known.points[:, 0]
    away = {
        "right" if body.endswith("_r") else "left": np.linalg.norm(
            measured.points[:, column] - center, axis=1
        )
        for column, body in enumerate(measured.bodies)
    }
    nearer = away["right"] <= away["left"]
    force = known.forces[:, 0]
    return {"right": nearer[:, None] * force, "left": ~nearer[:, None] * force}


def _phases(recording: Recording, side: str) -> dict[str, NDArray[np.bool_]]:
    """Frames of the beginning, the middle and the end of all contacts of a foot.

    Where a plate measures it while it stands on the floor, only its contacts with a step count.
    """
    measured = recording.measured
    column = [body.endswith(SIDES[side]) for body in measured.bodies].index(True)
    loaded = measured.forces[:, column, 1] > LOADED * recording.model.weight
    if recording.on_step:
        loaded &= measured.points[:, column, 1] > 0.02
    phases = {
        name: np.zeros(len(loaded), bool) for name in ("beginning", "middle", "end", "not loaded")
    }
    for start, stop in runs(loaded):
        edge = max(1, round(EDGE * (stop - start)))
        phases["beginning"][start : start + edge] = True
        phases["middle"][start + edge : stop - edge] = True
        phases["end"][stop - edge : stop] = True
    if not recording.on_step:
        phases["not loaded"] = ~loaded
    return {
        name: frames & recording.use
        for name, frames in phases.items()
        if (frames & recording.use).any()
    }


def _errors(
    recording: Recording,
    side: str,
    frames: NDArray[np.bool_],
    found: dict[str, Array],
    generic: dict[str, Array],
) -> Row:
    """Root mean square errors of a foot's force in some frames [% weight]."""
    measured = recording.measured
    column = [body.endswith(SIDES[side]) for body in measured.bodies].index(True)
    truth = measured.forces[frames, column]
    scale = 100.0 / recording.model.weight
    error = found[side][frames] - truth
    row: Row = {
        f"{axis} [% weight]": scale * rms(error[:, number])
        for number, axis in ((1, "vertical"), (0, "fore-aft"), (2, "lateral"))
    }
    row["generic, vertical [% weight]"] = scale * rms((generic[side][frames] - truth)[:, 1])
    row["nothing, vertical [% weight]"] = scale * rms(truth[:, 1])
    return row
