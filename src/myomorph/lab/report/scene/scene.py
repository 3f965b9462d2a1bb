"""The body in space at chosen instants: bones, muscle paths and ground forces, to be drawn."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.model.sides import split_side
from myomorph.core.model.surface import Surface, body_meshes
from myomorph.core.muscles.drawn_paths import drawn_paths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analysis.selection import subjects
from myomorph.lab.report.scene.shapes import box_corners, primitive, stand_ins, sticks


@dataclass(frozen=True, eq=False)
class Solid:
    """A surface that moves with a body: its number (0 is the ground) and its local surface."""

    body: int
    surface: Surface


@read_only
class MusclePath:
    """A muscle as a line."""

    name: str
    points: Array  # (frames, points, 3) in ground [m], NaN beyond the last that a frame uses
    radius: float  # to draw it with [m]
    activation: Array  # (frames,), NaN where unknown


@read_only
class Scene:
    """What is to be seen at some instants."""

    time: Array  # (frames,) [s]
    # rotations, origins: (frames, bodies, 3, 3), (frames, bodies, 3) poses in ground, body 0 the
    # ground
    rotations: Array
    origins: Array
    solids: tuple[Solid, ...]  # bones, or sticks where a body has no mesh
    muscles: tuple[MusclePath, ...]  # their paths
    # force_starts, force_vectors: (frames, wrenches, 3) point [m] and force [N], NaN where unloaded
    force_starts: Array
    force_vectors: Array
    weight: float  # of the body [N], the size that force arrows are drawn by
    # up, forward, right: unit vectors of the subject in ground, (3,)
    up: Array
    forward: Array
    right: Array
    size: float  # of the body [m]
    # low, high: lowest and highest height that the body reaches along `up` [m]
    low: float
    high: float
    floor: float  # height of the ground along `up` [m]


class Acting(NamedTuple):
    """What acts on the body and in it, at its nearest sample.

    Attributes
    ----------
    activations : which color the muscles
    wrenches : which become arrows
    """

    activations: Series | None = None
    wrenches: Wrenches | None = None


NOTHING_ACTS = Acting()


def make_scene(
    model: Model,
    motion: Motion,
    frames: Sequence[int],
    surfaces: Mapping[str, Surface] | None = None,
    acting: Acting = NOTHING_ACTS,
) -> Scene:
    """Make the scene of the body at some frames of a motion.

    Bodies whose meshes are absent become sticks.
    """
    tree = compile_tree(model)
    chosen = np.asarray(frames, dtype=np.int64)
    time = motion.time[chosen]
    coordinates = np.ascontiguousarray(np.nan_to_num(tree.coordinates_of(motion)[chosen]))
    poses = forward_kinematics(tree, coordinates)
    solids = _solids(model, tree.body_index, surfaces or {})
    low, high, size = _extent(poses, solids, model.up)
    forward, right = _facing(model, poses, model.up) or _heading(model, poses, model.up)
    starts, vectors = _forces(acting.wrenches, time)
    muscles = _muscles(model, coordinates, acting.activations, time, size)
    heights = [muscle.points @ model.up for muscle in muscles]
    return Scene(
        time=time,
        rotations=poses.rotations,
        origins=poses.origins,
        solids=solids,
        muscles=muscles,
        force_starts=starts,
        force_vectors=vectors,
        weight=_weight(model, vectors),
        up=model.up,
        forward=forward,
        right=right,
        size=size,
        low=min([low, *(float(np.nanmin(each)) for each in heights)]),
        high=max([high, *(float(np.nanmax(each)) for each in heights)]),
        floor=_floor(starts @ model.up, low, size),
    )


def _weight(model: Model, forces: Array) -> float:
    """Return the body's weight, or where it has none, the largest force component [N]."""
    return model.weight if model.weight > 0 else float(np.nanmax(np.abs(forces), initial=1.0))


def _floor(heights: Array, lowest: float, size: float) -> float:
    """Find the floor's height by those of forces, else by the lowest point of the body [m]."""
    floor = float(np.nanmedian(heights)) if np.isfinite(heights).any() else lowest
    if not lowest - 0.2 * size < floor < lowest + 0.2 * size:
        # Forces far from the feet (a bar, a wheel) say nothing of the ground.
        return lowest
    return floor


def _solids(
    model: Model, numbers: Mapping[str, int], surfaces: Mapping[str, Surface]
) -> tuple[Solid, ...]:
    solids: list[Solid] = []
    fallback = sticks(model) | stand_ins(model)
    for body in model.bodies:
        surfaces_of = [surface for surface in body_meshes(body, surfaces) if len(surface.faces)]
        for mesh in body.meshes:
            shape = primitive(mesh)
            if shape is not None:
                surfaces_of.append(Surface(mesh.pose.apply(shape.vertices), shape.faces))
        solids += [
            Solid(numbers[body.name], surface) for surface in surfaces_of or fallback[body.name]
        ]
    return tuple(solids)


def _extent(poses: Poses, solids: Sequence[Solid], up: Array) -> tuple[float, float, float]:
    """Find lowest and highest height and size of the body over the frames [m].

    A few points of every solid stand for it.
    """
    stacked = np.concatenate(
        solid_corners(solids, poses.rotations, poses.origins) or [poses.origins[:, 1:]], axis=1
    )
    heights = stacked @ up
    size = float(np.linalg.norm(np.ptp(stacked, axis=1), axis=1).max())
    return float(heights.min()), float(heights.max()), max(size, 1e-6)


