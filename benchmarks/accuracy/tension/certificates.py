"""What the data leave undetermined of contact forces, next to plates.

Its programs are compared with HiGHS, and contacts are made wrong.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator, Sequence
from dataclasses import replace
from functools import cache, partial
from pathlib import Path
from typing import NamedTuple

import numpy as np
from scipy.optimize import linprog

import myomorph as mm
from benchmarks.accuracy.contact.hidden_plates import LOADED
from benchmarks.accuracy.contact.pair import (
    KNOWN,
    Knowledge,
    bouts,
    emg_target,
    open_sites,
    recorded_motion,
)
from benchmarks.hidden_plates import CASES, Hidden, HiddenCase, feet_of, opened
from myomorph.core.contact.states import preferred_directions
from myomorph.core.model.arrays import Array
from myomorph.core.rigid.frames import over_frames
from myomorph.core.tension.certificates import (
    Bounds,
    CertificateOptions,
    ContactIntervals,
    SolvedFrames,
    contact_intervals,
    group_functions,
    open_bounds,
    solved_frames,
)
from myomorph.core.tension.problem import TensionInputs, TensionProblem, tension_problem
from myomorph.core.tension.relaxation import RESIDUAL_SHARE, Relaxation, relaxations
from myomorph.core.tension.simplex import extremes
from myomorph.core.tension.tension import Tension
from myomorph.core.tension.terms.contacts import ContactTask
from myomorph.show.simulate.bout import FEET
from myomorph.show.simulate.pair import VirtualPair
from truths.optimality import optimality

Row = dict[str, object]

AXES = ("fore-aft", "vertical", "lateral")
EVERY = 5
"""Of the frames that are compared, each so many-th is asked."""

MODEL_ERROR = 0.05
"""Share of the weight that residuals may give: what errors of model and motion may amount to (Hicks
et al. 2015).
"""


ROUNDING = 1.0
"""Beyond an interval that still counts as inside [N]."""


def solved(
    hidden: Hidden, change: Callable[[ContactTask], ContactTask] = lambda task: task
) -> tuple[TensionProblem, Tension]:
    """Return the problem of a recording with its plates hidden, all settings defaults, solved."""
    task = ContactTask(
        hidden.sites,
        hidden.activations,
        preferred=preferred_directions(hidden.model, hidden.motion, hidden.sites),
    )
    torques = mm.inverse_dynamics(hidden.model, hidden.motion)
    problem = tension_problem(
        TensionInputs(hidden.model, hidden.motion, torques, contacts=change(task))
    )
    over_frames(problem.solve, len(hidden.motion), None, problem.window)
    return problem, problem.result()


@cache
def solved_case(folder: Path, case: HiddenCase) -> tuple[Hidden, TensionProblem, Tension]:
    """Return the same of a case, cached."""
    hidden = opened(folder, case)
    return hidden, *solved(hidden)


def measure(folder: Path) -> Iterator[Row]:
    """Measure widths of intervals on one foot and on several contacts.

    The rows have whether plates' forces lie inside.
    """
    for case in CASES:
        hidden, problem, tension = solved_case(folder, case)
        frames = np.flatnonzero(hidden.use)[::EVERY]
        found = contact_intervals(problem, tension, frames.tolist())
        several = _touching(hidden, found.groups, frames).sum(axis=1) > 1
        row: Row = {
            "recording": case.name,
            "instants": len(frames),
            "several contacts": int(several.sum()),
        }
        width = 100.0 * (found.high - found.low) / hidden.weight
        near = 100.0 * (found.near_high - found.near_low) / hidden.weight
        row |= _median_widths("one contact", width[~several])
        row |= _median_widths("several", width[several])
        row |= _median_widths("near optimum", near[several])
        options = CertificateOptions(residual=MODEL_ERROR, near=0.0)
        wide = contact_intervals(problem, tension, frames.tolist(), options)
        yield row | _plates_inside(hidden, wide, frames)


def _touching(hidden: Hidden, names: Sequence[str], frames: np.ndarray) -> np.ndarray:
    """Return whether each group of sites may touch (frames, groups)."""
    ready = hidden.activations.values[frames] > 0.0
    groups = np.array([one.group for one in hidden.sites])
    return np.stack([ready[:, groups == name].any(axis=1) for name in names], axis=1)


def _median_widths(what: str, widths: Array) -> Row:
    """Return medians of the widest interval of any group, from widths (frames, groups, 3)."""
    return {
        f"{what}, {AXES[axis]} [% weight]": (
            float(np.median(widths[:, :, axis].max(axis=1))) if len(widths) else ""
        )
        for axis in (1, 0, 2)
    }


def _plates_inside(hidden: Hidden, wide: ContactIntervals, frames: np.ndarray) -> Row:
    """Return how often the plates' forces lie inside intervals, while they carry."""
    feet = [
        (name, force)
        for side, force, _ in feet_of(hidden)
        if (name := f"foot_{side[0]}") in wide.groups
    ]
    columns = [wide.groups.index(name) for name, _ in feet]
    measured = np.stack([force[frames] for _, force in feet], axis=1)
    inside = (measured >= wide.low[:, columns]) & (measured <= wide.high[:, columns])
    carrying = measured[..., 1] > LOADED * hidden.weight
    return {
        f"plates inside, {AXES[axis]}": float(inside[carrying][:, axis].mean())
        for axis in (1, 0, 2)
    }


