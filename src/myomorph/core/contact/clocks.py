"""Clocks of a camera and of a sound against that of a motion, where nothing triggered both.

A camera is set by events that both saw; a sound by its impacts, which fall where sticks turn round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.contact.sound import HeardImpacts
from myomorph.core.contact.strikers import site_places
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Contacts, Site
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion

EITHER_SIDE = 0.015
"""Time before and after a moment over which a tip's change of velocity is taken [s]."""
STEP = 0.001
APART = 0.06
"""Step of the shifts that are tried, and how far another shift is that could have been meant [s].
"""
MIN_COUNT = 3
"""Number of impacts that a clock needs."""


@dataclass(frozen=True)
class SoundClock:
    """Delay of a sound: how much later it starts on the motion's clock than in its file.

    Attributes
    ----------
    shift : to be added to `Sound.start` [s]
    ratio : mean change of velocity at the impacts over that at the next best shift; 1 shows nothing
    impacts : how many lie within the motion then
    """

    shift: float
    ratio: float
    impacts: int


def sound_clock(
    heard: HeardImpacts,
    model: Model,
    motion: Motion,
    sites: Sequence[Site],
    search_range: float = 5.0,
) -> SoundClock:
    """Find the shift at which impacts fall on the largest changes of velocity of what strikes.

    Parameters
    ----------
    heard : impacts on the sound's clock
    model : of the body that strikes
    motion : coordinates over time
    sites : at least those that the instruments name
    search_range : largest shift either way [s]

    Raises
    ------
    BadData : too few impacts by sites of the model
    UnknownName : an instrument names a site that does not exist
    """
    changes = _changes_by_instrument(heard, model, motion, sites)
    used = [impact for impact in heard.impacts if impact.instrument in changes]
    if len(used) < MIN_COUNT:
        raise BadData(
            f"{len(used)} impacts by sites of the model: a clock needs {MIN_COUNT} or more"
        )
    shifts = np.arange(-search_range, search_range + 0.5 * STEP, STEP)
    summed = np.zeros(len(shifts))
    count = np.zeros(len(shifts))
    for impact in used:
        at = impact.time + shifts
        inside = (at >= motion.time[0]) & (at <= motion.time[-1])
        summed += np.where(inside, np.interp(at, motion.time, changes[impact.instrument]), 0.0)
        count += inside
    # Few impacts that fit well by chance must not win over all of them.
    enough = count >= max(MIN_COUNT, 0.5 * count.max())
    mean = np.where(enough, summed / np.maximum(count, 1.0), 0.0)
    best = int(np.argmax(mean))
    others = mean[np.abs(shifts - shifts[best]) > APART]
    ratio = float(mean[best] / max(others.max(initial=0.0), 1e-300))
    return SoundClock(shift=float(shifts[best]), ratio=ratio, impacts=int(count[best]))


def _changes_by_instrument(
    heard: HeardImpacts, model: Model, motion: Motion, sites: Sequence[Site]
) -> dict[str, Array]:
    """Largest change of velocity (frames,) of the sites of each instrument [m/s]."""
    by_name = {site.name: site for site in sites}
    changes: dict[str, Array] = {}
    for instrument in heard.instruments:
        for name in instrument.sites:
            check_name("contact site", name, by_name, "the model's sites")
        of_sites = [
            _changes(motion.time, site_places(model, motion, by_name[name]))
            for name in instrument.sites
        ]
        if of_sites:
            changes[instrument.name] = np.max(of_sites, axis=0)
    return changes


def _changes(time: Array, places: Array) -> Array:
    """Change of velocity over `EITHER_SIDE` about each moment.

    Parameters
    ----------
    time : (frames,) [s]
    places : (frames, 3) [m]

    Returns
    -------
    (frames,) [m/s]
    """
    velocities = np.gradient(places, time, axis=0)
    after = [np.interp(time + EITHER_SIDE, time, column) for column in velocities.T]
    before = [np.interp(time - EITHER_SIDE, time, column) for column in velocities.T]
    return np.linalg.norm(np.array(after) - before, axis=0)


@dataclass(frozen=True)
class CameraClock:
    """A camera's time on the motion's clock: t_motion = start + pace t_camera.

    Attributes
    ----------
    start : time of the camera's zero on the motion's clock [s]
    pace : seconds of the motion per second of the camera
    error : largest distance of the events seen by both from this line [s]
    """

    start: float = 0.0
    pace: float = 1.0
    error: float = 0.0


def camera_clock(seen: Sequence[float], known: Sequence[float], drift: float = 1e-3) -> CameraClock:
    """Set the clock of a camera by events that both saw, as a flash, a clap or a heel drop.

    One event gives the start; two or more give the pace too, by least squares, so they should lie
    far apart.

    Parameters
    ----------
    seen, known : times of the events on the camera's and on the motion's clock, in the same order
        [s]
    drift : greatest difference of the pace from 1 that is believed

    Raises
    ------
    BadData : another number of events on both clocks, none, or a pace beyond the drift
    """
    a = np.asarray(seen, dtype=np.float64)
    b = np.asarray(known, dtype=np.float64)
    if not len(a) or len(a) != len(b):
        raise BadData(
            f"{len(a)} events on the camera's clock, {len(b)} on the motion's: expected as many,"
            " one or more"
        )
    if len(a) == 1 or np.ptp(a) == 0.0:
        return CameraClock(float(np.mean(b - a)), 1.0, float(np.ptp(b - a)))
    pace, start = np.polyfit(a, b, 1)
    error = float(np.abs(start + pace * a - b).max())
    if abs(pace - 1.0) > drift:
        raise BadData(
            f"the camera's clock runs {pace:.4f} times as fast as the motion's: check its rate, and"
            " whether events of the same instants are paired"
        )
    return CameraClock(float(start), float(pace), error)


def on_clock(contacts: Contacts, clock: CameraClock) -> Contacts:
    """Move contacts onto the motion's clock.

    Parameters
    ----------
    contacts : on the clock of a camera [s]
    clock : of the camera

    Returns
    -------
    the contacts, their intervals at the motion's times [s]
    """
    start = clock.start
    pace = clock.pace
    intervals = (
        replace(touch, start=start + pace * touch.start, stop=start + pace * touch.stop)
        for touch in contacts.intervals
    )
    return replace(contacts, intervals=tuple(intervals))
