"""The force that lifts the box, hidden and estimated.

It is estimated from body and plate, with the box, and without the plate.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.hands_lift import BOX_SIZE, Recorded, box, man, recorded
from myomorph.core.contact.held_objects import find_holds, raised_contacts
from myomorph.core.contact.site_motion import rest_on_floor
from myomorph.core.contact.sites import body_sites, foot_sites
from myomorph.core.contact.states import (
    ActivationOptions,
    ContactStateOptions,
    contact_activations,
    preferred_directions,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import SharedWrench, Site
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.rigid.frames import over_frames
from myomorph.core.tension.certificates import ContactIntervals, contact_intervals
from myomorph.core.tension.problem import TensionInputs, tension_problem
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from truths.carried_bodies import needed_wrench

HANDS = ("hand_r", "hand_l")
WAYS = {
    "newton": "body and plate, Newton's law alone",
    "body": "body and plate",
    "box": "body, plate and box",
    "hidden": "body and box, no plate",
    "first": "body and box, no plate; contacts first, muscles after",
}
LEAVES = 0.005
"""The box has left the floor where it is that much higher than at rest [m]."""


@dataclass(frozen=True, eq=False)
class Lift:
    """What was found of one lift.

    `hands`: (frames, 3) force of both hands on the box [N]; `feet`: (frames, 3) force of the floor
    on both feet [N]; `tension`: None where nothing was solved.
    """

    hands: Array
    feet: Array
    tension: Tension | None


def both(folder: Path, lift: str) -> tuple[mm.Model, mm.Motion]:
    """Man and box as one model, and its motion."""
    (body, motion) = man(folder, lift)
    (thing, thing_motion) = box(folder, lift)
    return join_models({"man": body, "box": thing}), join_motions(
        {"man": motion, "box": thing_motion}
    )


def plate_on_feet(record: Recorded, time: Array) -> mm.Wrenches:
    """Assign the plate's force to one foot: what it does to the rest of the body is the same.

    Parameters
    ----------
    record : with the plate's force
    time : (frames,) [s]

    Returns
    -------
    One wrench, on the right foot
    """
    return mm.Wrenches(
        time,
        ("plate",),
        ("calcn_r",),
        record.plate[:, None],
        record.plate_point[:, None],
        np.zeros((len(time), 1, 3)),
    )


def left_floor(folder: Path, lift: str) -> float:
    """When the box leaves the floor [s]."""
    record = recorded(folder, lift)
    height = record.box[:, 1] - np.median(record.box[:20, 1])
    return float(record.markers.time[np.flatnonzero(height > LEAVES)[0]])


@lru_cache(maxsize=8)
def holding(folder: Path, lift: str) -> tuple[tuple[Site, ...], Array]:
    """Return the hands' sites on the box, and how surely each holds it.

    Parameters
    ----------
    folder : of the collection
    lift : name of the recording

    Returns
    -------
    Sites, and (frames, 2) contact activations
    """
    model, motion = both(folder, lift)
    sites = tuple(
        replace(one, against="box_body", group="hands") for one in body_sites(model, HANDS)
    )
    return sites, np.array(
        contact_activations(model, motion, sites, find_holds(model, motion, sites)).values
    )


@dataclass(frozen=True, eq=False)
class Task:
    """What `solve_tension` takes."""

    model: mm.Model
    motion: mm.Motion
    torques: mm.Series
    contacts: ContactTask


def task(folder: Path, lift: str, way: str) -> Task:
    """Return the problem of a way in `WAYS`, "newton" excepted."""
    measured = () if way in ("hidden", "first") else (_plate(folder, lift),)
    options = ContactOptions(formulation="sequential" if way == "first" else "simultaneous")
    touching = _touching(folder, lift, with_box=way != "body")
    time = man(folder, lift)[1].time
    contacts = ContactTask(
        sites=touching.sites,
        activations=mm.Series(time, tuple(one.name for one in touching.sites), touching.ready),
        measured=measured,
        options=options,
        preferred=touching.directions,
    )
    return Task(
        model=touching.model,
        motion=touching.motion,
        torques=mm.inverse_dynamics(touching.model, touching.motion),
        contacts=contacts,
    )


def _plate(folder: Path, lift: str) -> SharedWrench:
    """Return the plate's wrench, which both feet share.

    Its moments are about the ground's origin; the free torque of the plate is not in the file.
    """
    body, motion = man(folder, lift)
    record = recorded(folder, lift)
    feet = soles_of(body, motion)[0]
    return SharedWrench(
        name="plate",
        sites=tuple(one.name for one in feet),
        forces=record.plate,
        moments=np.cross(record.plate_point, record.plate) * (1.0, np.nan, 1.0),
    )


@dataclass(frozen=True, kw_only=True, eq=False)
class _Touching:
    """Sites of a lift.

    Attributes
    ----------
    model, motion : of the man, or of man and box
    sites : hands, feet, and the box's bottom with the box
    ready : (frames, sites) contact activations
    directions : (frames, sites, 3) preferred directions, 0 where there is none
    """

    model: mm.Model
    motion: mm.Motion
    sites: tuple[Site, ...]
    ready: Array
    directions: Array


def _touching(folder: Path, lift: str, with_box: bool) -> _Touching:
    body, body_motion = man(folder, lift)
    hands, held = holding(folder, lift)
    feet, standing, lean = soles_of(body, body_motion)
    if with_box:
        model, motion = both(folder, lift)
        floor = Site("floor_under_box", "box_body", _bottom())
        feet = tuple(replace(one, body=f"man_{one.body}") for one in feet)
        sites = (*hands, *feet, floor)
        raised = raised_contacts(model, motion, floor, feet)[1]
        ready = np.hstack([held, standing, raised[:, None]])
    else:
        model = body
        motion = body_motion
        palms = tuple(replace(one, group="hands") for one in body_sites(body, HANDS))
        sites = (*palms, *feet)
        ready = np.hstack([held, standing])
    directions = np.zeros((*ready.shape, 3))
    directions[:, 2 : 2 + len(feet)] = lean
    return _Touching(model=model, motion=motion, sites=sites, ready=ready, directions=directions)


def soles_of(model: mm.Model, motion: mm.Motion) -> tuple[tuple[Site, ...], Array, Array]:
    """Return sites under the feet, their activations, and the preferred directions of their forces.

    Parameters
    ----------
    model : with the feet
    motion : of the model

    Returns
    -------
    Sites; (frames, sites) contact activations; (frames, sites, 3) preferred directions
    """
    feet, floor = rest_on_floor(model, motion, foot_sites(model))
    touches = mm.find_contacts(model, motion, feet, ContactStateOptions(floor=floor.height))
    ready = contact_activations(model, motion, feet, touches, ActivationOptions(floor=floor.height))
    return feet, np.array(ready.values), preferred_directions(model, motion, feet)


@lru_cache(maxsize=16)
def found(folder: Path, lift: str, way: str) -> Lift:
    """Estimate the hands' force in one of `WAYS`."""
    if way == "newton":
        body, motion = man(folder, lift)
        plate = recorded(folder, lift).plate
        left = needed_wrench(
            body, motion, "pelvis", plate_on_feet(recorded(folder, lift), motion.time)
        )
        return Lift(-left.forces[:, 0], plate, None)
    inputs = task(folder, lift, way)
    tension = mm.solve_tension(
        inputs.model,
        inputs.motion,
        inputs.torques,
        contacts=inputs.contacts,
        recruitment=EFFORT_ALONE,
    )
    assert tension.contacts is not None
    forces = tension.contacts.contact_force
    feet = [k for k, one in enumerate(inputs.contacts.sites) if one.group.startswith("foot")]
    return Lift(-forces[:, :2].sum(axis=1), forces[:, feet].sum(axis=1), tension)


def left_open(inputs: Task, frames: Sequence[int]) -> ContactIntervals:
    """Return what the data leave undetermined of contact forces in some frames."""
    problem = tension_problem(
        TensionInputs(inputs.model, inputs.motion, inputs.torques, contacts=inputs.contacts)
    )
    over_frames(problem.solve, len(inputs.motion), None, problem.window)
    return contact_intervals(problem, problem.result(), frames)


def _bottom() -> Array:
    """Corners of the box's bottom (4, 3) [m]."""
    x, y, z = BOX_SIZE
    x = 0.5 * x
    y = 0.5 * y
    z = 0.5 * z
    return np.array([(i * x, -y, k * z) for i in (-1, 1) for k in (-1, 1)])
