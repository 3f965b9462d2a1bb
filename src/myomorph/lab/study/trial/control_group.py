"""A control group of the user's own: people whose results lie in folders, as a norm of gait."""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.model.arrays import read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.analysis.gait_curves import SIDES, GaitCurves, joined_curves
from myomorph.lab.analysis.gait_parameters import ParameterTable, gait_parameters
from myomorph.lab.analysis.gait_scores import GaitNorm, control_norm
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.report.trial.prepared import Prepared
from myomorph.lab.store.results import Stored, read_result, result_files
from myomorph.lab.study.step.step import large_variables
from myomorph.lab.study.trial.norm_file import SPEED


@read_only
class ControlPerson:
    """A person of a control group.

    Attributes
    ----------
    curves : over all strides of the person's walks
    parameters : mean of both sides, by the names of `gait_parameters`
    age : [years], None where it is not stated
    """

    curves: GaitCurves
    parameters: Mapping[str, float]
    age: float | None


def control_people(
    folders: Iterable[str], prepared: Callable[[Path, Stored], Prepared]
) -> Mapping[str, ControlPerson]:
    """Read the walks of a control group.

    Parameters
    ----------
    folders : of results
    prepared : what follows from the results of a trial

    Returns
    -------
    by the person's name
    """
    walks: dict[str, list[Prepared]] = {}
    for path in (path for folder in folders for path in result_files(Path(folder))):
        stored = read_result(path, leave_out=large_variables())
        walk = prepared(path, stored)
        if walk.gait is not None:
            walks.setdefault(stored.facts.get("subject", path.stem), []).append(walk)
    return FrozenMap({name: _person(parts) for name, parts in walks.items()})


def _person(walks: Sequence[Prepared]) -> ControlPerson:
    """Return a person of all walks together."""
    ages = [walk.results.recorded.age for walk in walks]
    curves = [walk.gait for walk in walks if walk.gait is not None]
    strides: list[Strides] = [walk.strides for walk in walks if walk.strides is not None]
    return ControlPerson(
        curves=joined_curves(curves),
        parameters=FrozenMap(_means(gait_parameters(*strides))),
        age=next((age for age in ages if age is not None), None),
    )


def _means(parameters: ParameterTable) -> dict[str, float]:
    """Return the mean of both sides of each parameter."""
    return {
        name: float(np.mean([sides[side].mean for side in SIDES if side in sides]))
        for name, sides in parameters.items()
        if sides
    }


def group_norm(people: Sequence[ControlPerson], source: str) -> GaitNorm:
    """Return a control group as a norm.

    It fits speeds within two standard deviations of the people's own, and their ages, where all are
    stated.

    Raises
    ------
    BadData : they are too few
    """
    norm = control_norm([person.curves for person in people], source)
    names = dict.fromkeys(name for person in people for name in person.parameters)
    parameters = {name: _mean_and_sd(people, name) for name in names}
    return replace(
        norm,
        parameters=FrozenMap(parameters),
        ages=_ages(people),
        speeds=_speeds(people, parameters.get(SPEED)),
        group="controls",
    )


def _mean_and_sd(people: Sequence[ControlPerson], name: str) -> tuple[float, float]:
    """Return mean and standard deviation between people of a parameter."""
    values = [person.parameters[name] for person in people if name in person.parameters]
    sd = float(np.std(values, ddof=1)) if len(values) > 1 else float("nan")
    return float(np.mean(values)), sd


def _ages(people: Sequence[ControlPerson]) -> tuple[float, float]:
    """Return the youngest and the oldest, all ages where one is not stated."""
    ages = [person.age for person in people if person.age is not None]
    if len(ages) < len(people):
        return 0.0, np.inf
    return min(ages), max(ages)


def _speeds(
    people: Sequence[ControlPerson], usual: tuple[float, float] | None
) -> tuple[float, float]:
    """Return speeds that the group is a norm for."""
    speeds = [person.parameters[SPEED] for person in people if SPEED in person.parameters]
    if usual is None or len(speeds) < len(people):
        return 0.0, np.inf
    mean, sd = usual
    return min(mean - 2.0 * sd, *speeds), max(mean + 2.0 * sd, *speeds)
