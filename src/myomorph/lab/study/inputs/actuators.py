"""Reserve and residual actuators beside the model's own."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from myomorph.core.model.model import Actuator
from myomorph.lab.store.results import file_source
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import File


@dataclass(frozen=True)
class ActuatorsFile:
    """OpenSim force set (.xml) of reserve and residual actuators."""

    actuators: Annotated[Path | None, File()] = None


@dataclass(frozen=True)
class Actuators:
    """Actuators beside the model's own; without any every coordinate has a weak reserve."""

    actuators: tuple[Actuator, ...]


def _open(settings: ActuatorsFile, opening: Opening) -> Opened:
    path = settings.actuators
    if path is None:
        return Opened()
    from myomorph.core.io.osim.actuators import read_actuators

    with reading.about(path):
        actuators = Actuators(read_actuators(path, opening.model))
    return Opened((actuators,), (file_source("actuators", path),))


INPUT = Input(name="actuators", settings=ActuatorsFile, open=_open, main="actuators")
