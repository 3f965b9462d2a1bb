"""Inverse kinematics and inverse dynamics against OpenSim; whole turns of angles without bounds."""

from __future__ import annotations

import tempfile
import time
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path
from unittest.mock import patch

import numpy as np

import myomorph as mm
from benchmarks import opensim_tools
from benchmarks.recordings import FORCE_CASES, MARKER_CASES, ForceCase, MarkerCase, read_markers
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.io.sto import table_from_motion
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Markers
from myomorph.core.motion import newton
from myomorph.core.motion.ik import pose_problem, tracked_markers
from myomorph.core.motion.newton import SCOUT
from myomorph.core.motion.starts import scout_poses
from myomorph.core.motion.sync import cut
from myomorph.core.motion.turns import floating_coordinates
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.loops import close_loops, free_coordinates
from myomorph.core.rigid.tree import compile_tree


def marker_rmse(
    model: mm.Model,
    names: tuple[str, ...],
    weights: np.ndarray,
    markers: mm.Markers,
    values: np.ndarray,
) -> float:
    """Return the weighted root mean square distance of the model's markers from the measured ones.

    Parameters
    ----------
    model : that has the markers
    names : of the coordinates
    weights : (markers,) of the markers, in their order
    markers : measured
    values : (frames, coordinates) [rad or m]

    Returns
    -------
    over all frames [m]
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, values)
    bodies = np.array([tree.body_index[model.marker(name).body] for name in names])
    placed = poses.points(bodies, np.array([model.marker(name).location for name in names]))
    seen = markers.values[:, [markers.names.index(name) for name in names]]
    squares = ((placed - seen) ** 2).sum(axis=2)
    shares = np.where(np.isfinite(squares), weights, 0.0)
    return float(np.sqrt((shares * np.nan_to_num(squares)).sum() / shares.sum()))


def measure_inverse_kinematics(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each recording."""
    return (_inverse_kinematics(folder, case) for case in MARKER_CASES)


def _inverse_kinematics(folder: Path, case: MarkerCase) -> dict[str, object]:
    """Marker RMSE of both programs with the same weights, and their milliseconds a frame."""
    model = mm.read_model(folder / case.model)
    markers = read_markers(folder / case.markers)
    markers = cut(markers, markers.time[0], markers.time[min(case.most_frames, len(markers)) - 1])
    shared = _shared_weights(folder, case, model, markers)
    options = mm.InverseKinematicsOptions(marker_weights=shared, only_weighted=True)
    mm.inverse_kinematics(model, markers, options)
    began = time.perf_counter()
    fit = mm.inverse_kinematics(model, markers, options)
    ours = time.perf_counter() - began
    theirs = opensim_tools.inverse_kinematics(
        folder / case.model, folder / case.markers, shared, (markers.time[0], markers.time[-1])
    )
    table = motion_from_opensim(model, theirs)
    common = markers_at(markers, table.time)
    values = compile_tree(model).coordinates_of(table)
    ours_at = compile_tree(model).coordinates_of(motion_at(fit.motion, table.time))
    rotational = [j for j, c in enumerate(model.coordinates) if c.motion == "rotational"]
    difference = np.degrees(np.abs((ours_at - values + np.pi) % (2 * np.pi) - np.pi)[:, rotational])
    return {
        "case": case.name,
        "frames": len(table),
        "coordinates": len(model.coordinates),
        "RMSE ours [mm]": 1e3
        * marker_rmse(model, fit.marker_names, fit.marker_weight, common, ours_at),
        "RMSE OpenSim [mm]": 1e3
        * marker_rmse(model, fit.marker_names, fit.marker_weight, common, values),
        "median angle difference [deg]": float(np.median(difference)),
        "converged": float(fit.converged.mean()),
        "ours [ms/frame]": 1e3 * ours / len(markers),
        "OpenSim [ms/frame]": 1e3 * theirs.seconds / len(theirs.time),
    }


def _shared_weights(
    folder: Path, case: MarkerCase, model: mm.Model, markers: mm.Markers
) -> dict[str, float]:
    """Return the weights of markers that the model and the recording have, 1 without a file."""
    if case.tasks:
        weights = read_ik_tasks(folder / case.tasks).marker_weights
    else:
        weights = dict.fromkeys(model.marker_names, 1.0)
    return {
        name: weight
        for name, weight in weights.items()
        if name in markers.names and name in model.marker_names
    }


def motion_from_opensim(model: mm.Model, result: opensim_tools.ToolResult) -> mm.Motion:
    """Coordinates a tool wrote, degrees turned into radians."""
    names = [name for name in result.names if name in model.coordinate_names]
    columns = [
        result.values[:, result.names.index(name)]
        * (np.pi / 180.0 if model.coordinate(name).motion == "rotational" else 1.0)
        for name in names
    ]
    return mm.Motion(result.time, tuple(names), np.column_stack(columns))


