"""Coordinates that agree with markers and forces, in the place of those of inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.model.arrays import read_only
from myomorph.model.series import Motion


@read_only
@dataclass(frozen=True, eq=False)
class RefinedMotion:
    """Coordinates that agree with markers and forces.

    Attributes
    ----------
    cutoff : of the low-pass filter of the forces; the motion holds nothing much above it [Hz]
    """

    motion: Motion
    cutoff: float
