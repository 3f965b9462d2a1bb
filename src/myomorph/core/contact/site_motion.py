"""Motion of sites over the floor: positions, speeds against a floor that may be a belt, the floor.

A body that only inertial sensors see is where its feet say: the lowest is on a level floor and does
not slide,

    minimise  int sum_i w_i |v + s_i'|^2 + |v''|^2 / (2 pi f)^4  dt

over the root's velocity v; s_i are places of the soles' corners against the root. Weights w_i fade
with a corner's height over the floor and its speed against it. Heights of corners, less those of
the default pose, keep the path on the floor, slowly: soles and joints are not known so well that a
step from foot to foot would be level.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.contact.sites import foot_sites
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import STANDARD_GRAVITY, Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.coordinates import Ints
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import Tree, compile_tree

STILL = 0.1
"""A site at rest moves slower than this, over the speed sqrt(g height)."""
RESTS = 0.3
"""A group of sites that is never slower than this, over the same speed, does not rest."""
BELT = 0.15
"""Soles that all glide along faster than this, over the same speed, stand on a belt."""
CLUSTER = 0.25
"""Share of samples that the narrowest interval about the floor holds."""


JOINED = 0.35
"""Frequency below which velocities by feet say more, above which accelerations do: the ratio of
their errors [Hz].
"""
CUTOFF = 5.0
DRIFT = 0.3
"""Half power of the low-pass of the velocity that feet on the ground give the root, and of what
heights correct [Hz].
"""
HIGH = 0.05
FAST = 0.1
"""Height over the lowest corner, over the height of the center of mass, and speed over that of
Froude number 1, at which a corner's weight is 1/e.
"""
BARELY = 1e-4
TRIFLE = 1e-9
"""Weight of the lowest corner however fast it is, and of rest, so that the path is determined in
every frame.
"""
LOWER = 0.005
"""A corner of a sole must be lower than the one that stands by so much to take over, while frames
arrive [m].
"""
ROUNDS = 4
"""How often weights follow from the path and the path from weights."""


@read_only
class SiteMotion:
    """Sites over a motion, in ground.

    Attributes
    ----------
    time : (frames,) [s]
    up : (3,) against gravity
    places : (frames, sites, 3) mean of each site's points [m]
    lowest : (frames, sites) height of each site's lowest point along `up` [m]
    velocities : (frames, sites, 3) of `places` [m/s]
    height : of the center of mass over the lowest site, median of all frames: the length that
        thresholds are relative to, so that a mouse and a man are judged alike [m]
    carried : (frames,) vertical force that the center of mass needs, over the weight of the model
    """

    time: Array
    up: Array
    places: Array
    lowest: Array
    velocities: Array
    height: float
    carried: Array

    @property
    def pace(self) -> float:
        """Speed that thresholds are relative to: sqrt(g height), of Froude number 1 [m/s]."""
        return float(np.sqrt(STANDARD_GRAVITY * self.height))

    def distances_to(self, points: Array) -> Array:
        """Horizontal distance of each site to points, as centers of pressure.

        Parameters
        ----------
        points : (frames, 3) [m]

        Returns
        -------
        (frames, sites) [m]
        """
        offset = self.places - points[:, None]
        return np.linalg.norm(offset - (offset @ self.up)[..., None] * self.up, axis=2)

    def over(self, raised: Array | None) -> SiteMotion:
        """Take heights over what the sites stand on.

        Parameters
        ----------
        raised : (frames, sites) height of that above the floor [m], None for the floor throughout

        Returns
        -------
        the same motion of as many frames
        """
        return self if raised is None else replace(self, lowest=self.lowest - raised)


@read_only
class Floor:
    """The ground that the sites walk on.

    Attributes
    ----------
    height : along up [m]
    velocity : (3,) of a treadmill's belt, zero of the ground [m/s]
    """

    height: float
    velocity: Array


def site_motion(model: Model, motion: Motion, sites: Sequence[Site]) -> SiteMotion:
    """Compute positions and speeds of sites; frames in which the motion is NaN are NaN.

    In a model of several subjects and objects only those count whose the sites are.

    Parameters
    ----------
    model : with the sites' bodies
    motion : coordinates (frames, coordinates) [rad or m], NaN in gaps
    sites : of contact

    Returns
    -------
    over the frames of the motion

    Raises
    ------
    BadData : no frame of the motion is whole
    """
    if not np.isfinite(motion.values).all(axis=1).any():
        raise BadData("no frame of the motion is without gaps: contacts cannot be found")
    tree = compile_tree(model)
    up = model.up
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    site_of = np.repeat(np.arange(len(sites)), [len(site.points) for site in sites])
    bodies = np.array([tree.body_index[sites[int(number)].body] for number in site_of], np.int64)
    points = poses.points(bodies, np.concatenate([site.points for site in sites]))
    of_sites = [points[:, site_of == number] for number in range(len(sites))]
    places = np.stack([corners.mean(axis=1) for corners in of_sites], axis=1)
    lowest = np.stack([(corners @ up).min(axis=1) for corners in of_sites], axis=1)

    center = center_of(tree, poses, np.isin(tree.roots, tree.roots[bodies])) @ up
    rises = _slope(motion.time, _slope(motion.time, center))
    gravity = float(np.linalg.norm(model.gravity)) or STANDARD_GRAVITY
    return SiteMotion(
        time=motion.time,
        up=up,
        places=places,
        lowest=lowest,
        velocities=_slope(motion.time, places),
        height=float(np.nanmedian(center - np.min(lowest, axis=1))),
        carried=1.0 + rises / gravity,
    )


def center_of(tree: Tree, poses: Poses, chosen: NDArray[np.bool_]) -> Array:
    """Center of mass of some bodies.

    Parameters
    ----------
    tree : of the model
    poses : of the bodies
    chosen : (bodies,)

    Returns
    -------
    (frames, 3) [m]
    """
    numbers = np.flatnonzero(chosen)
    mass = tree.arrays.mass[numbers]
    centers = poses.points(numbers, tree.arrays.mass_center[numbers])
    return np.einsum("b,fbi->fi", mass, centers) / max(float(mass.sum()), 1e-300)


def _slope(time: Array, values: Array) -> Array:
    """Differentiate by second-order differences, zero with fewer than three frames.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, ...)

    Returns
    -------
    (frames, ...)
    """
    if len(time) < 3:
        return np.zeros_like(values)
    return np.gradient(values, time, axis=0)


def floor_under(sites: SiteMotion, height: float | None = None) -> Floor:
    """Find the floor that sites rest on: where the lowest stays while it is slow, or a belt.

    The height is the middle of the narrowest interval that holds a quarter of the lowest sites'
    heights, so that neither a swing, nor a toe that a stiff model foot pushes through the floor,
    moves it. A belt's velocity is the median horizontal one of the lowest sites; below `BELT`
    sqrt(g height) the floor is at rest.

    Parameters
    ----------
    sites : one per column
    height : of the floor where it is known, as from plates [m]
    """
    known = np.isfinite(sites.lowest).all(axis=1)
    rows = np.flatnonzero(known)
    if not len(rows):
        return Floor(0.0 if height is None else height, np.zeros(3))
    first = sites.lowest[rows].argmin(axis=1)
    level = sites.lowest[rows, first]
    velocity = sites.velocities[rows, first]
    rising = velocity @ sites.up
    calm = np.abs(rising) <= max(STILL * sites.pace, float(np.percentile(np.abs(rising), 25.0)))
    near = np.abs(level - cluster(level[calm])) < 0.05 * sites.height
    glide = np.median((velocity - rising[:, None] * sites.up)[calm & near], axis=0)
    if not np.linalg.norm(glide) > BELT * sites.pace:
        glide = np.zeros(3)
    slow = np.linalg.norm(velocity - glide, axis=1) < 2.0 * STILL * sites.pace
    return Floor(cluster(level[slow if slow.any() else calm]) if height is None else height, glide)


def plate_height(model: Model, plates: Wrenches | None) -> float | None:
    """Find the median height of loaded plates' centers of pressure.

    Points that a force table writes at exactly zero while it is unloaded do not count.

    Parameters
    ----------
    model : which states the vertical
    plates : their forces, None where there are none

    Returns
    -------
    [m], None where no plate is loaded
    """
    if plates is None:
        return None
    up = model.up
    pressing = np.nan_to_num(plates.forces @ up)
    heights = plates.points @ up
    firm = np.isfinite(heights) & (pressing > 0.3 * pressing.max(initial=0.0)) & (pressing > 0.0)
    return float(np.median(heights[firm])) if firm.any() else None


def cluster(values: Array) -> float:
    """Median of the values inside the narrowest interval that holds a share `CLUSTER` of them.

    Parameters
    ----------
    values : (n,)

    Returns
    -------
    in the unit of the values
    """
    ordered = np.sort(values)
    count = max(1, round(CLUSTER * len(ordered)))
    widths = ordered[count - 1 :] - ordered[: len(ordered) - count + 1]
    start = int(np.argmin(widths))
    return float(np.median(ordered[start : start + count]))


def rest_on_floor(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    height: float | None = None,
    raised: Array | None = None,
) -> tuple[tuple[Site, ...], Floor]:
    """Move sites along the floor's normal so that each lies on it while its group rests.

    How thick a sole is, no model has; shoes and markers' places make some centimetres of it. A
    group rests in the frames in which it is low and its sites, on the mean, are slow against the
    floor; each site is moved by the median of its heights there, or, in a group that never rests,
    by the mean of the other groups' sites.

    Parameters
    ----------
    model : the body, with the bodies that the sites are on
    motion : coordinates over time
    sites : places that can touch [m]
    height : of the floor where it is known, as from plates; else where the sites rest as they are
        [m]
    raised : (frames, sites) height above the floor of what they stand on, as on steps [m]; None for
        the floor throughout

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
    tree = compile_tree(model)
    moving = site_motion(model, motion, sites).over(raised)
    floor = floor_under(moving, height)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    gap = moving.lowest - floor.height
    speed = np.linalg.norm(moving.velocities - floor.velocity, axis=2)
    rests = []
    shifts = np.full(len(sites), np.nan)
    for number, site in enumerate(sites):
        members = [j for j, other in enumerate(sites) if other.group == site.group]
        pace = speed[:, members].mean(axis=1)
        frames = _resting(gap[:, members].mean(axis=1), pace, STILL * moving.pace)
        rests.append(frames)
        if len(frames) and pace[frames].min() < RESTS * moving.pace:
            shifts[number] = np.median(gap[frames, number])
    # A foot that swings throughout has the sole of the one that stands.
    known = np.isfinite(shifts)
    shifts[~known] = shifts[known].mean() if known.any() else 0.0
    moved = []
    for site, shift, frames in zip(sites, shifts, rests, strict=True):
        rotations = poses.rotations[frames, tree.body_index[site.body]]
        moved.append(_shifted(site, shift, rotations, moving.up))
    return tuple(moved), floor


