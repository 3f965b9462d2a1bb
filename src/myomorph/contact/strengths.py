"""How ready each site is to carry force: smooth functions of its height and speed, while it touches."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.contact.site_motion import center_of, floor_under, site_motion
from myomorph.model.arrays import Array
from myomorph.model.contacts import Contacts, Site
from myomorph.model.errors import BadData
from myomorph.model.model import GROUND, Model
from myomorph.model.series import Motion, Series
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

PIVOT = 0.3
"""Height of the virtual pivot point above the center of mass, over the height of that above the floor."""


@dataclass(frozen=True)
class StrengthOptions:
    """Where readiness fades. Lengths count from the height of the center of mass, speeds from sqrt(g height).

    The defaults are, for an adult, the 40 mm and 0.8 m/s that AnyBody's template for ground forces documents.

    Attributes
    ----------
    height, speed : at which a site is not ready any more
    high, fast : shares of those up to which it is fully ready
    least : readiness of a site that touches, however it moves
    floor : height of the floor [m], None to find it
    """

    height: float = 0.042
    speed: float = 0.26
    high: float = 0.8
    fast: float = 0.15
    least: float = 0.05
    floor: float | None = None


def strengths(
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    contacts: Contacts | None = None,
    options: StrengthOptions | None = None,
) -> Series:
    """How ready each site is to carry force (frames, sites), 0 to 1.

    s = max(least, fade(z / z_limit, high) fade(v / v_limit, fast)) confidence,

    fade(x, a) = 1 below a, (1 + cos(pi (x - a) / (1 - a))) / 2 up to 1, then 0,

    of the height z of a site's lowest point over the floor and its speed v against it, times how sure it is that it
    touches: a strength that fades with height and speed, in the manner of Fluit et al. (2014) and Skals et al. (2017);
    the curve is ours. A site on anything but the ground is as ready as it is sure to touch.

    Parameters
    ----------
    contacts : when sites touch; all the time without
    """
    options = options or StrengthOptions()
    names = tuple(one.name for one in sites)
    sure = np.ones((len(motion), len(sites)))
    if contacts is not None:
        missing = [name for name in names if name not in contacts.sites]
        if missing:
            raise BadData(f"contacts say nothing of site '{missing[0]}': they are of {', '.join(contacts.sites)}")
        columns = [contacts.sites.index(name) for name in names]
        sure = contacts.states(motion.time).values[:, columns]
    walking = [k for k, one in enumerate(sites) if one.against == GROUND]
    values = np.array(sure)
    if walking:
        moving = site_motion(model, motion, [sites[k] for k in walking])
        floor = floor_under(moving, options.floor)
        z = (moving.lowest - floor.height) / moving.height
        v = np.linalg.norm(moving.velocities - floor.velocity, axis=2) / moving.pace
        ready = fade(z / options.height, options.high) * fade(v / options.speed, options.fast)
        least = options.least if contacts is not None else 0.0
        values[:, walking] *= np.nan_to_num(np.maximum(ready, least))
    return Series(motion.time, names, values)


def leans(model: Model, motion: Motion, sites: Sequence[Site], pivot: float = PIVOT) -> Array:
    """Which way forces at sites on the ground lean most readily: to a pivot above the subject's center of mass.

    What two feet push against each other moves nothing, so physics leaves it open. Walkers' ground forces meet
    near a point above the center of mass, the virtual pivot point (Maus et al. 2010): a force that leans to it costs
    least.

    Parameters
    ----------
    pivot : height of the point above the center of mass, over the height of that above the floor

    Returns
    -------
    (frames, sites, 3) in ground: force across the cone's direction per force along it, 0 of a site on anything but
    the ground, or whose cone has no direction fixed in ground
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    moving = site_motion(model, motion, sites)
    owner = tree.roots
    found = np.zeros((len(motion), len(sites), 3))
    for subject in np.unique(owner[1:]):
        pivots = center_of(tree, poses, owner == subject) + pivot * moving.height * moving.up
        for k, site in enumerate(sites):
            up = site.cone.direction
            mine = owner[tree.body_index[site.body]] == subject and site.against == GROUND
            if mine and up is not None and site.cone.frame == GROUND:
                way = pivots - moving.places[:, k]
                along = way @ up
                ahead = along > 0.1 * moving.height
                found[ahead, k] = way[ahead] / along[ahead, None] - up
    return found


def fade(x: Array, full: float) -> Array:
    """1 below `full`, half a cosine down to 0 at 1, 0 beyond; NaN stays."""
    way = np.clip((x - full) / (1.0 - full), 0.0, 1.0)
    faded: Array = 0.5 * (1.0 + np.cos(np.pi * way))
    return faded
