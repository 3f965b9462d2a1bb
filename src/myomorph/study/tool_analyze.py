"""OpenSim's AnalyzeTool: muscle lengths and moment arms, muscle forces by static optimization, loads of joints."""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from types import MappingProxyType

import numpy as np

from myomorph.io.actuators import read_actuators
from myomorph.io.sto import write_sto
from myomorph.io.tool_setups import Analysis, AnalyzeSetup, StaticOptimizationSettings
from myomorph.model.errors import BadData, BadModel, listing
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series, Table
from myomorph.motion.filters import differentiate
from myomorph.rigid.closed_motion import closed_motion
from myomorph.study import inputs
from myomorph.study.progress import progress
from myomorph.study.tool_outputs import ToolResult, check_outputs, write_outputs
from myomorph.study.tool_reactions import joint_reaction, with_speeds
from myomorph.study.tools import indexed_frames, loads_at, needed, picked

KINDS = ("StaticOptimization", "MuscleAnalysis", "JointReaction")
MOST_ENTRIES = 20_000_000
"""Moment arms (frames x muscles x coordinates) that are in memory at a time."""

TWIN = 1e-6
"""A frame that follows within this share of the usual step stands at the time of the one before."""

Tables = dict[str, Table]


def run_analyze(setup: AnalyzeSetup, source: Path) -> ToolResult:
    """Run the analyses of a setup that exist here; the others are named in the warnings.

    Raises
    ------
    BadData
        where none of them exists
    """
    built = [one for one in setup.analyses if one.kind in KINDS]
    others = tuple(dict.fromkeys(one.kind for one in setup.analyses if one.kind not in KINDS))
    if not built:
        asked = ", ".join(others) or "none"
        raise BadData(f"{source}: asks for {asked}, but the analyses that exist are {listing(asked, KINDS)}")
    model_path = needed(setup.model, "model_file", source)
    motion_path = needed(setup.coordinates or setup.states, "coordinates_file", source)
    warnings = [*setup.warnings, *(f"analysis {kind} is left out: it is not built" for kind in others)]

    model = inputs.open_model(model_path)
    warnings += [f"{model_path.name}: {text}" for text in model.warnings]
    recorded, twice = without_twins(inputs.open_motion(motion_path, model))
    warnings += twice
    # As OpenSim's tool, which assembles the model in every frame; its InverseDynamicsTool does not.
    whole, notes = closed_motion(model, differentiate(recorded, setup.cutoff))
    warnings += notes
    motion = indexed_frames(whole, setup.time_range, motion_path)
    first = int(np.searchsorted(whole.time, motion.time[0]))
    told: list[str] = []
    tables: dict[Path, Table] = {}
    name = setup.name or source.stem
    for analysis in built:
        part = picked(motion, stepped(first, len(motion), analysis.step))
        if analysis.static_optimization is not None:
            torques = _torques(setup, model, recorded, part)
            actuators = _actuators(setup, model)
            of_muscles = replace(model, muscles=(), actuators=()) if setup.replace_forces else model
            found, text = static_optimization(of_muscles, part, torques, analysis.static_optimization, actuators, name)
        elif analysis.kind == "JointReaction":
            found, text, notes = _reactions(setup, model, recorded, part, analysis)
            warnings += notes
        else:
            found, text = muscle_analysis(model, part, analysis)
            warnings.append("MuscleAnalysis writes Length and MomentArm: fibers and forces are left out")
        told.append(text)
        tables |= {setup.results / f"{name}_{analysis.name}_{one}.sto": table for one, table in found.items()}
    read = (source, model_path, motion_path, setup.loads, *setup.actuators, *(one.forces for one in built))
    check_outputs(tables, read)
    writers: dict[Path, Callable[[Path], object]] = {path: partial(write_sto, one) for path, one in tables.items()}
    return ToolResult("AnalyzeTool", tuple(told), write_outputs(writers), tuple(dict.fromkeys(warnings)))


def stepped(first: int, count: int, step: int) -> np.ndarray:
    """The frames that OpenSim analyses of `count` from the file's frame `first` on: the ends, and every `step`-th."""
    frames = np.arange(count)
    return frames[(frames == 0) | (frames == count - 1) | ((frames + first) % step == 0)]


def without_twins(motion: Motion) -> tuple[Motion, tuple[str, ...]]:
    """A motion without frames at the time of the one before, which integrators log and no spline bears, and a note."""
    steps = np.diff(motion.time)
    keep = np.concatenate([[True], steps > TWIN * np.median(steps)]) if len(steps) else np.array([True])
    found = picked(motion, np.arange(len(motion))[keep])
    gone = len(motion) - len(found)
    return found, (f"{gone} frames were left out: their time is that of the frame before",) if gone else ()


