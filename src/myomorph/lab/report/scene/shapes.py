"""Surfaces made here: primitive shapes, shapes of bodies without a mesh, and coarser copies."""

from __future__ import annotations

import itertools
import re
from collections.abc import Sequence
from functools import lru_cache
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Mesh, Model
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.kinematics import standing_poses

FINEST = 0.012  # Cells that surfaces are made coarser by at first, as a share of the body's size.


def primitive(mesh: Mesh) -> Surface | None:
    """Make the surface of a primitive in its own frame, of the half sizes `mesh.scale`.

    The result is None for other meshes. A cylinder or capsule of two sizes (the third is zero)
    stands along z with a radius and half a length, as in MuJoCo; one of three along y, as in
    OpenSim.
    """
    size = np.asarray(mesh.scale, dtype=np.float64)
    if mesh.shape in ("sphere", "ellipsoid"):
        return _scaled(_ball(), size if mesh.shape == "ellipsoid" else np.full(3, size[0]))
    if mesh.shape == "box":
        return _scaled(_box(), size)
    if mesh.shape == "cylinder":
        if size[2] > 0.0:
            rod = _rod()
            return _scaled(Surface(rod.vertices[:, [0, 2, 1]], rod.faces), size)
        return _scaled(_rod(), np.array([size[0], size[0], size[1]]))
    if mesh.shape == "capsule":
        ball = _ball()
        shift = np.where(ball.vertices[:, 2:] >= 0, size[1], -size[1]) * np.array([0.0, 0.0, 1.0])
        return Surface(ball.vertices * size[0] + shift, ball.faces)
    return None


def _scaled(surface: Surface, factors: Array) -> Surface:
    return Surface(surface.vertices * factors, surface.faces)


@lru_cache(maxsize=4)
def _ball(rings: int = 10, sides: int = 14) -> Surface:
    """Make a unit sphere of rings around z.

    Both middle rings are on one side of the equator so that it can be pulled apart.
    """
    polar = np.linspace(0.0, np.pi, rings)[:, None, None]
    points = np.sin(polar) * _ring(sides) + np.cos(polar) * np.array([0.0, 0.0, 1.0])
    return Surface(points.reshape(-1, 3), quads(rings, sides))


@lru_cache(maxsize=1)
def _rod(sides: int = 10) -> Surface:
    """Make a closed unit cylinder along z, from -1 to 1."""
    ring = _ring(sides)
    up = np.array([0.0, 0.0, 1.0])
    points = np.concatenate([0.0 * ring + up, ring + up, ring - up, 0.0 * ring - up])
    return Surface(points, quads(4, sides))


def _ring(sides: int) -> Array:
    """(sides, 3) points on the unit circle around z."""
    around = np.arange(sides) * 2.0 * np.pi / sides
    return np.stack([np.cos(around), np.sin(around), np.zeros(sides)], axis=1)


def tube(sides: int = 6) -> Surface:
    """Side of a unit cylinder along z from -1 to 1, open because muscles end in bones."""
    ring = _ring(sides)
    up = np.array([0.0, 0.0, 1.0])
    return Surface(np.concatenate([ring + up, ring - up]), quads(2, sides))


@lru_cache(maxsize=1)
def cone(sides: int = 12) -> Surface:
    """Make a closed unit cone along z, its base at -1 and its tip at 1."""
    ring = _ring(sides) - [0.0, 0.0, 1.0]
    tips = np.tile([0.0, 0.0, 1.0], (sides, 1))
    fan = np.stack(
        [np.zeros(sides - 2, np.int64), np.arange(2, sides), np.arange(1, sides - 1)], axis=1
    )
    return Surface(
        np.concatenate([tips, ring, ring]), np.concatenate([quads(2, sides), fan + 2 * sides])
    )


@lru_cache(maxsize=1)
def _box() -> Surface:
    corners = np.array(
        [[x, y, z] for x in (-1, 1) for y in (-1, 1) for z in (-1, 1)], dtype=np.float64
    )
    sides = [(0, 1, 3, 2), (4, 6, 7, 5), (0, 4, 5, 1), (2, 3, 7, 6), (0, 2, 6, 4), (1, 5, 7, 3)]
    # Corners are not shared, so that every side keeps its own normal.
    points = corners[[i for side in sides for i in side]]
    faces = [
        (4 * side + a, 4 * side + b, 4 * side + c)
        for side in range(6)
        for a, b, c in ((0, 1, 2), (0, 2, 3))
    ]
    return Surface(points, np.array(faces))


