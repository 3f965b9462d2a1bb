"""OpenSim's MuscleAnalysis: lengths, forces and powers of fibers and tendons, moment arms and moments."""

from __future__ import annotations

from collections.abc import Iterator
from types import MappingProxyType

import numpy as np

from myomorph.io.osim.tool_setups import Analysis
from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.series import Table
from myomorph.opensim_tools.states import Analyzed

MOST_ENTRIES = 20_000_000
"""Moment arms (frames x muscles x coordinates) that are in memory at a time."""

Tables = dict[str, Table]

FIBERS = {
    "PennationAngle": "pennation",
    "FiberLength": "fiber_length",
    "TendonLength": "tendon_length",
    "FiberVelocity": "fiber_velocity",
    "NormFiberVelocity": "normalized_velocity",
    "PennationAngularVelocity": "pennation_velocity",
    "TendonForce": "tendon_force",
    "FiberForce": "fiber_force",
    "ActiveFiberForce": "active_force",
    "PassiveFiberForce": "passive_force",
    "FiberActivePower": "active_power",
    "FiberPassivePower": "passive_power",
    "TendonPower": "tendon_power",
    "MuscleActuatorPower": "muscle_power",
}
"""OpenSim's tables that are arrays of `FiberStates`."""


def muscle_analysis(here: Analyzed, analysis: Analysis) -> tuple[Tables, str, tuple[str, ...]]:
    """All tables of a MuscleAnalysis by their names, what was found, and warnings.

    Raises
    ------
    BadModel
        The model has no muscles.
    """
    model = here.model
    if not model.muscles:
        raise BadModel(f"model '{model.name}' has no muscles")
    names, unknown = listed(analysis.options.get("muscle_list", ""), model.muscle_names)
    notes = [f"{analysis.name}: muscle '{name}' is not in the model: left out" for name in unknown]
    moving = analysis.flag("compute_moments", True)
    about: tuple[str, ...] = ()
    if moving:
        about, unknown = listed(analysis.options.get("moment_arm_coordinate_list", ""), model.coordinate_names)
        notes += [f"{analysis.name}: coordinate '{name}' is not in the model: left out" for name in unknown]
    columns = [model.muscle_names.index(one) for one in names]
    found: dict[str, Array] = {"Length": here.paths.lengths[:, columns]}
    if here.without_fibers:
        classes = ", ".join(here.without_fibers)
        notes.append(f"{analysis.name} writes Length and MomentArm only: fibers of {classes} are not built")
    else:
        found |= _fibers(here, columns)
        notes += here.unbalanced
    pulls = None if here.without_fibers else here.fibers.tendon_force[:, columns]
    for name, arms in _moment_arms(here, columns, about):
        found[f"MomentArm_{name}"] = arms
        if pulls is not None:
            found[f"Moment_{name}"] = arms * pulls
    tables = {
        name: Table(here.motion.time, names, values, facts=MappingProxyType({"name": name}))
        for name, values in found.items()
    }
    text = f"muscle analysis: {len(here.motion)} frames, {len(names)} muscles, {len(about)} coordinates"
    return tables, text, tuple(notes)


def _fibers(here: Analyzed, columns: list[int]) -> dict[str, Array]:
    fibers = here.fibers
    found = {name: getattr(fibers, own)[:, columns] for name, own in FIBERS.items()}
    optimal = np.array([here.model.muscles[k].optimal_fiber_length for k in columns])
    cosine = np.cos(found["PennationAngle"])
    found["NormalizedFiberLength"] = found["FiberLength"] / optimal
    for name in ("ActiveFiberForce", "PassiveFiberForce"):
        found[f"{name}AlongTendon"] = found[name] * cosine
    return found


def _moment_arms(here: Analyzed, columns: list[int], about: tuple[str, ...]) -> Iterator[tuple[str, Array]]:
    """Moment arms (frames, muscles) about each coordinate [m or 1]."""
    if not about:
        return
    model, frames = here.model, len(here.motion)
    arms = np.empty((len(about), frames, len(columns)))
    wanted = [model.coordinate_names.index(one) for one in about]
    block = max(1, MOST_ENTRIES // (len(model.muscles) * len(model.coordinates)))
    for start in range(0, frames, block):
        part = slice(start, start + block)
        arms[:, part] = np.moveaxis(here.paths.dense(part)[:, columns][:, :, wanted], 2, 0)
    yield from zip(about, arms, strict=True)


def listed(words: str, names: tuple[str, ...]) -> tuple[tuple[str, ...], tuple[str, ...]]:
    """The names that a list asks for, in its order, all of them where it says so; and those that do not exist."""
    asked = tuple(words.split())
    if not asked or asked[0].lower() == "all":
        return names, ()
    return tuple(one for one in asked if one in names), tuple(one for one in asked if one not in names)
