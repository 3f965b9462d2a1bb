"""Sites that rest on something else than the floor: a seat, a step, a table."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.contact.site_motion import site_motion
from myomorph.contact.states import ContactStateOptions, find_contacts
from myomorph.contact.strengths import StrengthOptions, strengths
from myomorph.model.arrays import Array
from myomorph.model.contacts import Contacts, Site
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.rigid.tree import compile_tree

RESTING = 10.0
"""Percentile of a site's heights that is taken for the height it rests at."""


def resting_height(model: Model, motion: Motion, site: Site) -> float:
    """Height at which a site rests on what is under it [m]: the lowest that it gets, but for a tenth of the time."""
    return float(np.nanpercentile(site_motion(model, motion, (site,)).lowest[:, 0], RESTING))


def raised_contacts(
    model: Model, motion: Motion, site: Site, soles: Sequence[Site], height: float | None = None
) -> tuple[Contacts, Array]:
    """When a site touches a surface of its own, and how ready it is to carry force (frames,).

    Parameters
    ----------
    soles : sites under the feet, which tell how large the body is; those of other bodies count for nothing, and an
        object is judged by its own height
    height : of the surface [m]; None takes `resting_height`
    """
    height = resting_height(model, motion, site) if height is None else height
    tree = compile_tree(model)
    part = {one.name: tree.roots[tree.body_index[one.body]] for one in (site, *soles)}
    sites = (site, *(one for one in soles if part[one.name] == part[site.name]))
    found = find_contacts(model, motion, sites, ContactStateOptions(floor=height))
    ready = strengths(model, motion, sites, found, StrengthOptions(floor=height))
    return Contacts((site.name,), found.of(site.name)), ready.values[:, 0]
