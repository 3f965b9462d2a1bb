"""Frames that all markers repeat, and frames that are missing though their numbers go on.

A frame in which every marker stands where it stood, to the last digit, was written twice. Where
frames are missing, every marker goes on along its own path by more than its neighbours in time say:
the step d_k is compared with the one that a cubic through the steps around it has there,

    (4 d_(k-1) + 4 d_(k+1) - d_(k-2) - d_(k+2)) / 6
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import MARKERS, RATES
from myomorph.core.model.findings import Finding
from myomorph.core.model.series import Markers

FROZEN = "frozen markers"
LOST = "lost frames"
"""Kinds of findings."""
REPEATS = 2
"""Steps without motion from which frames are repeated; one may be a doubled frame."""
MOVES = 0.5
"""Share of the other steps in which markers move, where one that stands still says anything."""
MISSING = 0.7
"""Missing frames at a step, from which it is one."""
SHARPER = 8.0
"""What a step with missing frames leaves, over what steps around it leave."""
ALONG = 0.6
"""Part of it that may be left once every marker has gone on along its path."""
AROUND = 25
"""Steps on both sides that are typical."""


def lost_findings(markers: Markers, names: Sequence[str]) -> Iterator[Finding]:
    """Find frames that are repeated or missing.

    Parameters
    ----------
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    names : of the markers that count

    Yields
    ------
    a finding for each stretch that is repeated, and for the clearest place with missing frames
    """
    values = markers.values[:, [markers.names.index(name) for name in names]]
    if len(values) < 12 or not len(names):
        return
    steps = np.diff(values, axis=0)
    still = _still(steps)
    for start, stop in runs(still):
        if stop - start < REPEATS or (~still).mean() < MOVES:
            continue
        span = (float(markers.time[start]), float(markers.time[stop]))
        text = MARKERS.message(
            f"no marker moves in {stop - start + 1} frames from {span[0]:.2f} to {span[1]:.2f} s:"
            " they are one frame repeated; leave this part out (--time), or export"
            " the recording again",
            severity="changes results",
        )
        yield Finding(kind=FROZEN, place="all markers", text=text, times=(span,))
    yield from _missing(markers, steps, still)


def _still(steps: Array) -> NDArray[np.bool_]:
    """Flag the steps (frames - 1, markers, 3) in which no marker moves and some are seen."""
    length = np.linalg.norm(steps, axis=2)
    seen = np.isfinite(length)
    moved = np.where(seen, length, 0.0).max(axis=1)
    return np.asarray((moved == 0.0) & (seen.sum(axis=1) >= 0.5 * seen.any(axis=0).sum()))


def _missing(markers: Markers, steps: Array, still: NDArray[np.bool_]) -> Iterator[Finding]:
    """Find the clearest step in which all markers go on by several frames' way."""
    expected = (4.0 * steps[1:-3] + 4.0 * steps[3:-1] - steps[:-4] - steps[4:]) / 6.0
    known = np.isfinite(expected + steps[2:-2])
    jump = np.where(known, steps[2:-2] - expected, 0.0)
    expected = np.where(known, expected, 0.0)
    squares = np.maximum((expected**2).sum(axis=(1, 2)), 1e-12)
    missing = (jump * expected).sum(axis=(1, 2)) / squares
    whole = np.sqrt((jump**2).sum(axis=(1, 2)))
    left = np.sqrt(((jump - missing[:, None, None] * expected) ** 2).sum(axis=(1, 2)))
    typical = np.array(
        [np.median(whole[max(0, k - AROUND) : k + AROUND + 1]) for k in range(len(whole))]
    )
    free = ~np.convolve(still, np.ones(7), "same").astype(bool)[2:-2]
    at = int(np.argmax(np.where(free, whole / np.maximum(typical, 1e-9), 0.0)))
    sharp = whole[at] > SHARPER * typical[at] and left[at] < ALONG * whole[at]
    if not (free[at] and missing[at] > MISSING and sharp):
        return
    time = float(markers.time[at + 3])
    text = RATES.message(
        f"all markers jump ahead by the distance of {missing[at]:.0f} frames at {time:.3f} s:"
        " frames are"
        " missing there though their numbers go on, so what follows is early; export the recording"
        " again, or use one side of it (--time)",
        size=missing[at] + 1.0,
    )
    yield Finding(kind=LOST, place="all markers", text=text, times=((time, time),))
