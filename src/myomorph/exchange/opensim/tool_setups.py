"""Setup files of OpenSim's tools: inverse kinematics, inverse dynamics and analyses.

Scaling has its own file.
"""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.osim import setup_parts
from myomorph.core.io.osim.document import Node, read_document
from myomorph.core.io.osim.scale_setup import SCALE_TOOL, ScaleSetup, scale_setup
from myomorph.core.model.errors import BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.exchange.causes import SETUPS

IK_TOOLS = ("InverseKinematicsTool", "IKTool")
MISSPELT = {"InverseKinemtaticsTool": "InverseKinematicsTool"}
"""Names that setups in the world have, OpenSim's own examples among them, which it reads all the
same.
"""

OTHER_TOOLS = (
    "ForwardTool",
    "CMCTool",
    "RRATool",
    "IMUInverseKinematicsTool",
    "COMAKTool",
    "COMAKInverseKinematicsTool",
)
TOOLS = (SCALE_TOOL, *IK_TOOLS, "InverseDynamicsTool", "AnalyzeTool")
EVERY_TOOL = (
    "model_file",
    "results_directory",
    "input_directory",
    "output_precision",
    "time_range",
    "output_motion_file",
    "notes",
    "defaults",
)
READ = {
    "InverseKinematicsTool": (
        "IKTaskSet",
        "marker_file",
        "coordinate_file",
        "accuracy",
        "constraint_weight",
        "report_errors",
        "report_marker_locations",
        "IKTrialSet",
        "optimizer_algorithm",
    ),
    "InverseDynamicsTool": (
        "coordinates_file",
        "coordinates_in_degrees",
        "external_loads_file",
        "forces_to_exclude",
        "lowpass_cutoff_frequency_for_coordinates",
        "output_gen_force_file",
        "output_body_forces_file",
    ),
    "AnalyzeTool": (
        "force_set_files",
        "actuator_set_files",
        "replace_force_set",
        "replace_actuator_set",
        "initial_time",
        "final_time",
        "AnalysisSet",
        "Analyses",
        "external_loads_file",
        "coordinates_file",
        "states_file",
        "lowpass_cutoff_frequency_for_coordinates",
        "solve_for_equilibrium_for_auxiliary_states",
        "maximum_number_of_integrator_steps",
        "maximum_integrator_step_size",
        "minimum_integrator_step_size",
        "integrator_error_tolerance",
    ),
}


@dataclass(frozen=True)
class InverseKinematicsSetup:
    """Settings of an InverseKinematicsTool.

    Paths are absolute or relative to the setup file's folder.
    """

    name: str
    model: Path | None
    markers: Path | None
    coordinates: Path | None
    tasks: setup_parts.IkTasks
    time_range: tuple[float, float]  # [s]
    output: Path | None  # the motion to write, None for none
    results: Path
    accuracy: float = 1e-5
    constraint_weight: float = np.inf  # inf where constraints hold strictly
    report_errors: bool = True
    report_locations: bool = False
    warnings: tuple[Message, ...] = ()  # what the file holds that is not read, one line each


@dataclass(frozen=True)
class InverseDynamicsSetup:
    """Settings of an InverseDynamicsTool."""

    name: str
    model: Path | None
    coordinates: Path | None
    loads: Path | None
    time_range: tuple[float, float]
    cutoff: float | None  # low-pass of the coordinates [Hz], None for no filter
    output: str  # name of the table of generalized forces in the folder `results`
    results: Path
    # forces left out, as the file names them ("Muscles", "ALL", ...)
    excluded: tuple[str, ...] = ()
    warnings: tuple[Message, ...] = ()


@dataclass(frozen=True)
class StaticOptimizationSettings:
    """Settings of a StaticOptimization analysis."""

    exponent: float = 2.0
    use_physiology: bool = True
    use_model_forces: bool = True


@dataclass(frozen=True)
class Analysis:
    """One analysis of an AnalyzeTool that is switched on."""

    kind: str  # its class, "StaticOptimization"
    name: str
    step: int  # every so many frames
    static_optimization: StaticOptimizationSettings | None = None
    # its other properties as texts
    options: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    forces: Path | None = None  # the file of forces that a JointReaction takes, None for none

    def flag(self, option: str, default: bool) -> bool:
        """Whether an option that is true or false is true."""
        return self.options.get(option, str(default)).strip().lower() in ("true", "1")


@dataclass(frozen=True)
class AnalyzeSetup:
    """Settings of an AnalyzeTool."""

    name: str
    model: Path | None
    coordinates: Path | None
    states: Path | None
    loads: Path | None
    actuators: tuple[Path, ...]  # files of forces that are added to the model's, or replace them
    replace_forces: bool
    time_range: tuple[float, float]
    cutoff: float | None  # low-pass of the coordinates [Hz], None for no filter
    results: Path
    equilibrium: bool = False  # whether muscles are put into equilibrium at every frame
    analyses: tuple[Analysis, ...] = ()  # in the file's order
    warnings: tuple[Message, ...] = ()


Setup = ScaleSetup | InverseKinematicsSetup | InverseDynamicsSetup | AnalyzeSetup


