"""What OpenSim's tools are told: inverse kinematics tasks and the settings of setup files."""

from __future__ import annotations

import os
from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path, PureWindowsPath
from types import MappingProxyType
from typing import Literal

import numpy as np
from lxml import etree

from myomorph.io.osim_document import Node, read_document
from myomorph.model.errors import BadFile

UNASSIGNED = ("", "Unassigned", "NULL")
IK_TOOLS = ("InverseKinematicsTool", "IKTool")


@dataclass(frozen=True)
class CoordinateAim:
    """A coordinate that inverse kinematics pulls towards a value.

    Attributes
    ----------
    weight : of the squared difference
    source : where the value comes from: the model's default, `value`, or a table of coordinates
    value : [rad or m], of source "value"
    """

    coordinate: str
    weight: float
    source: Literal["default", "value", "table"] = "default"
    value: float = 0.0


@dataclass(frozen=True)
class IkTasks:
    """Weights of markers and of coordinates; only markers with a weight are tracked."""

    marker_weights: Mapping[str, float]
    coordinates: tuple[CoordinateAim, ...] = ()


@dataclass(frozen=True)
class InverseKinematicsSetup:
    """Settings of an InverseKinematicsTool; paths are absolute or relative to the setup file's folder.

    Attributes
    ----------
    time_range : [s]
    constraint_weight : inf where constraints hold strictly
    """

    name: str
    model: Path | None
    markers: Path | None
    coordinates: Path | None
    tasks: IkTasks
    time_range: tuple[float, float]
    output: str
    results: Path
    accuracy: float = 1e-5
    constraint_weight: float = np.inf
    report_errors: bool = True


@dataclass(frozen=True)
class InverseDynamicsSetup:
    """Settings of an InverseDynamicsTool.

    Attributes
    ----------
    cutoff : low-pass of the coordinates [Hz], None for no filter
    excluded : forces left out, as the file names them ("Muscles", "ALL", ...)
    """

    name: str
    model: Path | None
    coordinates: Path | None
    loads: Path | None
    time_range: tuple[float, float]
    cutoff: float | None
    output: str
    results: Path
    excluded: tuple[str, ...] = ()


@dataclass(frozen=True)
class StaticOptimizationSettings:
    """Settings of a StaticOptimization analysis."""

    exponent: float = 2.0
    use_physiology: bool = True
    use_model_forces: bool = True
    step: int = 1


@dataclass(frozen=True)
class AnalyzeSetup:
    """Settings of an AnalyzeTool.

    Attributes
    ----------
    actuators : files of forces that are added to the model's, or replace them
    cutoff : low-pass of the coordinates [Hz], None for no filter
    analyses : classes of the analyses that are switched on, in the file's order
    static_optimization : None where that analysis is not asked for
    """

    name: str
    model: Path | None
    coordinates: Path | None
    states: Path | None
    loads: Path | None
    actuators: tuple[Path, ...]
    replace_forces: bool
    time_range: tuple[float, float]
    cutoff: float | None
    results: Path
    analyses: tuple[str, ...] = ()
    static_optimization: StaticOptimizationSettings | None = None
    options: Mapping[str, Mapping[str, str]] = field(default_factory=lambda: MappingProxyType({}))


Setup = InverseKinematicsSetup | InverseDynamicsSetup | AnalyzeSetup


def read_ik_tasks(path: str | os.PathLike[str]) -> IkTasks:
    """The inverse kinematics tasks of an IKTaskSet file, or of the setup file of a tool that has one.

    Raises
    ------
    BadFile
        The file holds no task set, or a task has no name or an impossible weight.
    """
    return _tasks(read_document(path, (), "inverse kinematics tasks (IKTaskSet) or a tool's setup"))


def read_setup(path: str | os.PathLike[str]) -> Setup:
    """The settings in an OpenSim setup file: inverse kinematics, inverse dynamics or analyze.

    Raises
    ------
    BadFile
        The file is the setup of no such tool.
    """
    tools = (*IK_TOOLS, "InverseDynamicsTool", "AnalyzeTool")
    node = read_document(path, tools, f"the setup of one of {', '.join(tools)}")
    if node.kind in IK_TOOLS:
        return _inverse_kinematics(node)
    return _inverse_dynamics(node) if node.kind == "InverseDynamicsTool" else _analyze(node)


