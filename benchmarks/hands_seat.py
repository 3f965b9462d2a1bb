"""Standing up from a chair that was on no plate: the seat's force."""

from __future__ import annotations

from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.hands_lift_forces import Task, soles_of
from benchmarks.recordings import read_markers
from myomorph.core.contact.assign import assign_bodies
from myomorph.core.contact.held_objects import raised_contacts
from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.sites import body_sites
from myomorph.core.contact.spells import hysteresis
from myomorph.core.io.loads import read_external_loads
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.contacts import Site
from myomorph.core.model.scale import scale
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask
from truths.carried_bodies import needed_wrench

FOLDER = "opencap-subject4-multitask"
CUTOFF = 6.0
UNLOADED = 0.05
LOADED = 0.10
"""The seat is left where it carries less than the first share of the weight, and taken above the
second.
"""


@dataclass(frozen=True, eq=False)
class Chair:
    """Standing up several times.

    `feet`: forces of the plates, by foot; `seat`: site on the pelvis; `places`: (frames, 3) of its
    middle [m]; `soles`: sites under the feet; `ready`: (frames, 1 + soles) how ready the seat and
    they are, by their height and speed alone; `lean`: (frames, soles, 3) which way the soles'
    forces lean; `newton`: (frames, 3) force that is left for the seat, and `moment` (frames, 3)
    about `places` [N], [N m].
    """

    model: mm.Model
    motion: mm.Motion
    feet: mm.Wrenches
    seat: Site
    soles: tuple[Site, ...]
    places: Array
    ready: Array
    lean: Array
    newton: Array
    moment: Array

    @property
    def weight(self) -> float:
        """Of the body [N]."""
        return float(self.model.mass * np.linalg.norm(self.model.gravity))


@lru_cache(maxsize=1)
def chair(folder: Path) -> Chair:
    """Read the trial STS1 on the expert's model, its mass that of standing on the plates."""
    here = folder / FOLDER
    model = _expert_model(here)
    markers = read_markers(here / "markers" / "STS1.trc")
    motion = mm.differentiate(mm.inverse_kinematics(model, markers).motion, CUTOFF)
    plates = read_external_loads(here / "grf" / "STS1_external_forces.xml")
    soles, standing, lean = soles_of(model, motion)
    feet = _loads_of_feet(model, motion, plates, soles)
    (seat,) = body_sites(model, ("seat",))
    raised = raised_contacts(model, motion, seat, soles)[1]
    left = needed_wrench(model, motion, "pelvis", feet)
    places = site_motion(model, motion, (seat,)).places[:, 0]
    moment = left.torques[:, 0] + np.cross(left.points[:, 0] - places, left.forces[:, 0])
    return Chair(
        model=model,
        motion=motion,
        feet=feet,
        seat=seat,
        soles=soles,
        places=places,
        ready=np.hstack([raised[:, None], standing]),
        lean=lean,
        newton=left.forces[:, 0],
        moment=moment,
    )


def _expert_model(here: Path) -> mm.Model:
    """Read the expert's model, its mass that of standing on the plates."""
    given = mm.read_model(here / "models" / "manually_scaled.osim")
    loads = read_external_loads(here / "grf" / "static1_external_forces.xml")
    standing = loads.forces[:, :, 1].sum(axis=1)
    mass = float(np.median(standing) / np.linalg.norm(given.gravity))
    return scale(given, {}, mass, preserve_mass_distribution=True)


def _loads_of_feet(
    model: mm.Model, motion: mm.Motion, plates: mm.Wrenches, soles: tuple[Site, ...]
) -> mm.Wrenches:
    """Assign the plates' forces to the feet; the third plate lies idle."""
    at = site_motion(model, motion, soles).places
    by_foot = {
        body: at[:, [k for k, one in enumerate(soles) if one.group == group]]
        for body, group in (("calcn_r", "foot_r"), ("calcn_l", "foot_l"))
    }
    loads = mm.resample_wrenches(plates, motion.time, CUTOFF)
    used = [k for k in range(len(loads.names)) if np.abs(loads.forces[:, k]).max() > 0.0]
    unknown = mm.Wrenches(
        time=loads.time,
        names=tuple(loads.names[k] for k in used),
        bodies=("",) * len(used),
        forces=loads.forces[:, used],
        points=loads.points[:, used],
        torques=loads.torques[:, used],
    )
    return assign_bodies(unknown, by_foot).wrenches


def task(folder: Path, plates: bool, first: bool = False) -> Task:
    """Return the problem of the seat's force; the feet's is known by plates, or hidden too.

    `first` finds contact forces before muscles instead of both together.
    """
    one = chair(folder)
    sites = (one.seat,) if plates else (one.seat, *one.soles)
    ready = mm.Series(
        one.motion.time, tuple(site.name for site in sites), one.ready[:, : len(sites)]
    )
    torques = mm.inverse_dynamics(one.model, one.motion, one.feet if plates else None)
    lean = np.concatenate([np.zeros((len(one.motion), 1, 3)), one.lean], axis=1)[:, : len(sites)]
    options = ContactOptions(formulation="sequential" if first else "simultaneous")
    return Task(
        model=one.model,
        motion=one.motion,
        torques=torques,
        contacts=ContactTask(
            sites=sites, activations=ready, measured=(), options=options, preferred=lean
        ),
    )


@lru_cache(maxsize=4)
def solved(folder: Path, plates: bool, first: bool = False) -> Tension:
    """Tensions with the seat's force."""
    asked = task(folder, plates, first)
    return mm.solve_tension(
        asked.model, asked.motion, asked.torques, contacts=asked.contacts, recruitment=EFFORT_ALONE
    )


@dataclass(frozen=True)
class Leaving:
    """One time of leaving the seat (or of sitting down), as three signs tell it [s].

    `motion`: the seat's readiness falls below a half; `force`: what Newton's law leaves for it
    falls below `UNLOADED` of the weight; `plates`: the feet carry the weight.
    """

    rising: bool
    motion: float
    force: float
    plates: float


def leavings(one: Chair) -> tuple[Leaving, ...]:
    """Return times of rising and sitting down.

    On these the three signs agree within half a second.
    """
    time = one.motion.time
    up = one.newton[:, 1] / one.weight
    feet = one.feet.forces[:, :, 1].sum(axis=1) / one.weight
    sat = {
        "motion": hysteresis(one.ready[:, 0] > 0.5, one.ready[:, 0] < 0.5),
        "force": hysteresis(up > LOADED, up < UNLOADED),
        "plates": hysteresis(feet < 0.9, feet > 1.0),
    }
    found = []
    for first, stop in runs(sat["motion"]):
        for frame, rising in ((stop, True), (first, False)):
            if not 0 < frame < len(time):
                continue
            near = {name: _nearest(time, state, frame, rising) for name, state in sat.items()}
            if all(abs(one - time[frame]) < 0.5 for one in near.values()):
                found.append(
                    Leaving(
                        rising=rising,
                        motion=near["motion"],
                        force=near["force"],
                        plates=near["plates"],
                    )
                )
    return tuple(found)


def _nearest(time: Array, state: np.ndarray, frame: int, rising: bool) -> float:
    """Return the nearest time at which a state ends (rising) or begins."""
    edges = [stop if rising else first for first, stop in runs(state)]
    inside = [one for one in edges if 0 < one < len(time)]
    return float(time[min(inside, key=lambda one: abs(one - frame))]) if inside else np.inf
