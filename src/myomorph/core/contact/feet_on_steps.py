"""Feet on steps: forces of stairs on the bodies of a model."""

from __future__ import annotations

from collections.abc import Collection, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path
from typing import Literal, NamedTuple

import numpy as np

from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.stairs import StairOptions, Step, StepLoads
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.causes import FEET_BESIDE, PLATES
from myomorph.core.model.contacts import Contacts, SharedWrench, Site, Touch
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Wrenches

Unmeasured = Literal["unknown", "zero"]
MIN_NOISE = 1e-4
"""Standard deviation of a measured component that has no noise at all, over body weight."""


@read_only
class FeetOnSteps:
    """Loads of the steps at the times of a motion, and the sites that stand on each.

    Attributes
    ----------
    forces, moments : (frames, steps, 3) in ground, moments about the tread's middle [N], [N m]; NaN
        where not measured
    loaded : (frames, steps)
    standing : (frames, steps, sites) whether a site is on a step while it is loaded
    places : (frames, sites, 3) of the sites [m]
    noise : (steps,) standard deviation of the normal force [N]
    weight : of the body [N]
    height : of its center of mass over its lowest site [m]
    notes : loadings that nobody stands on and steps that carry several bodies, one line each
    """

    time: Array
    steps: tuple[Step, ...]
    sites: tuple[Site, ...]
    forces: Array
    moments: Array
    loaded: np.ndarray
    standing: np.ndarray
    places: Array
    noise: Array
    weight: float
    height: float
    notes: tuple[Message, ...] = ()


class BodyForce(NamedTuple):
    """Force of a step on a body, its point and torque, (frames, 3) each [N], [m], [N m]."""

    force: Array
    point: Array
    torque: Array


def feet_on_steps(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    loads: StepLoads,
    options: StairOptions | None = None,
) -> FeetOnSteps:
    """Give the load of each step to the sites that stand on it.

    A site is on the step that it is nearest to, within reach, and stands there while it is slow.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    sites : of feet that may stand on steps
    loads : of the steps, on their own clock
    options : thresholds

    Raises
    ------
    BadData : no site
    """
    options = options or StairOptions()
    if not sites:
        raise BadData("no foot is specified that might stand on a step")
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
    forces = _while_loaded(loads, loads.forces, motion.time, loaded)
    moments = _while_loaded(loads, loads.moments, motion.time, loaded)
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


def _while_loaded(loads: StepLoads, measured: Array, time: Array, loaded: np.ndarray) -> Array:
    """Components at the times of a motion, 0 while unloaded, NaN where not measured.

    Parameters
    ----------
    measured : (samples, steps, 3) on the clock of `loads`
    time, loaded : (frames,) [s] and (frames, steps)

    Returns
    -------
    (frames, steps, 3)
    """
    values = np.where(loaded[:, :, None], _interpolated(loads.time, measured, time), 0.0)
    values[:, np.isnan(measured).all(axis=0)] = np.nan
    return values