class _Programs(NamedTuple):
    """Extremes by our simplex and by HiGHS.

    Attributes
    ----------
    apart : greatest difference of their extremes [N]
    ours, highs : processor time [s]
    """

    apart: float
    ours: float
    highs: float


def measure_programs(folder: Path) -> Iterator[Row]:
    """Compare extremes by our simplex with HiGHS.

    The rows have conditions of an optimum, and processor time per instant.
    """
    for case in CASES[:2]:
        hidden, problem, tension = solved_case(folder, case)
        frames = np.flatnonzero(hidden.use)[:: 4 * EVERY]
        dense = solved_frames(problem, tension, frames)
        columns = problem.contacts.generators if problem.contacts is not None else None
        assert columns is not None
        names = tuple(dict.fromkeys(one.group for one in columns.sites))
        members = [
            np.array([columns.sites[k].group == name for k in columns.site]) for name in names
        ]
        functions = group_functions(problem, dense, members)
        solved_by = _solved_programs(
            dense, open_bounds(problem, dense, CertificateOptions()), functions
        )
        began = time.process_time()
        contact_intervals(problem, tension, frames.tolist())
        whole = time.process_time() - began
        conditions = optimality(problem, tension, frames.tolist())
        yield {
            "recording": case.name,
            "instants": len(frames),
            "programs an instant": 8 * len(names),
            "variables": dense.x.shape[1],
            "equations": dense.b.shape[1],
            "difference, maximum [N]": solved_by.apart,
            "ours [ms]": 1e3 * solved_by.ours / len(frames),
            "HiGHS [ms]": 1e3 * solved_by.highs / len(frames),
            "all intervals [ms]": 1e3 * whole / len(frames),
            "stationarity": float(conditions.stationarity.max()),
            "balance": float(conditions.balance.max()),
        }


def _solved_programs(dense: SolvedFrames, bounds: Bounds, functions: Array) -> _Programs:
    """Minimize and maximize functions (frames, functions, variables) in frames by both programs."""
    ours_seconds = 0.0
    highs_seconds = 0.0
    apart = 0.0
    for k in range(len(functions)):
        costs = np.stack([functions[k], -functions[k]], axis=1).reshape(-1, functions.shape[-1])
        began = time.process_time()
        ours, _ = extremes(dense.A[k], dense.x[k], bounds.lower[k], bounds.upper[k], costs)
        ours_seconds += time.process_time() - began
        began = time.process_time()
        theirs = [
            _highs(cost, dense.A[k], dense.x[k], bounds.lower[k], bounds.upper[k]) for cost in costs
        ]
        highs_seconds += time.process_time() - began
        apart = max(apart, float(np.abs(ours - theirs).max()))
    return _Programs(apart=apart, ours=ours_seconds, highs=highs_seconds)


