"""Who stands on which step: forces of stairs on the bodies of a model."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Literal

import numpy as np

from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.stairs import StairOptions, Step, StepLoads
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.contacts import Contacts, SharedWrench, Site, Touch
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches

Unmeasured = Literal["unknown", "zero"]
# Standard deviation of a measured component that has no noise at all, over body weight
LEAST_NOISE = 1e-4


@read_only
class FeetOnSteps:
    """Loads of the steps at the times of a motion, and the sites that stand on each."""

    time: Array
    steps: tuple[Step, ...]
    sites: tuple[Site, ...]
    # forces, moments: (frames, steps, 3) in ground, moments about the tread's middle; NaN where not
    # measured
    forces: Array
    moments: Array
    loaded: np.ndarray
    standing: np.ndarray  # (frames, steps, sites) whether a site is on a step while it is loaded
    places: Array  # (frames, sites, 3) of the sites [m]
    noise: Array
    # weight, height: of the body [N], of its center of mass over its lowest site [m]
    weight: float
    height: float
    # loadings that nobody stands on and steps that carry several bodies, one line each
    notes: tuple[str, ...] = ()


def feet_on_steps(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    loads: StepLoads,
    options: StairOptions | None = None,
) -> FeetOnSteps:
    """Give the load of each step to the sites that stand on it.
    A site is on the step that it is nearest to, within reach, and stands there while it is slow.
    `sites`: of feet that may stand on steps; `loads`: of the steps, on their own clock.
    """
    options = options or StairOptions()
    if not sites:
        raise BadData("no foot is given that might stand on a step")
    moving = site_motion(model, motion, sites)
    away = np.stack([_distances(step, moving.places) for step in loads.steps], axis=1)
    nearest = np.argmin(np.where(np.isfinite(away), away, np.inf), axis=1)
    nearest_step = np.arange(len(loads.steps))[None, :, None] == nearest[:, None]
    near = nearest_step & (away <= options.search_range * moving.height)
    loaded = _interpolated(loads.time, loads.loaded.astype(np.float64), motion.time) > 0.5
    slow = np.linalg.norm(moving.velocities, axis=2) < options.still * moving.pace
    # A foot that swings past a step does not stand on it, unless nobody else is there.
    calm = near & slow[:, None, :]
    standing = np.where(calm.any(axis=2, keepdims=True), calm, near) & loaded[:, :, None]
    standing = _throughout(standing, loaded)
    forces = np.where(loaded[:, :, None], _interpolated(loads.time, loads.forces, motion.time), 0.0)
    moments = np.where(
        loaded[:, :, None], _interpolated(loads.time, loads.moments, motion.time), 0.0
    )
    for values, measured in ((forces, loads.forces), (moments, loads.moments)):
        values[:, np.isnan(measured).all(axis=0)] = np.nan
    notes = [*loads.notes, *_warnings(motion.time, loads.steps, sites, loaded, standing)]
    return FeetOnSteps(
        time=motion.time,
        steps=loads.steps,
        sites=tuple(sites),
        forces=forces,
        moments=moments,
        loaded=loaded,
        standing=standing,
        places=moving.places,
        noise=loads.noise,
        weight=model.weight,
        height=moving.height,
        notes=tuple(notes),
    )


def _throughout(standing: np.ndarray, loaded: np.ndarray) -> np.ndarray:
    """Who stands on each step through the whole of a loading: frames with nobody take those of the
    nearest with one.
    """
    filled = standing.copy()
    for index in range(loaded.shape[1]):
        for start, stop in runs(loaded[:, index]):
            known = np.flatnonzero(standing[start:stop, index].any(axis=1)) + start
            if len(known):
                frames = np.arange(start, stop)
                after = np.clip(np.searchsorted(known, frames), 0, len(known) - 1)
                before = np.clip(after - 1, 0, None)
                nearest = np.where(
                    np.abs(known[before] - frames) < np.abs(known[after] - frames), before, after
                )
                filled[start:stop, index] = standing[known[nearest], index]
    return filled


def _distances(step: Step, places: Array) -> Array:
    """Distance (frames, sites) of places to the rectangle of a tread [m]."""
    inside = step.pose.inverse().apply(places)
    half = 0.5 * np.array([*step.size, 0.0])
    return np.linalg.norm(np.maximum(np.abs(inside) - half, 0.0), axis=-1)


def _interpolated(time: Array, values: Array, at: Array) -> Array:
    """Values (samples, ...) at other times; 0 outside of the recording."""
    flat = values.reshape(len(time), -1)
    columns = [np.interp(at, time, np.nan_to_num(column), left=0.0, right=0.0) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(at), *values.shape[1:])


def _warnings(
    time: Array,
    steps: Sequence[Step],
    sites: Sequence[Site],
    loaded: np.ndarray,
    standing: np.ndarray,
) -> list[str]:
    result = []
    step_time = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for number, step in enumerate(steps):
        stands = _bodies_on(standing[:, number], sites)
        bodies = np.stack(list(stands.values()), axis=1)
        alone = loaded[:, number] & ~bodies.any(axis=1)
        if alone.any():
            result.append(
                f"step '{step.name}' is loaded for {alone.sum() * step_time:.3g} s, first at"
                f" {time[alone][0]:.3f} s, with no foot near it: its force is on nobody"
            )
        several = bodies.sum(axis=1) > 1
        if several.any():
            who = [body for body, stood in stands.items() if stood[several].any()]
            result.append(
                f"step '{step.name}' carries {' and '.join(who)} together for"
                f" {several.sum() * step_time:.3g} s: its force is shared"
            )
    return result


def _bodies_on(standing: np.ndarray, sites: Sequence[Site]) -> dict[str, np.ndarray]:
    """(frames,) whether each body stands on a step, by which of its sites (frames, sites) do."""
    bodies = dict.fromkeys(site.body for site in sites)
    return {
        body: np.asarray(standing[:, [site.body == body for site in sites]].any(axis=1))
        for body in bodies
    }


def stair_wrenches(
    feet: FeetOnSteps, unmeasured: Unmeasured = "unknown"
) -> tuple[Wrenches, tuple[str, ...]]:
    """External forces on bodies, for inverse dynamics, and what they leave open.
    A force acts at the center of pressure where the cell measures moments, else where the foot is.
    Two bodies on a step share its force so that the center of pressure is kept, or evenly where it
    is not known. `unmeasured`: "zero" takes components that a cell does not measure for zero; with
    "unknown" such a step has no force here: `shared_stairs` passes what is measured on to muscle
    tensions. Returns wrenches named `step_body`, and notes.
    """
    notes = list(feet.notes)
    columns: dict[tuple[str, str], tuple[Array, Array, Array]] = {}
    for number, step in enumerate(feet.steps):
        missing = [
            axis for i, axis in enumerate("xyz") if np.isnan(feet.forces[:, number, i]).all()
        ]
        if missing and unmeasured == "unknown":
            notes.append(
                f"step '{step.name}' does not measure force along {', '.join(missing)}: inverse"
                " dynamics goes without it; tensions with shared contacts take the rest"
            )
            continue
        if missing:
            notes.append(
                f"step '{step.name}' does not measure force along {', '.join(missing)}: taken for"
                " zero"
            )
        columns |= {(step.name, body): part for body, part in _parts(feet, number).items()}
    values = (
        np.array(list(columns.values())).reshape(-1, 3, len(feet.time), 3).transpose(1, 2, 0, 3)
    )
    names = tuple(f"{step}_{body}" for step, body in columns)
    return Wrenches(feet.time, names, tuple(body for _, body in columns), *values), tuple(notes)


def _parts(feet: FeetOnSteps, index: int) -> dict[str, tuple[Array, Array, Array]]:
    """Force, point and free torque (frames, 3) of a step on each body that stands on it."""
    step = feet.steps[index]
    force = np.nan_to_num(feet.forces[:, index])
    here = {
        body: on for body, on in _bodies_on(feet.standing[:, index], feet.sites).items() if on.any()
    }
    where = {body: _place(feet, index, body) for body in here}
    center, torque = _center_of_pressure(step, force, feet.moments[:, index])
    shares = _shares(here, where, center)
    result = {}
    for body in here:
        alone = shares[body] == 1.0
        point = np.where((alone & np.isfinite(center).all(axis=1))[:, None], center, where[body])
        point = np.where(here[body][:, None], point, step.pose.translation)
        result[body] = (force * shares[body][:, None], point, np.where(alone[:, None], torque, 0.0))
    return result


def _place(feet: FeetOnSteps, index: int, body: str) -> Array:
    """(frames, 3) mean place of a body's sites that stand on a step, brought down onto its tread; 0
    where none does.
    """
    members = [site.body == body for site in feet.sites]
    on = feet.standing[:, index, members][..., None]
    mean = np.where(on, feet.places[:, members], 0.0).sum(axis=1) / np.maximum(on.sum(axis=1), 1)
    pose = feet.steps[index].pose
    inside = pose.inverse().apply(mean)
    inside[:, 2] = 0.0
    half = 0.5 * np.array(feet.steps[index].size)
    inside[:, :2] = np.clip(inside[:, :2], -half, half)
    return pose.apply(inside)


def _center_of_pressure(step: Step, force: Array, moment: Array) -> tuple[Array, Array]:
    """Point (frames, 3) in ground, NaN where moments are not measured, and the free torque about
    it.
    """
    rotation = step.pose.rotation
    f = force @ rotation
    m = moment @ rotation
    with np.errstate(divide="ignore", invalid="ignore"):
        local = np.column_stack([-m[:, 1] / f[:, 2], m[:, 0] / f[:, 2], np.zeros(len(f))])
    half = 0.5 * np.array(step.size)
    local[:, :2] = np.where(np.isfinite(local[:, :2]), np.clip(local[:, :2], -half, half), np.nan)
    torque = (m - np.cross(np.nan_to_num(local), f)) @ rotation.T
    center: Array = local @ rotation.T + step.pose.translation
    return center, np.nan_to_num(np.where(np.isfinite(center), torque, 0.0))


def _shares(
    here: dict[str, np.ndarray], where: dict[str, Array], center: Array
) -> dict[str, Array]:
    """Share (frames,) of a step's force that each body has."""
    count = np.sum(list(here.values()), axis=0)
    shares = {
        body: np.where(stands, 1.0 / np.maximum(count, 1), 0.0) for body, stands in here.items()
    }
    for body, other in combinations(here, 2):
        two = here[body] & here[other] & (count == 2) & np.isfinite(center).all(axis=1)
        apart = where[other] - where[body]
        square = (apart**2).sum(axis=1)
        along = np.clip(
            ((center - where[body]) * apart).sum(axis=1) / np.maximum(square, 1e-12), 0.0, 1.0
        )
        along = np.where(square > 1e-12, along, 0.5)
        shares[body], shares[other] = (
            np.where(two, 1.0 - along, shares[body]),
            np.where(two, along, shares[other]),
        )
    return shares


