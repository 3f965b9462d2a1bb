"""Drops of a relaxed limb in a recording, their half swings, and muscles that were not silent."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData, listing
from myomorph.core.model.series import Series
from myomorph.core.motion.envelope import EnvelopeOptions, linear_envelope
from myomorph.swings.viscosity.relaxed.swing_equation import SwingEquation

STILL = 0.05  # Share of the fastest rate of a recording below which the limb is held or hangs.
HELD = 0.15  # Shortest time of a hold, unless the recording begins in it; a turn is shorter [s].
RELEASED = 0.2  # The same above which a hand no longer carries the limb that it let go.
AWAY = np.deg2rad(15.0)  # How far from where it hangs a limb is let go, at least [rad].
MIN_EXCURSION = np.deg2rad(2.0)  # Of a half swing that is used [rad].
MIN_HALVES = 4  # Half swings of a drop that is used.

SILENT = "the silence of muscles was judged by EMG"
SILENT_UNKNOWN = "no EMG was recorded: whether the muscles were silent is not known"
BAND = EnvelopeOptions(cutoff=20.0)
# Shortest stretch of a limb at rest from which the level of a silent muscle is taken [s].
QUIET = 0.3
# Standard deviations over that level from which on a muscle is active (Hodges and Bui 1996 use 3).
ABOVE = 5.0
BURST = 0.02  # Shortest activity that is named [s].
FORCE_AFTER = 0.1  # How long a muscle may pull after its EMG has ended [s].


@read_only
class Drop:
    """One swing from a hand that let go until it rests.

    Attributes
    ----------
    name : of recording and drop
    equation : of the joint's coordinate while this recording lasts
    measured : (frames,) angle as it was measured, NaN where unknown [rad]
    angles, rates : (frames,) low-passed, and their derivative [rad], [rad/s]
    turns : (half swings + 1,) frames of the release and of every turn
    used : (half swings,) which of these are explained
    """

    name: str
    equation: SwingEquation
    measured: Array
    angles: Array
    rates: Array
    turns: np.ndarray
    used: np.ndarray

    @property
    def parts(self) -> list[slice]:
        """Frames of half swings in use that follow each other."""
        return [
            slice(int(self.turns[start]), int(self.turns[stop])) for start, stop in runs(self.used)
        ]

    def time(self, half: int) -> tuple[float, float]:
        """Return when a half swing begins and ends [s]."""
        begin, end = self.equation.time[self.turns[half : half + 2]]
        return float(begin), float(end)


def find_drops(
    name: str, equation: SwingEquation, measured: Array, angles: Array, rates: Array
) -> tuple[Drop, ...]:
    """Find the drops of a recording.

    Each begins where a limb that was held away from where it hangs gets fast, and ends with its
    last half swing of `MIN_EXCURSION`.

    Parameters
    ----------
    name : of the recording
    equation : of the joint's coordinate
    measured : (frames,) angle as it was measured, NaN where unknown [rad]
    angles, rates : (frames,) low-passed, and their derivative [rad], [rad/s]

    Returns
    -------
    one or more

    Raises
    ------
    BadData : there is none
    """
    fastest = float(np.nanmax(np.abs(rates), initial=0.0))
    last = angles[-max(3, len(angles) // 20) :]
    # Where the recording ends, unless the limb still swings there.
    rest = float(np.nanmedian(last if np.ptp(last) < AWAY else angles))
    held = [
        stop
        for start, stop in runs(np.abs(rates) < STILL * fastest)
        if not start or equation.time[stop - 1] - equation.time[start] > HELD
    ]
    starts = [stop for stop in held if abs(angles[stop - 1] - rest) > AWAY]
    drops: list[Drop] = []
    for start, end in pairwise([*starts, len(angles)]):
        turns = _turns(angles[start:end], rates[start:end], rest, fastest) + start
        if len(turns) > MIN_HALVES:
            drop = Drop(
                name=name if len(starts) == 1 else f"{name}, drop {len(drops) + 1}",
                equation=equation,
                measured=measured,
                angles=angles,
                rates=rates,
                turns=turns,
                used=np.ones(len(turns) - 1, bool),
            )
            drops.append(drop)
    if not drops:
        swung = f"it moves through {np.rad2deg(np.nanmax(angles) - np.nanmin(angles)):.0f} degrees"
        raise BadData(
            f"'{name}' holds no drop, a limb let go {np.rad2deg(AWAY):.0f} degrees or more from"
            f" where it hangs that then swings {MIN_HALVES} half swings or more by itself: {swung};"
            " give its 'time', or record another"
        )
    return tuple(drops)


def _turns(angles: Array, rates: Array, rest: float, fastest: float) -> NDArray[np.intp]:
    """Find the release of a limb that was held, and every turn that follows.

    Parameters
    ----------
    angles, rates : (frames,) from the end of the hold [rad], [rad/s]
    rest : angle at which the limb hangs [rad]
    fastest : rate of the recording [rad/s]

    Returns
    -------
    (turns,) frames; none where the limb does not get fast
    """
    moving = np.flatnonzero(np.abs(rates) > RELEASED * fastest)
    towards = moving[np.sign(rates[moving]) == np.sign(rest - angles[0])] if len(moving) else moving
    if not len(towards):
        return np.zeros(0, np.intp)
    first = int(towards[0])
    crossings = first + 1 + np.flatnonzero(np.diff(np.sign(rates[first:])) != 0)
    turns = np.array([first, *crossings])
    small = np.abs(np.diff(angles[turns])) < MIN_EXCURSION
    # One small half swing may be where a muscle stopped the limb; two in a row are rest.
    small &= np.append(small[1:], True)
    return turns[: 1 + (int(np.argmax(small)) if small.any() else len(small))]


@dataclass(frozen=True)
class Activity:
    """A muscle that should be silent and is not.

    Attributes
    ----------
    muscle : name of the channel
    start, stop : of its activity [s]
    ratio : of its largest envelope to its level at rest
    """

    muscle: str
    start: float
    stop: float
    ratio: float


def activities(
    emg: Series, muscles: Sequence[str], rest: Sequence[tuple[float, float]]
) -> tuple[Activity, ...]:
    """Find where raw EMG rises above its level while the limb rests.

    Parameters
    ----------
    emg : raw
    muscles : channels that must be silent, all where none is named
    rest : times in which the limb is at rest [s]

    Raises
    ------
    BadData : a channel is unknown, or nothing shows its level
    """
    unknown = [name for name in muscles if name not in emg.names]
    if unknown:
        raise BadData(
            f"no EMG channel '{unknown[0]}': the recording has {listing(unknown[0], emg.names)}"
        )
    smooth = linear_envelope(emg, BAND)
    quiet = [
        (emg.time >= start) & (emg.time <= stop) for start, stop in rest if stop - start >= QUIET
    ]
    if not any(part.any() for part in quiet):
        raise BadData(
            f"the limb is never at rest for {QUIET:g} s, so the level of silent muscles is unknown:"
            " record a second more before the limb is let go, or until it hangs still"
        )
    result = []
    for name in muscles or emg.names:
        envelope = smooth[name]
        levels = [
            (float(envelope[part].mean()), float(envelope[part].std()))
            for part in quiet
            if part.any()
        ]
        level, spread = min(levels)
        for start, stop in runs(envelope > max(level + ABOVE * spread, 2.0 * level)):
            begin = float(emg.time[start])
            end = float(emg.time[stop - 1])
            if end - begin >= BURST:
                result.append(
                    Activity(
                        muscle=name,
                        start=begin,
                        stop=end,
                        ratio=float(envelope[start:stop].max()) / max(level, 1e-300),
                    )
                )
    return tuple(result)


def at_rest(drops: Sequence[Drop]) -> list[tuple[float, float]]:
    """Find the times of a recording in which its limb is at rest [s]."""
    speed = np.abs(drops[0].rates)
    time = drops[0].equation.time
    still = speed < STILL * np.nanmax(speed)
    return [(float(time[start]), float(time[stop - 1])) for start, stop in runs(still)]
