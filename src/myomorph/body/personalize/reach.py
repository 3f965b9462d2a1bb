"""Muscles whose path leaves the range that they can work in."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.body.personalize.recordings import Windows
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MUSCLES
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.paths import Muscle

OVERSTRETCHED = 1.8  # Normalized fiber length beyond which no muscle works


def cannot_reach(model: Model, windows: Sequence[Windows]) -> list[Message]:
    """Report muscles whose path is shorter than their slack tendon, or stretches them too far.

    Parameters
    ----------
    model : that personalization begins with
    windows : recordings

    Returns
    -------
    one line for each muscle that cannot reach in some frames
    """
    lengths = np.concatenate([window.lengths[window.counted] for window in windows])
    time = np.concatenate([window.time[window.counted] for window in windows])
    where = [window.name for window in windows for _ in range(int(window.counted.sum()))]
    notes = []
    for m, muscle in enumerate(model.muscles):
        if not muscle.enabled:
            continue
        excess = _excess(muscle, lengths[:, m])
        frames = int((excess > 0.0).any(axis=1).sum())
        if frames:
            frame, too_long = divmod(int(np.argmax(excess)), 2)
            reason = _reason(muscle, float(excess[frame, too_long]), bool(too_long))
            notes.append(
                MUSCLES.message(
                    f"muscle '{muscle.name}' cannot reach in {frames} of {len(time)} frames of the"
                    f" model given: its path {reason} at {time[frame]:.2f} s of '{where[frame]}'"
                )
            )
    return notes


def _excess(muscle: Muscle, lengths: Array) -> Array:
    """Compute by how much a path leaves the range of its muscle.

    Parameters
    ----------
    muscle : with its fiber and slack length
    lengths : (frames,) of its path [m]

    Returns
    -------
    (frames, 2) too short and too long, in optimal fiber lengths; 0 or less within the range
    """
    short = (muscle.tendon_slack_length - lengths) / muscle.optimal_fiber_length
    return np.stack([short, -short - OVERSTRETCHED], axis=1)


def _reason(muscle: Muscle, excess: float, too_long: bool) -> str:
    """Say what a path does to its muscle, by so many optimal fiber lengths."""
    if too_long:
        return (
            f"stretches it beyond {OVERSTRETCHED:g} optimal fiber lengths, to"
            f" {excess + OVERSTRETCHED:.2f}"
        )
    length = 1e3 * excess * muscle.optimal_fiber_length
    return f"is shorter than its slack tendon by {length:.0f} mm"
