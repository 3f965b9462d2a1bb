"""Weights of markers and aims of coordinates, from an OpenSim task set."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from myomorph.study.inputs.input import Input, later
from myomorph.study.inputs.keys import File


@dataclass(frozen=True)
class TasksFile:
    """Tasks of inverse kinematics.

    Attributes
    ----------
    tasks : OpenSim task set or setup file: weights of markers
    """

    tasks: Annotated[Path | None, File()] = None


INPUT = Input(name="tasks", settings=TasksFile, open=later("myomorph.study.inputs.tasks_file:opened"), main="tasks")