def solid_corners(solids: Sequence[Solid], rotations: Array, origins: Array) -> list[Array]:
    """Find the corners of the box around each solid, of bodies in their poses.

    Parameters
    ----------
    solids : surfaces, each on a body
    rotations : (frames, bodies, 3, 3) from each body to ground
    origins : (frames, bodies, 3) in ground [m]

    Returns
    -------
    (frames, 8, 3) in ground [m], for each solid
    """
    return [
        np.einsum("fij,pj->fpi", rotations[:, solid.body], box_corners(solid.surface))
        + origins[:, None, solid.body]
        for solid in solids
    ]


def _facing(model: Model, poses: Poses, up: Array) -> tuple[Array, Array] | None:
    """Find the direction from the first person to the second, so that both are seen from the side.

    The result is None with fewer than two persons.
    """
    people = [subject for subject in subjects(model) if len(subject.bodies) > 1]
    if len(people) < 2:
        return None
    numbers = poses.tree.body_index
    middles = [
        poses.origins[:, [numbers[body] for body in person.bodies]].mean(axis=1)
        for person in people[:2]
    ]
    ahead = (middles[1] - middles[0]).mean(axis=0)
    ahead = ahead - (ahead @ up) * up
    length = float(np.linalg.norm(ahead))
    return None if length < 1e-3 else (ahead / length, np.cross(ahead / length, up))


def _heading(model: Model, poses: Poses, up: Array) -> tuple[Array, Array]:
    """Find where the subject looks and where its right is, from bodies that come in pairs.

    Without pairs x is forward.
    """
    numbers = poses.tree.body_index
    sides: dict[str, dict[str, int]] = {}
    for body in model.bodies:
        base, side = split_side(body.name)
        sides.setdefault(base, {})[side] = numbers[body.name]
    couples = [
        (both["right"], both["left"])
        for both in sides.values()
        if "right" in both and "left" in both
    ]
    right = np.zeros(3)
    for r, left in couples:
        across = poses.origins[:, r] - poses.origins[:, left]
        across = across - np.outer(across @ up, up)
        lengths = np.linalg.norm(across, axis=1, keepdims=True)
        # Pairs that start in one point (hips in one pelvis frame) show nothing.
        right += np.where(lengths > 1e-6, across / np.maximum(lengths, 1e-9), 0.0).mean(axis=0)
    if np.linalg.norm(right) < 0.3 * max(len(couples), 1):
        ahead = np.array([1.0, 0.0, 0.0])
        ahead = ahead - (ahead @ up) * up
        ahead = (
            ahead / np.linalg.norm(ahead)
            if np.linalg.norm(ahead) > 0.1
            else np.array([0.0, 0.0, 1.0])
        )
        return ahead, np.cross(ahead, up)
    right /= np.linalg.norm(right)
    return np.cross(up, right), right


def _forces(wrenches: Wrenches | None, time: Array) -> tuple[Array, Array]:
    if wrenches is None or not len(wrenches) or not len(wrenches.names):
        return np.full((len(time), 0, 3), np.nan), np.full((len(time), 0, 3), np.nan)
    nearest = nearest_samples(wrenches.time, time)
    points = np.array(wrenches.points[nearest])
    forces = np.array(wrenches.forces[nearest])
    idle = np.linalg.norm(forces, axis=2) < 0.05 * max(
        float(np.nanmax(np.abs(wrenches.forces), initial=0.0)), 1e-12
    )
    points[idle] = np.nan
    forces[idle] = np.nan
    forces[~np.isfinite(points).all(axis=2)] = np.nan
    return points, forces


def nearest_samples(clock: Array, time: Array) -> np.ndarray:
    """Find the sample of a clock that is nearest to each time.

    Parameters
    ----------
    clock : (samples,) [s]
    time : (frames,) [s]

    Returns
    -------
    (frames,) indices of samples
    """
    after = np.clip(np.searchsorted(clock, time), 1, max(len(clock) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(clock) - 1)
    return np.where(time - clock[before] <= clock[after] - time, before, after)


def _muscles(
    model: Model, coordinates: Array, activations: Series | None, time: Array, size: float
) -> tuple[MusclePath, ...]:
    strongest = max((muscle.max_isometric_force for muscle in model.muscles), default=1.0) or 1.0
    columns = {} if activations is None else {name: i for i, name in enumerate(activations.names)}
    nearest = (
        np.zeros(0, np.int64) if activations is None else nearest_samples(activations.time, time)
    )
    outside = np.zeros(len(time), dtype=bool)
    if activations is not None and len(activations) > 1:
        # Between samples the nearest one counts; before and after the solution nothing is known.
        near = 1.5 / activations.rate
        outside = (time < activations.time[0] - near) | (time > activations.time[-1] + near)
    tubes = []
    drawn = drawn_paths(compile_paths(model), coordinates) if model.muscles else None
    for m, muscle in enumerate(model.muscles):
        assert drawn is not None
        active = np.full(len(time), np.nan)
        if activations is not None and muscle.name in columns:
            active = np.array(activations.values[nearest, columns[muscle.name]])
            active[outside] = np.nan
        share = np.sqrt(max(muscle.max_isometric_force, 0.0) / strongest)
        radius = size * (0.0013 + 0.0036 * float(share))
        tubes.append(
            MusclePath(
                name=muscle.name,
                points=drawn.places[:, drawn.muscle == m],
                radius=radius,
                activation=active,
            )
        )
    return tuple(tubes)
