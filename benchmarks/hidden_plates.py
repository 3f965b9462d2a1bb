"""Recordings whose measured ground forces are hidden and estimated.

It has what they are made of, and solves them.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path
from typing import Any, Literal

import numpy as np

import myomorph as mm
from benchmarks.recordings import RECORDINGS, read_markers
from myomorph.body.identify.recordings import RecordingOptions, usable
from myomorph.core.contact.site_motion import plate_height, rest_on_floor, site_motion
from myomorph.core.contact.sites import body_sites, foot_sites
from myomorph.core.contact.spells import steady
from myomorph.core.contact.states import (
    ActivationOptions,
    ContactStateOptions,
    contact_activations,
    preferred_directions,
)
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.model.contacts import SharedWrench, Site
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.motion.sync import cut
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from myomorph.lab.study.inputs.external_forces import force_table
from truths.carried_bodies import assign_feet

TABLES = (
    {"R_ground_force_": "calcn_r", "L_ground_force_": "calcn_l"},
    {"l_ground_force_": "calcn_l", "ground_force_": "calcn_r"},
    {"ground_force_": "calcn_r", "1_ground_force_": "calcn_l"},
)
"""What the columns of force tables begin with, and the feet they act on."""

CALM = 6.0
QUICK = 12.0
"""Low-pass of motion and forces where the body never flies, and where it does: the field's for
walks and runs [Hz].
"""

Formulation = Literal["simultaneous", "sequential"]


@dataclass(frozen=True)
class HiddenCase:
    """A recording with force plates.

    `seated`: a chair carries too, which no plate measures: a seat is a contact, and every frame
    counts; `calibrated`: the model is generic: its lengths and markers' places are found from the
    recordings first; `tracked`: `markers` is a table of coordinates that somebody else found;
    `span`: start and end of what is used [s].
    """

    name: str
    model: str
    markers: str
    forces: str
    mass: float
    tasks: str = ""
    seated: bool = False
    calibrated: bool = False
    tracked: bool = False
    span: tuple[float, float] = (-np.inf, np.inf)


def _case(name: str, recording: str, mass: float | None = None, **more: Any) -> HiddenCase:
    files = RECORDINGS[recording]
    markers = files.motion if more.get("tracked") else files.markers
    case = HiddenCase(
        name=name,
        model=files.model,
        markers=markers,
        forces=files.loads,
        mass=mass or files.mass,
    )
    return replace(case, **more)


CASES = (
    _case("walk, Rajagopal", "rajagopal"),
    _case("walk, treadmill, gait2354", "gait2354", tasks=RECORDINGS["gait2354"].tasks),
    _case("walk, OpenCap", "opencap-walk"),
    _case("sit to stand, OpenCap", "opencap-rise", seated=True),
    _case("drop jump, OpenCap", "opencap-jump"),
    _case("run, 2 m/s", "run-2", calibrated=True),
    _case("run, 5 m/s", "run-5", calibrated=True),
    _case("walk, treadmill, no arms", "treadmill", tracked=True, span=(10.0, 14.0)),
    _case("walk, treadmill, gait2392", "gait2392", 58.0, tracked=True, span=(10.0, 14.0)),
)


@dataclass(frozen=True, eq=False)
class Hidden:
    """A recording ready to be estimated.

    `motion`: filtered, with derivatives, over the times that the plates cover; `measured`: forces
    on the feet through the same filter, which no estimate sees; `raw`: the same unfiltered, at
    their own times; `use`: (frames,) in which the plates measure all that is compared; `weighs`:
    mass that they say [kg]; `cutoff`: of the filter [Hz]; `floor`: its height [m].
    """

    case: HiddenCase
    model: mm.Model
    motion: mm.Motion
    sites: tuple[Site, ...]
    contacts: mm.Contacts
    activations: mm.Series
    measured: mm.Wrenches
    raw: mm.Wrenches
    use: np.ndarray
    weighs: float
    cutoff: float
    floor: float

    @property
    def weight(self) -> float:
        """Of the subject [N]."""
        return self.model.mass * float(np.linalg.norm(self.model.gravity))


@cache
def subject_model(folder: Path, case_model: str, mass: float, calibrated: bool) -> mm.Model:
    """Return the model at the subject's mass.

    A generic one is calibrated on all recordings that use it.
    """
    model = mm.read_model(folder / case_model)
    if calibrated:
        trials = [read_markers(folder / one.markers) for one in CASES if one.model == case_model]
        model = mm.calibrate(model, trials, mm.CalibrationOptions(mass=mass)).model
    return with_inertial_parameters(model, inertial_parameters(model) * (mass / model.mass))


def cutoff_of(model: mm.Model, motion: mm.Motion) -> float:
    """Choose the cutoff of the low-pass filter.

    It is `QUICK` where the center of mass falls freely for 50 ms, else `CALM`.
    """
    carried = site_motion(model, mm.differentiate(motion, CALM), foot_sites(model)).carried
    flies = steady(carried < ContactStateOptions().carried, motion.time, 0.05)
    return QUICK if flies[1:-1].any() else CALM


@cache
def opened(folder: Path, case: HiddenCase) -> Hidden:
    """Read kinematics, contacts and activations of a recording.

    The plates show the height of the floor and nothing else.
    """
    model = subject_model(folder, case.model, case.mass, case.calibrated)
    recorded = tracked(folder, case, model)
    raw = _forces(folder / case.forces)
    cutoff = cutoff_of(model, recorded)
    whole = mm.differentiate(recorded, cutoff)
    assert whole.velocities is not None
    feet, floor = rest_on_floor(model, whole, foot_sites(model), plate_height(model, raw))
    contacts = mm.find_contacts(model, whole, feet, ContactStateOptions(floor=floor.height))
    ready = contact_activations(model, whole, feet, contacts, ActivationOptions(floor=floor.height))
    sites: tuple[Site, ...] = feet
    if case.seated:
        seat, also = _seat(model, whole)
        sites = (*feet, *seat)
        names = (*ready.names, *also.names)
        ready = mm.Series(ready.time, names, np.hstack([ready.values, also.values]))
    motion = cut(whole, max(whole.time[0], raw.time[0]), min(whole.time[-1], raw.time[-1]))
    raw = _owned(model, motion, feet, raw, cutoff)
    found = usable(model, recorded, raw, mass=case.mass, options=RecordingOptions(cutoff=cutoff))
    return Hidden(
        case=case,
        model=model,
        motion=motion,
        sites=sites,
        contacts=contacts,
        activations=mm.Series(
            motion.time, ready.names, ready.values[np.isin(whole.time, motion.time)]
        ),
        measured=mm.resample_wrenches(raw, motion.time, cutoff),
        raw=raw,
        use=found.use if not case.seated else _inside(motion, cutoff),
        weighs=found.weighs,
        cutoff=cutoff,
        floor=floor.height,
    )


def _seat(model: mm.Model, motion: mm.Motion) -> tuple[tuple[Site, ...], mm.Series]:
    """Return the sites of the seat and their activations."""
    seat = body_sites(model, ("seat",))
    sitting = mm.find_contacts(model, motion, seat)
    return seat, contact_activations(model, motion, seat, sitting)


def _owned(
    model: mm.Model, motion: mm.Motion, feet: tuple[Site, ...], raw: mm.Wrenches, cutoff: float
) -> mm.Wrenches:
    """Assign each plate's force to the body that took most of it."""
    loads = mm.resample_wrenches(raw, motion.time, 3.0 * cutoff)
    owned = assign_feet(model, motion, feet, loads).wrenches
    return replace(raw, bodies=_bodies(owned, raw))


