"""Forces that plates measure of several sites together, as of two feet on one plate."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.plate_forces import PlateForces, over_outline
from myomorph.core.contact.site_motion import SiteMotion, site_motion
from myomorph.core.contact.spells import hysteresis, steady
from myomorph.core.model.causes import PLATES
from myomorph.core.model.contacts import Contacts, SharedWrench, Site
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.sync import refuse_other_times

MARGIN = 0.03
"""A site within this distance of a plate's outline may stand on it, over the height of the center
of mass.
"""
REACH = 0.25
"""Distance of a site to the center of pressure of a plate without outline, over the same."""
LOADED = 0.02
UNLOADED = 0.01
"""Shares of the weight between which a plate begins and ceases to count as loaded."""
DEVIATION = 0.005
"""Standard deviation of a component of force, over the weight; of a moment, over that times the
height of the center of mass.
"""
SHORTEST = 0.03
"""Loadings and gaps that last less are taken for noise [s]."""
UNMEASURED = 0.1
"""Where plates measure all but so much of what carries the body, over the weight, nothing that
touches stands beside them.
"""


class Together(NamedTuple):
    """Plates that carry some sites together.

    Attributes
    ----------
    plates, sites : their numbers, ascending
    """

    plates: tuple[int, ...]
    sites: tuple[int, ...]


def shared_wrenches(  # page: the measurements, and two limits
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    contacts: Contacts,
    plates: PlateForces,
    margin: float = MARGIN,
    reach: float = REACH,
) -> tuple[SharedWrench, ...]:
    """Find the wrench of every loaded plate, for the sites that touch while they are over it.

    Sites against another body, as hands that hold a box, stand on no plate. Frames in which other
    sites stand on a plate make a wrench of their own, which is NaN in all other frames.

    Of plates with an outline a site belongs to the one it is over; one within the margin of two
    loaded plates joins these: their sum is known for the sites of both. Of plates without an
    outline a site belongs to that which acts on a body of its group, or, where bodies are not
    known, to those whose center of pressure its group is near. While plates without an outline
    carry the whole body, a foot that touches and has none of them stands on the one that is
    nearest: a file may put on one foot what two feet press on. A plate with an outline whose body
    somebody named carries the sites of this body's group alone.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    sites : that may stand on plates
    contacts : when sites touch
    plates : what they measured, at the motion's times
    margin, reach : see `MARGIN`, `REACH`

    Returns
    -------
    one per group of plates and the sites on them

    Raises
    ------
    BadData : forces of other times
    """
    wrenches = plates.wrenches
    refuse_other_times("forces of plates", wrenches.time, motion.time)
    moving = site_motion(model, motion, sites)
    columns = [contacts.sites.index(site.name) for site in sites]
    touching = contacts.states(motion.time).values[:, columns] > 0.0
    touching &= np.array([site.against == GROUND for site in sites], np.bool_)
    weight = model.weight
    pressing = np.nan_to_num(wrenches.forces @ moving.up)
    state = hysteresis(pressing > LOADED * weight, pressing < UNLOADED * weight)
    loaded = np.stack([steady(column, motion.time, SHORTEST) for column in state.T], axis=1)
    outlines = [plates.trusted_outline(plate, moving.up) for plate in range(len(wrenches.names))]
    near = _beside(model, moving, wrenches, sites, reach * moving.height)
    own = _of_named_bodies(model, wrenches, sites)
    for plate, corners in enumerate(outlines):
        if corners is not None:
            over = over_outline(moving.places, corners, moving.up, margin * moving.height)
            near[:, plate] = over & own[plate]
    standing = near & loaded[:, :, None] & touching[:, None]
    bare = np.array([corners is None for corners in outlines], np.bool_)
    if bare.any():
        whole = pressing[:, bare].sum(axis=1) > (moving.carried - UNMEASURED) * weight
        alone = touching & steady(whole, motion.time, SHORTEST)[:, None] & ~standing.any(axis=1)
        alone &= _are_soles(model, sites)
        standing |= alone[:, None] & _nearest(moving, wrenches, sites, loaded & bare)
    sd = DEVIATION * weight
    return _wrenches(_together(standing, loaded), wrenches, sites, sd, sd * moving.height)


def _of_named_bodies(model: Model, wrenches: Wrenches, sites: Sequence[Site]) -> NDArray[np.bool_]:
    """Return whether a plate's named body is of a site's group; every site where nobody named one.

    Parameters
    ----------
    wrenches : of the plates

    Returns
    -------
    (plates, sites)
    """
    bodies = group_bodies(model, sites)
    return np.array(
        [[not body or body in bodies[site.group] for site in sites] for body in wrenches.bodies],
        np.bool_,
    ).reshape(len(wrenches.bodies), len(sites))


def _beside(
    model: Model, moving: SiteMotion, wrenches: Wrenches, sites: Sequence[Site], reach: float
) -> np.ndarray:
    """Return whether a site may stand on a plate without an outline.

    Parameters
    ----------
    wrenches : of the plates, at the motion's times
    reach : distance to the center of pressure, at most [m]

    Returns
    -------
    (frames, plates, sites)
    """
    groups = _groups(sites)
    bodies = group_bodies(model, sites)
    near = np.zeros((len(moving.time), len(wrenches.names), len(sites)), np.bool_)
    for plate, body in enumerate(wrenches.bodies):
        distance = moving.distances_to(np.nan_to_num(wrenches.points[:, plate]))
        for group, members in groups.items():
            if body:
                near[:, plate, members] = body in bodies[group]
            else:
                near[:, plate, members] = (distance[:, members].min(axis=1) < reach)[:, None]
    return near


def _are_soles(model: Model, sites: Sequence[Site]) -> NDArray[np.bool_]:
    """Return whether sites are of feet."""
    heels = set(feet_of(model))
    feet = {site.group for site in sites if site.body in heels}
    return np.array([site.group in feet for site in sites], np.bool_)


def _nearest(
    moving: SiteMotion, wrenches: Wrenches, sites: Sequence[Site], loaded: NDArray[np.bool_]
) -> NDArray[np.bool_]:
    """Return whether a plate's center of pressure is the nearest one to a site's group.

    Parameters
    ----------
    wrenches : of the plates, at the motion's times
    loaded : (frames, plates) whether a plate carries something; only these count

    Returns
    -------
    (frames, plates, sites), nothing where no plate is loaded
    """
    distances = np.stack(
        [
            moving.distances_to(np.nan_to_num(wrenches.points[:, plate]))
            for plate in range(len(wrenches.names))
        ],
        axis=1,
    )
    for members in _groups(sites).values():
        distances[:, :, members] = distances[:, :, members].min(axis=2, keepdims=True)
    distances = np.where(loaded[:, :, None], distances, np.inf)
    nearest = distances == distances.min(axis=1, keepdims=True)
    return np.asarray(nearest & np.isfinite(distances))


def _groups(sites: Sequence[Site]) -> dict[str, list[int]]:
    """Numbers of the sites of each group."""
    return grouped((site.group, index) for index, site in enumerate(sites))


def group_bodies(model: Model, sites: Sequence[Site]) -> dict[str, set[str]]:
    """Find the bodies of each group's sites, and those a joint away from them.

    Plates' forces are put on the talus too.

    Parameters
    ----------
    model : with the bodies
    sites : of contact

    Returns
    -------
    names of bodies by group
    """
    result = {}
    for group, members in _groups(sites).items():
        bodies = {sites[member].body for member in members}
        parents = {joint.parent for joint in model.joints if joint.child in bodies}
        children = {joint.child for joint in model.joints if joint.parent in bodies}
        result[group] = bodies | parents | children
    return result


def without_measured(
    model: Model, ready: Series, sites: Sequence[Site], measured: Wrenches
) -> Series:
    """Set activations of sites to zero while a force that was measured carries their group.

    It is known already. A force counts as carrying between `LOADED` and `UNLOADED` of the weight,
    so that what a filter makes of an unloaded plate does not silence a foot that steps next to it.

    Parameters
    ----------
    model : of the body
    ready : activations (frames, sites) at the times of `measured`
    sites : one per column
    measured : forces on bodies that act as they were measured
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


