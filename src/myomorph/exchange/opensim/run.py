"""OpenSim's tools run from their setup files, as by `opensim-cmd run-tool`.

Results have the same names.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.core.io.osim.actuators import read_actuators, write_controls
from myomorph.core.io.osim.scale_setup import ScaleSetup
from myomorph.core.io.sto import table_from_motion, write_sto
from myomorph.core.model.errors import BadData, listing
from myomorph.core.model.findings import messages_of_findings
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import GROUND, Actuator, Model
from myomorph.core.model.series import Markers, Motion, Series, Table, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit
from myomorph.core.motion.marker_checks import MarkerCheckOptions, checked_kinematics
from myomorph.core.muscles.passive import passive_generalized_forces
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.recruitment import EFFORT_ALONE
from myomorph.core.tension.solve import solve_tension
from myomorph.core.tension.tension import TensionOptions
from myomorph.exchange.causes import SETUPS
from myomorph.exchange.opensim.bodies import (
    body_kinematics,
    kinematics,
    muscle_analysis,
    point_kinematics,
)
from myomorph.exchange.opensim.forces import (
    actuation,
    force_columns,
    inverse_dynamics_analysis,
    joint_reaction,
    reported_forces,
    reported_states,
)
from myomorph.exchange.opensim.missing_torque import missing_torques
from myomorph.exchange.opensim.outputs import (
    ToolResult,
    Writers,
    check_outputs,
    needed,
    write_outputs,
)
from myomorph.exchange.opensim.scale import run_scale, tasks_of_setup
from myomorph.exchange.opensim.states import (
    Analyzed,
    Result,
    Tables,
    analyzed,
    indexed_frames,
    loads_at,
    overlap,
)
from myomorph.exchange.opensim.tool_setups import (
    Analysis,
    AnalyzeSetup,
    InverseDynamicsSetup,
    InverseKinematicsSetup,
    StaticOptimizationSettings,
    read_setup,
)
from myomorph.lab.report.trial.summary_lines import dynamics_line, kinematics_line, tension_line
from myomorph.lab.store.progress import progress
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.trial.steps.id import torque_table


def run_tool(source: Path) -> ToolResult:
    """Run a setup file and write what it requests, where it requests it.

    Paths are relative to the setup file's folder, as OpenSim takes them.
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
    """Run inverse kinematics of a marker file.

    Results are the motion, marker errors, and the model's markers where requested.
    """
    model_path = needed(setup.model, "model_file", source)
    markers_path = needed(setup.markers, "marker_file", source)
    name = setup.name or source.stem
    errors = setup.results / f"{name}_ik_marker_errors.sto" if setup.report_errors else None
    places = (
        setup.results / f"{name}_ik_model_marker_locations.sto" if setup.report_locations else None
    )
    targets = [path for path in (setup.output, errors, places) if path is not None]
    check_outputs(targets, (source, model_path, markers_path, setup.coordinates))

    model = reading.open_model(model_path)
    trial = reading.fitted_to(model, reading.read_recording(markers_path))
    assert trial.markers is not None
    markers = nearest_frames(trial.markers, setup.time_range, markers_path)
    options = tasks_of_setup(
        InverseKinematicsOptions(root_bounds=True, untracked_coordinates="default"),
        setup.tasks,
        setup.coordinates,
        model,
        source,
    )
    with reading.about(source), progress(f"{name}: inverse kinematics", len(markers)) as advance:
        # As OpenSim, which takes labels as they are: what the checks find is reported, nothing is
        # repaired.
        checked = checked_kinematics(
            model, markers, options, MarkerCheckOptions(repair=False), advance
        )
    fit = checked.fit
    tables = {setup.output: table_from_motion(fit.motion, model), errors: error_table(fit)}
    if places is not None:
        tables[places] = location_table(model, fit)
    warnings = (
        *messages_of_findings(checked.findings),
        *setup.warnings,
        *located(model_path.name, model.warnings),
        *located(markers_path.name, trial.warnings),
    )
    return ToolResult(
        tool="InverseKinematicsTool",
        lines=(kinematics_line(fit, model, markers),),
        written=write_outputs(table_writers(tables)),
        warnings=warnings,
    )


def run_inverse_dynamics(setup: InverseDynamicsSetup, source: Path) -> ToolResult:
    """Run inverse dynamics of a table of coordinates, to a table of generalized forces.

    External forces are not filtered, and forces of the model's own that are not excluded are taken
    off, both as in OpenSim.
    """
    model_path = needed(setup.model, "model_file", source)
    motion_path = needed(setup.coordinates, "coordinates_file", source)
    target = _torque_file(setup)
    check_outputs([target], (source, model_path, motion_path, setup.loads))

    model = reading.open_model(model_path)
    reading.has_mass(model, "inverse dynamics")
    recorded, odd = reading.read_noted_motion(motion_path, model)
    motion = indexed_frames(differentiate(recorded, setup.cutoff), setup.time_range, motion_path)
    wrenches = loads_at(setup.loads, model, recorded, motion)
    torques, warnings = net_torques(model, motion, wrenches, setup.excluded)
    torques = torques_in_order(model, torques)
    count = 0 if wrenches is None else len(wrenches.names)
    line = f"{len(torques)} frames, {len(torques.names)} coordinates, {count} external forces"
    residual = dynamics_line(model, motion, torques, wrenches)
    notes = () if wrenches is None else wrenches.notes
    of_model = located(model_path.name, model.warnings)
    return ToolResult(
        tool="InverseDynamicsTool",
        lines=(f"{line}; {residual}" if residual else line,),
        written=write_outputs(table_writers({target: torque_table(torques, model)})),
        warnings=(*odd, *notes, *setup.warnings, *of_model, *warnings),
    )


