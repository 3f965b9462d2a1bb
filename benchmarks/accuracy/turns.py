"""Whole turns of angles: simulated markers of every model of the collection, without bounds of rotations."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np

import myomorph as mm
from myomorph.model.arrays import Array
from myomorph.model.model import Marker, Model
from myomorph.model.series import Markers
from myomorph.motion.ik import pose_problem, tracked_markers
from myomorph.motion.newton import solve_poses
from myomorph.motion.starts import SCOUT, scout_poses
from myomorph.motion.turns import floating_coordinates
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.loops import close_loops, free_coordinates
from myomorph.rigid.tree import compile_tree

MJCF = (
    *("mouse-arm-muscles/akira_muscle.xml", "mouse-skeleton-keypoints/mouse_with_meshes.xml"),
    "rat-keypoints/rodent.xml",
)
FRAMES, RATE = 260, 100.0
"""Of a recording: more than four chunks of inverse kinematics."""

SWING = 0.35
"""Largest swing of an angle to either side of its default [rad]; the heading of a floating body turns once."""

ARM, NOISE = 1.0 / 20.0, 1.0 / 1000.0
"""Distance of markers from the body's origin and their error, over the model's size: 9 cm and 1.8 mm for a human."""

CUTOFF = 6.0
"""Low-pass filter before torques [Hz]."""

JUMP = 1.5 * np.pi
"""Change of an angle from frame to frame that is a whole turn [rad]; no simulated angle changes by a tenth of it."""


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """A row a model: turns in what chunks give and in the result, and torques beside those of one chunk."""
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
        chunks, whole = (_solved(model, markers, chunk) for chunk in (64, FRAMES))
        torques, apart = (_torques(model, motion)[:, turning] for motion in (result, whole))
        yield row | {
            "turns, chunks alone": _turns(chunks, turning),
            "turns": _turns(result, turning),
            "largest step [deg]": np.degrees(np.abs(np.diff(result.values[:, turning], axis=0)).max()),
            "largest step, one chunk [deg]": np.degrees(np.abs(np.diff(whole.values[:, turning], axis=0)).max()),
            "largest torque [N m]": np.abs(apart).max(),
            "difference to one chunk [N m]": np.abs(torques - apart).max(),
            "difference, chunks alone [N m]": np.abs(_torques(model, chunks)[:, turning] - apart).max(),
        }


def _free(model: Model) -> Model:
    """The model without bounds of rotations, and with four markers on every body."""
    coordinates = [
        replace(coordinate, clamped=coordinate.clamped and coordinate.motion != "rotational")
        for coordinate in model.coordinates
    ]
    places = _size(model) * ARM * np.vstack([np.zeros(3), np.eye(3)])
    markers = [Marker(f"{body.name}{i}", body.name, place) for body in model.bodies for i, place in enumerate(places)]
    return replace(model, coordinates=tuple(coordinates), markers=tuple(markers))


def _size(model: Model) -> float:
    """Largest extent of the origins of all bodies in the default pose [m]."""
    tree = compile_tree(model)
    return float(np.ptp(forward_kinematics(tree, tree.defaults[None]).origins[0], axis=0).max())


def _simulated(model: Model, random: np.random.Generator) -> Markers:
    """Markers with errors of a smooth motion of all free angles."""
    tree, time = compile_tree(model), np.arange(FRAMES) / RATE
    values = np.tile(tree.defaults, (FRAMES, 1))
    heading = [name for name in floating_coordinates(model) if model.coordinate(name).motion == "rotational"][-1:]
    for index in free_coordinates(tree):
        coordinate = model.coordinates[index]
        if coordinate.motion != "rotational":
            continue
        if coordinate.name in heading:
            values[:, index] += 2.0 * np.pi * time / time[-1]
            continue
        low, high = coordinate.range if coordinate.range[0] < coordinate.range[1] else (-np.pi, np.pi)
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
    tree, options = compile_tree(model), mm.InverseKinematicsOptions()
    problem = pose_problem(tree, *tracked_markers(model, markers, options), options, markers)
    starts = np.repeat(scout_poses(tree, problem, options.settings), SCOUT, axis=0)[: len(markers)]
    values = solve_poses(tree, problem, starts, options.settings, chunk=chunk).values
    return mm.Motion(markers.time, model.coordinate_names, values)


def _torques(model: Model, motion: mm.Motion) -> Array:
    return mm.inverse_dynamics(model, mm.differentiate(motion, CUTOFF)).values


def _turns(motion: mm.Motion, turning: list[bool]) -> int:
    return int((np.abs(np.diff(motion.values[:, turning], axis=0)) > JUMP).sum())