def _throughout(standing: np.ndarray, loaded: np.ndarray) -> np.ndarray:
    """Fill who stands on each step through the whole of a loading.

    Frames with nobody take those of the nearest with one.

    Parameters
    ----------
    standing : (frames, steps, sites)
    loaded : (frames, steps)

    Returns
    -------
    (frames, steps, sites)
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
    """Distance of places to the rectangle of a tread.

    Parameters
    ----------
    places : (frames, sites, 3) [m]

    Returns
    -------
    (frames, sites) [m]
    """
    inside = step.pose.inverse().apply(places)
    half = 0.5 * np.array([*step.size, 0.0])
    return np.linalg.norm(np.maximum(np.abs(inside) - half, 0.0), axis=-1)


def _interpolated(time: Array, values: Array, at: Array) -> Array:
    """Interpolate values (samples, ...) at other times, 0 outside of the recording.

    Parameters
    ----------
    time, at : (samples,) and (frames,) [s]

    Returns
    -------
    (frames, ...)
    """
    flat = values.reshape(len(time), -1)
    columns = [np.interp(at, time, np.nan_to_num(column), left=0.0, right=0.0) for column in flat.T]
    return np.stack(columns, axis=1).reshape(len(at), *values.shape[1:])


def _warnings(
    time: Array,
    steps: Sequence[Step],
    sites: Sequence[Site],
    loaded: np.ndarray,
    standing: np.ndarray,
) -> list[Message]:
    """Say where nobody stands on a loaded step, and where several bodies do.

    Parameters
    ----------
    time : (frames,) [s]
    loaded, standing : (frames, steps) and (frames, steps, sites)
    """
    result = []
    step_time = float(np.median(np.diff(time))) if len(time) > 1 else 0.0
    for number, step in enumerate(steps):
        stands = _bodies_on(standing[:, number], sites)
        bodies = np.stack(list(stands.values()), axis=1)
        alone = loaded[:, number] & ~bodies.any(axis=1)
        if alone.any():
            result.append(
                FEET_BESIDE.message(
                    f"step '{step.name}' is loaded for {alone.sum() * step_time:.3g} s, first at"
                    f" {time[alone][0]:.3f} s, with no foot near it: its force is on nobody",
                    place=step.name,
                )
            )
        several = bodies.sum(axis=1) > 1
        if several.any():
            who = [body for body, stood in stands.items() if stood[several].any()]
            result.append(
                FEET_BESIDE.message(
                    f"step '{step.name}' carries {' and '.join(who)} together for"
                    f" {several.sum() * step_time:.3g} s: its force is shared",
                    place=step.name,
                    severity="may change results",
                )
            )
    return result


def _bodies_on(standing: np.ndarray, sites: Sequence[Site]) -> dict[str, np.ndarray]:
    """Flag when each body stands on a step, by which of its sites (frames, sites) do.

    Returns
    -------
    (frames,) by body
    """
    bodies = dict.fromkeys(site.body for site in sites)
    return {
        body: np.asarray(standing[:, [site.body == body for site in sites]].any(axis=1))
        for body in bodies
    }


def stair_wrenches(
    feet: FeetOnSteps, unmeasured: Unmeasured = "unknown"
) -> tuple[Wrenches, tuple[Message, ...]]:
    """External forces on bodies, for inverse dynamics, and what they leave open.

    A force acts at the center of pressure where the cell measures moments, else where the foot is.
    Two bodies on a step share its force so that the center of pressure is kept, or evenly where it
    is not known.

    Parameters
    ----------
    feet : on the steps
    unmeasured : "zero" takes components that a cell does not measure for zero; with "unknown" such
        a step has no force here: `shared_stairs` passes what is measured on to muscle tensions

    Returns
    -------
    wrenches named `step_body`, and notes
    """
    notes = list(feet.notes)
    columns: dict[tuple[str, str], BodyForce] = {}
    for number, step in enumerate(feet.steps):
        missing = [
            axis for i, axis in enumerate("xyz") if np.isnan(feet.forces[:, number, i]).all()
        ]
        if missing and unmeasured == "unknown":
            notes.append(
                FEET_BESIDE.message(
                    f"step '{step.name}' does not measure force along {', '.join(missing)}: inverse"
                    " dynamics goes without it; tensions with shared contacts take the rest",
                    place=step.name,
                    severity="may change results",
                )
            )
            continue
        if missing:
            notes.append(
                PLATES.message(
                    f"step '{step.name}' does not measure force along {', '.join(missing)}: taken"
                    " for zero",
                    place=step.name,
                )
            )
        columns |= {(step.name, body): part for body, part in _parts(feet, number).items()}
    parts = list(columns.values())
    nothing = np.zeros((len(feet.time), 0, 3))
    wrenches = Wrenches(
        time=feet.time,
        names=tuple(f"{step}_{body}" for step, body in columns),
        bodies=tuple(body for _, body in columns),
        forces=np.concatenate([nothing, *(part.force[:, None] for part in parts)], axis=1),
        points=np.concatenate([nothing, *(part.point[:, None] for part in parts)], axis=1),
        torques=np.concatenate([nothing, *(part.torque[:, None] for part in parts)], axis=1),
    )
    return wrenches, tuple(notes)


def _parts(feet: FeetOnSteps, index: int) -> dict[str, BodyForce]:
    """Force of a step on each body that stands on it."""
    step = feet.steps[index]
    force = np.nan_to_num(feet.forces[:, index])
    standing = _bodies_on(feet.standing[:, index], feet.sites)
    here = {body: stands for body, stands in standing.items() if stands.any()}
    where = {body: _place(feet, index, body) for body in here}
    center, torque = _center_of_pressure(step, force, feet.moments[:, index])
    shares = _shares(here, where, center)
    result = {}
    for body in here:
        alone = shares[body] == 1.0
        point = np.where((alone & np.isfinite(center).all(axis=1))[:, None], center, where[body])
        result[body] = BodyForce(
            force=force * shares[body][:, None],
            point=np.where(here[body][:, None], point, step.pose.translation),
            torque=np.where(alone[:, None], torque, 0.0),
        )
    return result


def _place(feet: FeetOnSteps, index: int, body: str) -> Array:
    """Mean place of a body's sites that stand on a step, brought down onto its tread.

    Returns
    -------
    (frames, 3) in ground [m], 0 where none does
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
    """Center of pressure in ground, NaN where moments are not measured, and the torque about it.

    Parameters
    ----------
    force, moment : (frames, 3) about the tread's middle [N], [N m]

    Returns
    -------
    (frames, 3) [m] and (frames, 3) [N m]
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
    """Share of a step's force that each body has.

    Parameters
    ----------
    here : (frames,) when each body stands on it
    where : (frames, 3) where [m]
    center : (frames, 3) of pressure, NaN where unknown [m]

    Returns
    -------
    (frames,) by body
    """
    count = np.sum(list(here.values()), axis=0)
    shares = {
        body: np.where(stands, 1.0 / np.maximum(count, 1), 0.0) for body, stands in here.items()
    }
    for body, other in combinations(here, 2):
        two = here[body] & here[other] & (count == 2) & np.isfinite(center).all(axis=1)
        line = where[other] - where[body]
        square = (line**2).sum(axis=1)
        projection = ((center - where[body]) * line).sum(axis=1)
        along = np.clip(projection / np.maximum(square, 1e-12), 0.0, 1.0)
        along = np.where(square > 1e-12, along, 0.5)
        shares[body] = np.where(two, 1.0 - along, shares[body])
        shares[other] = np.where(two, along, shares[other])
    return shares


def shared_stairs(feet: FeetOnSteps, leave_out: Collection[str] = ()) -> tuple[SharedWrench, ...]:
    """Measurements of the cells, for the sites on each step together.

    Unmeasured components stay open. Frames in which other sites stand on a step make a wrench of
    their own, NaN in all others. Muscle tensions find the rest within the friction cones of the
    sites (`ContactTask.measured`).

    Parameters
    ----------
    feet : on the steps
    leave_out : steps whose force is known otherwise
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
            name = step.name if len(groups) == 1 else f"{step.name}_{number + 1}"
            results.append(_shared_wrench(feet, index, name, members, frames))
    return tuple(results)


