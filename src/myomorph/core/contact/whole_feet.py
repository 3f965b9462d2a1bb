"""Contacts that were reported of whole feet, as `foot_l`, put on the sites of their soles."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.site_motion import SiteMotion, site_motion
from myomorph.core.contact.states import ContactStateOptions, touches_of
from myomorph.core.model.contacts import Contacts, Site, Touch
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion


def contacts_of_sites(
    reported: Contacts, model: Model, motion: Motion, sites: Sequence[Site]
) -> Contacts:
    """Put contacts that a table reports of a group of sites on these.

    While the group touches, those of its sites do that are near the lowest one, as under a plate's
    force; nothing of it touches at other times, nor in frames in which the motion is NaN.

    Source: ours, the rule of `states.by_plates`.

    Parameters
    ----------
    reported : contacts of sites, and of groups of sites by their name, as `foot_l`
    model : with the sites' bodies
    motion : coordinates (frames, coordinates) [rad or m]
    sites : of contact

    Returns
    -------
    contacts of sites alone; names that are neither a site nor a group stay as they are
    """
    names = {site.name for site in sites}
    groups = {
        group: members
        for group, members in grouped((site.group, site) for site in sites).items()
        if group in reported.sites and group not in names
    }
    if not groups:
        return reported
    members = [site for group in groups.values() for site in group]
    moving = site_motion(model, motion, members)
    touches: list[Touch] = []
    for touch in reported.intervals:
        touches += _of_sites(touch, moving, members) if touch.site in groups else [touch]
    return replace(
        reported, sites=_names_of_sites(reported.sites, groups), intervals=tuple(touches)
    )


def _names_of_sites(names: Sequence[str], groups: Mapping[str, Sequence[Site]]) -> tuple[str, ...]:
    """Names of sites, in the place of the groups among some names."""
    result: list[str] = []
    for name in names:
        result += [site.name for site in groups[name]] if name in groups else [name]
    return tuple(dict.fromkeys(result))


def _of_sites(touch: Touch, moving: SiteMotion, sites: Sequence[Site]) -> list[Touch]:
    """Contacts of the sites of a group in one contact of it.

    Parameters
    ----------
    touch : of the group
    moving : positions of sites
    sites : in the order of `moving`
    """
    columns = [column for column, site in enumerate(sites) if site.group == touch.site]
    inside = (moving.time >= touch.start - 1e-9) & (moving.time <= touch.stop + 1e-9)
    touching = np.zeros(moving.lowest.shape, np.bool_)
    touching[np.ix_(inside, np.array(columns))] = _near_the_lowest(moving, columns)[inside]
    found = touches_of(
        sites, touching, np.full(touching.shape, touch.confidence), moving.time, touch.source
    )
    return [replace(one, surface=touch.surface) for one in found]


def _near_the_lowest(moving: SiteMotion, columns: Sequence[int]) -> NDArray[np.bool_]:
    """Return whether sites are near the lowest of them; (frames, columns)."""
    level = moving.lowest[:, list(columns)]
    known = np.isfinite(level)
    level = np.where(known, level, np.inf)
    lowest = level.min(axis=1, keepdims=True)
    near = level < lowest + ContactStateOptions().high * moving.height
    return np.asarray(known & near)