def _torque_file(setup: InverseDynamicsSetup) -> Path:
    """Return the file of generalized forces; OpenSim adds the ending where a name has none."""
    name = Path(setup.output.replace("\\", "/")).name
    has_ending = Path(name).suffix.lower() in (".sto", ".mot")
    return setup.results / (name if has_ending else f"{name}.sto")


def table_writers(tables: dict[Path | None, Table]) -> Writers:
    """Return a writer of each table that has a path."""
    return {path: partial(write_sto, table) for path, table in tables.items() if path is not None}


def net_torques(
    model: Model, motion: Motion, wrenches: Wrenches | None, excluded: tuple[str, ...]
) -> tuple[Series, list[Message]]:
    """Return generalized forces less those of the model's own springs and dampers.

    Those that are excluded are not taken off. The second value holds warnings.
    """
    words = {word.upper() for word in excluded}
    torques = inverse_dynamics(model, motion, wrenches)
    if "ALL" in words:
        return torques, []
    passive = passive_generalized_forces(model, motion, excluded)
    warnings = []
    if model.muscles and not words & {"MUSCLES", "ACTUATORS"}:
        warnings.append(
            SETUPS.message(
                "forces_to_exclude does not name Muscles: their forces are left out anyway"
            )
        )
    return replace(torques, values=torques.values - passive.values), warnings


def torques_in_order(model: Model, torques: Series) -> Series:
    """Return generalized forces in the order of OpenSim's InverseDynamicsTool.

    Joints are in the order of their distance from the ground.
    """
    depth = {GROUND: 0}
    for joint in model.joints:
        depth[joint.child] = depth[joint.parent] + 1
    joints = sorted(model.joints, key=lambda joint: depth[joint.child])
    names = [name for joint in joints for name in joint.coordinates]
    names += [name for name in torques.names if name not in names]
    return torques.columns([torques.names.index(name) for name in names])


def nearest_frames(markers: Markers, span: tuple[float, float], path: Path) -> Markers:
    """Frames from the one nearest to the start to the one nearest to the end [s]."""
    start, end = overlap(span, markers.time, path)
    first = int(np.argmin(np.abs(markers.time - start)))
    last = int(np.argmin(np.abs(markers.time - end)))
    return markers.frames(slice(first, last + 1))


def error_table(fit: KinematicsFit) -> Table:
    """Return marker errors as OpenSim's inverse kinematics reports them.

    They are those of all markers of a frame together.
    """
    total = np.nansum(fit.marker_error**2, axis=1)
    names = ("total_squared_error", "marker_error_RMS", "marker_error_max")
    facts = FrozenMap({"name": "Model Marker Errors from IK"})
    return Table(
        fit.motion.time, names, np.column_stack([total, fit.rms, fit.largest]), facts=facts
    )


def location_table(model: Model, fit: KinematicsFit) -> Table:
    """Where the model's markers are in every frame, in ground [m]."""
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(fit.motion))
    points = poses.markers([model.marker(name) for name in fit.marker_names])
    names = tuple(f"{name}_t{axis}" for name in fit.marker_names for axis in "xyz")
    facts = FrozenMap({"name": "Model Marker Locations from IK"})
    return Table(fit.motion.time, names, points.reshape(len(points), -1), facts=facts)


def run_analyze(setup: AnalyzeSetup, source: Path) -> ToolResult:
    """Run the analyses of a setup that exist here; the others are named in the warnings."""
    chosen, missing = _chosen_analyses(setup, source)
    model_path = needed(setup.model, "model_file", source)
    warnings = [*setup.warnings, *missing]

    model = reading.open_model(model_path)
    warnings += located(model_path.name, model.warnings)
    here, notes = analyzed(setup, model, _actuators(setup, model), source)
    warnings += notes
    lines: list[str] = []
    writers: dict[Path, Callable[[Path], object]] = {}
    controls: dict[Path, Callable[[Path], object]] = {}
    name = setup.name or source.stem
    for analysis in chosen:
        results, text, odd = ANALYSES[analysis.kind](here.every(analysis.step), analysis)
        lines.append(text)
        warnings += odd
        writers |= {
            setup.results / _table_name(name, analysis.name, end): partial(write_sto, table)
            for end, table in results.items()
        }
        if analysis.kind == "StaticOptimization":
            controls[setup.results / f"{name}_{analysis.name}_controls.xml"] = partial(
                write_controls, results["activation"]
            )
    writers |= controls
    if any(analysis.kind in WITH_FORCES for analysis in chosen) and here.wrenches is not None:
        warnings = [*here.wrenches.notes, *warnings]
    check_outputs(tuple(writers), (source, model_path, *_named_files(setup, chosen)))
    return ToolResult(
        tool="AnalyzeTool",
        lines=tuple(lines),
        written=write_outputs(writers),
        warnings=tuple(dict.fromkeys(warnings)),
    )