def _shifted(site: Site, shift: float, rotations: Array, up: Array) -> Site:
    """Shift a site down along the floor's normal.

    Parameters
    ----------
    shift : [m]
    rotations : (frames, 3, 3) of its body while it rests; none leave it where it is
    up : (3,) in ground
    """
    down = -np.einsum("fji,j->fi", rotations, up).sum(axis=0)
    size = float(np.linalg.norm(down))
    return replace(site, points=site.points + shift * down / size) if size > 0.0 else site


def _resting(height: Array, speed: Array, max_speed: float) -> Ints:
    """Frames in which a group is among its lowest 40 % and slow.

    At least the 5 % of those that are slowest.

    Parameters
    ----------
    height, speed : (frames,) of the group [m], [m/s]
    max_speed : [m/s]

    Returns
    -------
    (resting,) numbers
    """
    known = np.flatnonzero(np.isfinite(height) & np.isfinite(speed))
    if not len(known):
        return known
    low = known[height[known] <= np.percentile(height[known], 40.0)]
    limit = max(max_speed, float(np.percentile(speed[low], 5.0)))
    return low[speed[low] <= limit]


def root_places(model: Model) -> tuple[str, ...]:
    """Find translations of a floating root whose feet can show where it is; () without."""
    slides = tuple(
        name
        for name in floating_coordinates(model)
        if model.coordinate(name).motion == "translational"
    )
    return slides if len(slides) == 3 and feet_of(model) else ()


