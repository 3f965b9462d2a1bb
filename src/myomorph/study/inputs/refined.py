"""Coordinates that agree with markers and forces, in the place of those of inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path

from myomorph.model.arrays import read_only
from myomorph.model.series import Motion
from myomorph.study.inputs.input import Input, later


@dataclass(frozen=True)
class RefinedFile:
    """What the subject's step `refine` found of a trial. `path`: of its coordinates; no such file where the trial was
    not among its own; `cutoff`: of the low-pass filter of the forces that these agree with [Hz].
    """

    path: Path
    cutoff: float


@read_only
class RefinedMotion:
    """Coordinates that agree with markers and forces. `cutoff`: of the low-pass filter of the forces; the motion holds
    nothing much above it [Hz].
    """

    motion: Motion
    cutoff: float


INPUT = Input(name="refined", settings=RefinedFile, open=later("myomorph.study.inputs.refined_motion:opened"))
