"""How sites move over the floor: places, speeds against a floor that may be a belt, and where the floor is."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, read_only
from myomorph.model.contacts import Site
from myomorph.model.errors import BadData
from myomorph.model.model import STANDARD_GRAVITY, Model
from myomorph.model.series import Motion, Wrenches
from myomorph.rigid.coordinates import Ints
from myomorph.rigid.kinematics import Poses, forward_kinematics
from myomorph.rigid.tree import Tree, compile_tree

STILL = 0.1  # A site at rest moves slower than this, over the speed sqrt(g height)
RESTS = 0.3  # A group of sites that is never slower than this, over the same speed, does not rest
BELT = 0.15  # Soles that all glide along faster than this, over the same speed, stand on a belt
CLUSTER = 0.25  # Share of samples that the narrowest interval about the floor holds


@read_only
class SiteMotion:
    """Sites over a motion, in ground."""

    time: Array
    up: Array  # (3,) against gravity
    places: Array  # (frames, sites, 3) mean of each site's points [m]
    lowest: Array  # (frames, sites) height of each site's lowest point along `up` [m]
    velocities: Array  # (frames, sites, 3) of `places` [m/s]
    # of the center of mass over the lowest site, median of all frames: the length that thresholds are relative to, so
    # that a mouse and a man are judged alike [m]
    height: float
    carried: Array  # (frames,) vertical force that the center of mass needs, over the weight of the model

    @property
    def pace(self) -> float:
        """Speed that thresholds are relative to: sqrt(g height), whose Froude number is 1 [m/s]."""
        return float(np.sqrt(STANDARD_GRAVITY * self.height))


@read_only
class Floor:
    """What the sites walk on.

    Attributes
    ----------
    height : along up [m]
    velocity : (3,) of a treadmill's belt, zero of the ground [m/s]
    """

    height: float
    velocity: Array


def site_motion(model: Model, motion: Motion, sites: Sequence[Site]) -> SiteMotion:
    """Places and speeds of sites; frames in which the motion is NaN are NaN.
    In a model of several subjects and objects only those count whose the sites are.
    """
    if not np.isfinite(motion.values).all(axis=1).any():
        raise BadData("no frame of the motion is without gaps: contacts cannot be found")
    tree, up = compile_tree(model), model.up
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    owner = np.repeat(np.arange(len(sites)), [len(site.points) for site in sites])
    bodies = np.array([tree.body_index[sites[int(number)].body] for number in owner], np.int64)
    points = poses.points(bodies, np.concatenate([site.points for site in sites]))
    places = np.stack([points[:, owner == index].mean(axis=1) for index in range(len(sites))], axis=1)
    lowest = np.stack([(points[:, owner == index] @ up).min(axis=1) for index in range(len(sites))], axis=1)
    center = center_of(tree, poses, np.isin(tree.roots, tree.roots[bodies])) @ up
    rises = _slope(motion.time, _slope(motion.time, center))
    gravity = float(np.linalg.norm(model.gravity)) or STANDARD_GRAVITY
    height = float(np.nanmedian(center - np.min(lowest, axis=1)))
    return SiteMotion(motion.time, up, places, lowest, _slope(motion.time, places), height, 1.0 + rises / gravity)


def center_of(tree: Tree, poses: Poses, own: NDArray[np.bool_]) -> Array:
    """Center of mass (frames, 3) of some bodies."""
    numbers = np.flatnonzero(own)
    mass = tree.arrays.mass[numbers]
    centers = poses.points(numbers, tree.arrays.mass_center[numbers])
    return np.einsum("b,fbi->fi", mass, centers) / max(float(mass.sum()), 1e-300)


def _slope(time: Array, values: Array) -> Array:
    """First derivative over time by second-order differences, zero with fewer than three frames."""
    if len(time) < 3:
        return np.zeros_like(values)
    return np.gradient(values, time, axis=0)


def floor_under(sites: SiteMotion, height: float | None = None) -> Floor:
    """The floor that sites rest on: where the lowest of them stays while it is slow, and a belt's speed.
    The height is the middle of the narrowest interval that holds a quarter of the lowest sites' heights, so
    that neither a swing, nor a toe that a stiff model foot pushes through the floor, moves it. A belt's velocity is the
    median horizontal one of the lowest sites; below `BELT` sqrt(g height) the floor is at rest.
    `height`: of the floor where it is known, as from plates [m].
    """
    known = np.isfinite(sites.lowest).all(axis=1)
    rows = np.flatnonzero(known)
    if not len(rows):
        return Floor(0.0 if height is None else height, np.zeros(3))
    first = sites.lowest[rows].argmin(axis=1)
    level, velocity = sites.lowest[rows, first], sites.velocities[rows, first]
    rising = velocity @ sites.up
    calm = np.abs(rising) <= max(STILL * sites.pace, float(np.percentile(np.abs(rising), 25.0)))
    near = np.abs(level - cluster(level[calm])) < 0.05 * sites.height
    glide = np.median((velocity - rising[:, None] * sites.up)[calm & near], axis=0)
    if not np.linalg.norm(glide) > BELT * sites.pace:
        glide = np.zeros(3)
    slow = np.linalg.norm(velocity - glide, axis=1) < 2.0 * STILL * sites.pace
    return Floor(cluster(level[slow if slow.any() else calm]) if height is None else height, glide)


def plate_height(model: Model, plates: Wrenches | None) -> float | None:
    """Height of loaded plates' centers of pressure, the median along up; None where there is none [m].
    Points that a force table writes at exactly zero while it is unloaded do not count.
    """
    if plates is None:
        return None
    up = model.up
    pressing = np.nan_to_num(plates.forces @ up)
    heights = plates.points @ up
    firm = np.isfinite(heights) & (pressing > 0.3 * pressing.max(initial=0.0)) & (pressing > 0.0)
    return float(np.median(heights[firm])) if firm.any() else None


def cluster(values: Array) -> float:
    """Median of the values (n,) inside the narrowest interval that holds a share `CLUSTER` of them."""
    ordered = np.sort(values)
    count = max(1, round(CLUSTER * len(ordered)))
    widths = ordered[count - 1 :] - ordered[: len(ordered) - count + 1]
    start = int(np.argmin(widths))
    return float(np.median(ordered[start : start + count]))


def rest_on_floor(
    model: Model, motion: Motion, sites: Sequence[Site], height: float | None = None
) -> tuple[tuple[Site, ...], Floor]:
    """Sites moved along the floor's normal so that each lies on it while its group rests, and that floor.

    How thick a sole is, no model has; shoes and markers' places make some centimetres of it. A group rests in
    the frames in which it is low and its sites, on the mean, are slow against the floor; each site is moved by the
    median of its heights there, or, in a group that never rests, by the mean of the other groups' sites.

    Parameters
    ----------
    model : the body, with the bodies that the sites are on
    motion : coordinates over time
    sites : places that can touch [m]
    height : of the floor where it is known, as from plates; else where the sites rest as they are [m]

    Returns
    -------
    the sites, moved on their bodies [m], and the floor: height [m] and velocity [m/s]

    Raises
    ------
    BadData : no frame of the motion is whole

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> sites = [mm.Site("hand", "fore", [[0.0, -0.3, 0.0]], mm.Cone(direction=model.up))]
    >>> moved, floor = mm.contact.rest_on_floor(model, motion, sites, height=1.1)
    >>> moved[0].name, moved[0].points.shape, floor.height
    ('hand', (1, 3), 1.1)
    """
    tree, moving = compile_tree(model), site_motion(model, motion, sites)
    floor = floor_under(moving, height)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    gap = moving.lowest - floor.height
    speed = np.linalg.norm(moving.velocities - floor.velocity, axis=2)
    rests, shifts = [], np.full(len(sites), np.nan)
    for number, site in enumerate(sites):
        members = [j for j, other in enumerate(sites) if other.group == site.group]
        pace = speed[:, members].mean(axis=1)
        rests.append(_resting(gap[:, members].mean(axis=1), pace, STILL * moving.pace))
        if len(rests[number]) and pace[rests[number]].min() < RESTS * moving.pace:
            shifts[number] = np.median(gap[rests[number], number])
    # A foot that swings throughout has the sole of the one that stands.
    known = np.isfinite(shifts)
    shifts[~known] = shifts[known].mean() if known.any() else 0.0
    moved = []
    for number, site in enumerate(sites):
        rotations = poses.rotations[rests[number], tree.body_index[site.body]]
        down = -np.einsum("fji,j->fi", rotations, moving.up).sum(axis=0)
        size = float(np.linalg.norm(down))
        moved.append(replace(site, points=site.points + shifts[number] * down / size) if size > 0.0 else site)
    return tuple(moved), floor


def _resting(height: Array, speed: Array, still: float) -> Ints:
    """Frames in which a group is among its lowest 40 % and still, or at least the 5 % of those that are slowest."""
    known = np.flatnonzero(np.isfinite(height) & np.isfinite(speed))
    if not len(known):
        return known
    low = known[height[known] <= np.percentile(height[known], 40.0)]
    limit = max(still, float(np.percentile(speed[low], 5.0)))
    return low[speed[low] <= limit]
