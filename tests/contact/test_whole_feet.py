"""A table of contacts by foot means the sites of its sole that are down."""

from __future__ import annotations

import numpy as np
import pytest

from measured_walk import measured_walk
from myomorph.core.contact.site_motion import site_motion
from myomorph.core.contact.states import find_contacts
from myomorph.core.contact.whole_feet import contacts_of_sites
from myomorph.core.model.contacts import FOREVER, Contacts, Touch


@pytest.fixture(scope="module")
def walk(data):
    return measured_walk(data)


def marked(walk, *spans):
    """Contacts of the left foot, and of one site of the right one."""
    right = next(site.name for site in walk.sites if site.group == "foot_r")
    touches = [Touch(site="foot_l", start=start, stop=stop) for start, stop in spans]
    touches.append(Touch(site=right, start=0.6, stop=0.7))
    return right, Contacts(("foot_l", right), tuple(touches))


def test_sites_of_the_foot_touch_while_it_does_and_never_else(walk):
    start = float(walk.motion.time[0])
    right, table = marked(walk, (start + 0.1, start + 0.5), (start + 0.9, FOREVER))
    found = contacts_of_sites(table, walk.model, walk.motion, walk.sites)
    left = [site.name for site in walk.sites if site.group == "foot_l"]
    assert set(found.sites) == {*left, right}
    assert found.of(right) == table.of(right)
    time = walk.motion.time
    states = found.states(time)
    touching = np.stack([states[name] > 0.0 for name in left], axis=1)
    on = ((time >= start + 0.1) & (time <= start + 0.5)) | (time >= start + 0.9)
    assert (touching.any(axis=1) == on).all()
    moving = site_motion(walk.model, walk.motion, walk.sites)
    columns = [k for k, site in enumerate(walk.sites) if site.group == "foot_l"]
    lowest = moving.lowest[:, columns].argmin(axis=1)
    assert touching[on, lowest[on]].all()


def test_sites_that_motion_finds_are_found_again_from_its_feet(walk):
    """Most of what heights and speeds of single sites tell is told by when the foot stands."""
    by_site = find_contacts(walk.model, walk.motion, walk.sites)
    time = walk.motion.time
    names = [site.name for site in walk.sites]
    single = np.stack([by_site.states(time)[name] > 0.0 for name in names], axis=1)
    groups = tuple(dict.fromkeys(site.group for site in walk.sites))
    touches = []
    for group in groups:
        columns = [k for k, site in enumerate(walk.sites) if site.group == group]
        on = np.flatnonzero(np.diff(np.r_[0, single[:, columns].any(axis=1), 0]))
        for first, last in zip(on[::2], on[1::2] - 1, strict=True):
            touches.append(Touch(site=group, start=time[first], stop=time[last]))
    by_foot = contacts_of_sites(
        Contacts(groups, tuple(touches)), walk.model, walk.motion, walk.sites
    )
    again = np.stack([by_foot.states(time)[name] > 0.0 for name in names], axis=1)
    assert (again == single).mean() > 0.85


def test_names_of_sites_and_unknown_ones_stay(walk):
    names = tuple(site.name for site in walk.sites)[:2]
    table = Contacts((*names, "hand"), (Touch(site=names[0], start=0.6, stop=0.7),))
    assert contacts_of_sites(table, walk.model, walk.motion, walk.sites) is table