def static_optimization(
    model: Model,
    motion: Motion,
    torques: Series,
    settings: StaticOptimizationSettings,
    actuators: Sequence[Actuator],
    name: str,
) -> tuple[Tables, str]:
    """Activations and forces of muscles and actuators: OpenSim's problem, so without the muscles' passive force."""
    from myomorph.tension.solve import TensionOptions, solve_tension

    if not settings.use_model_forces:
        raise BadData("StaticOptimization: use_model_force_set is false, which leaves no muscles to solve for")
    curves = "opensim" if settings.use_physiology else "constant"
    options = TensionOptions(exponent=settings.exponent, passive=False, curves=curves)  # type: ignore[arg-type]
    with progress(f"{name}: static optimization", len(motion)) as advance:
        tension = solve_tension(model, motion, torques, options, actuators, advance)
    strength = {one.name: one.optimal_force for one in (*model.actuators, *actuators)}
    controls = tension.reserves / np.array([strength[one] for one in tension.reserve_names])
    names = (*tension.muscles, *tension.reserve_names)
    facts = MappingProxyType({"name": "Static Optimization"})
    # OpenSim has viscosity as a force beside the muscle's.
    pulls = tension.forces - tension.viscous
    tables = {
        "activation": Table(tension.time, names, np.hstack([tension.activations, controls]), facts=facts),
        "force": Table(tension.time, names, np.hstack([pulls, tension.reserves]), facts=facts),
    }
    text = f"static optimization: {len(tension)} frames, {int(tension.optimal.sum())} optimal"
    if tension.reserves.size and np.isfinite(tension.reserves).any():
        worst = np.unravel_index(int(np.nanargmax(np.abs(tension.reserves))), tension.reserves.shape)
        text += f", largest reserve {abs(tension.reserves[worst]):.3g} ({tension.reserve_names[worst[1]]})"
    return tables, text


def muscle_analysis(model: Model, motion: Motion, analysis: Analysis) -> tuple[Tables, str]:
    """Lengths of muscle paths, and moment arms about the coordinates that the analysis names, a table each."""
    from myomorph.muscles.path import muscle_kinematics

    if not model.muscles:
        raise BadModel(f"model '{model.name}' has no muscles")
    names = _listed(analysis.options.get("muscle_list", ""), model.muscle_names)
    columns = [model.muscle_names.index(one) for one in names]
    moving = analysis.options.get("compute_moments", "true").lower() in ("true", "1")
    about = _listed(analysis.options.get("moment_arm_coordinate_list", ""), model.coordinate_names) if moving else ()
    kinematics = muscle_kinematics(model, motion, velocities=False, moment_arms=bool(about))
    facts = MappingProxyType({"name": "MuscleAnalysis"})
    tables = {"Length": Table(motion.time, names, kinematics.lengths[:, columns], facts=facts)}
    if about:
        arms = np.empty((len(about), len(motion), len(names)))
        wanted = [model.coordinate_names.index(one) for one in about]
        block = max(1, MOST_ENTRIES // (len(model.muscles) * len(model.coordinates)))
        for start in range(0, len(motion), block):
            frames = slice(start, start + block)
            arms[:, frames] = np.moveaxis(kinematics.dense(frames)[:, columns][:, :, wanted], 2, 0)
        tables |= {
            f"MomentArm_{one}": Table(motion.time, names, table, facts=facts)
            for one, table in zip(about, arms, strict=True)
        }
    return tables, f"muscle analysis: {len(motion)} frames, {len(names)} muscles, {len(about)} coordinates"


def _listed(words: str, names: tuple[str, ...]) -> tuple[str, ...]:
    asked = words.split()
    return names if not asked or "all" in asked else tuple(one for one in names if one in asked)


def _reactions(
    setup: AnalyzeSetup, model: Model, recorded: Motion, motion: Motion, analysis: Analysis
) -> tuple[Tables, str, tuple[str, ...]]:
    inputs.has_mass(model, "joint reactions")
    wrenches = loads_at(setup.loads, model, recorded, motion)
    if setup.coordinates is None and setup.states is not None:
        motion = with_speeds(setup.states, model, motion)
    whole = replace(model, muscles=(), actuators=()) if setup.replace_forces else model
    table, text, notes = joint_reaction(whole, motion, wrenches, analysis, _actuators(setup, model))
    return {"ReactionLoads": table}, text, notes


def _torques(setup: AnalyzeSetup, model: Model, recorded: Motion, motion: Motion) -> Series:
    from myomorph.rigid.dynamics import inverse_dynamics

    inputs.has_mass(model, "static optimization")
    return inverse_dynamics(model, motion, loads_at(setup.loads, model, recorded, motion))


def _actuators(setup: AnalyzeSetup, model: Model) -> tuple[Actuator, ...]:
    found: tuple[Actuator, ...] = ()
    for path in setup.actuators:
        with inputs.about(path):
            found += read_actuators(path, model)
    return found
