"""OpenSim's ScaleTool: a generic model made as large and as heavy as a person.

Its markers are placed where a trial shows them.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, field, replace
from functools import partial
from pathlib import Path

import numpy as np

from myomorph.core.io.osim.scale_setup import PlacerSetup, ScalerSetup, ScaleSetup
from myomorph.core.io.osim.setup_parts import IkTasks, write_marker_set, write_scale_set
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import write_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import Model
from myomorph.core.model.scale import scale
from myomorph.core.model.series import Markers, Motion, Table
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.measurements import (
    Placement,
    frames_around,
    measure,
    place_on_pose,
    with_measured,
)
from myomorph.core.muscles.fiber_states import default_states, without_fibers
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.exchange.causes import SETUPS
from myomorph.exchange.opensim.outputs import ToolResult, check_outputs, write_outputs
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.tasks import with_tasks
from myomorph.lab.study.subject.calibrating import with_marker_set


def run_scale(setup: ScaleSetup, source: Path) -> ToolResult:
    """Scale a model and place its markers; see OpenSim's ScaleTool."""
    if setup.model is None:
        raise BadData(f"{source}: names no model_file: expected that of the generic model")
    read: list[Path | None] = [source, setup.model, setup.marker_set]
    for part in (setup.scaler, setup.placer):
        read += [] if part is None else [part.markers, getattr(part, "coordinates", None)]
    check_outputs(_targets(setup), read)

    model = reading.open_model(setup.model)
    if setup.marker_set is not None:
        model = with_marker_set(model, setup.marker_set)
    model = replace(model, name=setup.name or model.name)
    outputs = _Outputs(warnings=[*setup.warnings, *located(setup.model.name, model.warnings)])
    if setup.scaler is None:
        outputs.warnings.append(
            SETUPS.message("ModelScaler is switched off: the model keeps its size and its mass")
        )
    else:
        model = _scale(model, setup, setup.scaler, source, outputs)
    if setup.placer is None:
        outputs.warnings.append(SETUPS.message("MarkerPlacer is switched off: no marker is moved"))
    else:
        _place(model, setup.placer, source, outputs)
    written = write_outputs(outputs.writers)
    return ToolResult(
        tool="ScaleTool",
        lines=tuple(outputs.lines),
        written=written,
        warnings=tuple(dict.fromkeys(outputs.warnings)),
    )


@dataclass
class _Outputs:
    """Outputs of both steps of a ScaleTool: lines to print, warnings, and writers of files."""

    lines: list[str] = field(default_factory=list)
    warnings: list[Message] = field(default_factory=list)
    writers: dict[Path, Callable[[Path], object]] = field(default_factory=dict)


def _targets(setup: ScaleSetup) -> list[Path]:
    """Return the files that a setup writes."""
    names = ("output_model", "output_factors", "output_motion", "output_markers")
    targets = [
        path
        for part in (setup.scaler, setup.placer)
        for name in names
        if (path := getattr(part, name, None)) is not None
    ]
    if _one_model(setup) and setup.scaler is not None and setup.scaler.output_model is not None:
        # Both steps may write the same file, as many setups say: the placer's model is the one that
        # stays.
        targets.remove(setup.scaler.output_model)
    return targets


def _scale(
    model: Model, setup: ScaleSetup, scaler: ScalerSetup, source: Path, outputs: _Outputs
) -> Model:
    """Scale a model, and add what it writes to the outputs."""
    model, factors, notes = scaled(model, scaler, setup.mass, source)
    outputs.warnings += notes
    outputs.lines.append(_factors_line(factors, model))
    if scaler.output_model is not None and not _one_model(setup):
        outputs.writers[scaler.output_model] = partial(_write_model, model, outputs.warnings)
    if scaler.output_factors is not None:
        outputs.writers[scaler.output_factors] = partial(write_scale_set, factors)
    return model


def _place(model: Model, placer: PlacerSetup, source: Path, outputs: _Outputs) -> None:
    """Place the markers of a model, and add what it writes to the outputs."""
    placement = placed(model, placer, source)
    outputs.warnings += placement.notes
    outputs.lines.append(_markers_line(placement))
    if placer.output_model is not None:
        outputs.writers[placer.output_model] = partial(
            _write_model, placement.model, outputs.warnings
        )
    if placer.output_markers is not None:
        outputs.writers[placer.output_markers] = partial(write_marker_set, placement.model)
    if placer.output_motion is not None:
        pose = pose_table(placement.fit.motion, model)
        outputs.writers[placer.output_motion] = partial(write_sto, pose)


def _one_model(setup: ScaleSetup) -> bool:
    """Whether scaling and placing want to write one file."""
    paths = [
        part.output_model
        for part in (setup.scaler, setup.placer)
        if part is not None and part.output_model
    ]
    return len(paths) == 2 and paths[0].resolve() == paths[1].resolve()


