"""What plates measure of several sites together: two feet on a plate, a foot on several, fewer
plates than contacts.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.contact.plates import wrenches_from_plates
from myomorph.core.contact.site_motion import SiteMotion, site_motion
from myomorph.core.contact.states import hysteresis, steady
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Contacts, SharedWrench, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.series import ForcePlate, Motion, Series, Wrenches
from myomorph.core.motion.sync import refuse_other_times

# A site that far beside a plate's outline may stand on it, over the height of the center of mass
MARGIN = 0.03
# Where a plate's outline is not known: distance of a site to the center of pressure, over the same
REACH = 0.25
LOADED = 0.02
UNLOADED = 0.01  # Shares of the weight between which a plate begins and ceases to count as loaded
# Of a component of force, over the weight; of a moment, over that times the center of mass' height
DEVIATION = 0.005
SHORTEST = 0.03  # Loadings and gaps that last less are taken for noise [s]


def shared_wrenches(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    contacts: Contacts,
    plates: Sequence[ForcePlate] | Wrenches,
    plate_time: Array | None = None,
    margin: float = MARGIN,
    reach: float = REACH,
) -> tuple[SharedWrench, ...]:
    """The wrench of every loaded plate, for the sites that touch while they are over it.
    Frames in which other sites stand on a plate make a wrench of their own, which is NaN in all
    other frames. Of plates with an outline a site belongs to the one it is over; one within the
    margin of two loaded plates joins these: their sum is known for the sites of both. Of wrenches
    without an outline a site belongs to that which acts on a body of its group, or, where bodies
    are not known, to those whose center of pressure its group is near. `plates`: with outlines, or
    wrenches at the motion's times; `plate_time`: clock of plates with outlines (samples,) [s];
    `margin`, `reach`: see `MARGIN`, `REACH`.
    """
    moving = site_motion(model, motion, sites)
    if isinstance(plates, Wrenches):
        refuse_other_times("forces of plates", plates.time, motion.time)
        wrenches = plates
    elif plate_time is None:
        raise BadData("plates with outlines need their clock: give plate_time")
    else:
        wrenches = wrenches_from_plates(plates, plate_time, motion.time)
    touching = (
        contacts.states(motion.time).values[:, [contacts.sites.index(site.name) for site in sites]]
        > 0.0
    )
    weight = model.weight
    pressing = np.nan_to_num(wrenches.forces @ moving.up)
    state = hysteresis(pressing > LOADED * weight, pressing < UNLOADED * weight)
    loaded = np.stack([steady(column, motion.time, SHORTEST) for column in state.T], axis=1)
    if isinstance(plates, Wrenches):
        near = _beside(model, moving, plates, sites, reach * moving.height)
    else:
        near = _over(moving, [plate.corners for plate in plates], margin * moving.height)
    standing = near & loaded[:, :, None] & touching[:, None]
    deviations = (DEVIATION * weight, DEVIATION * weight * moving.height)
    return _wrenches(_together(standing, loaded), wrenches, sites, deviations)


def _over(moving: SiteMotion, outlines: Sequence[Array], margin: float) -> np.ndarray:
    """Whether a site is over a plate, less than `margin` beside its outline (frames, plates,
    sites).
    """
    results = []
    for corners in outlines:
        inside = np.ones(moving.places.shape[:2], np.bool_)
        middle = corners.mean(axis=0)
        for corner, other in zip(corners, np.roll(corners, -1, axis=0), strict=True):
            normal = np.cross(other - corner, moving.up)
            normal = normal / np.linalg.norm(normal)
            outwards = normal if (corner - middle) @ normal > 0.0 else -normal
            inside &= (moving.places - corner) @ outwards < margin
        results.append(inside)
    return np.stack(results, axis=1)


def _beside(
    model: Model, moving: SiteMotion, wrenches: Wrenches, sites: Sequence[Site], reach: float
) -> np.ndarray:
    """Whether a site may stand on a plate without an outline (frames, plates, sites)."""
    groups = _groups(sites)
    bodies = group_bodies(model, sites)
    near = np.zeros((len(moving.time), len(wrenches.names), len(sites)), np.bool_)
    for plate, body in enumerate(wrenches.bodies):
        distance = moving.beside(np.nan_to_num(wrenches.points[:, plate]))
        for group, members in groups.items():
            if body:
                near[:, plate, members] = body in bodies[group]
            else:
                near[:, plate, members] = (distance[:, members].min(axis=1) < reach)[:, None]
    return near


def _groups(sites: Sequence[Site]) -> dict[str, list[int]]:
    return grouped((site.group, index) for index, site in enumerate(sites))


def group_bodies(model: Model, sites: Sequence[Site]) -> dict[str, set[str]]:
    """Bodies of each group's sites, and those a joint away from them: plates' forces are put on the
    talus too.
    """
    result = {}
    for group, members in _groups(sites).items():
        bodies_of_group = {sites[member].body for member in members}
        near = {joint.parent for joint in model.joints if joint.child in bodies_of_group} | {
            joint.child for joint in model.joints if joint.parent in bodies_of_group
        }
        result[group] = bodies_of_group | near
    return result


def without_measured(
    model: Model, ready: Series, sites: Sequence[Site], measured: Wrenches
) -> Series:
    """The activations of sites, zero while a force that was measured carries their group: it is
    known already. A force counts as carrying between `LOADED` and `UNLOADED` of the weight, so that
    what a filter makes of an unloaded plate does not silence a foot that steps beside it. `ready`:
    activations (frames, sites) at the times of `measured`; `measured`: forces on bodies that act as
    they were measured.
    """
    weight = model.weight
    size = np.linalg.norm(np.nan_to_num(measured.forces), axis=2)
    carrying = hysteresis(size > LOADED * weight, size < UNLOADED * weight)
    values = np.array(ready.values)
    bodies = group_bodies(model, sites)
    for group, members in _groups(sites).items():
        columns = [i for i, body in enumerate(measured.bodies) if body in bodies[group]]
        values[np.ix_(carrying[:, columns].any(axis=1), np.array(members))] = 0.0
    return replace(ready, values=values)


def _together(
    standing: np.ndarray, loaded: np.ndarray
) -> dict[tuple[tuple[int, ...], tuple[int, ...]], list[int]]:
    """Frames in which some plates, taken together, carry some sites: ((plates), (sites)) to frames."""
    together: list[tuple[tuple[tuple[int, ...], tuple[int, ...]], int]] = []
    for frame in range(len(standing)):
        parts: list[tuple[set[int], set[int]]] = []
        for plate in np.flatnonzero(loaded[frame]):
            plates = {int(plate)}
            members = set(np.flatnonzero(standing[frame, plate]).tolist())
            apart = []
            for others, taken in parts:
                if taken & members:
                    plates = plates | others
                    members = members | taken
                else:
                    apart.append((others, taken))
            parts = [*apart, (plates, members)]
        together += [
            ((tuple(sorted(plates)), tuple(sorted(members))), frame)
            for plates, members in parts
            if members
        ]
    return grouped(together)


def _wrenches(
    by_members: dict[tuple[tuple[int, ...], tuple[int, ...]], list[int]],
    wrenches: Wrenches,
    sites: Sequence[Site],
    deviations: tuple[float, float],
) -> tuple[SharedWrench, ...]:
    forces = np.nan_to_num(wrenches.forces)
    moments = np.nan_to_num(wrenches.torques) + np.cross(np.nan_to_num(wrenches.points), forces)
    shared = []
    counts: dict[str, int] = {}
    for (plates, members), frames in by_members.items():
        name = " + ".join(wrenches.names[plate] for plate in plates)
        counts[name] = counts.get(name, 0) + 1
        force, moment = (np.full((len(forces), 3), np.nan) for _ in range(2))
        force[frames] = forces[frames][:, list(plates)].sum(axis=1)
        moment[frames] = moments[frames][:, list(plates)].sum(axis=1)
        label = name if counts[name] == 1 else f"{name} ({counts[name]})"
        on_it = tuple(sites[member].name for member in members)
        shared.append(SharedWrench(label, on_it, force, moment, *deviations))
    return tuple(shared)


def misplaced_forces(
    model: Model, motion: Motion, sites: Sequence[Site], wrenches: Wrenches
) -> tuple[str, ...]:
    """Forces that a file puts on one foot while their center of pressure is under another, one line
    each. A force counts as misplaced where the mean distance of its center of pressure to the soles
    of its own foot, weighted by the force, is more than twice that to another foot. `wrenches`: at
    the motion's times, with the bodies that the file names.
    """
    places = site_motion(model, motion, sites).places
    bodies = group_bodies(model, sites)
    members = _groups(sites)
    notes = []
    for index, (name, body) in enumerate(zip(wrenches.names, wrenches.bodies, strict=True)):
        size = np.linalg.norm(np.nan_to_num(wrenches.forces[:, index]), axis=1)
        size = np.where(
            np.isfinite(wrenches.points[:, index]).all(axis=1)
            & (size > 0.1 * size.max(initial=0.0)),
            size,
            0.0,
        )
        own = [group for group in members if body in bodies[group]]
        if not own or not size.any():
            continue
        apart = np.linalg.norm(places - np.nan_to_num(wrenches.points[:, index, None]), axis=2)
        mean = {
            group: float(np.average(apart[:, member].min(axis=1), weights=size))
            for group, member in members.items()
        }
        nearest = min(mean, key=lambda group: mean[group])
        if nearest not in own and 2.0 * mean[nearest] < min(mean[group] for group in own):
            notes.append(
                f"force '{name}' is put on '{body}', but its center of pressure lies"
                f" {mean[nearest]:.2f} m from '{nearest}' and {mean[own[0]]:.2f} m from '{own[0]}':"
                " does it act on another foot?"
            )
    return tuple(notes)