def walked(model: Model, motion: Motion, accelerations: Array | None = None) -> Motion:
    """Find the translations of a root from the feet, and from accelerations.

    A belt's speed is not seen: a walk on a treadmill goes over ground. Flight is bridged, without
    accelerations too low.

    Parameters
    ----------
    model : with `root_places`
    motion : coordinates over time
    accelerations : (frames, 3) of a point near the root, without gravity, NaN where unknown [m/s^2]

    Returns
    -------
    the motion with these translations
    """
    names = root_places(model)
    tree = compile_tree(model)
    sites = foot_sites(model)
    columns = [motion.names.index(name) for name in names]
    rest = Motion(motion.time[:1], model.coordinate_names, tree.defaults[None])
    values = np.array(motion.values)
    values[:, columns] = [model.coordinate(name).default for name in names]
    in_place = replace(motion, values=values, velocities=None, accelerations=None)
    moving = site_motion(model, in_place, sites)
    heights = (moving.places - site_motion(model, rest, sites).places) @ moving.up
    unknown = np.full((len(motion), 3), np.nan)
    path = _path(moving, heights, unknown if accelerations is None else accelerations)
    values[:, columns] += path @ np.linalg.inv(_directions(tree, names)).T
    values[~np.isfinite(motion.values).all(axis=1)] = np.nan
    return replace(motion, values=values, velocities=None, accelerations=None)


