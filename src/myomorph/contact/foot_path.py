"""Where a body is that only inertial sensors see, by its feet: the lowest is on a level floor and does not slide.

    minimise  int sum_i w_i |v + s_i'|^2 + |v''|^2 / (2 pi f)^4  dt

over the root's velocity v; s_i are places of the soles' corners against the root. Weights w_i fade with a corner's
height over the floor and its speed against it. Heights of corners, less those of the default pose, keep the path on the
floor, slowly: soles and joints are not known so well that a step from foot to foot would be level.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.contact.site_motion import SiteMotion, site_motion
from myomorph.contact.sites import foot_sites
from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.segments import feet_of
from myomorph.model.series import Motion
from myomorph.motion.turns import floating_coordinates
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree, compile_tree

JOINED = 0.35
"""Frequency below which velocities by feet say more, above which accelerations do: the ratio of their errors [Hz]."""
CUTOFF, DRIFT = 5.0, 0.3
"""Half power of the low-pass of the velocity that feet on the ground give the root, and of what heights mend [Hz]."""
HIGH, FAST = 0.05, 0.1
"""Height over the lowest corner, over the height of the center of mass, and speed over that of Froude number 1, at
which a corner's weight is 1/e."""
BARELY, TRIFLE = 1e-4, 1e-9
"""Weight of the lowest corner however fast it is, and of rest, so that the path is determined in every frame."""
LOWER = 0.005
"""A corner of a sole must be lower than the one that stands by so much to take over, while frames arrive [m]."""
STEPS = 4
"""Times that weights follow from the path and the path from weights."""


def root_places(model: Model) -> tuple[str, ...]:
    """Translations of a floating root whose feet can show where it is; () for a model without."""
    slides = tuple(name for name in floating_coordinates(model) if model.coordinate(name).motion == "translational")
    return slides if len(slides) == 3 and feet_of(model) else ()


def walked(model: Model, motion: Motion, accelerations: Array | None = None) -> Motion:
    """The motion of a model with `root_places`, these found from the feet, and from accelerations (frames, 3) of a
    point near the root, without gravity, NaN where unknown [m/s^2]. A belt's speed is not seen: a walk on a treadmill
    goes over ground. Flight is bridged, without accelerations too low.
    """
    names, tree, sites = root_places(model), compile_tree(model), foot_sites(model)
    columns = [motion.names.index(name) for name in names]
    rest = Motion(motion.time[:1], model.coordinate_names, tree.defaults[None])
    values = np.array(motion.values)
    values[:, columns] = [model.coordinate(name).default for name in names]
    moving = site_motion(model, replace(motion, values=values, velocities=None, accelerations=None), sites)
    heights = (moving.places - site_motion(model, rest, sites).places) @ moving.up
    unknown = np.full((len(motion), 3), np.nan)
    path = _path(moving, heights, unknown if accelerations is None else accelerations)
    values[:, columns] += path @ np.linalg.inv(_directions(tree, names)).T
    values[~np.isfinite(motion.values).all(axis=1)] = np.nan
    return replace(motion, values=values, velocities=None, accelerations=None)


class OnlineFootPath:
    """The same while frames arrive: the root goes so that the lowest corner of the soles stays where it is. Another
    corner takes over where it is lower by `LOWER`, so that two of one height do not change places.
    """

    def __init__(self, model: Model):
        self._tree, sites = compile_tree(model), foot_sites(model)
        names = root_places(model)
        self._columns = [model.coordinate_names.index(name) for name in names]
        self._inverse = np.linalg.inv(_directions(self._tree, names))
        self._bodies = np.array([self._tree.body_number(site.body) for site in sites], np.int64)
        self._points, self._up = np.concatenate([site.points for site in sites]), np.asarray(model.up)
        self._rest = self._corners(self._tree.defaults) @ self._up
        self._lowest, self._foothold = -1, np.zeros(3)

    def placed(self, pose: Array) -> Array:
        """The pose (coordinates,) with the root where the feet have carried it."""
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
        self._lowest, self._foothold = lowest, corners[lowest] + path
        pose[self._columns] += self._inverse @ path
        return pose

    def _corners(self, pose: Array) -> Array:
        return forward_kinematics(self._tree, pose[None]).points(self._bodies, self._points)[0]