def scaled(
    model: Model, setup: ScalerSetup, mass: float | None, source: Path
) -> tuple[Model, dict[str, Array], list[Message]]:
    """Scale a model as a setup requests.

    Parameters
    ----------
    model : generic model
    setup : of the ModelScaler
    mass : of the person [kg]; None to keep the model's
    source : setup file, for errors

    Returns
    -------
    the scaled model, the factors (3,) of all its bodies and of the ground, and notes of what is odd
    about them

    Raises
    ------
    BadData : measurements without a marker file
    """
    notes: list[Message] = []
    factors: dict[str, Array] = {}
    for kind in setup.order:
        if kind == "manualScale":
            factors |= {body: np.array(factor) for body, factor in setup.factors.items()}
        elif setup.measurements:
            factors = _measured_factors(model, setup, source, factors, notes)
    unknown = [body for body in factors if body not in model.body_names and body != "ground"]
    notes += [
        SETUPS.message(f"scale factors of '{body}' are not used: the model has no such body")
        for body in unknown
    ]
    known = {body: factors[body] for body in model.body_names if body in factors}
    larger = scale(
        model,
        known,
        mass,
        preserve_mass_distribution=setup.preserve_mass_distribution,
        path_lengths=default_path_lengths if model.muscles else None,
    )
    every = {body: known.get(body, np.ones(3)) for body in ("ground", *model.body_names)}
    return larger, every, notes


def _measured_factors(
    model: Model,
    setup: ScalerSetup,
    source: Path,
    factors: dict[str, Array],
    notes: list[Message],
) -> dict[str, Array]:
    """Add the factors (3,) of bodies that distances between markers give to those known before."""
    if setup.markers is None:
        raise BadData(f"{source}: ModelScaler has measurements, but names no marker_file")
    trial = frames_around(_markers(setup.markers, model, notes), *setup.time_range)
    measured = [measure(model, trial, measurement) for measurement in setup.measurements]
    odd = (note for measurement in measured for note in measurement.notes)
    notes += located(setup.markers.name, odd)
    return with_measured(measured, factors)


def placed(model: Model, setup: PlacerSetup, source: Path) -> Placement:
    """Place the model's markers where a static trial shows them."""
    if setup.markers is None:
        raise BadData(f"{source}: MarkerPlacer names no marker_file: expected a static trial")
    notes: list[Message] = []
    trial = _markers(setup.markers, model, notes)
    # With weights of 1000 and 1 the trunk lies in a flat valley of the cost: a usual end is
    # millimetres off.
    exact = InverseKinematicsOptions(
        tolerance=1e-9, posture_weight=1e-10, iterations=500, root_bounds=True
    )
    options = tasks_of_setup(exact, setup.tasks, setup.coordinates, model, source)
    with reading.about(setup.markers):
        placement = place_on_pose(model, trial, *setup.time_range, options, setup.most_movement)
    return replace(placement, notes=(*notes, *located(setup.markers.name, placement.notes)))


def _markers(path: Path, model: Model, notes: list[Message]) -> Markers:
    trial = reading.fitted_to(model, reading.read_recording(path))
    assert trial.markers is not None
    notes += located(path.name, trial.warnings)
    return trial.markers


def pose_table(motion: Motion, model: Model) -> Table:
    """Return a pose as a table of states at rest, as OpenSim writes the static pose [rad, m].

    Muscles are at their defaults.
    """
    owner = {name: joint.name for joint in model.joints for name in joint.coordinates}
    paths = [f"/jointset/{owner[name]}/{name}" for name in motion.names]
    values = np.zeros((len(motion), len(paths), 2))
    values[:, :, 0] = motion.values
    names = tuple(f"{path}/{kind}" for path in paths for kind in ("value", "speed"))
    states = {} if without_fibers(model) else default_states(model)
    rest = np.tile(list(states.values()), (len(motion), 1)).reshape(len(motion), -1)
    facts = FrozenMap({"name": "static pose"})
    labels = (*names, *(f"/forceset/{muscle}/{state}" for muscle, state in states))
    return Table(
        motion.time, labels, np.hstack([values.reshape(len(motion), -1), rest]), facts=facts
    )


def _write_model(model: Model, warnings: list[Message], path: Path) -> None:
    warnings += write_osim(model, path)


def _factors_line(factors: dict[str, Array], model: Model) -> str:
    sizes = [factor for body, factor in factors.items() if (factor != 1.0).any()]
    if not sizes:
        return f"no body is scaled, mass {model.mass:.2f} kg"
    span = f"factors {np.min(sizes):.4g} to {np.max(sizes):.4g}"
    return f"{len(sizes)} of {len(factors) - 1} bodies scaled, {span}, mass {model.mass:.2f} kg"


def _markers_line(placement: Placement) -> str:
    rms = 100.0 * float(placement.fit.rms[0])
    worst = 100.0 * float(placement.fit.largest[0])
    text = (
        f"{len(placement.moved)} markers moved; before, root mean square {rms:.2f} cm, largest"
        f" {worst:.2f} cm"
    )
    return text + (
        f"; {len(placement.removed)} that were not recorded removed" if placement.removed else ""
    )


def tasks_of_setup(
    options: InverseKinematicsOptions,
    tasks: IkTasks,
    coordinates: Path | None,
    model: Model,
    source: Path,
) -> InverseKinematicsOptions:
    """Return options with the tasks of a setup file.

    Coordinate tasks take their values from the motion of a file, which is not read where there are
    none.
    """
    options = with_tasks(options, tasks, model, str(source))
    wanted = [
        aim.coordinate for aim in tasks.coordinates if aim.source == "table" and aim.weight > 0.0
    ]
    if not wanted:
        return options
    if coordinates is None:
        raise BadData(
            f"{source}: the task of '{wanted[0]}' takes its value from a file, without"
            " coordinate_file"
        )
    return replace(options, coordinates=reading.read_motion(coordinates, model))