class OnlineFootPath:
    """`walked` while frames arrive: the lowest corner of the soles stays where it is.

    Another corner takes over where it is lower by `LOWER`, so that two of one height do not change
    places.
    """

    def __init__(self, model: Model):
        self._tree = compile_tree(model)
        sites = foot_sites(model)
        names = root_places(model)
        self._columns = [model.coordinate_names.index(name) for name in names]
        self._inverse = np.linalg.inv(_directions(self._tree, names))
        self._bodies = np.array([self._tree.body_number(site.body) for site in sites], np.int64)
        self._points = np.concatenate([site.points for site in sites])
        self._up = np.asarray(model.up)
        self._rest = self._corners(self._tree.defaults) @ self._up
        self._lowest = -1
        self._foothold = np.zeros(3)

    def placed(self, pose: Array) -> Array:
        """Put the root where the feet have carried it.

        Parameters
        ----------
        pose : (coordinates,) [rad or m]

        Returns
        -------
        (coordinates,)
        """
        if not np.isfinite(pose).all():
            return pose
        pose = np.array(pose)
        pose[self._columns] = self._tree.defaults[self._columns]
        corners = self._corners(pose)
        heights = corners @ self._up - self._rest
        lowest = int(np.argmin(heights))
        moved = self._foothold - corners
        if self._lowest < 0:
            moved = np.zeros_like(corners)
        elif heights[self._lowest] - heights[lowest] < LOWER:
            lowest = self._lowest
        path = moved[self._lowest]
        path = path - (path @ self._up + heights[lowest]) * self._up
        self._lowest = lowest
        self._foothold = corners[lowest] + path
        pose[self._columns] += self._inverse @ path
        return pose

    def _corners(self, pose: Array) -> Array:
        """Corners of the soles (corners, 3) in ground [m], at a pose (coordinates,)."""
        return forward_kinematics(self._tree, pose[None]).points(self._bodies, self._points)[0]


def _directions(tree: Tree, names: tuple[str, ...]) -> Array:
    """Directions in which a foot goes by each translation.

    Returns
    -------
    (3, 3) one per column
    """
    values = np.tile(tree.defaults, (4, 1))
    for row, name in enumerate(names):
        values[row, tree.model.coordinate_names.index(name)] += 1.0
    foot = forward_kinematics(tree, values).origins[:, tree.body_number(feet_of(tree.model)[0])]
    return np.asarray((foot[:3] - foot[3]).T)


