"""Objects of known inertia that hands hold or push: when they are held, and surfaces to rest on.

A seat, a step or a table is a surface of its own height at which a site rests.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.spells import hysteresis, steady
from myomorph.core.contact.states import (
    KINEMATICS,
    ActivationOptions,
    ContactStateOptions,
    contact_activations,
    find_contacts,
    touches_of,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Contacts, Site
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import Tree, compile_tree

MOVING = 0.1
"""An object moves where the held place is faster than that [m/s]."""
NEAR = 0.03
FAR = 0.05
"""A hold begins where the site comes so near to the place at which it holds the moving object, and
ends where it leaves that far from it [m].
"""
SHORTEST = 0.03
"""Holds and gaps that last less are taken for noise [s]."""


RESTING = 10.0
"""Percentile of a site's heights that is taken for the height it rests at."""


def find_holds(model: Model, motion: Motion, sites: Sequence[Site]) -> Contacts:
    """Find when sites hold the objects that they are against.

    An object that nothing else drives moves only while it is held, so the site's place on it then
    (the median) is where it is held; it is held before and after for as long as the site stays
    there.

    Parameters
    ----------
    model : of body and objects together (`join_models`)
    motion : coordinates over time
    sites : on the hands, each against the body of an object

    Raises
    ------
    BadData : a site is against the ground, or an object never moves
    """
    if len(motion) < 2:
        raise BadData(
            f"a motion of {len(motion)} frames: an object that is held is recognized by its"
            " movement, so give a longer one"
        )
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    held = np.zeros((len(motion), len(sites)), np.bool_)
    for number, site in enumerate(sites):
        if site.against == GROUND:
            raise BadData(
                f"site '{site.name}' is against the ground: expected a body, the object that it"
                " holds"
            )
        place = _place_on_object(tree, poses, site)
        moving = _speed_of_place(tree, poses, site, place, motion.time) > MOVING
        if not moving.any():
            raise BadData(
                f"'{site.against}' is never faster than {MOVING:g} m/s: when '{site.name}' holds it"
                " cannot be found from motion; name the times in a table of contacts"
            )
        distance = np.linalg.norm(place - np.median(place[moving], axis=0), axis=1)
        near = hysteresis(distance <= NEAR, distance > FAR)
        held[:, number] = steady(near, motion.time, SHORTEST)
    touches = touches_of(sites, held, np.ones(held.shape), motion.time, KINEMATICS)
    return Contacts(tuple(site.name for site in sites), touches)


def _place_on_object(tree: Tree, poses: Poses, site: Site) -> Array:
    """Middle of a site (frames, 3) in the frame of its object [m]."""
    thing = tree.body_index[site.against]
    hand = np.array([tree.body_index[site.body]])
    point = poses.points(hand, site.points.mean(axis=0)[None])[:, 0]
    return np.einsum("fji,fj->fi", poses.rotations[:, thing], point - poses.origins[:, thing])


def _speed_of_place(tree: Tree, poses: Poses, site: Site, place: Array, time: Array) -> Array:
    """Speed (frames,) of places (frames, 3) on the object of a site [m/s]."""
    thing = tree.body_index[site.against]
    turning = np.gradient(poses.rotations[:, thing], time, axis=0)
    velocity = np.gradient(poses.origins[:, thing], time, axis=0)
    return np.linalg.norm(velocity + np.einsum("fij,fj->fi", turning, place), axis=1)


def resting_height(model: Model, motion: Motion, site: Site) -> float:
    """Find the height at which a site rests: its lowest, but for a tenth of the time.

    Parameters
    ----------
    model : with the site's body
    motion : coordinates (frames, coordinates) [rad or m], NaN in gaps
    site : that rests

    Returns
    -------
    along the vertical of the model [m]
    """
    return float(np.nanpercentile(site_motion(model, motion, (site,)).lowest[:, 0], RESTING))


class RaisedContact(NamedTuple):
    """Contact of a site that rests on a surface of its own.

    Attributes
    ----------
    contacts : of the site
    activation : (frames,) 0 to 1
    """

    contacts: Contacts
    activation: Array


def raised_contacts(
    model: Model, motion: Motion, site: Site, soles: Sequence[Site], height: float | None = None
) -> RaisedContact:
    """Find when a site touches a surface of its own, and how ready it is to carry force.

    Parameters
    ----------
    model : of body and objects together
    motion : coordinates over time
    site : that rests on the surface
    soles : sites under the feet, which show how large the body is; those of other bodies count for
        nothing, and an object is judged by its own height
    height : of the surface [m]; None takes `resting_height`
    """
    height = resting_height(model, motion, site) if height is None else height
    tree = compile_tree(model)
    root = {sole.name: tree.roots[tree.body_index[sole.body]] for sole in (site, *soles)}
    sites = (site, *(sole for sole in soles if root[sole.name] == root[site.name]))
    contacts = find_contacts(model, motion, sites, ContactStateOptions(floor=height))
    ready = contact_activations(model, motion, sites, contacts, ActivationOptions(floor=height))
    return RaisedContact(
        contacts=Contacts((site.name,), contacts.of(site.name)), activation=ready.values[:, 0]
    )