def read_setup(path: str | os.PathLike[str]) -> Setup:
    """Read the settings in an OpenSim setup file.

    They are those of scaling, inverse kinematics, inverse dynamics or analyses.
    """
    node = read_document(path, (), "")
    kind = MISSPELT.get(node.kind, node.kind)
    if kind not in TOOLS:
        what = f"holds <{kind}>" + (", a tool that is not supported" if kind in OTHER_TOOLS else "")
        raise BadFile(path, what, f"the tools that exist are {listing(kind, TOOLS)}")
    node = setup_parts.with_included(node)
    if kind == SCALE_TOOL:
        return scale_setup(node)
    if kind in IK_TOOLS:
        setup = _inverse_kinematics(node)
        warnings = (
            () if kind == node.kind else (SETUPS.message(f"<{node.kind}> was taken for <{kind}>"),)
        )
        return replace(setup, warnings=(*warnings, *setup.warnings))
    return _inverse_dynamics(node) if kind == "InverseDynamicsTool" else _analyze(node)


def _inverse_kinematics(node: Node) -> InverseKinematicsSetup:
    # Before 2.3 a tool had trials inside.
    trials = list(node.element.iter("IKTrial"))
    if len(trials) > 1:
        raise node.bad("holds several trials", "split it into one setup file a trial")
    settings = Node(trials[0], node.document) if trials else node
    weight = node.number("constraint_weight", np.inf, infinite=True)
    warnings = setup_parts.unknown_parts(node, (*EVERY_TOOL, *READ["InverseKinematicsTool"]))
    if np.isfinite(weight):
        # OpenSim 4.6 reads the weight, but its solver replaces it by infinity.
        warnings += (
            (
                SETUPS.message(
                    f"constraint_weight is {weight:g}: constraints are enforced strictly anyway, as"
                    " in OpenSim 4.6",
                    severity="good to know",
                )
            ),
        )
    return InverseKinematicsSetup(
        name=node.name,
        model=setup_parts.path_of(node, "model_file"),
        markers=setup_parts.path_of(settings, "marker_file"),
        coordinates=setup_parts.path_of(settings, "coordinate_file"),
        tasks=setup_parts.tasks_of(node),
        time_range=_range(settings),
        output=setup_parts.output_of(settings, "output_motion_file"),
        results=_results(node),
        accuracy=node.number("accuracy", 1e-5),
        constraint_weight=weight,
        report_errors=node.flag("report_errors", True),
        report_locations=node.flag("report_marker_locations", False),
        warnings=warnings,
    )


def _inverse_dynamics(node: Node) -> InverseDynamicsSetup:
    return InverseDynamicsSetup(
        name=node.name,
        model=setup_parts.path_of(node, "model_file"),
        coordinates=setup_parts.path_of(node, "coordinates_file"),
        loads=setup_parts.path_of(node, "external_loads_file"),
        time_range=_range(node),
        cutoff=_cutoff(node),
        output=node.text("inverse_dynamics.sto", "output_gen_force_file"),
        results=_results(node),
        excluded=tuple(node.words("forces_to_exclude")),
        warnings=setup_parts.unknown_parts(node, (*EVERY_TOOL, *READ["InverseDynamicsTool"])),
    )


def _analyze(node: Node) -> AnalyzeSetup:
    analysis_set = node.find("AnalysisSet", "Analyses")
    analyses = (
        []
        if analysis_set is None
        else [node.node(element) for element in analysis_set.findall("objects/*")]
    )
    files = [
        name
        for name in node.words("force_set_files", "actuator_set_files")
        if name not in setup_parts.UNASSIGNED
    ]
    return AnalyzeSetup(
        name=node.name,
        model=setup_parts.path_of(node, "model_file"),
        coordinates=setup_parts.path_of(node, "coordinates_file"),
        states=setup_parts.path_of(node, "states_file"),
        loads=setup_parts.path_of(node, "external_loads_file"),
        actuators=tuple(setup_parts.resolved(node, name) for name in files),
        replace_forces=node.flag("replace_force_set", node.flag("replace_actuator_set", False)),
        time_range=(
            node.number("initial_time", 0.0, infinite=True),
            node.number("final_time", 1.0, infinite=True),
        ),
        cutoff=_cutoff(node),
        results=_results(node),
        equilibrium=node.flag("solve_for_equilibrium_for_auxiliary_states", False),
        analyses=tuple(_analysis(analysis) for analysis in analyses if analysis.flag("on", True)),
        warnings=setup_parts.unknown_parts(node, (*EVERY_TOOL, *READ["AnalyzeTool"])),
    )


def _analysis(node: Node) -> Analysis:
    step = node.number("step_interval", 1.0)
    if step < 1 or step != int(step):
        raise node.bad(f"'step_interval' is {step:g}", "expected a whole number of frames")
    static = None
    if node.kind == "StaticOptimization":
        static = StaticOptimizationSettings(
            node.number("activation_exponent", 2.0),
            node.flag("use_muscle_physiology", True),
            node.flag("use_model_force_set", True),
        )
    options = {
        str(element.tag): (element.text or "").strip()
        for element in node.element
        if not len(element)
    }
    forces = setup_parts.path_of(node, "forces_file")
    return Analysis(
        kind=node.kind,
        name=node.name or node.kind,
        step=int(step),
        static_optimization=static,
        options=FrozenMap(options),
        forces=forces,
    )


def _range(node: Node) -> tuple[float, float]:
    low, high = node.vector("time_range", (-np.inf, np.inf), infinite=True)
    return float(low), float(high)


def _cutoff(node: Node) -> float | None:
    cutoff = node.number("lowpass_cutoff_frequency_for_coordinates", -1.0)
    return cutoff if cutoff > 0 else None


def _results(node: Node) -> Path:
    return setup_parts.resolved(node, node.text("./", "results_directory") or "./")
