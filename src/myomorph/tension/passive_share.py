"""How much of each muscle's strength its passive force takes up, and when: told wherever passive force takes part."""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array
from myomorph.tension.tension import Tension

LARGE = 0.2
"""Share of the maximum isometric force from which a muscle's passive force is named."""


class PassivePeaks(NamedTuple):
    """Greatest passive force of each muscle over its maximum isometric force, (muscles,), and when [s]."""

    share: Array
    time: Array


def passive_peaks(passive: Array, strength: Array, time: Array) -> PassivePeaks:
    """The peaks in some frames, from forces (frames, muscles) and maximum isometric forces (muscles,) [N]."""
    share = np.nan_to_num(passive) / np.where(strength > 0.0, strength, 1.0)
    frame = share.argmax(axis=0)
    return PassivePeaks(share[frame, np.arange(len(strength))], time[frame])


def greatest_peaks(parts: Sequence[PassivePeaks], muscles: int) -> PassivePeaks:
    """The peaks of all frames; 0 at 0 s where there are no parts."""
    if not parts:
        return PassivePeaks(np.zeros(muscles), np.zeros(muscles))
    share, time = (np.stack(item) for item in zip(*parts, strict=True))
    best, each = share.argmax(axis=0), np.arange(muscles)
    return PassivePeaks(share[best, each], time[best, each])


def passive_notes(tension: Tension) -> tuple[str, ...]:
    """What passive force does in a result, in a line or two; none where it takes no part."""
    if not tension.options.passive:
        return ()
    notes = []
    if tension.options.tendons == "rigid":
        notes.append(
            "passive force on rigid tendons: fibers take up all that a path lengthens, so it comes out larger than "
            "with tendons that stretch"
        )
    order = [i for i in np.argsort(-tension.passive_share) if tension.passive_share[i] > LARGE]
    if order:
        worst = ", ".join(
            f"{tension.muscles[i]} {100.0 * tension.passive_share[i]:.0f} % at {tension.passive_time[i]:.2f} s"
            for i in order[:3]
        )
        more = " ..." if len(order) > 3 else ""
        notes.append(
            f"passive force above {100.0 * LARGE:.0f} % of the maximum isometric force in {len(order)} of "
            f"{len(tension.muscles)} muscles: {worst}{more}"
        )
    return tuple(notes)


def contact_notes(tension: Tension) -> tuple[str, ...]:
    """A line where a muscle's passive force in the problem that found contact forces passes all it can pull with."""
    if not tension.overstretched:
        return ()
    order = sorted(tension.overstretched, key=lambda name: -tension.passive_share[tension.muscles.index(name)])
    at = [tension.muscles.index(name) for name in order[:3]]
    worst = ", ".join(
        f"{tension.muscles[i]} {tension.passive_share[i]:.1f} times at {tension.passive_time[i]:.2f} s" for i in at
    )
    return (
        f"contact forces: passive force above the maximum isometric force in {len(order)} of {len(tension.muscles)} "
        f"muscles ({worst}{' ...' if len(order) > 3 else ''}): fibers of the model do not fit the motion; compare with "
        "--no-contact-passive",
    )
