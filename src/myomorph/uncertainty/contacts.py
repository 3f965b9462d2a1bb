"""Contacts drawn around those that a motion shows: where they are on the bodies, when they begin and end."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.contacts import Site
from myomorph.model.series import Series
from myomorph.uncertainty.bodies import Draw


def drawn_sites(sites: Sequence[Site], draw: Draw) -> tuple[Site, ...]:
    """Sites elsewhere on their bodies, those of one contact on one body by the same."""
    if not draw.sources.contact_point:
        return tuple(sites)
    return tuple(
        replace(site, points=site.points + draw.of("contact_point", f"{site.group} {site.body}", 3)) for site in sites
    )


def drawn_strengths(ready: Series, sites: Sequence[Site], draw: Draw) -> Series:
    """Contacts that begin and end at other times, all touches of one contact late by the same.

    Parameters
    ----------
    ready : how ready each site is to carry force (frames, sites)
    """
    if not draw.sources.contact_time or len(ready) < 2:
        return ready
    values = np.array(ready.values)
    for group in dict.fromkeys(site.group for site in sites):
        begin, end = draw.of("contact_time", group, 2)
        members = [index for index, site in enumerate(sites) if site.group == group]
        values[:, members] = _moved(ready.time, values[:, members], float(begin), float(end))
    return replace(ready, values=values)


def _moved(time: Array, values: Array, begin: float, end: float) -> Array:
    """Columns of which the first half of every touch of any comes later by `begin` [s], the second by `end`.

    A touch that lasts to the end of the recording keeps that end: nothing was found there.
    """
    on = (values > 0.0).any(axis=1)
    edges = np.flatnonzero(np.diff(np.concatenate([[0], on.astype(int), [0]])))
    result = np.zeros_like(values)
    for start, stop in edges.reshape(-1, 2):
        first = begin if start > 0 else 0.0
        last = end if stop < len(time) else 0.0
        alone = np.zeros_like(values)
        alone[start:stop] = values[start:stop]
        middle = 0.5 * (time[start] + time[stop - 1])
        # Times of the touch that was found, at which it is as it now is at `time`.
        length = max(time[stop - 1] - time[start] + last - first, 1e-9)
        late = first + (last - first) * np.clip((time - time[start] - first) / length, 0.0, 1.0)
        at = time - (late if stop - start > 2 else np.where(time < middle, first, last))
        for index in range(values.shape[1]):
            result[:, index] = np.maximum(result[:, index], np.interp(at, time, alone[:, index]))
    return result