def shared_stairs(feet: FeetOnSteps, leave_out: Collection[str] = ()) -> tuple[SharedWrench, ...]:
    """What the cells measured, for the sites on each step together; unmeasured components stay
    open. Frames in which other sites stand on a step make a wrench of their own, NaN in all others.
    Muscle tensions find the rest within the friction cones of the sites (`ContactTask.measured`).
    `leave_out`: steps whose force is known otherwise.
    """
    results = []
    for index, step in enumerate(feet.steps):
        if step.name in leave_out:
            continue
        frames_of = np.flatnonzero(feet.standing[:, index].any(axis=1)).tolist()
        groups = grouped(
            (tuple(np.flatnonzero(feet.standing[i, index]).tolist()), i) for i in frames_of
        )
        for number, (members, frames) in enumerate(groups.items()):
            forces, moments = np.full((2, len(feet.time), 3), np.nan)
            force = feet.forces[frames, index]
            forces[frames] = force
            # About the ground's origin a moment needs the forces across it.
            arm = np.cross(np.eye(3), step.pose.translation)
            used = np.abs(arm) > 1e-12
            open_ = (used[None] & np.isnan(force)[:, None, :]).any(axis=2)
            moved = feet.moments[frames, index] + np.nan_to_num(force) @ arm.T
            moments[frames] = np.where(open_, np.nan, moved)
            sd = max(float(feet.noise[index]), LEAST_NOISE * feet.weight)
            name = step.name if len(groups) == 1 else f"{step.name}_{number + 1}"
            sites = tuple(feet.sites[i].name for i in members)
            results.append(
                SharedWrench(
                    name=name,
                    sites=sites,
                    forces=forces,
                    moments=moments,
                    force_sd=sd,
                    moment_sd=sd * 0.5 * max(step.size),
                )
            )
    return tuple(results)


