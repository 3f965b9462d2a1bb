"""What force plates weigh: a subject who stands still on them, or walks on belts that measure all of it."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.model.errors import BadData
from myomorph.store.settings import ForceOptions
from myomorph.study.analyze.plate_cover import LASTS, is_between_feet, total_force, uncovered_share
from myomorph.study.analyze.recordings import Recording

GRAVITY = 9.80665
LIGHT, HEAVY = 8.0, 300.0
"""A person weighs between these [kg]."""
STEADY = 0.02
"""Halves of what is weighed agree within this share, and somebody who stands still varies by no more."""
SECONDS = 1.5
"""A gait weighs its body in the mean over so long at least, whatever the steps at its ends carry [s]."""


def weighed(static: Recording | None, moving: Sequence[Recording], options: ForceOptions) -> tuple[float, str]:
    """Mass of the subject [kg] by the plates of the static trial, else of a long gait on belts, and a sentence on it.
    Raises `BadData`: no recording weighs the subject.
    """
    recordings = [*([static] if static is not None else []), *moving]
    for recording in sorted(recordings, key=lambda recording: not recording.still):
        mass = _mass(recording, options)
        if mass is not None:
            how = "standing still" if recording.still else "in the mean over the recording"
            return mass, f"Mass {mass:.1f} kg, as the plates of {recording.path.name} weigh it {how} (--mass)."
    raise BadData(
        "no mass was given, and no plate weighs the subject: neither somebody who stands still with both feet on "
        f"plates, nor {SECONDS:g} s of gait on belts that carry the whole body; give the mass (--mass KG)"
    )


def _mass(recording: Recording, options: ForceOptions) -> float | None:
    """Mass by a recording [kg], None where its plates do not carry all of the body, or not steadily."""
    measured = total_force(recording, options)
    if measured is None or len(measured[0]) < 2:
        return None
    time, force, center = measured
    mean = float(np.mean(force))
    first, second = (float(np.mean(half)) for half in np.array_split(force, 2))
    mass = round(mean / GRAVITY, 1)
    if not LIGHT < mass < HEAVY or abs(first - second) > STEADY * mean:
        return None
    if recording.still:
        return mass if np.std(force) < STEADY * mean and is_between_feet(recording, center) else None
    covered = uncovered_share(recording, mean, options) < LASTS
    return mass if covered and time[-1] - time[0] > SECONDS else None