def quads(rings: int, sides: int) -> np.ndarray:
    """Make the triangles of a surface whose vertices are rings, in order.

    Parameters
    ----------
    rings : how many
    sides : vertices of a ring

    Returns
    -------
    (2 (rings - 1) sides, 3) indices of vertices
    """
    i, j = np.meshgrid(np.arange(rings - 1), np.arange(sides), indexing="ij")
    a = i * sides + j
    b = i * sides + (j + 1) % sides
    faces = np.stack(
        [np.stack([a, a + sides, b + sides], axis=-1), np.stack([a, b + sides, b], axis=-1)], axis=2
    )
    return faces.reshape(-1, 3)


def stick(start: Array, end: Array, radius: float) -> Surface:
    """Make a spindle from one point to another, as bones are drawn without a mesh.

    Parameters
    ----------
    start, end : (3,) [m]; it is thickest near the start
    radius : [m]

    Returns
    -------
    Surface in the frame of the points
    """
    axes, length = _axes_along(start, end)
    ball = _ball().vertices
    profile = 1.0 - 0.45 * np.clip((ball[:, 2:] + 1.0) / 2.0, 0.0, 1.0)
    local = np.concatenate([ball[:, :2] * radius * profile, ball[:, 2:] * length / 2], axis=1)
    return Surface(
        local @ axes + start + 0.5 * (np.asarray(end, dtype=np.float64) - start), _ball().faces
    )


def _axes_along(start: Array, end: Array) -> tuple[Array, float]:
    """Find axes (3, 3), one a row, of which the third goes from one point to another.

    The distance of the points is the second result.
    """
    along = np.asarray(end, dtype=np.float64) - start
    length = max(float(np.linalg.norm(along)), 1e-9)
    z = along / length
    x = np.cross(z, np.eye(3)[int(np.argmin(np.abs(z)))])
    x /= np.linalg.norm(x)
    return np.stack([x, np.cross(z, x), z]), length


def sphere(radius: float, rings: int = 6, sides: int = 8) -> Surface:
    """Make a ball around the origin."""
    return _scaled(_ball(rings, sides), np.full(3, radius))


def ellipsoid(middle: Array, axes: Array, half: Array) -> Surface:
    """Make an ellipsoid.

    Parameters
    ----------
    middle : (3,) [m]
    axes : (3, 3) unit vectors, one a row
    half : (3,) half sizes along the axes [m]

    Returns
    -------
    Surface in the frame of the middle
    """
    ball = _ball()
    # Axes of a left-handed frame would turn the surface inside out.
    faces = ball.faces if np.linalg.det(axes) > 0.0 else ball.faces[:, ::-1]
    return Surface((ball.vertices * half) @ axes + middle, faces)


def capsule(start: Array, end: Array, radius: float) -> Surface:
    """Make a round limb from one point to another.

    Parameters
    ----------
    start, end : (3,) [m]
    radius : at and beyond both points [m]

    Returns
    -------
    Surface in the frame of the points
    """
    axes, length = _axes_along(start, end)
    ball = _ball().vertices
    local = radius * ball + np.where(ball[:, 2:] > 0.0, length, 0.0) * np.array([0.0, 0.0, 1.0])
    return Surface(local @ axes + start, _ball().faces)


def bones(model: Model) -> dict[str, tuple[Array, list[Array]]]:
    """Find the centers of the joints of every body in the default pose, in its frame [m].

    Parameters
    ----------
    model : with its joints

    Returns
    -------
    By body, the (3,) center of its own joint and those of the joints it carries
    """
    poses = standing_poses(model)
    starts = {joint.child: joint.child_frame.translation for joint in model.joints}
    result: dict[str, tuple[Array, list[Array]]] = {
        name: (starts[name], []) for name in model.body_names
    }
    for joint in model.joints:
        if joint.parent in result:
            center = poses[joint.child].apply(starts[joint.child])
            result[joint.parent][1].append(poses[joint.parent].inverse().apply(center))
    return result