def _together(standing: np.ndarray, loaded: np.ndarray) -> dict[Together, list[int]]:
    """Frames in which some plates, taken together, carry some sites.

    Parameters
    ----------
    standing : (frames, plates, sites)
    loaded : (frames, plates)
    """
    pairs = [
        (together, frame)
        for frame in range(len(standing))
        for together in _together_in(standing[frame], loaded[frame])
    ]
    return grouped(pairs)


def _together_in(standing: np.ndarray, loaded: np.ndarray) -> list[Together]:
    """Plates that share sites in one frame; `standing` (plates, sites), `loaded` (plates,)."""
    parts: list[tuple[set[int], set[int]]] = []
    for plate in np.flatnonzero(loaded):
        plates = {int(plate)}
        members = set(np.flatnonzero(standing[plate]).tolist())
        separate = []
        for others, taken in parts:
            if taken & members:
                plates = plates | others
                members = members | taken
            else:
                separate.append((others, taken))
        parts = [*separate, (plates, members)]
    return [
        Together(plates=tuple(sorted(plates)), sites=tuple(sorted(members)))
        for plates, members in parts
        if members
    ]


def _wrenches(
    by_members: dict[Together, list[int]],
    wrenches: Wrenches,
    sites: Sequence[Site],
    force_sd: float,
    moment_sd: float,
) -> tuple[SharedWrench, ...]:
    """Sum of the wrenches of plates taken together, NaN in other frames."""
    forces = np.nan_to_num(wrenches.forces)
    moments = np.nan_to_num(wrenches.torques) + np.cross(np.nan_to_num(wrenches.points), forces)
    shared = []
    counts: dict[str, int] = {}
    for together, frames in by_members.items():
        plates = list(together.plates)
        name = " + ".join(wrenches.names[plate] for plate in plates)
        counts[name] = counts.get(name, 0) + 1
        force = np.full((len(forces), 3), np.nan)
        moment = np.full((len(forces), 3), np.nan)
        force[frames] = forces[frames][:, plates].sum(axis=1)
        moment[frames] = moments[frames][:, plates].sum(axis=1)
        shared.append(
            SharedWrench(
                name=name if counts[name] == 1 else f"{name} ({counts[name]})",
                sites=tuple(sites[member].name for member in together.sites),
                forces=force,
                moments=moment,
                force_sd=force_sd,
                moment_sd=moment_sd,
            )
        )
    return tuple(shared)