def _highs(
    cost: np.ndarray, A: np.ndarray, x: np.ndarray, lower: np.ndarray, upper: np.ndarray
) -> float:
    found = linprog(
        cost, A_eq=A, b_eq=A @ x, bounds=np.column_stack([lower, upper]), method="highs"
    )
    return float(found.fun)


def measure_faults(folder: Path) -> Iterator[Row]:
    """Make contacts of the walks wrong while one foot alone stands.

    The rows have how often that is detected, and named correctly. Frames that must be marked are
    those whose net force alone is beyond what the contacts may carry by more than residuals may
    give. Moments may require more.
    """
    for case in CASES[:3]:
        hidden = opened(folder, case)
        tau = mm.inverse_dynamics(hidden.model, hidden.motion)
        force = np.stack([tau[f"pelvis_t{axis}"] for axis in "xyz"], axis=1)
        for name in FAULTS:
            right = _marked_frames(hidden, force, name, "foot_r", "foot_l")
            left = _marked_frames(hidden, force, name, "foot_l", "foot_r")
            counts = {key: right[key] + left[key] for key in right}
            yield {"recording": case.name, "fault": name} | counts


def _marked_frames(
    hidden: Hidden, force: Array, fault_name: str, foot: str, other: str
) -> dict[str, int]:
    """Count frames that are marked while a faulty foot alone stands.

    `force`: (frames, 3) that has to act on the pelvis [N].
    """
    kind, fault, most = FAULTS[fault_name]
    groups = np.array([one.group for one in hidden.sites])
    ready = hidden.activations.values[:, groups == foot]
    others = hidden.activations.values[:, groups == other]
    alone = hidden.use & (ready.max(axis=1) > 0.9) & ~(others > 0.0).any(axis=1)
    problem, tension = solved(hidden, partial(fault, foot=foot))
    found = {one.frame: one for one in relaxations(problem, tension)}
    lacking = most(force, (ready > 0.0).sum(axis=1)) > RESIDUAL_SHARE * hidden.weight
    seen = np.isin(np.arange(len(alone)), list(found))
    named = [_named(found[int(frame)], kind, foot) for frame in np.flatnonzero(alone & seen)]
    return {
        "frames": int(alone.sum()),
        "must be marked": int((alone & lacking).sum()),
        "of these marked": int((alone & lacking & seen).sum()),
        "marked in all": int((alone & seen).sum()),
        "named rightly": sum(named),
    }


def measure_truth() -> Iterator[Row]:
    """Compare intervals with simulated fighters whose forces are known.

    The rows have whether the truth lies inside, and where the error lies.
    """
    pairs = [(pair, recorded_motion(pair)) for pair in bouts()]
    for known in (KNOWN[0], KNOWN[3], KNOWN[5]):
        inside = []
        near = []
        width = []
        along = []
        groups = ()
        for pair, motion in pairs:
            problem = pair_problem(pair, motion, known)
            over_frames(problem.solve, len(motion), None, problem.window)
            frames = np.arange(10, len(motion) - 10, 4 * EVERY)
            found = contact_intervals(problem, problem.result(), frames.tolist())
            groups = found.groups
            truth = np.stack([pair.truth.forces[name] for name in groups], axis=1)[frames]
            miss = found.forces - truth
            inside.append((truth >= found.low - ROUNDING) & (truth <= found.high + ROUNDING))
            near.append((truth >= found.near_low) & (truth <= found.near_high))
            width.append(found.high - found.low)
            along.append(
                (miss * found.direction).sum(axis=(1, 2)) ** 2 / (miss**2).sum(axis=(1, 2))
            )
        of_feet = np.array([name in FEET for name in groups])
        yield {
            "known": known.words,
            "instants": sum(map(len, along)),
            "feet inside": float(np.concatenate(inside)[:, of_feet].mean()),
            "grips inside": float(np.concatenate(inside)[:, ~of_feet].mean()),
            "feet, width [N]": float(np.median(np.concatenate(width)[:, of_feet])),
            "grips, width [N]": float(np.median(np.concatenate(width)[:, ~of_feet])),
            "feet near optimum": float(np.concatenate(near)[:, of_feet].mean()),
            "grips near optimum": float(np.concatenate(near)[:, ~of_feet].mean()),
            "error along the least determined direction": float(np.concatenate(along).mean()),
            "by chance": 1.0 / (3 * len(groups)),
        }


