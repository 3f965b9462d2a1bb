"""Forces of a mouse on a ladder of load cells, recovered from channels of 1, 3 and 6 axes.

They are simulated, so that the forces are known.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace
from functools import lru_cache
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms
from myomorph.bones.morph.mirror.model import with_other_side
from myomorph.core.contact.feet_on_steps import feet_on_steps, stair_wrenches
from myomorph.core.contact.stairs import COMPONENTS, Step, step_loads
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Site
from myomorph.core.model.model import Marker
from myomorph.core.model.spatial import Transform, rotation_from_euler_xyz
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from truths.mouse_hindlimb import mouse_hindlimb_model

Row = dict[str, object]
RATE = 500.0
PERIOD = 0.3
DUTY = 0.6
CYCLES = 4
PITCH = 0.012
RISE = 0.004
APART = 0.009
"""From rung to rung, forward and up; half the distance between the tracks of the paws [m]."""
RUNG = (0.003, 0.06)
PAWS = {"r": "Toes_r", "l": "Toes_l"}
AXES = {1: ("fz",), 3: ("fx", "fy", "fz"), 6: COMPONENTS}
CUTOFF = 60.0
BENT = {"Hip_flexion": 0.3, "Knee_extension": -1.6, "Ankle_flexion": 0.3, "MTP_flexion": 0.3}
"""Angles from which inverse kinematics starts: a straight leg finds no way to bend [rad]."""


@dataclass(frozen=True, eq=False)
class Climb:
    """A mouse that climbs, and what acts on it.

    `forces`, `points`: by paw, (frames, 3) in ground; `rung`: by paw, (frames,) which one it stands
    on, -1 in swing.
    """

    model: mm.Model
    motion: mm.Motion
    steps: tuple[Step, ...]
    sites: tuple[Site, ...]
    forces: dict[str, Array]
    points: dict[str, Array]
    rung: dict[str, np.ndarray]


@lru_cache(maxsize=1)
def climb(folder: Path) -> Climb:
    """Simulate the anatomist's hindlimb and its mirrored other side on a ladder.

    Paths of paws and forces are invented.
    """
    model = with_other_side(
        mouse_hindlimb_model(folder / "mouse-hindlimb-muscles/mouse_hindlimb.json")
    )
    time = np.arange(0.0, CYCLES * PERIOD, 1.0 / RATE)
    targets = {}
    rung = {}
    for side in PAWS:
        targets[side], rung[side] = _paw_path(time, side)
    motion = _followed(model, time, _body_path(time), targets)
    places = _paws(model, motion)
    steps = _ladder()
    return Climb(
        model=model,
        motion=motion,
        steps=steps,
        sites=tuple(Site(f"paw_{side}", body, np.zeros((1, 3))) for side, body in PAWS.items()),
        forces={side: _paw_force(time, side, model.weight) for side in PAWS},
        points={side: _on_rungs(steps, rung[side], places[side]) for side in PAWS},
        rung=rung,
    )


def _paw_path(time: Array, side: str) -> tuple[Array, np.ndarray]:
    """Return where a paw goes (frames, 3) [m], and the rung (frames,) that it stands on.

    The left paw is half a cycle later and a rung further. In swing the rung is -1.
    """
    left = side == "l"
    cycle = time / PERIOD - (0.5 if left else 0.0)
    turn = np.floor(cycle).astype(np.int64)
    share = cycle % 1.0
    u = np.clip((share - DUTY) / (1.0 - DUTY), 0.0, 1.0)
    smooth = u**3 * (10.0 - 15.0 * u + 6.0 * u**2)
    at = 2.0 * (turn + smooth) + (1.0 if left else 0.0) + 2.0
    across = np.full_like(at, -APART if left else APART)
    place = np.stack([PITCH * at, RISE * at, across], axis=1)
    place[:, 1] += 0.004 * np.sin(np.pi * u) ** 2
    return place, np.where(share < DUTY, 2 * turn + left + 2, -1)


def _body_path(time: Array) -> Array:
    """Return where the pelvis goes (frames, 3) [m]."""
    forward = PITCH * (2.0 * time / PERIOD + 2.2)
    up = RISE * (2.0 * time / PERIOD + 2.0) + 0.03
    return np.stack([forward, up, 0.0 * time], axis=1)


def _ladder() -> tuple[Step, ...]:
    """Return the rungs, each with a cell of six axes."""
    return tuple(
        Step(
            name=f"rung{k}",
            pose=Transform(
                rotation_from_euler_xyz((-np.pi / 2.0, 0.0, 0.0)),
                np.array([PITCH * k, RISE * k, 0.0]),
            ),
            size=RUNG,
            measures=COMPONENTS,
            channels=tuple(f"{one}{k}" for one in COMPONENTS),
            origin=np.array([0.0, 0.0, -0.005]),
        )
        for k in range(2 * CYCLES + 4)
    )


def _paw_force(time: Array, side: str, weight: float) -> Array:
    """Return the force on a paw (frames, 3) [N], a half sine while it stands."""
    left = side == "l"
    share = (time / PERIOD - (0.5 if left else 0.0)) % 1.0 / DUTY
    push = np.where(share < 1.0, np.sin(np.pi * np.clip(share, 0.0, 1.0)), 0.0) * weight
    forward = 0.15 * push * np.sin(np.pi * (2 * share - 1))
    out = -0.06 if left else 0.06
    return np.stack([forward, 0.9 * push, out * push], axis=1)


def _on_rungs(steps: tuple[Step, ...], rung: np.ndarray, places: Array) -> Array:
    """Return where a paw presses (frames, 3) [m]: where it is, as far as the rung reaches."""
    return np.array(
        [
            _on(steps[max(int(k), 0)], place) if k >= 0 else place
            for k, place in zip(rung, places, strict=True)
        ]
    )


def _followed(model: mm.Model, time: Array, body: Array, targets: dict[str, Array]) -> mm.Motion:
    """Return coordinates with which the pelvis and the paws go where they should.

    They are smooth to the second derivative.
    """
    corners = np.array([[0.0, 0.0, 0.0], [-0.01, 0.0, 0.0], [0.0, 0.01, 0.0], [0.0, 0.0, 0.005]])
    own = [Marker(f"P{k}", "Pelvis", corner) for k, corner in enumerate(corners)]
    own += [Marker(f"paw_{side}", name, np.zeros(3)) for side, name in PAWS.items()]
    values = np.concatenate(
        [body[:, None] + corners, np.stack([targets["r"], targets["l"]], axis=1)], axis=1
    )
    bent = tuple(
        replace(one, default=BENT.get(one.name[:-2], one.default)) for one in model.coordinates
    )
    guided = replace(model, markers=tuple(own), coordinates=bent)
    fit = mm.inverse_kinematics(guided, mm.Markers(time, tuple(one.name for one in own), values))
    return mm.differentiate(fit.motion, CUTOFF)


def _paws(model: mm.Model, motion: mm.Motion) -> dict[str, Array]:
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return {side: poses.origins[:, tree.body_index[name]] for side, name in PAWS.items()}


def _on(step: Step, place: Array) -> Array:
    inside = step.pose.inverse().apply(place)
    half = 0.5 * np.array(step.size)
    return step.pose.apply(np.array([*np.clip(inside[:2], -half, half), 0.0]))


def channels(made: Climb, noise: float, cross: Array | None, seed: int = 0) -> mm.Series:
    """Return what all cells read.

    Parameters
    ----------
    made : the climb
    noise : standard deviation of white noise [body weights]; of moments, times 10 mm
    cross : (6, 6) cross-talk of forces and moments, None for none
    seed : of the noise

    Returns
    -------
    Series of 6 columns per rung
    """
    rng = np.random.default_rng(seed)
    columns = []
    sd = noise * made.model.weight * np.array([1.0, 1.0, 1.0, 0.01, 0.01, 0.01])
    for k, step in enumerate(made.steps):
        total = np.zeros((len(made.motion), 6))
        for side in PAWS:
            on = made.rung[side] == k
            force = np.where(on[:, None], made.forces[side], 0.0) @ step.pose.rotation
            arm = step.pose.inverse().apply(made.points[side]) - step.origin
            total += np.hstack([force, np.cross(arm, force)])
        if cross is not None:
            total = total @ cross.T
        columns.append(total + rng.standard_normal(total.shape) * sd + 0.1 * made.model.weight)
    return mm.Series(
        made.motion.time,
        tuple(name for step in made.steps for name in step.channels),
        np.hstack(columns),
    )


def recovered(
    made: Climb, axes: int, read: mm.Series, away: float = 0.0, given: Array | None = None
) -> mm.Wrenches:
    """Return the wrenches on the paws from cells of some axes.

    Parameters
    ----------
    made : the climb
    axes : number of axes of a cell: 1, 3 or 6
    read : channels of all cells
    away : displacement of the paws [m]
    given : (6, 6) known cross-talk, None for none

    Returns
    -------
    Wrenches on the paws
    """
    steps = []
    for step in made.steps:
        names = AXES[axes]
        if given is not None:
            steps.append(replace(step, matrix=np.asarray(np.linalg.inv(given), dtype=np.float64)))
            continue
        own = tuple(step.channels[COMPONENTS.index(one)] for one in names)
        steps.append(replace(step, measures=names, channels=own))
    loads = step_loads(steps, read, made.model.weight)
    shift = away / np.sqrt(3.0) * np.ones(3)
    sites = tuple(replace(one, points=one.points + shift) for one in made.sites)
    return stair_wrenches(feet_on_steps(made.model, made.motion, sites, loads), "zero")[0]


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each kind of cell, noise and misplacement."""
    made = climb(folder)
    mixed = np.eye(6) + 0.03 * np.random.default_rng(1).standard_normal((6, 6)) * np.outer(
        [1, 1, 1, 0.01, 0.01, 0.01], [1, 1, 1, 100, 100, 100]
    )
    for axes in (6, 3, 1):
        for noise, away in ((0.0, 0.0), (0.005, 0.0), (0.02, 0.0), (0.005, 1e-3), (0.005, 3e-3)):
            yield _row(
                made,
                f"{axes}",
                noise,
                away,
                recovered(made, axes, channels(made, noise, None), away),
            )
    read = channels(made, 0.005, mixed)
    yield _row(made, "6, cross-talk of 3 % left in", 0.005, 0.0, recovered(made, 6, read))
    yield _row(made, "6, cross-talk taken out", 0.005, 0.0, recovered(made, 6, read, given=mixed))


