"""Coordinates of a file, in the place of inverse kinematics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from myomorph.core.model.causes import UNSEEN
from myomorph.core.model.messages import located
from myomorph.core.model.series import Motion
from myomorph.lab.store.results import file_source
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import File


@dataclass(frozen=True)
class MotionFile:
    """Coordinates over time (.mot or .sto)."""

    motion: Annotated[Path | None, File(per="trial")] = None


@dataclass(frozen=True, eq=False)
class RecordedMotion:
    """Coordinates of a file, all of the model's (frames, coordinates) [rad or m]."""

    motion: Motion


def _open(settings: MotionFile, opening: Opening) -> Opened:
    path = settings.motion
    model = opening.model
    if path is None:
        return Opened()
    read = reading.read_noted_motion(path, model)
    recorded, lacking = reading.whole_motion(read.motion, model)
    recorded, apart = reading.coupled_motion(recorded, model)
    warnings = (*read.notes, *located(path.name, apart))
    if lacking:
        warnings = (
            *warnings,
            UNSEEN.message(f"{path.name}: lacks {', '.join(lacking)}: they stay at their defaults"),
        )
    return Opened(
        values=(RecordedMotion(recorded),),
        sources=(file_source("motion", path),),
        warnings=warnings,
        real=f"coordinates from {path.name}",
    )


INPUT = Input(name="motion", settings=MotionFile, open=_open, main="motion", holds=("error sizes",))