def pair_problem(pair: VirtualPair, motion: mm.Motion, known: Knowledge) -> TensionProblem:
    """Return the simultaneous problem of a bout."""
    wrenches = [pair.plates[part] for part in known.plates]
    torques = mm.inverse_dynamics(pair.model, motion, together(wrenches) if wrenches else None)
    sites = open_sites(pair, known)
    names = tuple(one.name for one in sites)
    columns = [pair.touching.names.index(name) for name in names]
    task = ContactTask(sites, mm.Series(motion.time, names, pair.touching.values[:, columns]))
    return tension_problem(
        TensionInputs(pair.model, motion, torques, contacts=task, emg=emg_target(pair, known.emg))
    )


def together(wrenches: Sequence[mm.Wrenches]) -> mm.Wrenches:
    """Several loads as one."""
    parts = {
        name: np.concatenate([getattr(one, name) for one in wrenches], axis=1)
        for name in ("forces", "points", "torques")
    }
    names = tuple(name for one in wrenches for name in one.names)
    return mm.Wrenches(
        wrenches[0].time, names, tuple(body for one in wrenches for body in one.bodies), **parts
    )


def _forgotten(task: ContactTask, foot: str) -> ContactTask:
    """Remove the contact of a foot."""
    mine = np.array([one.group == foot for one in task.sites])
    values = np.where(mine, 0.0, task.activations.values)
    return replace(
        task, activations=mm.Series(task.activations.time, task.activations.names, values)
    )


def _slippery(task: ContactTask, foot: str) -> ContactTask:
    """Place the foot as on ice: friction 0.02."""
    return _with_cone(task, foot, friction=0.02)


def _weak(task: ContactTask, foot: str) -> ContactTask:
    """Each site of the foot may carry 100 N at most."""
    return _with_cone(task, foot, most=100.0)


def _with_cone(task: ContactTask, foot: str, **change: float) -> ContactTask:
    sites = tuple(
        replace(one, cone=replace(one.cone, **change)) if one.group == foot else one  # type: ignore[arg-type]
        for one in task.sites
    )
    return replace(task, sites=sites, preferred=None)


Lacking = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Net force (frames, 3) and number of touching sites (frames,) to what contacts cannot carry of it
(frames,) [N].
"""

FAULTS: dict[str, tuple[str, Callable[..., ContactTask], Lacking]] = {
    "none": ("", lambda task, foot: task, lambda force, sites: np.zeros(len(force))),
    "foot forgotten": ("contact", _forgotten, lambda force, sites: np.linalg.norm(force, axis=1)),
    "friction 0.02": (
        "friction",
        _slippery,
        lambda force, sites: np.hypot(force[:, 0], force[:, 2]) - 0.02 * force[:, 1],
    ),
    "100 N a site at most": ("most", _weak, lambda force, sites: force[:, 1] - 100.0 * sites),
}


def _named(found: Relaxation, kind: str, foot: str) -> bool:
    return any(one.kind == kind and one.where == foot for one in found.allowances)
