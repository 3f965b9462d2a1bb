"""Contacts marked on a camera's clock, brought to the clock of the motion."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.model.contacts import Contacts, Touch
from myomorph.model.errors import BadData


@dataclass(frozen=True)
class CameraClock:
    """What a camera's time is on the motion's clock: t_motion = start + pace t_camera.

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
    """The clock of a camera from events that both saw, as a flash, a clap or a heel drop.

    One event gives the start; two or more give the pace too, by least squares, so they should lie far apart.

    Parameters
    ----------
    seen, known : times of the events on the camera's and on the motion's clock, in the same order [s]
    drift : greatest difference of the pace from 1 that is believed

    Raises
    ------
    BadData : no event, not as many of both, or clocks that drift more than is believed
    """
    a, b = np.asarray(seen, dtype=np.float64), np.asarray(known, dtype=np.float64)
    if not len(a) or len(a) != len(b):
        raise BadData(f"{len(a)} events on the camera's clock, {len(b)} on the motion's: expected as many, one or more")
    if len(a) == 1 or np.ptp(a) == 0.0:
        return CameraClock(float(np.mean(b - a)), 1.0, float(np.ptp(b - a)))
    pace, start = np.polyfit(a, b, 1)
    error = float(np.abs(start + pace * a - b).max())
    if abs(pace - 1.0) > drift:
        raise BadData(
            f"the camera's clock runs {pace:.4f} times as fast as the motion's: is its rate right, or were events of "
            "different moments paired?"
        )
    return CameraClock(float(start), float(pace), error)


def on_clock(contacts: Contacts, clock: CameraClock) -> Contacts:
    """The same contacts on the motion's clock."""
    return replace(contacts, touches=tuple(_moved(one, clock) for one in contacts.touches))


def _moved(touch: Touch, clock: CameraClock) -> Touch:
    start, stop = (clock.start + clock.pace * time for time in (touch.start, touch.stop))
    return replace(touch, start=start, stop=stop)
