"""Speed of muscle tensions and contact forces in one problem.

Maintained QP solvers solve the same problems. `python -m benchmarks contacts`: frames a second of
the QP step alone and of everything from coordinates to tensions, on all cores, then milliseconds
per frame on one core next to other solvers. Walks are recorded, their plates hidden.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.recordings import read_markers
from benchmarks.speed.qp import QuadraticFrames, solvers_of
from benchmarks.speed.size import simulated
from benchmarks.speed.timing import alternate
from data_collection import data_folder
from myomorph.core.contact.sites import foot_sites
from myomorph.core.contact.states import contact_activations
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.join import join_models, join_motions
from myomorph.core.rigid.frames import over_frames, thread_count
from myomorph.core.tension.problem import Balance, TensionInputs, TensionProblem, tension_problem
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.terms.contacts import ContactOptions, ContactTask

WALK = "rajagopal-walk-emg/"
RATE = 100.0
PATIENCE = 20.0
"""A solver that took longer has no further round [s]."""


@dataclass(frozen=True, eq=False)
class ContactCase:
    """A motion without measured forces.

    It has what may touch, frames a second requested, and frames that all solvers solve.
    """

    name: str
    model: mm.Model
    motion: mm.Motion
    task: ContactTask
    asked: float
    compared: int = 30


def at_rate(
    motion: mm.Motion, rate: float, start: float = -np.inf, stop: float = np.inf
) -> mm.Motion:
    """Every n-th frame of a motion between two times, so that about `rate` are left a second."""
    step = max(1, round(motion.rate / rate))
    keep = np.flatnonzero((motion.time >= start) & (motion.time <= stop))[::step]
    return motion.frames(keep)


def walk(folder: Path, rate: float = RATE) -> tuple[mm.Model, mm.Motion]:
    """Read the recorded walk of the Rajagopal model, filtered at 6 Hz."""
    model = mm.read_model(folder / (WALK + "subject_walk_scaled.osim"))
    whole = mm.differentiate(mm.read_motion(folder / (WALK + "coordinates.sto"), model), 6.0)
    return model, at_rate(whole, rate, 0.5, 1.75)


def on_feet(model: mm.Model, motion: mm.Motion) -> tuple[tuple[Site, ...], np.ndarray]:
    """Return sites under the feet and their activations.

    Parameters
    ----------
    model : with the feet
    motion : with derivatives

    Returns
    -------
    Sites, and (frames, sites) contact activations
    """
    sites = foot_sites(model)
    contacts = mm.find_contacts(model, motion, sites)
    return sites, contact_activations(model, motion, sites, contacts).values


def one_walker(folder: Path) -> ContactCase:
    """Two feet of six sites each."""
    model, motion = walk(folder)
    sites, values = on_feet(model, motion)
    return ContactCase(
        name="walk, 80 muscles, 12 sites",
        model=model,
        motion=motion,
        task=_task(motion, sites, values),
        asked=1000.0,
    )


def two_walkers(folder: Path) -> ContactCase:
    """Two walkers side by side whose hands hold each other."""
    model, motion = walk(folder)
    feet, values = on_feet(model, motion)
    parts: Mapping[str, mm.Model] = {"one": model, "two": model}
    joined = join_models(parts)
    together = join_motions(dict.fromkeys(parts, motion))
    sites = [
        replace(
            site,
            name=f"{part}_{site.name}",
            body=f"{part}_{site.body}",
            group=f"{part}_{site.group}",
        )
        for part in parts
        for site in feet
    ]
    hold = Cone(direction=None, grip=0.05)
    sites += [
        Site(
            name=f"hold_{side}",
            body=f"one_hand_{side}",
            points=[[0.0, -0.08, 0.0]],
            cone=hold,
            against=f"two_hand_{side}",
        )
        for side in "rl"
    ]
    ready = np.hstack([values, values, np.ones((len(motion), 2))])
    case = "two walkers, 160 muscles, 24 sites, 2 holds"
    return ContactCase(
        name=case,
        model=joined,
        motion=together,
        task=_task(motion, tuple(sites), ready),
        asked=200.0,
        compared=15,
    )


def cyclist(folder: Path) -> ContactCase:
    """Return the largest model on eight patches of four points.

    It swings slowly about its recorded static pose.
    """
    model = mm.read_model(folder / "fullbody-many-muscles/cyclistFullBodyMuscle.osim")
    recorded = read_markers(folder / "fullbody-many-muscles/s01_static.trc")
    pose = mm.inverse_kinematics(model, recorded).motion.values[0]
    motion = mm.differentiate(simulated(model, pose, 60)[1])
    bodies = ("calcn_r", "calcn_l", "toes_r", "toes_l", "hand_r", "hand_l", "pelvis", "thoracic5")
    corners = [[x, 0.0, z] for x in (-0.03, 0.03) for z in (-0.03, 0.03)]
    sites = tuple(
        Site(name=body, body=body, points=corners, cone=Cone(torsion=0.01)) for body in bodies
    )
    # Some of its muscles are stretched so far in this pose that their passive forces mean nothing.
    task = _task(motion, sites, np.ones((len(motion), len(sites))), passive=False)
    name = "simulated swing, 520 muscles, 171 coordinates, 8 patches of 4 points"
    return ContactCase(name=name, model=model, motion=motion, task=task, asked=50.0, compared=10)


def _task(
    motion: mm.Motion, sites: tuple[Site, ...], values: np.ndarray, passive: bool = True
) -> ContactTask:
    ready = mm.Series(motion.time, tuple(site.name for site in sites), values)
    return ContactTask(
        sites, ready, options=ContactOptions(smoothness=0.0, contact_passive=passive)
    )


def quadratic(problem: TensionProblem, given: Balance, keep: np.ndarray) -> QuadraticFrames:
    """Write some frames as minimize sum x^2: every variable scaled by the root of its weight.

    Parameters
    ----------
    problem : to solve
    given : balance of all frames
    keep : (n,) indices of the frames

    Returns
    -------
    The quadratic programs of these frames
    """
    S = problem.separable
    root = np.sqrt(S.weight)
    columns = np.repeat(np.arange(len(root)), np.diff(S.start))
    values = given.values[keep] / root[columns]
    right = np.ascontiguousarray(given.right[keep])
    A = np.zeros((len(keep), right.shape[1], len(root)))
    A[:, S.row, columns] = values
    unit = S._replace(weight=np.ones_like(root), lower=S.lower * root, upper=S.upper * root)
    return QuadraticFrames(
        separable=unit, values=values, right=right, A=A, lower=unit.lower, upper=unit.upper
    )


def solved(case: ContactCase, torques: mm.Series, task: ContactTask) -> mm.Tension:
    """Contact forces and muscles by the effort alone."""
    return mm.solve_tension(
        case.model, case.motion, torques, contacts=task, recruitment=EFFORT_ALONE
    )


def speed(case: ContactCase, rounds: int = 5) -> dict[str, object]:
    """Measure frames a second on all cores.

    They are of the QP step alone, everything, and everything with forces smoothed.
    """
    torques = mm.inverse_dynamics(case.model, case.motion)
    smooth = replace(
        case.task, options=ContactOptions(contact_passive=case.task.options.contact_passive)
    )
    problem = tension_problem(TensionInputs(case.model, case.motion, torques, contacts=case.task))
    frames = len(case.motion)
    parts = {
        start: problem.balance(start, min(start + 16, frames)) for start in range(0, frames, 16)
    }
    status: list[np.ndarray] = []

    def qp() -> None:
        over_frames(
            lambda start, stop: status.append(problem.solved(parts[start])[4]), frames, chunk=16
        )

    seconds = alternate(
        {
            "qp": qp,
            "whole": lambda: solved(case, torques, case.task),
            "smooth": lambda: solved(case, torques, smooth),
        },
        rounds,
    )
    return {
        "case": case.name,
        "frames": frames,
        "rows": len(problem.assembly.pattern.order),
        "variables": len(problem.separable.weight),
        "cores": thread_count(),
        "QP step [frames/s]": frames / seconds["qp"],
        "required [frames/s]": case.asked,
        "everything [frames/s]": frames / seconds["whole"],
        "everything, forces smoothed [frames/s]": frames / seconds["smooth"],
        "optimal [%]": 100.0 * float(np.mean(np.concatenate(status) == 0)),
    }


def against_others(case: ContactCase, rounds: int = 3) -> Iterator[dict[str, object]]:
    """Milliseconds a frame on one core: ours and maintained solvers, same frames, alternating."""
    torques = mm.inverse_dynamics(case.model, case.motion)
    problem = tension_problem(TensionInputs(case.model, case.motion, torques, contacts=case.task))
    keep = (len(case.motion) - case.compared) // 2 + np.arange(case.compared)
    frames = quadratic(problem, problem.balance(0, len(case.motion)), keep)
    solvers = solvers_of(frames)
    found = {name: solver() for name, solver in solvers.items()}
    times = {
        name: 1e3 * taken / len(keep)
        for name, taken in alternate(solvers, rounds, PATIENCE).items()
    }
    least = np.sum(found["ours, warm"] ** 2, axis=1)
    for name, taken in times.items():
        yield {
            "case": case.name,
            "solver": name,
            "ms/frame, one core": taken,
            "times ours": taken / times["ours, warm"],
            "cost beyond ours [%], greatest": 100.0
            * float(np.max(np.sum(found[name] ** 2, axis=1) / least - 1.0)),
        }


def run() -> list[dict[str, object]]:
    """Rows of all cases, for `python -m benchmarks contacts`."""
    folder = data_folder()
    rows: list[dict[str, object]] = []
    for made in (one_walker, cyclist, two_walkers):
        case = made(folder)
        rows.append(speed(case))
        rows += against_others(case)
    return rows