def misplaced_forces(
    model: Model, motion: Motion, sites: Sequence[Site], wrenches: Wrenches
) -> tuple[Message, ...]:
    """Warn of forces that a file puts on one foot while their center of pressure is under another.

    A force counts as misplaced where the mean distance of its center of pressure to the soles of
    its own foot, weighted by the force, is more than twice that to another foot.

    Parameters
    ----------
    model : of the body
    motion : coordinates over time
    sites : of the soles
    wrenches : at the motion's times, with the bodies that the file names
    """
    places = site_motion(model, motion, sites).places
    bodies = group_bodies(model, sites)
    members = _groups(sites)
    notes = []
    for index, (name, body) in enumerate(zip(wrenches.names, wrenches.bodies, strict=True)):
        points = wrenches.points[:, index]
        size = np.linalg.norm(np.nan_to_num(wrenches.forces[:, index]), axis=1)
        firm = np.isfinite(points).all(axis=1) & (size > 0.1 * size.max(initial=0.0))
        size = np.where(firm, size, 0.0)
        own_groups = [group for group in members if body in bodies[group]]
        if not own_groups or not size.any():
            continue
        distances = np.linalg.norm(places - np.nan_to_num(points[:, None]), axis=2)
        mean = {
            group: float(np.average(distances[:, member].min(axis=1), weights=size))
            for group, member in members.items()
        }
        nearest = min(mean, key=lambda group: mean[group])
        own = own_groups[0]
        own_distance = min(mean[group] for group in own_groups)
        if nearest not in own_groups and 2.0 * mean[nearest] < own_distance:
            notes.append(
                PLATES.message(
                    f"force '{name}' is put on '{body}', but its center of pressure lies"
                    f" {mean[nearest]:.2f} m from '{nearest}' and {mean[own]:.2f} m from '{own}':"
                    " does it act on the other foot?",
                    place=name,
                )
            )
    return tuple(notes)