def sticks(model: Model) -> dict[str, list[Surface]]:
    """Make spindles between the centers of each body's joints, in its frame.

    The spindle of a last body goes to twice its mass center.
    """
    result: dict[str, list[Surface]] = {body.name: [] for body in model.bodies}
    for body, (start, ends) in zip(model.bodies, bones(model).values(), strict=True):
        if not ends and body.mass > 0.0:
            ends = [start + 1.8 * (body.mass_center - start)]
        lengths = [float(np.linalg.norm(end - start)) for end in ends]
        for end, length in zip(ends, lengths, strict=True):
            if length > 1e-6 and length > 0.15 * max(lengths):
                result[body.name].append(stick(start, end, 0.07 * length))
    return result


def coarser(surface: Surface, cell: float) -> Surface:
    """Make a copy with fewer triangles.

    Vertices in one cell of a grid of edge `cell` [m] become their mean.
    """
    if not len(surface.faces):
        return surface
    cells = np.floor((surface.vertices - surface.vertices.min(axis=0)) / cell).astype(np.int64)
    _, owner = np.unique(_one_number(cells), return_inverse=True)
    count = np.bincount(owner)
    points = np.stack(
        [np.bincount(owner, surface.vertices[:, i]) / count for i in range(3)], axis=1
    )
    faces = owner[surface.faces]
    a, b, c = faces.T
    faces = faces[(a != b) & (b != c) & (c != a)]
    _, first = np.unique(_one_number(np.sort(faces, axis=1)), return_index=True)
    faces = faces[np.sort(first)]
    used, renumbered = np.unique(faces, return_inverse=True)
    return Surface(points[used], renumbered.reshape(-1, 3))


def reduced(surfaces: Sequence[Surface], size: float, most: int) -> list[Surface]:
    """Make coarser copies of the surfaces of a body of a size [m].

    Together they have no more triangles than a screen needs.
    """
    shrunk = list(surfaces)
    if sum(len(surface.faces) for surface in shrunk) <= most:
        return shrunk
    extents = [float(np.linalg.norm(np.ptp(surface.vertices, axis=0))) for surface in surfaces]
    # Small bones get smaller cells, or fingers and ribs would vanish before a pelvis looks coarse.
    cells = [(extent / size) ** 0.7 * size * FINEST for extent in extents]
    for attempt in range(20):
        shrunk = [
            surface if len(surface.faces) < 60 else coarser(surface, cell * 1.25**attempt)
            for surface, cell in zip(surfaces, cells, strict=True)
        ]
        if sum(len(surface.faces) for surface in shrunk) <= most:
            break
    return shrunk


def _one_number(rows: np.ndarray) -> np.ndarray:
    """Rows (n, 3) of counts from 0 as one number each, in the rows' order."""
    wide = rows.max(axis=0, initial=0) + 1
    return (rows[:, 0] * wide[1] + rows[:, 1]) * wide[2] + rows[:, 2]


def box_corners(surface: Surface) -> Array:
    """Find the corners of the box around a surface.

    Parameters
    ----------
    surface : with its vertices

    Returns
    -------
    (8, 3) in the frame of the surface [m]
    """
    ends = np.array([surface.vertices.min(axis=0), surface.vertices.max(axis=0)])
    return np.array(list(itertools.product(*ends.T)))


def outward(surface: Surface) -> Surface:
    """Return the surface with faces that look outwards as a whole.

    Such faces enclose a volume above zero.
    """
    if not len(surface.faces):
        return surface
    a, b, c = (surface.vertices - surface.vertices.mean(axis=0))[surface.faces].transpose(1, 0, 2)
    volume = np.einsum("ij,ij->", a, np.cross(b, c))
    return surface if volume >= 0.0 else Surface(surface.vertices, surface.faces[:, ::-1])


def normals(surface: Surface) -> Array:
    """Compute the unit normal at every vertex.

    Parameters
    ----------
    surface : with its faces

    Returns
    -------
    (n, 3) zero where no face touches the vertex
    """
    corners = surface.vertices[surface.faces]
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    total = np.zeros((len(surface.vertices), 3))
    for i in range(3):
        total[:, i] = sum(
            np.bincount(surface.faces[:, corner], across[:, i], len(total)) for corner in range(3)
        )
    lengths = np.linalg.norm(total, axis=1, keepdims=True)
    return total / np.where(lengths > 0, lengths, 1.0)


