"""Clocks of a camera and of a sound against that of a motion, where nothing triggered both.

A camera is set by events that both saw; a sound by its impacts, which fall where sticks turn round.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.contact.impacts import site_places
from myomorph.core.contact.sound import HeardImpacts
from myomorph.core.model.arrays import Array
from myomorph.core.model.contacts import Contacts, Site
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion

# Time before and after a moment over which a tip's change of velocity is taken [s]
EITHER_SIDE = 0.015
STEP = 0.001
APART = 0.06
"""Step of the shifts that are tried, and how far another shift is that could have been meant [s].
"""
MIN_COUNT = 3


@dataclass(frozen=True)
class SoundClock:
    """How much later on the motion's clock a sound starts than it was said to."""

    shift: float  # to be added to `Sound.start` [s]
    # mean change of velocity at the impacts over that at the next best shift; 1 shows nothing
    ratio: float
    impacts: int  # how many lie within the motion then


def sound_clock(
    heard: HeardImpacts, model: Model, motion: Motion, sites: Sequence[Site], reach: float = 5.0
) -> SoundClock:
    """The shift at which impacts fall on the largest changes of velocity of the sites that make
    them. `sites`: at least those that the instruments name; `reach`: largest shift either way [s].
    """
    by_name = {site.name: site for site in sites}
    changes: dict[str, Array] = {}
    for instrument in heard.instruments:
        for name in instrument.sites:
            check_name("contact site", name, by_name, "the model's sites")
        if instrument.sites:
            each = [
                _changes(motion.time, site_places(model, motion, by_name[name]))
                for name in instrument.sites
            ]
            changes[instrument.name] = np.max(each, axis=0)
    used = [impact for impact in heard.impacts if impact.instrument in changes]
    if len(used) < MIN_COUNT:
        raise BadData(
            f"{len(used)} impacts by sites of the model: a clock needs {MIN_COUNT} or more"
        )
    shifts = np.arange(-reach, reach + 0.5 * STEP, STEP)
    summed = np.zeros(len(shifts))
    count = np.zeros(len(shifts))
    for impact in used:
        at = impact.time + shifts
        inside = (at >= motion.time[0]) & (at <= motion.time[-1])
        summed += np.where(inside, np.interp(at, motion.time, changes[impact.instrument]), 0.0)
        count += inside
    # Few impacts that fit well by chance must not win over all of them.
    mean = np.where(
        count >= max(MIN_COUNT, 0.5 * count.max()), summed / np.maximum(count, 1.0), 0.0
    )
    best = int(np.argmax(mean))
    others = mean[np.abs(shifts - shifts[best]) > APART]
    ratio = float(mean[best] / max(others.max(initial=0.0), 1e-300))
    return SoundClock(float(shifts[best]), ratio, int(count[best]))


def _changes(time: Array, places: Array) -> Array:
    """Change of velocity (frames,) over `EITHER_SIDE` about each moment [m/s]."""
    velocities = np.gradient(places, time, axis=0)
    sides = (EITHER_SIDE, -EITHER_SIDE)
    after, before = (
        [np.interp(time + side, time, column) for column in velocities.T] for side in sides
    )
    return np.linalg.norm(np.array(after) - before, axis=0)


@dataclass(frozen=True)
class CameraClock:
    """What a camera's time is on the motion's clock: t_motion = start + pace t_camera."""

    start: float = 0.0  # time of the camera's zero on the motion's clock [s]
    pace: float = 1.0  # seconds of the motion per second of the camera
    error: float = 0.0  # largest distance of the events seen by both from this line [s]


def camera_clock(seen: Sequence[float], known: Sequence[float], drift: float = 1e-3) -> CameraClock:
    """The clock of a camera from events that both saw, as a flash, a clap or a heel drop.
    One event gives the start; two or more give the pace too, by least squares, so they should lie
    far apart. `seen`, `known`: times of the events on the camera's and on the motion's clock, in
    the same order [s]; `drift`: greatest difference of the pace from 1 that is believed.
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
            f"the camera's clock runs {pace:.4f} times as fast as the motion's: is its rate right,"
            " or were events of different moments paired?"
        )
    return CameraClock(float(start), float(pace), error)


def on_clock(contacts: Contacts, clock: CameraClock) -> Contacts:
    """The same contacts on the motion's clock."""
    start = clock.start
    pace = clock.pace
    intervals = (
        replace(touch, start=start + pace * touch.start, stop=start + pace * touch.stop)
        for touch in contacts.intervals
    )
    return replace(contacts, intervals=tuple(intervals))