def _row(made: Climb, axes: str, noise: float, away: float, found: mm.Wrenches) -> Row:
    weight = made.model.weight
    vertical = []
    level = []
    place = []
    right = 0.0
    total = 0.0
    truth = []
    for side, body in PAWS.items():
        force = made.forces[side]
        truth.append((force, made.points[side], np.zeros_like(force)))
        mine = [j for j, one in enumerate(found.bodies) if one == body]
        own = found.forces[:, mine].sum(axis=1)
        loaded = force[:, 1] > 0.1 * weight
        error = own[loaded] - force[loaded]
        vertical.append(error[:, 1])
        level.append(error[:, [0, 2]])
        right += float(np.minimum(own[loaded, 1], force[loaded, 1]).clip(0.0).sum())
        total += float(force[loaded, 1].sum())
        for j in mine:
            pressed = found.forces[:, j, 1] > 0.3 * weight
            place.append(
                np.linalg.norm(found.points[pressed, j] - made.points[side][pressed], axis=1)
            )
    given = [np.stack(parts, axis=1) for parts in zip(*truth, strict=True)]
    exact = mm.Wrenches(made.motion.time, tuple(PAWS), tuple(PAWS.values()), *given)
    return {
        "axes": axes,
        "noise [% of weight]": 100.0 * noise,
        "paw misplaced [mm]": 1000.0 * away,
        "force on its paw [%]": 100.0 * right / total,
        "vertical, RMS [% of weight]": 100.0 * rms(np.concatenate(vertical)) / weight,
        "level, RMS [% of weight]": 100.0 * rms(np.concatenate(level)) / weight,
        "place, RMS [mm]": 1000.0 * rms(np.concatenate(place)),
    } | _torques(made, exact, found)


def _torques(made: Climb, exact: mm.Wrenches, found: mm.Wrenches) -> Row:
    truth = mm.inverse_dynamics(made.model, made.motion, exact)
    told = mm.inverse_dynamics(made.model, made.motion, found)
    row: Row = {}
    for joint, name in (
        ("hip", "Hip_flexion"),
        ("knee", "Knee_extension"),
        ("ankle", "Ankle_flexion"),
    ):
        columns = [truth.names.index(f"{name}_{side}") for side in "rl"]
        values = truth.values[:, columns]
        row[f"{joint} torque, RMS [% of peak]"] = (
            100.0 * rms(told.values[:, columns] - values) / np.abs(values).max()
        )
    return row