@dataclass(frozen=True, eq=False)
class Stairs:
    """Loads of the steps of a recording, and who may stand on them."""

    path: Path
    loads: StepLoads
    paws: tuple[Site, ...]  # contact sites of the model
    recording: Path  # file of the channels
    options: StairOptions
    unmeasured: Unmeasured

    def paws_in(self, model: Model, motion: Motion) -> FeetOnSteps:
        """Who stands where while the model moves."""
        return feet_on_steps(model, motion, self.paws, self.loads, self.options)


def stairs_wrenches(stairs: Stairs, model: Model, motion: Motion) -> Wrenches:
    """Forces on bodies at the cells' times, as far as the motion reaches; what they leave open is
    in their notes.
    """
    time = stairs.loads.time
    inside = (time >= motion.time[0] - 1e-9) & (time <= motion.time[-1] + 1e-9)
    if not inside.any():
        raise BadData(
            f"{stairs.recording}: runs from {time[0]:g} to {time[-1]:g} s, the motion from"
            f" {motion.time[0]:g} to {motion.time[-1]:g} s: they have no time in common"
        )
    at = time[inside]
    columns = [np.interp(at, motion.time, column) for column in motion.values.T]
    moving = Motion(at, motion.names, np.array(columns).T)
    wrenches, notes = stair_wrenches(stairs.paws_in(model, moving), stairs.unmeasured)
    return replace(wrenches, notes=tuple(notes))


def stairs_contacts(paws: FeetOnSteps) -> Contacts:
    """Touches of the paws that stood on a step, as its cell shows."""
    touches = []
    for i, site in enumerate(paws.sites):
        on = paws.standing[:, :, i]
        for number, step in enumerate(paws.steps):
            touches += [
                Touch(
                    site.name,
                    float(paws.time[a]),
                    float(paws.time[b - 1]),
                    source=f"step {step.name}",
                )
                for a, b in runs(on[:, number])
            ]
    return Contacts(tuple(site.name for site in paws.sites), tuple(touches))
