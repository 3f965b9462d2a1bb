"""OpenSim's AnalyzeTool: one motion, and what each of its analyses writes of it."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.io.osim.actuators import read_actuators, write_controls
from myomorph.io.osim.tool_setups import Analysis, AnalyzeSetup, StaticOptimizationSettings
from myomorph.io.sto import write_sto
from myomorph.model.errors import BadData, listing
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series, Table
from myomorph.opensim_tools.bodies import body_kinematics, kinematics, muscle_analysis, point_kinematics
from myomorph.opensim_tools.forces import (
    actuation,
    force_columns,
    inverse_dynamics_analysis,
    joint_reaction,
    reported_forces,
    reported_states,
)
from myomorph.opensim_tools.outputs import ToolResult, check_outputs, needed, write_outputs
from myomorph.opensim_tools.states import Analyzed, Result, Tables, analyzed
from myomorph.report.trial.summary_lines import tension_line
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.store.progress import progress
from myomorph.study.inputs import reading
from myomorph.tension.solve import solve_tension
from myomorph.tension.tension import TensionOptions


def run_analyze(setup: AnalyzeSetup, source: Path) -> ToolResult:
    """Run the analyses of a setup that exist here; the others are named in the warnings."""
    built = [analysis for analysis in setup.analyses if analysis.kind in ANALYSES]
    others = tuple(dict.fromkeys(analysis.kind for analysis in setup.analyses if analysis.kind not in ANALYSES))
    if not built:
        asked = ", ".join(others) or "none"
        raise BadData(f"{source}: asks for {asked}, but the analyses that exist are {listing(asked, tuple(ANALYSES))}")
    model_path = needed(setup.model, "model_file", source)
    warnings = [*setup.warnings, *(f"analysis {kind} is left out: it is not built" for kind in others)]

    model = reading.open_model(model_path)
    warnings += [f"{model_path.name}: {text}" for text in model.warnings]
    here, notes = analyzed(setup, model, _actuators(setup, model), source)
    warnings += notes
    lines: list[str] = []
    tables: dict[Path, Table] = {}
    controls: dict[Path, Table] = {}
    name = setup.name or source.stem
    for analysis in built:
        results, text, odd = ANALYSES[analysis.kind](here.every(analysis.step), analysis)
        lines.append(text)
        warnings += odd
        for end, table in results.items():
            tables[setup.results / f"{'_'.join(part for part in (name, analysis.name, end) if part)}.sto"] = table
        if analysis.kind == "StaticOptimization":
            controls[setup.results / f"{name}_{analysis.name}_controls.xml"] = results["activation"]
    if any(analysis.kind in WITH_FORCES for analysis in built) and here.wrenches is not None:
        warnings = [*here.wrenches.notes, *warnings]
    named = (setup.coordinates, setup.states, setup.loads, *setup.actuators, *(analysis.forces for analysis in built))
    check_outputs((*tables, *controls), (source, model_path, *named))
    writers: dict[Path, Callable[[Path], object]] = {path: partial(write_sto, table) for path, table in tables.items()}
    writers |= {path: partial(write_controls, control) for path, control in controls.items()}
    return ToolResult("AnalyzeTool", tuple(lines), write_outputs(writers), tuple(dict.fromkeys(warnings)))


def _optimized(here: Analyzed, analysis: Analysis) -> Result:
    assert analysis.static_optimization is not None
    reading.has_mass(here.model, "static optimization")
    torques = inverse_dynamics(here.model, here.motion, here.wrenches)
    settings, actuators = analysis.static_optimization, here.actuators
    tables, text = static_optimization(here.model, here.motion, torques, settings, actuators, analysis.name)
    forces = tables["force"]
    names, values, notes = force_columns(here, Series(forces.time, forces.names, forces.values))
    tables["force"] = replace(forces, names=names, values=values)
    return tables, text, tuple(f"{analysis.name}: {note}" for note in notes)


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


def static_optimization(
    model: Model,
    motion: Motion,
    torques: Series,
    settings: StaticOptimizationSettings,
    actuators: Sequence[Actuator],
    name: str,
) -> tuple[Tables, str]:
    """Activations and forces of muscles and actuators: OpenSim's problem, so without the muscles' passive force."""
    if not settings.use_model_forces:
        raise BadData("StaticOptimization: use_model_force_set is false, which leaves no muscles to solve for")
    options = TensionOptions(
        exponent=settings.exponent,
        passive=False,
        min_activation="model",
        curves="opensim" if settings.use_physiology else "constant",
    )
    with progress(f"{name}: static optimization", len(motion)) as advance:
        tension = solve_tension(model, motion, torques, options, actuators, advance)
    strength = {actuator.name: actuator.optimal_force for actuator in (*model.actuators, *actuators)}
    controls = tension.reserves / np.array([strength[reserve_name] for reserve_name in tension.reserve_names])
    names = (*tension.muscles, *tension.reserve_names)
    facts = FrozenMap({"name": "Static Optimization"})
    # OpenSim has viscosity as a force beside the muscle's.
    pulls = tension.forces - tension.viscous
    tables = {
        "activation": Table(tension.time, names, np.hstack([tension.activations, controls]), facts=facts),
        "force": Table(tension.time, names, np.hstack([pulls, tension.reserves]), facts=facts),
    }
    return tables, f"static optimization: {tension_line(model, tension)}"


def _actuators(setup: AnalyzeSetup, model: Model) -> tuple[Actuator, ...]:
    result: tuple[Actuator, ...] = ()
    for path in setup.actuators:
        with reading.about(path):
            result += read_actuators(path, model)
    return result
