"""The setup file of OpenSim's ScaleTool."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from myomorph.core.io.osim.document import Node
from myomorph.core.io.osim.setup_parts import IkTasks, output_of, path_of, tasks_of, unknown_parts
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.landmarks import Measurement
from myomorph.core.model.messages import Message

SCALE_TOOL = "ScaleTool"
ORDERS = ("measurements", "manualScale")
TOOL = (
    "mass",
    "height",
    "age",
    "notes",
    "GenericModelMaker",
    "ModelScaler",
    "MarkerPlacer",
    "defaults",
)
SCALER = (
    "apply",
    "scaling_order",
    "MeasurementSet",
    "ScaleSet",
    "marker_file",
    "time_range",
    "preserve_mass_distribution",
    "output_model_file",
    "output_scale_file",
)
PLACER = (
    "apply",
    "IKTaskSet",
    "marker_file",
    "coordinate_file",
    "time_range",
    "output_motion_file",
    "output_model_file",
    "output_marker_file",
    "max_marker_movement",
    "optimizer_algorithm",
)


@read_only
class ScalerSetup:
    """Measurements and factors by which bodies are scaled.

    Attributes
    ----------
    order : "measurements" and "manualScale", as they are carried out
    measurements : those that are switched on
    factors : (3,) by body, given by hand
    markers : file of the static trial, None for none
    time_range : frames of `markers` that are averaged [s]
    preserve_mass_distribution : whether the shares of bodies in the mass stay
    output_model, output_factors : files to write, None for none
    """

    order: tuple[str, ...]
    measurements: tuple[Measurement, ...]
    factors: Mapping[str, Array]
    markers: Path | None
    time_range: tuple[float, float]
    preserve_mass_distribution: bool
    output_model: Path | None
    output_factors: Path | None


@dataclass(frozen=True)
class PlacerSetup:
    """Settings of moving markers to their positions in a static trial.

    Attributes
    ----------
    tasks : weights of markers and coordinates
    markers : file of the static trial, None for none
    coordinates : table that gives coordinate tasks their values, None for none
    time_range : frames of `markers` that are averaged [s]
    output_model, output_motion, output_markers : files to write, None for none
    most_movement : of a marker in the static frames [m]; inf for no limit
    """

    tasks: IkTasks
    markers: Path | None
    coordinates: Path | None
    time_range: tuple[float, float]
    output_model: Path | None
    output_motion: Path | None
    output_markers: Path | None
    most_movement: float = np.inf


@dataclass(frozen=True)
class ScaleSetup:
    """Settings of a ScaleTool; paths are absolute or relative to the setup file's folder.

    Attributes
    ----------
    name : of the tool
    model, marker_set : files of the generic model, and of markers that replace or join its own
    mass : of the person [kg], None where the scaling gives it
    scaler, placer : None where switched off
    facts : height, age and notes, as texts
    warnings : parts that are left out, one line each
    """

    name: str
    model: Path | None
    marker_set: Path | None
    mass: float | None
    scaler: ScalerSetup | None
    placer: PlacerSetup | None
    facts: Mapping[str, str] = field(default_factory=lambda: FrozenMap({}))
    warnings: tuple[Message, ...] = ()


def scale_setup(node: Node) -> ScaleSetup:
    """Read the settings of a ScaleTool.

    Parameters
    ----------
    node : of the tool

    Returns
    -------
    the settings; `warnings` name the parts that are left out

    Raises
    ------
    BadFile : a part is not as it should be
    """
    maker = node.child("GenericModelMaker")
    scaler = node.child("ModelScaler")
    placer = node.child("MarkerPlacer")
    warnings = list(unknown_parts(node, TOOL))
    for part, read in ((scaler, SCALER), (placer, PLACER)):
        warnings += unknown_parts(part, read) if part is not None else ()
    mass = node.number("mass", -1.0)
    return ScaleSetup(
        name=node.name,
        model=None if maker is None else path_of(maker, "model_file"),
        marker_set=None if maker is None else path_of(maker, "marker_set_file"),
        mass=mass if mass > 0.0 else None,
        scaler=None if scaler is None or not scaler.flag("apply", True) else _scaler(scaler),
        placer=None if placer is None or not placer.flag("apply", True) else _placer(placer),
        facts=FrozenMap(
            {tag: text for tag in ("height", "age", "notes") if (text := node.text("", tag))}
        ),
        warnings=tuple(warnings),
    )


def _scaler(node: Node) -> ScalerSetup:
    """Read how bodies are scaled; `BadFile` for an unknown order, axis or factor."""
    order = tuple(node.words("scaling_order"))
    for word in order:
        if word not in ORDERS:
            raise node.bad(f"'scaling_order' names '{word}'", f"expected {' or '.join(ORDERS)}")
    measurements = [
        _measurement(item) for item in node.items("MeasurementSet") if item.flag("apply", True)
    ]
    factors = dict(_factors(item) for item in node.items("ScaleSet") if item.flag("apply", True))
    return ScalerSetup(
        order=order,
        measurements=tuple(measurements),
        factors=FrozenMap(factors),
        markers=path_of(node, "marker_file"),
        time_range=_range(node),
        preserve_mass_distribution=node.flag("preserve_mass_distribution", False),
        output_model=output_of(node, "output_model_file"),
        output_factors=output_of(node, "output_scale_file"),
    )


def _measurement(node: Node) -> Measurement:
    """Read a measurement: pairs of markers, and the axes of bodies that it scales."""
    pairs = []
    for pair in node.items("MarkerPairSet"):
        names = pair.words("markers")
        if len(names) != 2:
            raise pair.bad(
                f"'markers' names {len(names)}",
                f"expected two markers for measurement '{node.name}'",
            )
        pairs.append((names[0], names[1]))
    bodies = {}
    for body in node.items("BodyScaleSet"):
        axes = "".join(body.words("axes")).lower()
        if set(axes) - set("xyz"):
            raise body.bad(f"'axes' is '{axes}'", "expected some of X, Y and Z")
        if axes:
            bodies[body.name] = axes
    return Measurement(node.name, tuple(pairs), FrozenMap(bodies))


def _factors(node: Node) -> tuple[str, Array]:
    """Read a body and its factors (3,); `BadFile` where one is not above 0."""
    factors = node.vector("scales", (1.0, 1.0, 1.0))
    if (factors <= 0.0).any():
        raise node.bad(
            f"'scales' is '{node.text('', 'scales')}'", "expected three positive numbers"
        )
    return node.text("", "segment"), factors


def _placer(node: Node) -> PlacerSetup:
    # In the unit of the marker file, which is the millimetre wherever a static trial is a TRC file.
    """Read how markers are moved."""
    most = node.number("max_marker_movement", -1.0)
    return PlacerSetup(
        tasks=tasks_of(node),
        markers=path_of(node, "marker_file"),
        coordinates=path_of(node, "coordinate_file"),
        time_range=_range(node),
        output_model=output_of(node, "output_model_file"),
        output_motion=output_of(node, "output_motion_file"),
        output_markers=output_of(node, "output_marker_file"),
        most_movement=most / 1000.0 if most > 0.0 else np.inf,
    )


def _range(node: Node) -> tuple[float, float]:
    """Read a range of time [s]; an unset one, (-1, -1), is the first frame in OpenSim."""
    low, high = node.vector("time_range", (-1.0, -1.0), infinite=True)
    return float(low), float(high)