def motion_at(motion: mm.Motion, at: np.ndarray) -> mm.Motion:
    """Return the frames nearest to some times.

    Parameters
    ----------
    motion : to choose frames of
    at : (times,) [s]

    Returns
    -------
    Motion at these frames
    """
    index = np.abs(motion.time[:, None] - at[None]).argmin(axis=0)
    return mm.Motion(at, motion.names, motion.values[index])


def markers_at(markers: mm.Markers, at: np.ndarray) -> mm.Markers:
    """Return the frames nearest to some times.

    Parameters
    ----------
    markers : to choose frames of
    at : (times,) [s]

    Returns
    -------
    Markers at these frames
    """
    index = np.abs(markers.time[:, None] - at[None]).argmin(axis=0)
    return mm.Markers(at, markers.names, markers.values[index])


def written_whole(model: mm.Model, motion: mm.Motion, folder: Path) -> tuple[mm.Motion, Path]:
    """Return the motion with every coordinate, and a file of it.

    OpenSim's tools overlook columns named as states.
    """
    whole = mm.Motion(
        motion.time, model.coordinate_names, compile_tree(model).coordinates_of(motion)
    )
    path = folder / "motion.mot"
    mm.write_sto(table_from_motion(whole, model), path)
    return whole, path


def measure_inverse_dynamics(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each recording."""
    return (_inverse_dynamics(folder, case) for case in FORCE_CASES)


def _inverse_dynamics(folder: Path, case: ForceCase) -> dict[str, object]:
    """Largest RMS difference of a coordinate relative to its range, and milliseconds a frame."""
    model = mm.read_model(folder / case.model)
    given = mm.read_motion(folder / case.motion, model)
    loads = folder / case.loads if case.loads else None

    def chain() -> mm.Series:
        differentiated = cut(mm.differentiate(motion), case.start, case.end)
        wrenches = None
        if loads is not None:
            wrenches = mm.resample_wrenches(read_external_loads(loads), differentiated.time)
        return mm.inverse_dynamics(model, differentiated, wrenches)

    with tempfile.TemporaryDirectory() as work:
        motion, motion_path = written_whole(model, given, Path(work))
        chain()
        began = time.perf_counter()
        ours = chain()
        seconds = time.perf_counter() - began
        theirs = opensim_tools.inverse_dynamics(
            folder / case.model, motion_path, loads, float(ours.time[0]), float(ours.time[-1])
        )
    worst, worst_name = _worst_coordinate(ours, theirs)
    return {
        "case": case.name,
        "frames": len(theirs.time),
        "coordinates": len(model.coordinates),
        "worst RMS / range [%]": 100.0 * worst,
        "worst coordinate": worst_name,
        "ours [ms/frame]": 1e3 * seconds / len(ours),
        "OpenSim [ms/frame]": 1e3 * theirs.seconds / len(theirs.time),
    }


def _worst_coordinate(ours: mm.Series, theirs: opensim_tools.ToolResult) -> tuple[float, str]:
    """Return the largest RMS difference relative to OpenSim's range, and whose it is."""
    index = np.abs(ours.time[:, None] - theirs.time[None]).argmin(axis=0)
    worst = 0.0
    worst_name = ""
    for j, label in enumerate(theirs.names):
        name = label.rsplit("_", 1)[0]
        difference = ours[name][index] - theirs.values[:, j]
        spread = np.ptp(theirs.values[:, j])
        relative = float(np.sqrt(np.mean(difference**2)) / spread) if spread > 1e-6 else 0.0
        if relative > worst:
            worst = relative
            worst_name = name
    return worst, worst_name


MJCF = (
    *("mouse-arm-muscles/akira_muscle.xml", "mouse-skeleton-keypoints/mouse_with_meshes.xml"),
    "rat-keypoints/rodent.xml",
)
FRAMES = 260
RATE = 100.0
"""Of a recording: more than four chunks of inverse kinematics."""

SWING = 0.35
"""Largest swing of an angle to either side of its default [rad]; the heading of a floating body
turns once.
"""

ARM = 1.0 / 20.0
NOISE = 1.0 / 1000.0
"""Distance of markers from the body's origin and their error, over the model's size: 9 cm and 1.8
mm for a human.
"""

CUTOFF = 6.0
"""Low-pass filter before torques [Hz]."""

JUMP = 1.5 * np.pi
"""Change of an angle from frame to frame that is a whole turn [rad]; no simulated angle changes by
a tenth of it.
"""


def measure_turns(folder: Path) -> Iterator[dict[str, object]]:
    """Count turns in what chunks give and in the result.

    Each row is of a model. Torques are compared with those of one chunk.
    """
    for path in [*sorted(folder.rglob("*.osim")), *(folder / name for name in MJCF)]:
        try:
            model = _free(mm.read_model(path))
        except mm.MyomorphError:
            continue
        turning = [coordinate.motion == "rotational" for coordinate in model.coordinates]
        if not model.mass > 0.0 or not any(turning):
            continue
        row: dict[str, object] = {"model": str(path.relative_to(folder)), "angles": sum(turning)}
        try:
            markers = _simulated(model, np.random.default_rng(0))
            result = mm.inverse_kinematics(model, markers).motion
        except mm.MyomorphError as error:
            yield row | {"not simulated": str(error)[:80]}
            continue
        chunks = _solved(model, markers, 64)
        whole = _solved(model, markers, FRAMES)
        torques = _torques(model, result)[:, turning]
        apart = _torques(model, whole)[:, turning]
        yield row | {
            "turns, chunks alone": _turns(chunks, turning),
            "turns": _turns(result, turning),
            "largest step [deg]": np.degrees(
                np.abs(np.diff(result.values[:, turning], axis=0)).max()
            ),
            "largest step, one chunk [deg]": np.degrees(
                np.abs(np.diff(whole.values[:, turning], axis=0)).max()
            ),
            "largest torque [N m]": np.abs(apart).max(),
            "difference to one chunk [N m]": np.abs(torques - apart).max(),
            "difference, chunks alone [N m]": np.abs(
                _torques(model, chunks)[:, turning] - apart
            ).max(),
        }


def _free(model: Model) -> Model:
    """Return the model without bounds of rotations, and with four markers on every body."""
    coordinates = [
        replace(coordinate, clamped=coordinate.clamped and coordinate.motion != "rotational")
        for coordinate in model.coordinates
    ]
    places = _size(model) * ARM * np.vstack([np.zeros(3), np.eye(3)])
    markers = [
        Marker(f"{body.name}{i}", body.name, place)
        for body in model.bodies
        for i, place in enumerate(places)
    ]
    return replace(model, coordinates=tuple(coordinates), markers=tuple(markers))


def _size(model: Model) -> float:
    """Largest extent of the origins of all bodies in the default pose [m]."""
    tree = compile_tree(model)
    return float(np.ptp(forward_kinematics(tree, tree.defaults[None]).origins[0], axis=0).max())


def _simulated(model: Model, random: np.random.Generator) -> Markers:
    """Markers with errors of a smooth motion of all free angles."""
    tree = compile_tree(model)
    time = np.arange(FRAMES) / RATE
    values = np.tile(tree.defaults, (FRAMES, 1))
    heading = [
        name
        for name in floating_coordinates(model)
        if model.coordinate(name).motion == "rotational"
    ][-1:]
    for index in free_coordinates(tree):
        coordinate = model.coordinates[index]
        if coordinate.motion != "rotational":
            continue
        if coordinate.name in heading:
            values[:, index] += 2.0 * np.pi * time / time[-1]
            continue
        low, high = (
            coordinate.range if coordinate.range[0] < coordinate.range[1] else (-np.pi, np.pi)
        )
        swing = min(SWING, 0.25 * (high - low))
        middle = np.clip(coordinate.default, low + swing, high - swing)
        phase = 2.0 * np.pi * random.uniform(0.3, 1.0) * time + random.uniform(0.0, 2.0 * np.pi)
        values[:, index] = middle + swing * np.sin(phase)
    poses = forward_kinematics(tree, close_loops(tree, values))
    bodies = np.array([tree.body_index[marker.body] for marker in model.markers])
    places = poses.points(bodies, np.array([marker.location for marker in model.markers]))
    errors = NOISE * _size(model) * random.standard_normal(places.shape)
    return Markers(time, model.marker_names, places + errors)


def _solved(model: Model, markers: Markers, chunk: int) -> mm.Motion:
    """Poses of stretches of frames that were solved apart, as they come."""
    tree = compile_tree(model)
    options = mm.InverseKinematicsOptions()
    problem = pose_problem(tree, *tracked_markers(model, markers, options), options, markers)
    starts = np.repeat(scout_poses(tree, problem, options.settings), SCOUT, axis=0)[: len(markers)]
    # Users cannot choose it: it changes no more than which frames a thread solves in turn.
    with patch.object(newton, "CHUNK", chunk):
        values = newton.solve_poses(tree, problem, starts, options.settings).values
    return mm.Motion(markers.time, model.coordinate_names, values)


def _torques(model: Model, motion: mm.Motion) -> Array:
    return mm.inverse_dynamics(model, mm.differentiate(motion, CUTOFF)).values


def _turns(motion: mm.Motion, turning: list[bool]) -> int:
    return int((np.abs(np.diff(motion.values[:, turning], axis=0)) > JUMP).sum())
