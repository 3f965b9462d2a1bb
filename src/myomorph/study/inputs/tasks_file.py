"""OpenSim task sets as options of inverse kinematics."""

from __future__ import annotations

from dataclasses import replace

from myomorph.io.osim.setup_parts import IkTasks, read_ik_tasks
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.motion.ik import InverseKinematicsOptions
from myomorph.motion.tasks.coordinates import CoordinateTask
from myomorph.store.results import file_source
from myomorph.study.inputs.input import Opened, Opening
from myomorph.study.inputs.reading import about
from myomorph.study.inputs.tasks import TasksFile


def opened(settings: TasksFile, opening: Opening) -> Opened:
    """Options of inverse kinematics with those of a task set."""
    path = settings.tasks
    if path is None:
        return Opened()
    with about(path):
        tasks = read_ik_tasks(path)
    options = with_tasks(opening.options[InverseKinematicsOptions], tasks, opening.model, str(path))
    return Opened(sources=(file_source("tasks", path),), options=(options,))


def with_tasks(
    options: InverseKinematicsOptions, tasks: IkTasks, model: Model, source: str
) -> InverseKinematicsOptions:
    """Options with the weights and aims of an OpenSim task set; one without markers leaves all of them at 1. Raises
    `BadData` where the set gives no marker of the model a weight.
    """
    known = set(model.marker_names)
    weights = {name: weight for name, weight in tasks.marker_weights.items() if name in known}
    if tasks.marker_weights and not any(weights.values()):
        raise BadData(f"{source}: gives no marker of model '{model.name}' a weight")
    aims = []
    for aim in tasks.coordinates:
        if aim.weight > 0.0 and aim.coordinate in model.coordinate_names:
            default = model.coordinate(aim.coordinate).default
            value = {"value": aim.value, "default": default, "table": None}[aim.source]
            aims.append(CoordinateTask(aim.coordinate, aim.weight, value))
    only = bool(tasks.marker_weights)
    return replace(options, marker_weights=weights, only_weighted=only, tasks=(*options.tasks, *aims))