def tracked(folder: Path, case: HiddenCase, model: mm.Model) -> mm.Motion:
    """Coordinates of a recording, unfiltered."""
    if case.tracked:
        return cut(mm.read_motion(folder / case.markers, model), *case.span)
    weights = read_ik_tasks(folder / case.tasks).marker_weights if case.tasks else {}
    known = {one: weight for one, weight in weights.items() if one in model.marker_names}
    tracking = mm.InverseKinematicsOptions(marker_weights=known, only_weighted=bool(known))
    return mm.inverse_kinematics(model, read_markers(folder / case.markers), tracking).motion


def _forces(path: Path) -> mm.Wrenches:
    """Read forces as recorded, with 0 where a table has no number."""
    if path.suffix == ".xml":
        return read_external_loads(path)
    names = mm.read_sto(path).names
    columns = next(one for one in TABLES if all(f"{prefix}vx" in names for prefix in one))
    found = force_table(path, columns)
    return replace(found, forces=np.nan_to_num(found.forces), torques=np.nan_to_num(found.torques))


def _bodies(owned: mm.Wrenches, raw: mm.Wrenches) -> tuple[str, ...]:
    """Return the body that took most of each plate's force."""
    found = []
    for name in raw.names:
        mine = [k for k, one in enumerate(owned.names) if one == name or one.startswith(f"{name}_")]
        size = [float(np.abs(owned.forces[:, k]).sum()) for k in mine]
        found.append(owned.bodies[mine[int(np.argmax(size))]] or "calcn_r")
    return tuple(found)


