"""What setups of OpenSim's tools name, read and fitted to the model."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import GROUND, Model
from myomorph.model.series import Markers, Motion, Series, Table, Wrenches
from myomorph.motion.ik import KinematicsFit
from myomorph.motion.sync import resample_wrenches
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.study.trial import inputs


def net_torques(
    model: Model, motion: Motion, wrenches: Wrenches | None, excluded: tuple[str, ...]
) -> tuple[Series, list[str]]:
    """Generalized forces less those of the model's own springs and dampers that are not excluded, and warnings."""
    from myomorph.muscles.passive import passive_generalized_forces
    from myomorph.rigid.dynamics import inverse_dynamics

    words = {word.upper() for word in excluded}
    torques = inverse_dynamics(model, motion, wrenches)
    if "ALL" in words:
        return torques, []
    passive = passive_generalized_forces(model, motion, excluded)
    warnings = []
    if model.muscles and not words & {"MUSCLES", "ACTUATORS"}:
        warnings.append("forces_to_exclude does not name Muscles: their forces are left out all the same")
    return replace(torques, values=torques.values - passive.values), warnings


def torques_in_order(model: Model, torques: Series) -> Series:
    """Generalized forces in the order of OpenSim's InverseDynamicsTool: joints by their distance from the ground."""
    depth = {GROUND: 0}
    for joint in model.joints:
        depth[joint.child] = depth[joint.parent] + 1
    joints = sorted(model.joints, key=lambda joint: depth[joint.child])
    names = [name for joint in joints for name in joint.coordinates]
    names += [name for name in torques.names if name not in names]
    columns = [torques.names.index(name) for name in names]
    return Series(torques.time, tuple(names), torques.values[:, columns])


def needed(path: Path | None, tag: str, source: Path) -> Path:
    """The path, or `BadData` that says which part of the setup is missing."""
    if path is None:
        raise BadData(f"{source}: names no {tag}")
    return path


def table_path(folder: Path, name: str) -> Path:
    """A table in the folder of results; OpenSim adds the ending where a name has none."""
    plain = Path(name.replace("\\", "/")).name
    return folder / (plain if Path(plain).suffix.lower() in (".sto", ".mot") else f"{plain}.sto")


def nearest_frames(markers: Markers, span: tuple[float, float], path: Path) -> Markers:
    """Frames from the one nearest to the start to the one nearest to the end [s]."""
    start, end = _overlap(span, markers.time, path)
    first, last = (int(np.argmin(np.abs(markers.time - at))) for at in (start, end))
    return replace(markers, time=markers.time[first : last + 1], values=markers.values[first : last + 1])


def indexed_frames(motion: Motion, span: tuple[float, float], path: Path) -> Motion:
    """Frames from the last at or before the start to the last at or before the end [s]."""
    start, end = _overlap(span, motion.time, path)
    first, last = (max(int(np.searchsorted(motion.time, at, side="right")) - 1, 0) for at in (start, end))
    return picked(motion, np.arange(first, last + 1))


def picked(motion: Motion, frames: np.ndarray) -> Motion:
    """Some frames of a motion."""
    parts: dict[str, Any] = {
        name: None if (given := getattr(motion, name)) is None else given[frames]
        for name in ("velocities", "accelerations")
    }
    return replace(motion, time=motion.time[frames], values=motion.values[frames], **parts)


def _overlap(span: tuple[float, float], time: Array, path: Path) -> tuple[float, float]:
    start, end = max(span[0], float(time[0])), min(span[1], float(time[-1]))
    if start > end:
        raise BadData(
            f"{path}: runs from {time[0]:g} to {time[-1]:g} s, so nothing is between {span[0]:g} and {span[1]:g} s"
        )
    return start, end


def loads_at(path: Path | None, model: Model, recorded: Motion, motion: Motion) -> Wrenches | None:
    """External forces at the motion's times, not filtered."""
    return None if path is None else resample_wrenches(inputs.open_loads(path, model, recorded), motion.time)


def wrench_count(wrenches: Wrenches | None) -> int:
    """How many external forces there are."""
    return 0 if wrenches is None else len(wrenches.names)


def error_table(fit: KinematicsFit) -> Table:
    """Marker errors as OpenSim's inverse kinematics reports them: of all markers of a frame together."""
    total = np.nansum(fit.errors**2, axis=1)
    names = ("total_squared_error", "marker_error_RMS", "marker_error_max")
    facts = MappingProxyType({"name": "Model Marker Errors from IK"})
    return Table(fit.motion.time, names, np.column_stack([total, fit.rms, fit.largest]), facts=facts)


def location_table(model: Model, fit: KinematicsFit) -> Table:
    """Where the model's markers are in every frame, in ground [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(fit.motion))
    marked = [model.marker(name) for name in fit.marker_names]
    bodies = np.array([tree.body_index[one.body] for one in marked], np.int64)
    points = poses.points(bodies, np.array([one.location for one in marked]))
    names = tuple(f"{name}_t{axis}" for name in fit.marker_names for axis in "xyz")
    facts = MappingProxyType({"name": "Model Marker Locations from IK"})
    return Table(fit.motion.time, names, points.reshape(len(points), -1), facts=facts)