def _actuators(setup: AnalyzeSetup, model: Model) -> tuple[Actuator, ...]:
    """Read the actuators that a setup adds to the model."""
    actuators: tuple[Actuator, ...] = ()
    for path in setup.actuators:
        with reading.about(path):
            actuators += read_actuators(path, model)
    return actuators


def _table_name(*parts: str) -> str:
    """Return the file of a table, whose name joins the parts that are not empty."""
    stem = "_".join(part for part in parts if part)
    return f"{stem}.sto"


def _named_files(setup: AnalyzeSetup, chosen: Sequence[Analysis]) -> list[Path | None]:
    """Return the files that a setup and its analyses read, beside the model."""
    of_setup = (setup.coordinates, setup.states, setup.loads, *setup.actuators)
    return [*of_setup, *(analysis.forces for analysis in chosen)]


def _chosen_analyses(setup: AnalyzeSetup, source: Path) -> tuple[list[Analysis], list[Message]]:
    """Return the analyses of a setup that exist here, and a warning on each other one.

    Raises `BadData` where none exists.
    """
    chosen = [analysis for analysis in setup.analyses if analysis.kind in ANALYSES]
    others = dict.fromkeys(
        analysis.kind for analysis in setup.analyses if analysis.kind not in ANALYSES
    )
    if not chosen:
        asked = ", ".join(others) or "none"
        raise BadData(
            f"{source}: asks for {asked}, but the analyses that exist are"
            f" {listing(asked, tuple(ANALYSES))}"
        )
    return chosen, [
        SETUPS.message(f"analysis {kind} is left out: it is not supported") for kind in others
    ]


def _optimized(here: Analyzed, analysis: Analysis) -> Result:
    assert analysis.static_optimization is not None
    reading.has_mass(here.model, "static optimization")
    torques = inverse_dynamics(here.model, here.motion, here.wrenches)
    settings = analysis.static_optimization
    actuators = here.actuators
    tables, text, weak = _static_optimization(
        here.model, here.motion, torques, settings, actuators, analysis.name
    )
    forces = tables["force"]
    names, values, notes = force_columns(here, Series(forces.time, forces.names, forces.values))
    tables["force"] = replace(forces, names=names, values=values)
    return tables, text, (*weak, *located(analysis.name, notes))


ANALYSES: dict[str, Callable[[Analyzed, Analysis], Result]] = {
    "StaticOptimization": _optimized,
    "MuscleAnalysis": muscle_analysis,
    "JointReaction": joint_reaction,
    "BodyKinematics": body_kinematics,
    "PointKinematics": point_kinematics,
    "Kinematics": kinematics,
    "Actuation": actuation,
    "ForceReporter": reported_forces,
    "StatesReporter": reported_states,
    "InverseDynamics": inverse_dynamics_analysis,
}
"""What runs each kind of analysis."""

WITH_FORCES = ("StaticOptimization", "JointReaction", "InverseDynamics")
"""Kinds that external forces change: they are held against the motion, and findings come first."""


def _static_optimization(
    model: Model,
    motion: Motion,
    torques: Series,
    settings: StaticOptimizationSettings,
    actuators: Sequence[Actuator],
    name: str,
) -> tuple[Tables, str, list[Message]]:
    """Return activations and forces of muscles and actuators, by OpenSim's problem.

    So they are without the muscles' passive force. The text reports what is missing where muscles
    are too weak.
    """
    if not settings.use_model_forces:
        raise BadData(
            "StaticOptimization: use_model_force_set is false, which leaves no muscles to solve for"
        )
    options = TensionOptions(
        exponent=settings.exponent,
        passive=False,
        min_activation="model",
        curves="opensim" if settings.use_physiology else "constant",
    )
    with progress(f"{name}: static optimization", len(motion)) as advance:
        tension = solve_tension(
            model, motion, torques, options, actuators, advance, recruitment=EFFORT_ALONE
        )
    strength = {
        actuator.name: actuator.optimal_force for actuator in (*model.actuators, *actuators)
    }
    controls = tension.actuator_force / np.array(
        [strength[reserve_name] for reserve_name in tension.reserve_names]
    )
    names = (*tension.muscles, *tension.reserve_names)
    facts = FrozenMap({"name": "Static Optimization"})
    # OpenSim has viscosity as a force beside the muscle's.
    pulls = tension.muscle_force - tension.muscle_viscous_force
    tables = {
        "activation": Table(
            tension.time, names, np.hstack([tension.activation, controls]), facts=facts
        ),
        "force": Table(
            tension.time, names, np.hstack([pulls, tension.actuator_force]), facts=facts
        ),
    }
    weak = missing_torques(model, motion, torques, tension, actuators)
    return tables, f"static optimization: {tension_line(model, tension)}", weak