TRUNK = re.compile(r"(?:^|_)(?:torso|trunk|thorax|ribcage|upper_?body)(?:$|_)", re.IGNORECASE)
HEAD = re.compile(r"(?:^|_|neck)(?:head|skull|cranium)(?:$|_|neck)", re.IGNORECASE)

SHOULDERS = 1.42
HEAD_CENTER = 1.82
"""Heights over the joint of a trunk that ends at the lumbar spine, in units of that of its mass
center (gait2354).
"""

THORAX = np.array([0.31, 0.48, 0.23])
"""Half sizes of a thorax to the side, upwards and forward, in units of its height from the joint to
the shoulders.
"""

# Of a head, in units of the height of the trunk's mass center over its joint.
SKULL = np.array([0.19, 0.29, 0.24])


def stand_ins(model: Model) -> dict[str, list[Surface]]:
    """Make shapes of trunks and heads, in their bodies' frames.

    A trunk has a head where no body of its own is one. Shapes are made only for trunks and heads
    that have a mass center away from their joint, which shows their size.
    """
    poses = standing_poses(model)
    model_bones = bones(model)
    trunk = next(
        (body for body in model.bodies if TRUNK.search(body.name) and body.mass > 0.0), None
    )
    if trunk is None:
        return {}
    start, joints = model_bones[trunk.name]
    turn = poses[trunk.name].rotation
    up = turn.T @ model.up
    if float(np.linalg.norm(trunk.mass_center - start)) <= 0.0:
        return {}
    axes = np.stack([_across(model, up, turn), up, np.zeros(3)])
    axes[2] = np.cross(axes[0], up)
    headed = any(HEAD.search(body.name) for body in model.bodies)
    thorax = _thorax(trunk.mass_center, start, up, joints if headed else ())
    shapes = [ellipsoid(thorax.middle, axes, thorax.height * THORAX)]
    if not headed:
        shapes.append(ellipsoid(thorax.head, axes, thorax.size * SKULL))
    result = {trunk.name: shapes}
    for body in model.bodies:
        start, joints = model_bones[body.name]
        reach = float(np.linalg.norm(body.mass_center - start))
        if HEAD.search(body.name) and body is not trunk and not joints and reach > 0.0:
            there = poses[body.name].rotation.T @ turn @ axes.T
            half = max(reach, 0.3 * thorax.size) * SKULL / SKULL[1]
            result[body.name] = [ellipsoid(body.mass_center, there.T, half)]
    return result


class _Thorax(NamedTuple):
    """Where a trunk's thorax and head are, in its frame."""

    middle: Array  # (3,) [m]
    height: float  # [m]
    head: Array  # (3,) [m]
    size: float  # of the trunk, from its joint to the mass center [m]


def _thorax(center: Array, start: Array, up: Array, joints: Sequence[Array]) -> _Thorax:
    """Place the thorax by the trunk's mass center and joint.

    Without the head the mass center lies lower: `joints` of arms and neck show the height then.
    """
    rise = float((center - start) @ up)
    size = float(np.linalg.norm(center - start))
    if rise > 0.3 * size:
        along = (center - start) / size
        tall = SHOULDERS * size
        tall = max([1.05 * float((joint - start) @ up) for joint in joints], default=tall)
        return _Thorax(
            middle=start + 0.53 * tall * along,
            height=tall,
            head=start + HEAD_CENTER * size * along,
            size=size,
        )
    # A thorax whose frame lies at its top, as at the jugular notch: its mass center is in its
    # middle.
    tall = 2.3 * max(-rise, 0.6 * size)
    return _Thorax(
        middle=center, height=tall, head=center + 0.72 * tall * up, size=tall / SHOULDERS
    )


def _across(model: Model, up: Array, turn: Array) -> Array:
    """Find the unit vector to the side in the trunk's frame.

    Models look along x, with y or z up.
    """
    side = turn.T @ np.cross([1.0, 0.0, 0.0], model.up)
    side = side - (side @ up) * up
    length = float(np.linalg.norm(side))
    return np.asarray(side / length if length > 1e-6 else turn.T @ np.array([0.0, 1.0, 0.0]))
