"""OpenSim's tools run from their setup files: what `opensim-cmd run-tool` does, with the same names of results."""

from __future__ import annotations

from dataclasses import replace
from functools import partial
from pathlib import Path

from myomorph.io.osim.scale_setup import ScaleSetup
from myomorph.io.osim.tool_setups import InverseDynamicsSetup, InverseKinematicsSetup, read_setup
from myomorph.io.sto import table_from_motion, write_sto
from myomorph.model.series import Table
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.opensim_tools.inputs import (
    error_table,
    indexed_frames,
    loads_at,
    location_table,
    nearest_frames,
    needed,
    net_torques,
    table_path,
    torques_in_order,
    wrench_count,
)
from myomorph.opensim_tools.outputs import ToolResult, Writers, check_outputs, write_outputs
from myomorph.store.progress import progress
from myomorph.study.trial import inputs
from myomorph.study.trial.steps.id import torque_table
from myomorph.study.trial.trial_files import task_values, with_tasks


def run_tool(source: Path) -> ToolResult:
    """Run a setup file and write what it asks for, where it asks for it.

    Paths are relative to the setup file's folder, as OpenSim takes them.

    Raises
    ------
    MyomorphError
        where the file is no setup of a tool that exists, or an input is missing, wrong or would be overwritten
    """
    setup = read_setup(source)
    if isinstance(setup, ScaleSetup):
        from myomorph.opensim_tools.scale import run_scale

        return run_scale(setup, source)
    if isinstance(setup, InverseKinematicsSetup):
        return run_inverse_kinematics(setup, source)
    if isinstance(setup, InverseDynamicsSetup):
        return run_inverse_dynamics(setup, source)
    from myomorph.opensim_tools.analyze import run_analyze

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

    model = inputs.open_model(model_path)
    trial = inputs.fitted_to(model, inputs.open_trial(markers_path))
    assert trial.markers is not None
    markers = nearest_frames(trial.markers, setup.time_range, markers_path)
    options = with_tasks(InverseKinematicsOptions(), setup.tasks, model, str(source))
    options = replace(options, coordinates=task_values(setup.tasks, setup.coordinates, model, source))
    with inputs.about(source), progress(f"{name}: inverse kinematics", len(markers)) as advance:
        fit = inverse_kinematics(model, markers, options, advance)
    tables = {setup.output: table_from_motion(fit.motion, model), errors: error_table(fit)}
    if places is not None:
        tables[places] = location_table(model, fit)
    warnings = (
        *setup.warnings,
        *(f"{model_path.name}: {text}" for text in model.warnings),
        *(f"{markers_path.name}: {text}" for text in trial.warnings),
    )
    return ToolResult("InverseKinematicsTool", (fit.summary,), write_outputs(table_writers(tables)), warnings)


def run_inverse_dynamics(setup: InverseDynamicsSetup, source: Path) -> ToolResult:
    """Inverse dynamics of a table of coordinates: the table of generalized forces.

    External forces are not filtered, and forces of the model's own that are not excluded are taken off,
    both as in OpenSim.
    """
    model_path = needed(setup.model, "model_file", source)
    motion_path = needed(setup.coordinates, "coordinates_file", source)
    target = table_path(setup.results, setup.output)
    check_outputs([target], (source, model_path, motion_path, setup.loads))

    model = inputs.open_model(model_path)
    inputs.has_mass(model, "inverse dynamics")
    recorded = inputs.open_motion(motion_path, model)
    motion = indexed_frames(differentiate(recorded, setup.cutoff), setup.time_range, motion_path)
    wrenches = loads_at(setup.loads, model, recorded, motion)
    torques, warnings = net_torques(model, motion, wrenches, setup.excluded)
    torques = torques_in_order(model, torques)
    told = f"{len(torques)} frames, {len(torques.names)} coordinates, {wrench_count(wrenches)} external forces"
    written = write_outputs(table_writers({target: torque_table(torques, model)}))
    own = (f"{model_path.name}: {text}" for text in model.warnings)
    return ToolResult("InverseDynamicsTool", (told,), written, (*setup.warnings, *own, *warnings))


def table_writers(tables: dict[Path | None, Table]) -> Writers:
    """What writes each table that has a path."""
    return {path: partial(write_sto, table) for path, table in tables.items() if path is not None}