def _path(moving: SiteMotion, heights: Array, accelerations: Array) -> Array:
    """Path of the root from the soles' corners.

    Parameters
    ----------
    moving : of the corners, the root in place
    heights : (frames, corners) over those of the default pose [m]
    accelerations : (frames, 3) NaN where unknown [m/s^2]

    Returns
    -------
    (frames, 3) [m]
    """
    known = np.isfinite(heights).all(axis=1) & np.isfinite(moving.velocities).all(axis=(1, 2))
    heights = np.nan_to_num(heights)
    rates = np.nan_to_num(moving.velocities)
    path = -heights.min(axis=1)[:, None] * moving.up
    velocity = None
    for _ in range(ROUNDS):
        over = heights - heights.min(axis=1, keepdims=True)
        weights = np.exp(-((over / (HIGH * moving.height)) ** 2))
        if velocity is not None:
            speeds = np.linalg.norm(rates + velocity[:, None], axis=2)
            weights *= np.exp(-((speeds / (FAST * moving.pace)) ** 2))
        weights += BARELY * (over == 0.0)
        weights[~known] = 0.0
        path = _smooth(moving, weights, rates, heights, accelerations)
        velocity = np.gradient(path, moving.time, axis=0)
    return path


def _smooth(
    moving: SiteMotion, weights: Array, rates: Array, heights: Array, accelerations: Array
) -> Array:
    """Path of least cost for weights of the corners.

    Parameters
    ----------
    weights, heights : (frames, corners)
    rates : (frames, corners, 3) velocities of the corners, the root in place [m/s]
    accelerations : (frames, 3) [m/s^2]

    Returns
    -------
    (frames, 3) [m]
    """
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
    total = shares.sum(axis=1)
    time = moving.time
    of_feet = -(shares[..., None] * rates).sum(axis=1)
    velocity = _low_pass(time, total, of_feet, CUTOFF, accelerations)
    path = np.zeros_like(velocity)
    path[1:] = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None], axis=0)
    low = (shares * (heights + (path @ moving.up)[:, None])).sum(axis=1)
    return np.asarray(path - _low_pass(time, total, low[:, None], DRIFT) * moving.up)


def _low_pass(
    time: Array, weights: Array, weighted: Array, cutoff: float, rates: Array | None = None
) -> Array:
    """Low-pass weighted values: the x of least int w (x - x_0)^2 + x''^2 / (2 pi f)^4 dt.

    Where rates are known, (x' - rate)^2 / (2 pi `JOINED`)^2 takes the place of the second
    derivative.

    Parameters
    ----------
    time, weights : (frames,) [s], w
    weighted : (frames, columns) w x_0
    cutoff : f [Hz]
    rates : (frames, columns)

    Returns
    -------
    (frames, columns) x
    """
    step = float(np.median(np.diff(time)))
    # Rows of the band: the second diagonal above the main one first, the main one last.
    band = np.zeros((3, len(time)))
    right = np.array(weighted)
    band[2] = weights + TRIFLE
    between = np.full(weighted[1:].shape, np.nan)
    if rates is not None:
        between = 0.5 * (rates[1:] + rates[:-1])
    known = np.asarray(np.isfinite(between).all(axis=1))
    joined = 2.0 * np.pi * JOINED
    first_difference = np.array([-1.0, 1.0]) / (joined * step)
    second_difference = np.array([1.0, -2.0, 1.0]) / (2.0 * np.pi * cutoff * step) ** 2
    _add_squares(band, right, first_difference, known, between / joined)
    _add_squares(band, right, second_difference, ~(known[1:] & known[:-1]))
    return np.asarray(scipy.linalg.solveh_banded(band, right))


def _add_squares(
    band: Array, right: Array, stencil: Array, used: np.ndarray, targets: Array | None = None
) -> None:
    """Add squares of a difference, less its targets, to a banded normal matrix, where it is used.

    Parameters
    ----------
    band : (3, frames) upper diagonals, added to
    right : (frames, columns) added to
    stencil : (points,) factors of neighbouring frames
    used : (rows,) whether a difference counts
    targets : (rows, columns), 0 by default
    """
    rows = len(used)
    for i, left in enumerate(stencil):
        if targets is not None:
            right[i : i + rows][used] += left * targets[used]
        for j in range(i, len(stencil)):
            band[2 - (j - i), j : j + rows] += left * stencil[j] * used