def _inside(motion: mm.Motion, cutoff: float) -> np.ndarray:
    """Frames farther from the ends than the filter reaches."""
    reach = 0.75 / cutoff
    return (motion.time > motion.time[0] + reach) & (motion.time < motion.time[-1] - reach)


def estimated(
    hidden: Hidden,
    formulation: Formulation = "simultaneous",
    known: mm.Wrenches | None = None,
    shared: tuple[SharedWrench, ...] = (),
    ready: mm.Series | None = None,
) -> Tension:
    """Contact forces and tensions of a recording with the library's defaults.

    `known`: forces that act as they were measured; `shared`: forces known for several sites
    together; `ready`: activations to take instead.
    """
    task = ContactTask(
        sites=hidden.sites,
        activations=ready or hidden.activations,
        measured=shared,
        options=ContactOptions(formulation=formulation),
        preferred=preferred_directions(hidden.model, hidden.motion, hidden.sites),
    )
    torques = mm.inverse_dynamics(hidden.model, hidden.motion, known)
    return mm.solve_tension(
        hidden.model, hidden.motion, torques, contacts=task, recruitment=EFFORT_ALONE
    )


def feet_of(hidden: Hidden) -> Iterator[tuple[str, np.ndarray, np.ndarray]]:
    """Yield the measured wrench of each foot that plates carried.

    Parameters
    ----------
    hidden : recording

    Yields
    ------
    Side, (frames, 3) force [N], and (frames, 3) moment about the ground's origin [N m]
    """
    moments = hidden.measured.torques + np.cross(hidden.measured.points, hidden.measured.forces)
    for side, body in (("right", "calcn_r"), ("left", "calcn_l")):
        mine = [k for k, one in enumerate(hidden.measured.bodies) if one == body]
        force = hidden.measured.forces[:, mine].sum(axis=1)
        moment = moments[:, mine].sum(axis=1)
        if (force[hidden.use, 1] > 0.05 * hidden.weight).sum() > 5:
            yield side, force, moment


def foot_wrench(tension: Tension, side: str) -> tuple[np.ndarray, np.ndarray]:
    """Return the estimated wrench of a foot.

    Parameters
    ----------
    tension : solution with contacts
    side : "right" or "left"

    Returns
    -------
    (frames, 3) force [N], and (frames, 3) moment about the ground's origin [N m]
    """
    found = tension.contacts
    assert found is not None
    mine = [k for k, one in enumerate(found.sites) if one.group == f"foot_{side[0]}"]
    force = found.contact_force[:, mine]
    moment = found.contact_torque[:, mine] + np.cross(found.contact_point[:, mine], force)
    return force.sum(axis=1), moment.sum(axis=1)