def _directions(tree: Tree, names: tuple[str, ...]) -> Array:
    """(3, 3) ways that a foot goes by each translation, one a column."""
    values = np.tile(tree.defaults, (4, 1))
    for row, name in enumerate(names):
        values[row, tree.model.coordinate_names.index(name)] += 1.0
    foot = forward_kinematics(tree, values).origins[:, tree.body_number(feet_of(tree.model)[0])]
    return np.asarray((foot[:3] - foot[3]).T)


def _path(moving: SiteMotion, heights: Array, accelerations: Array) -> Array:
    """(frames, 3) by which the root moves, from the soles' corners and their heights (frames, corners)."""
    known = np.isfinite(heights).all(axis=1) & np.isfinite(moving.velocities).all(axis=(1, 2))
    heights, rates = np.nan_to_num(heights), np.nan_to_num(moving.velocities)
    path, velocity = -heights.min(axis=1)[:, None] * moving.up, None
    for _ in range(STEPS):
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


def _smooth(moving: SiteMotion, weights: Array, rates: Array, heights: Array, accelerations: Array) -> Array:
    """The path (frames, 3) of least cost for weights (frames, corners)."""
    shares = weights / np.maximum(weights.sum(axis=1, keepdims=True), 1.0)
    total, time = shares.sum(axis=1), moving.time
    velocity = _low_pass(time, total, -(shares[..., None] * rates).sum(axis=1), CUTOFF, accelerations)
    path = np.zeros_like(velocity)
    path[1:] = np.cumsum(0.5 * (velocity[1:] + velocity[:-1]) * np.diff(time)[:, None], axis=0)
    low = (shares * (heights + (path @ moving.up)[:, None])).sum(axis=1)
    return np.asarray(path - _low_pass(time, total, low[:, None], DRIFT) * moving.up)


def _low_pass(time: Array, weights: Array, weighted: Array, cutoff: float, rates: Array | None = None) -> Array:
    """Values (frames, columns) of least int w (x - x_0)^2 + x''^2 / (2 pi f)^4 dt; `weighted` are w x_0. Where rates
    (frames, columns) are known, (x' - rate)^2 / (2 pi `JOINED`)^2 takes the place of the second derivative.
    """
    # Half a second to import, which few trials need.
    from scipy.linalg import solveh_banded

    count, step = len(time), float(np.median(np.diff(time)))
    # Rows of the band: the second diagonal above the main one first, the main one last.
    band, right = np.zeros((3, count)), np.array(weighted)
    band[2] = weights + TRIFLE
    between = np.full(weighted[1:].shape, np.nan) if rates is None else 0.5 * (rates[1:] + rates[:-1])
    known = np.asarray(np.isfinite(between).all(axis=1))
    joined = 2.0 * np.pi * JOINED
    _add_squares(band, right, np.array([-1.0, 1.0]) / (joined * step), known, between / joined)
    _add_squares(
        band, right, np.array([1.0, -2.0, 1.0]) / (2.0 * np.pi * cutoff * step) ** 2, ~(known[1:] & known[:-1])
    )
    return np.asarray(solveh_banded(band, right))


def _add_squares(band: Array, right: Array, stencil: Array, used: np.ndarray, targets: Array | None = None) -> None:
    """Add squares of a difference, less its targets (rows, columns), to a banded normal matrix, where it is used."""
    rows = len(used)
    for i, left in enumerate(stencil):
        if targets is not None:
            right[i : i + rows][used] += left * targets[used]
        for j in range(i, len(stencil)):
            band[2 - (j - i), j : j + rows] += left * stencil[j] * used
