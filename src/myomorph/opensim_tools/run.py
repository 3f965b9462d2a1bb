"""OpenSim's tools run from their setup files: what `opensim-cmd run-tool` does, with the same names of results."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.io.osim.scale_setup import ScaleSetup
from myomorph.io.osim.tool_setups import InverseDynamicsSetup, InverseKinematicsSetup, read_setup
from myomorph.io.sto import table_from_motion, write_sto
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import GROUND, Model
from myomorph.model.series import Markers, Motion, Series, Table, Wrenches
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit
from myomorph.motion.marker_checks import MarkerCheckOptions, checked_kinematics
from myomorph.muscles.passive import passive_generalized_forces
from myomorph.opensim_tools.analyze import run_analyze
from myomorph.opensim_tools.outputs import ToolResult, Writers, check_outputs, needed, write_outputs
from myomorph.opensim_tools.scale import run_scale, tasks_of_setup
from myomorph.opensim_tools.states import indexed_frames, loads_at, overlap
from myomorph.report.trial.summary_lines import dynamics_line, kinematics_line
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.store.progress import progress
from myomorph.study.inputs import reading
from myomorph.study.trial.steps.id import torque_table


def run_tool(source: Path) -> ToolResult:
    """Run a setup file and write what it asks for, where it asks for it. Paths are relative to the setup file's folder,
    as OpenSim takes them.
    """
    setup = read_setup(source)
    if isinstance(setup, ScaleSetup):
        return run_scale(setup, source)
    if isinstance(setup, InverseKinematicsSetup):
        return run_inverse_kinematics(setup, source)
    if isinstance(setup, InverseDynamicsSetup):
        return run_inverse_dynamics(setup, source)
    return run_analyze(setup, source)


def run_inverse_kinematics(setup: InverseKinematicsSetup, source: Path) -> ToolResult:
    """Inverse kinematics of a marker file: the motion, marker errors, and the model's markers where asked for."""
    model_path = needed(setup.model, "model_file", source)
    markers_path = needed(setup.markers, "marker_file", source)
    name = setup.name or source.stem
    errors = setup.results / f"{name}_ik_marker_errors.sto" if setup.report_errors else None
    places = setup.results / f"{name}_ik_model_marker_locations.sto" if setup.report_locations else None
    targets = [path for path in (setup.output, errors, places) if path is not None]
    check_outputs(targets, (source, model_path, markers_path, setup.coordinates))

    model = reading.open_model(model_path)
    trial = reading.fitted_to(model, reading.read_recording(markers_path))
    assert trial.markers is not None
    markers = nearest_frames(trial.markers, setup.time_range, markers_path)
    options = tasks_of_setup(InverseKinematicsOptions(root_bounds=True), setup.tasks, setup.coordinates, model, source)
    with reading.about(source), progress(f"{name}: inverse kinematics", len(markers)) as advance:
        # As OpenSim, which takes labels as they are: what the checks find is reported, nothing is mended.
        checked = checked_kinematics(model, markers, options, MarkerCheckOptions(mend=False), advance)
    fit = checked.fit
    tables = {setup.output: table_from_motion(fit.motion, model), errors: error_table(fit)}
    if places is not None:
        tables[places] = location_table(model, fit)
    warnings = (
        *map(str, checked.findings),
        *setup.warnings,
        *(f"{model_path.name}: {text}" for text in model.warnings),
        *(f"{markers_path.name}: {text}" for text in trial.warnings),
    )
    return ToolResult(
        "InverseKinematicsTool", (kinematics_line(fit, model, markers),), write_outputs(table_writers(tables)), warnings
    )


def run_inverse_dynamics(setup: InverseDynamicsSetup, source: Path) -> ToolResult:
    """Inverse dynamics of a table of coordinates: the table of generalized forces. External forces are not filtered,
    and forces of the model's own that are not excluded are taken off, both as in OpenSim.
    """
    model_path = needed(setup.model, "model_file", source)
    motion_path = needed(setup.coordinates, "coordinates_file", source)
    target = table_path(setup.results, setup.output)
    check_outputs([target], (source, model_path, motion_path, setup.loads))

    model = reading.open_model(model_path)
    reading.has_mass(model, "inverse dynamics")
    recorded = reading.read_motion(motion_path, model)
    motion = indexed_frames(differentiate(recorded, setup.cutoff), setup.time_range, motion_path)
    wrenches = loads_at(setup.loads, model, recorded, motion)
    torques, warnings = net_torques(model, motion, wrenches, setup.excluded)
    torques = torques_in_order(model, torques)
    lines = f"{len(torques)} frames, {len(torques.names)} coordinates, {wrench_count(wrenches)} external forces"
    residual = dynamics_line(model, motion, torques, wrenches)
    lines += f"; {residual}" if residual else ""
    notes = () if wrenches is None else wrenches.notes
    written = write_outputs(table_writers({target: torque_table(torques, model)}))
    of_model = (f"{model_path.name}: {text}" for text in model.warnings)
    return ToolResult("InverseDynamicsTool", (lines,), written, (*notes, *setup.warnings, *of_model, *warnings))


def table_writers(tables: dict[Path | None, Table]) -> Writers:
    """What writes each table that has a path."""
    return {path: partial(write_sto, table) for path, table in tables.items() if path is not None}


def net_torques(
    model: Model, motion: Motion, wrenches: Wrenches | None, excluded: tuple[str, ...]
) -> tuple[Series, list[str]]:
    """Generalized forces less those of the model's own springs and dampers that are not excluded, and warnings."""
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
    return torques.columns([torques.names.index(name) for name in names])


def table_path(folder: Path, name: str) -> Path:
    """A table in the folder of results; OpenSim adds the ending where a name has none."""
    plain = Path(name.replace("\\", "/")).name
    return folder / (plain if Path(plain).suffix.lower() in (".sto", ".mot") else f"{plain}.sto")


def nearest_frames(markers: Markers, span: tuple[float, float], path: Path) -> Markers:
    """Frames from the one nearest to the start to the one nearest to the end [s]."""
    start, end = overlap(span, markers.time, path)
    first, last = (int(np.argmin(np.abs(markers.time - at))) for at in (start, end))
    return replace(markers, time=markers.time[first : last + 1], values=markers.values[first : last + 1])


def wrench_count(wrenches: Wrenches | None) -> int:
    """How many external forces there are."""
    return 0 if wrenches is None else len(wrenches.names)


def error_table(fit: KinematicsFit) -> Table:
    """Marker errors as OpenSim's inverse kinematics reports them: of all markers of a frame together."""
    total = np.nansum(fit.errors**2, axis=1)
    names = ("total_squared_error", "marker_error_RMS", "marker_error_max")
    facts = FrozenMap({"name": "Model Marker Errors from IK"})
    return Table(fit.motion.time, names, np.column_stack([total, fit.rms, fit.largest]), facts=facts)


def location_table(model: Model, fit: KinematicsFit) -> Table:
    """Where the model's markers are in every frame, in ground [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(fit.motion))
    points = poses.markers([model.marker(name) for name in fit.marker_names])
    names = tuple(f"{name}_t{axis}" for name in fit.marker_names for axis in "xyz")
    facts = FrozenMap({"name": "Model Marker Locations from IK"})
    return Table(fit.motion.time, names, points.reshape(len(points), -1), facts=facts)