def _shared_wrench(
    feet: FeetOnSteps, index: int, name: str, members: Sequence[int], frames: list[int]
) -> SharedWrench:
    """Measurements of one step in the frames in which some sites stand on it."""
    step = feet.steps[index]
    force = feet.forces[frames, index]
    # About the ground's origin a moment needs the forces across it.
    arm = np.cross(np.eye(3), step.pose.translation)
    used = np.abs(arm) > 1e-12
    unknown = (used[None] & np.isnan(force)[:, None, :]).any(axis=2)
    moment = feet.moments[frames, index] + np.nan_to_num(force) @ arm.T
    forces = np.full((len(feet.time), 3), np.nan)
    moments = np.full((len(feet.time), 3), np.nan)
    forces[frames] = force
    moments[frames] = np.where(unknown, np.nan, moment)
    sd = max(float(feet.noise[index]), MIN_NOISE * feet.weight)
    return SharedWrench(
        name=name,
        sites=tuple(feet.sites[i].name for i in members),
        forces=forces,
        moments=moments,
        force_sd=sd,
        moment_sd=sd * 0.5 * max(step.size),
    )


@dataclass(frozen=True, eq=False)
class Stairs:
    """Loads of the steps of a recording, and who may stand on them.

    Attributes
    ----------
    paws : contact sites of the model
    recording : file of the channels
    """

    path: Path
    loads: StepLoads
    paws: tuple[Site, ...]
    recording: Path
    options: StairOptions
    unmeasured: Unmeasured

    def paws_in(self, model: Model, motion: Motion) -> FeetOnSteps:
        """Find which paw stands on which step while the model moves.

        Parameters
        ----------
        model : with the paws
        motion : coordinates (frames, coordinates) [rad or m] at the cells' times
        """
        return feet_on_steps(model, motion, self.paws, self.loads, self.options)


def stairs_wrenches(stairs: Stairs, model: Model, motion: Motion) -> Wrenches:
    """Make forces on bodies at the cells' times, as far as the motion reaches.

    Parameters
    ----------
    stairs : cells and paws
    model : with the paws
    motion : coordinates (frames, coordinates) [rad or m], NaN in gaps

    Returns
    -------
    forces (frames, bodies, 3) [N]; what they leave open is in their notes

    Raises
    ------
    BadData : the recording and the motion have no time in common
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
    """Make contact intervals of the paws that stood on a step, as its cell shows.

    Parameters
    ----------
    paws : which stood on which step, by frame

    Returns
    -------
    intervals of each paw [s], their source the step
    """
    touches = []
    for i, site in enumerate(paws.sites):
        on = paws.standing[:, :, i]
        for number, step in enumerate(paws.steps):
            touches += [
                Touch(
                    site=site.name,
                    start=float(paws.time[first]),
                    stop=float(paws.time[after - 1]),
                    source=f"step {step.name}",
                )
                for first, after in runs(on[:, number])
            ]
    return Contacts(tuple(site.name for site in paws.sites), tuple(touches))