def _tasks(node: Node) -> IkTasks:
    found = node.element if node.kind == "IKTaskSet" else next(node.element.iter("IKTaskSet"), None)
    if found is None:
        raise node.bad("has no IKTaskSet inside")
    weights: dict[str, float] = {}
    aims = []
    for element in found.iter("IKMarkerTask", "IKCoordinateTask"):
        task = node.node(element)
        if not task.name:
            raise task.bad("has no name", "expected the name of a marker or coordinate")
        if not task.flag("apply", True):
            continue
        weight = task.number("weight", 0.0)
        if weight < 0:
            raise task.bad(f"has weight {weight:g}", "expected zero or more")
        if task.kind == "IKMarkerTask":
            weights[task.name] = weight
        else:
            aims.append(_aim(task, weight))
    return IkTasks(MappingProxyType(weights), tuple(aims))


def _aim(task: Node, weight: float) -> CoordinateAim:
    kind = task.text("default_value", "value_type").lower()
    if kind == "manual_value":
        return CoordinateAim(task.name, weight, "value", task.number("value", 0.0))
    return CoordinateAim(task.name, weight, "table" if kind == "from_file" else "default")


def _inverse_kinematics(node: Node) -> InverseKinematicsSetup:
    trial = next(node.element.iter("IKTrial"), None)
    one = node if trial is None else _merged(node, trial)
    return InverseKinematicsSetup(
        node.name,
        _path(node, "model_file"),
        _path(one, "marker_file"),
        _path(one, "coordinate_file"),
        _tasks(node),
        _range(one),
        one.text("", "output_motion_file"),
        _results(node),
        node.number("accuracy", 1e-5),
        node.number("constraint_weight", np.inf, infinite=True),
        node.flag("report_errors", True),
    )


def _merged(node: Node, trial: etree._Element) -> Node:
    """Before 2.3 a tool had trials inside; the first one's settings count."""
    if len(list(node.element.iter("IKTrial"))) > 1:
        raise node.bad("holds several trials", "split it into one setup file a trial")
    return Node(trial, node.document)


def _inverse_dynamics(node: Node) -> InverseDynamicsSetup:
    return InverseDynamicsSetup(
        node.name,
        _path(node, "model_file"),
        _path(node, "coordinates_file"),
        _path(node, "external_loads_file"),
        _range(node),
        _cutoff(node),
        node.text("inverse_dynamics.sto", "output_gen_force_file"),
        _results(node),
        tuple(node.words("forces_to_exclude")),
    )


def _analyze(node: Node) -> AnalyzeSetup:
    found = node.find("AnalysisSet", "Analyses")
    analyses = [] if found is None else [node.node(one) for one in found.findall("objects/*")]
    used = [one for one in analyses if one.flag("on", True)]
    static = next((one for one in used if one.kind == "StaticOptimization"), None)
    files = [name for name in node.words("force_set_files", "actuator_set_files") if name not in UNASSIGNED]
    return AnalyzeSetup(
        node.name,
        _path(node, "model_file"),
        _path(node, "coordinates_file"),
        _path(node, "states_file"),
        _path(node, "external_loads_file"),
        tuple(_resolved(node, name) for name in files),
        node.flag("replace_force_set", node.flag("replace_actuator_set", False)),
        (node.number("initial_time", 0.0, infinite=True), node.number("final_time", 1.0, infinite=True)),
        _cutoff(node),
        _results(node),
        tuple(one.kind for one in used),
        None if static is None else _static_optimization(static),
        MappingProxyType({one.kind: _options(one) for one in used}),
    )


def _static_optimization(node: Node) -> StaticOptimizationSettings:
    return StaticOptimizationSettings(
        node.number("activation_exponent", 2.0),
        node.flag("use_muscle_physiology", True),
        node.flag("use_model_force_set", True),
        int(node.number("step_interval", 1.0)),
    )


def _options(node: Node) -> Mapping[str, str]:
    return MappingProxyType({str(one.tag): (one.text or "").strip() for one in node.element if not len(one)})


def _range(node: Node) -> tuple[float, float]:
    low, high = node.vector("time_range", (-np.inf, np.inf), infinite=True)
    return float(low), float(high)


def _cutoff(node: Node) -> float | None:
    cutoff = node.number("lowpass_cutoff_frequency_for_coordinates", -1.0)
    return cutoff if cutoff > 0 else None


def _results(node: Node) -> Path:
    return _resolved(node, node.text("./", "results_directory") or "./")


def _path(node: Node, tag: str) -> Path | None:
    text = node.text("", tag)
    return None if text in UNASSIGNED else _resolved(node, text)


def _resolved(node: Node, name: str) -> Path:
    """A path beside the setup file; of a path on somebody's Windows drive, only the name counts elsewhere."""
    if "\0" in name:
        raise BadFile(node.document.path, f"names the path {name!r}")
    windows = PureWindowsPath(name)
    if windows.drive and os.name != "nt":
        return node.document.path.parent / windows.name
    return node.document.path.parent / name.replace("\\", "/")
