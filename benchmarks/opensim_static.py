"""OpenSim's static optimization and joint reactions (AnalyzeTool) on our cases.

Their results are forces, and the seconds they took.
"""

from __future__ import annotations

import tempfile
import time
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import opensim

import myomorph as mm
from benchmarks.opensim_tools import read_table
from myomorph.core.model.model import Actuator

opensim.Logger.setLevelString("Off")


@dataclass(frozen=True)
class StaticResult:
    """What the analysis wrote.

    `activations`, `forces`: (frames, actuators), reserves included, in the order of `names`.
    """

    time: np.ndarray
    names: tuple[str, ...]
    activations: np.ndarray
    forces: np.ndarray
    seconds: float


def write_actuators(actuators: Sequence[Actuator], path: Path) -> None:
    """Coordinate, point and torque actuators as a ForceSet that OpenSim appends."""
    forces = opensim.ForceSet()
    for one in actuators:
        if one.kind == "coordinate":
            made = opensim.CoordinateActuator(one.coordinate)
        elif one.kind == "point":
            made = opensim.PointActuator(one.body)
            made.set_point(opensim.Vec3(*one.point))
            made.set_direction(opensim.Vec3(*one.direction))
            made.set_point_is_global(one.point_is_global)
            made.set_force_is_global(one.direction_is_global)
        else:
            made = opensim.TorqueActuator()
            made.set_bodyA(one.body)
            made.set_bodyB(one.other_body or "ground")
            made.set_axis(opensim.Vec3(*one.direction))
            made.set_torque_is_global(one.direction_is_global)
        made.setName(one.name)
        made.setOptimalForce(one.optimal_force)
        made.setMinControl(one.min_control)
        made.setMaxControl(one.max_control)
        forces.cloneAndAppend(made)
    forces.printToXML(str(path))


@dataclass(frozen=True, kw_only=True)
class AnalyzeInputs:
    """What AnalyzeTool reads.

    Attributes
    ----------
    model : file
    motion : file of the coordinates
    loads : file of the external loads, None for none
    actuators : file of a ForceSet that is appended, None for none
    cutoff : of the low-pass filter of the coordinates [Hz], -1 for none
    """

    model: Path
    motion: Path
    loads: Path | None = None
    actuators: Path | None = None
    cutoff: float = -1.0


@dataclass(frozen=True, kw_only=True)
class StaticOptions:
    """Settings of StaticOptimization.

    Attributes
    ----------
    interval : frames between two solutions
    exponent : of activations in the cost
    tolerance : its `optimizer_convergence_criterion`
    """

    interval: int = 1
    exponent: float = 2.0
    tolerance: float = 1e-4


DEFAULTS = StaticOptions()


def static_optimization(
    inputs: AnalyzeInputs, start: float, end: float, options: StaticOptions = DEFAULTS
) -> StaticResult:
    """Run AnalyzeTool with StaticOptimization on a coordinates file.

    Parameters
    ----------
    inputs : files
    start, end : of the analysis [s]
    options : of the optimization

    Returns
    -------
    Activations and forces
    """
    with tempfile.TemporaryDirectory() as folder:
        model = opensim.Model(str(inputs.model))
        setup = Path(folder) / "setup.xml"
        _analyze_tool(inputs, start, end, options, folder).printToXML(str(setup))
        del model
        tool = opensim.AnalyzeTool(str(setup))
        began = time.perf_counter()
        tool.run()
        seconds = time.perf_counter() - began
        clock, names, activations = read_table(
            Path(folder) / "so_StaticOptimization_activation.sto"
        )
        _, force_names, forces = read_table(Path(folder) / "so_StaticOptimization_force.sto")
    columns = [force_names.index(name) for name in names]
    return StaticResult(
        time=clock, names=names, activations=activations, forces=forces[:, columns], seconds=seconds
    )


def _analyze_tool(
    inputs: AnalyzeInputs, start: float, end: float, options: StaticOptions, folder: str
) -> opensim.AnalyzeTool:
    analysis = opensim.StaticOptimization()
    analysis.setStartTime(start)
    analysis.setEndTime(end)
    analysis.setStepInterval(options.interval)
    analysis.setUseModelForceSet(True)
    analysis.setActivationExponent(options.exponent)
    analysis.setUseMusclePhysiology(True)
    analysis.setConvergenceCriterion(options.tolerance)
    analysis.setMaxIterations(1000)
    tool = opensim.AnalyzeTool()
    tool.setName("so")
    tool.setModelFilename(str(inputs.model.resolve()))
    tool.setCoordinatesFileName(str(inputs.motion.resolve()))
    if inputs.loads is not None:
        tool.setExternalLoadsFileName(str(inputs.loads.resolve()))
    if inputs.actuators is not None:
        files = opensim.ArrayStr()
        files.append(str(inputs.actuators.resolve()))
        tool.setForceSetFiles(files)
    tool.setReplaceForceSet(False)
    tool.setLowpassCutoffFrequency(inputs.cutoff)
    tool.setInitialTime(start)
    tool.setFinalTime(end)
    tool.setSolveForEquilibrium(False)
    tool.setResultsDir(folder)
    tool.updAnalysisSet().cloneAndAppend(analysis)
    return tool


REACTION_SETUP = """<?xml version="1.0"?><OpenSimDocument Version="40000"><AnalyzeTool name="jr">
<model_file>{model}</model_file><replace_force_set>false</replace_force_set><force_set_files></force_set_files>
<results_directory>{folder}</results_directory><initial_time>{start}</initial_time><final_time>{end}</final_time>
<solve_for_equilibrium_for_auxiliary_states>false</solve_for_equilibrium_for_auxiliary_states>
<AnalysisSet name="Analyses"><objects><JointReaction name="JR"><on>true</on>\
<step_interval>1</step_interval>
<forces_file>{forces}</forces_file><joint_names>{joint}</joint_names><apply_on_bodies>child</apply_on_bodies>
<express_in_frame>child</express_in_frame></JointReaction></objects></AnalysisSet>
<external_loads_file>{loads}</external_loads_file><coordinates_file>{motion}</coordinates_file>
<lowpass_cutoff_frequency_for_coordinates>{cutoff}</lowpass_cutoff_frequency_for_coordinates></AnalyzeTool>
</OpenSimDocument>"""


def reaction_force(
    inputs: AnalyzeInputs, tensions: StaticResult, joint: str
) -> tuple[np.ndarray, np.ndarray]:
    """Run AnalyzeTool with JointReaction on the results of the static optimization.

    Parameters
    ----------
    inputs : the same files, with external loads
    tensions : results of the static optimization
    joint : whose reaction is computed

    Returns
    -------
    (frames,) times [s], and (frames, 3) force on the joint's child in its axes [N]
    """
    assert inputs.loads is not None
    with tempfile.TemporaryDirectory() as folder:
        forces = Path(folder) / "forces.sto"
        setup = Path(folder) / "setup.xml"
        mm.write_sto(mm.Table(tensions.time, tensions.names, tensions.forces), forces)
        setup.write_text(
            REACTION_SETUP.format(
                model=inputs.model.resolve(),
                folder=folder,
                start=tensions.time[0],
                end=tensions.time[-1],
                forces=forces,
                joint=joint,
                loads=inputs.loads.resolve(),
                motion=inputs.motion.resolve(),
                cutoff=inputs.cutoff,
            )
        )
        tool = opensim.AnalyzeTool(str(setup))
        tool.run()
        clock, names, values = read_table(Path(folder) / "jr_JR_ReactionLoads.sto")
    return clock, values[:, [k for k, name in enumerate(names) if name[-2:] in ("fx", "fy", "fz")]]
