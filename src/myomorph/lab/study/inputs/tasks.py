"""Weights of markers and aims of coordinates, from an OpenSim task set."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.lab.store.results import file_source
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import File
from myomorph.lab.study.inputs.reading import about

if TYPE_CHECKING:
    from myomorph.core.io.osim.setup_parts import IkTasks
    from myomorph.core.motion.ik import InverseKinematicsOptions


@dataclass(frozen=True)
class TasksFile:
    """OpenSim task set or setup file with the weights of markers and coordinates."""

    tasks: Annotated[Path | None, File()] = None


def _open(settings: TasksFile, opening: Opening) -> Opened:
    path = settings.tasks
    if path is None:
        return Opened()
    from myomorph.core.io.osim.setup_parts import read_ik_tasks
    from myomorph.core.motion.ik import InverseKinematicsOptions

    with about(path):
        tasks = read_ik_tasks(path)
    options = with_tasks(opening.options[InverseKinematicsOptions], tasks, opening.model, str(path))
    return Opened(sources=(file_source("tasks", path),), options=(options,))


INPUT = Input(name="tasks", settings=TasksFile, open=_open, main="tasks")


def with_tasks(
    options: InverseKinematicsOptions, tasks: IkTasks, model: Model, source: str
) -> InverseKinematicsOptions:
    """Return options with the weights and aims of an OpenSim task set.

    One without markers leaves all of them at 1. Raises `BadData` where the set gives no marker of
    the model a weight.
    """
    from myomorph.core.motion.tasks.coordinates import CoordinateTask

    weights = {
        name: weight for name, weight in tasks.marker_weights.items() if name in model.marker_names
    }
    if tasks.marker_weights and not any(weights.values()):
        raise BadData(f"{source}: gives no marker of model '{model.name}' a weight")
    aims = []
    for aim in tasks.coordinates:
        if aim.weight > 0.0 and aim.coordinate in model.coordinate_names:
            default = model.coordinate(aim.coordinate).default
            value = {"value": aim.value, "default": default, "table": None}[aim.source]
            aims.append(CoordinateTask(aim.coordinate, aim.weight, value))
    only = bool(tasks.marker_weights)
    return replace(
        options, marker_weights=weights, only_weighted=only, tasks=(*options.tasks, *aims)
    )
