"""Coordinates that the step `refine` found for a trial, and the forces that belong to them."""

from __future__ import annotations

from collections.abc import Callable
from pathlib import Path

from myomorph.model.errors import BadFile
from myomorph.model.model import Model
from myomorph.model.series import Motion, Wrenches
from myomorph.motion.sync import resample_wrenches
from myomorph.study.trial.inputs import read_motion
from myomorph.study.trial.trial_inputs import RefinedMotion


def read_refined(path: Path, cutoff: float, model: Model) -> RefinedMotion:
    """Refined coordinates of a trial.

    Raises
    ------
    BadFile, BadData : it is no table of coordinates, or of another model
    """
    motion = read_motion(path, model)
    if motion.names != model.coordinate_names:
        raise BadFile(path, "is no refined motion of this model", "run the study again with --fresh")
    return RefinedMotion(motion, cutoff)


def filtered_loads(loads: Callable[[Motion], Wrenches], cutoff: float, motion: Motion) -> Wrenches:
    """External forces of a motion, filtered as they were when it was refined."""
    found = loads(motion)
    return resample_wrenches(found, found.time, cutoff)
