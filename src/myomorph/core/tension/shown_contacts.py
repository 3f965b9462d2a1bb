"""Contacts of whose forces nothing is known: what the data allow is wider than what they vary by.

    mean over frames (high - low)^2 / 12  >  variance over frames of the estimate

An estimate anywhere within what the data allow has the error on the left; a force that never
changes has the one on the right. Where the first is larger, a constant would do as well as the
estimate.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.alone import AloneOnPlates
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import CONTACTS_OPEN
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import few, whole
from myomorph.core.model.findings import Finding
from myomorph.core.tension.certificates import ContactIntervals

MIN_COUNT = 8
"""Number of instants below which nothing is said."""
SMALL = 0.05
"""What the data allow is not named below this share of the weight."""
NOT_SHOWN = "contact forces not shown"


class OpenContact(NamedTuple):
    """A contact and how far its force is known.

    Attributes
    ----------
    group : its name
    error : standard deviation of what the data allow [N]
    variation : standard deviation of the estimate over time [N]
    """

    group: str
    error: float
    variation: float


def open_contacts(
    intervals: ContactIntervals, sites: Iterable[Site], weight: float
) -> tuple[OpenContact, ...]:
    """Find contacts of whose forces the data show less than a constant would.

    Of contacts with a direction it is asked of the force along it, of others of the whole force.

    Source: ours, the equation above.

    Parameters
    ----------
    intervals : what the data allow at some instants
    sites : of contact
    weight : of the body [N]

    Returns
    -------
    in the order of the groups; none of fewer than `MIN_COUNT` instants
    """
    free = {site.group for site in sites if site.cone.direction is None}
    found = []
    for column, group in enumerate(intervals.groups):
        if group in free:
            force = intervals.forces[:, column]
            width = intervals.high[:, column] - intervals.low[:, column]
        else:
            force = intervals.normal[:, column, None]
            width = (intervals.normal_high - intervals.normal_low)[:, column, None]
        known = _known(force, width)
        if known.sum() < MIN_COUNT:
            continue
        error = float(np.sqrt(np.mean(np.sum(width[known] ** 2, axis=1)) / 12.0))
        variation = float(np.sqrt(force[known].var(axis=0).sum()))
        if error > max(variation, SMALL * weight):
            found.append(OpenContact(group, error, variation))
    return tuple(found)


def with_alone(
    intervals: ContactIntervals, alone: AloneOnPlates | None, up: Array
) -> ContactIntervals:
    """Add the forces of contacts alone on plates, of which nothing is left open.

    Parameters
    ----------
    intervals : of forces that were estimated
    alone : known forces, None for none
    up : (3,) unit vector, along which these contacts push

    Returns
    -------
    the same instants
    """
    if alone is None:
        return intervals
    known = np.zeros(intervals.forces.shape)
    for column, group in enumerate(alone.forces.names):
        if group in intervals.groups:
            place = intervals.groups.index(group)
            known[:, place] = alone.forces.forces[intervals.frames, column]
    along = known @ up
    return replace(
        intervals,
        forces=intervals.forces + known,
        low=intervals.low + known,
        high=intervals.high + known,
        normal=intervals.normal + along,
        normal_low=intervals.normal_low + along,
        normal_high=intervals.normal_high + along,
        near_low=intervals.near_low + known,
        near_high=intervals.near_high + known,
    )


def _known(force: Array, width: Array) -> NDArray[np.bool_]:
    """Return the instants (instants,) that were solved.

    Parameters
    ----------
    force, width : (instants, components) [N]; a width without end is infinite
    """
    return np.asarray(np.isfinite(force).all(axis=1) & ~np.isnan(width).any(axis=1))


def open_contact_findings(contacts: Sequence[OpenContact]) -> tuple[Finding, ...]:
    """Say of which contacts nothing is known, all in one line; none where something is.

    Parameters
    ----------
    contacts : of whose forces the data show less than a constant would
    """
    if not contacts:
        return ()
    worst = max(contacts, key=lambda contact: contact.error)
    names = few([contact.group for contact in contacts])
    wide = f"{whole(worst.error)} N" if np.isfinite(worst.error) else "any amount"
    text = CONTACTS_OPEN.message(
        f"nothing is known of the contact forces of {names}: what the data allow varies by"
        f" {wide} (standard deviation, '{worst.group}'), the estimate over time by"
        f" {whole(worst.variation)} N; a constant would do as well. Measure some of them (--loads,"
        " --measured), or EMG of all muscles that cross their joints",
        size=worst.error if np.isfinite(worst.error) else None,
    )
    place = ", ".join(contact.group for contact in contacts)
    return (Finding(kind=NOT_SHOWN, place=place, text=text, size=worst.error),)
