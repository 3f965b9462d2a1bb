"""Friction cones by their generators, and the generalized forces of every generator of every
contact.

A linearised cone is kept by its generators: a force inside it is a sum of generators with
amplitudes z >= 0, so that a cone is no more than a bound. The column of a generator is J^T (f; m)
at a point of a body, less the same on what it touches where that is a body: force and reaction act
at one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.rigid.kernels import kernel
from myomorph.core.rigid.kinematics import body_poses
from myomorph.core.rigid.tree import ROTATION, Tree
from myomorph.core.rigid.vectors import cross, dot, matrix, minus, plus, put_vector, turned, vector


class ConeArrays(NamedTuple):
    """Contact points and the generators of their cones, as the kernel reads them."""

    body: NDArray[np.int64]  # (points,) numbers in the tree
    place: Array  # (points, 3) in the body's frame [m]
    # (points + 1,) generators of point i are start[i] ... start[i + 1] - 1
    start: NDArray[np.int64]
    frame: NDArray[np.int64]  # (generators,) body whose axes a generator is given in
    push: Array  # (generators, 3) force and moment of one unit of a generator [1]
    turn: Array  # (generators, 3) force and moment of one unit of a generator [m]
    # (points + 1,) axes that a force at point i has power on are reach[i] ... reach[i + 1] - 1
    reach: NDArray[np.int64]
    # axis, sign: (reached,) number of the axis; 1 below the body, -1 below what it touches
    axis: NDArray[np.int64]
    sign: Array
    # (reached, 2) which of a generator's entries the axis's coordinates are, -1 for none
    slot: NDArray[np.int64]
    # (generators + 1,) entries of generator g are first[g] ... first[g + 1] - 1
    first: NDArray[np.int64]
    coordinate: NDArray[np.int64]  # (entries,)


@read_only
class ConeGenerators:
    """Generators of the cones of all sites."""

    tree: Tree
    sites: tuple[Site, ...]
    arrays: ConeArrays
    # site, point: (generators,) whose generator it is; points are numbered over all sites
    site: NDArray[np.int64]
    point: NDArray[np.int64]
    normal: Array  # (generators,) force along the cone's direction of one unit of the generator
    # (generators,) least amplitude: 0, or -inf where the opposite generator is allowed too
    lower: Array
    # (generators,) of amplitude^2, so that one unit of force along the direction costs 1 in all
    cost: Array
    names: tuple[str, ...]  # (generators,) such as "heel_r point 0 generator 3"
    weight: Array  # (sites,) of the body that the site belongs to, unit of its amplitudes [N]

    def __len__(self) -> int:
        return len(self.site)

    def evaluate(self, coordinates: Array) -> tuple[Array, Array, Array, Array]:
        """Columns of all generators, and where and how they push.
        `coordinates` (frames, coordinates) in the model's order, dependent ones consistent. Returns
        `entries` (frames, entries) generalized forces of one unit of force, on `arrays.coordinate`;
        `places` (frames, points, 3) in ground [m]; `pushes`, `turns` (frames, generators, 3) force
        and moment about the place, in ground [1], [m].
        """
        frames = len(coordinates)
        arrays = self.arrays
        entries = np.empty((frames, len(arrays.coordinate)))
        places = np.empty((frames, len(arrays.body), 3))
        pushes = np.empty((frames, len(self), 3))
        turns = np.empty((frames, len(self), 3))
        contact_columns(
            self.tree.arrays,
            arrays,
            np.array(coordinates, order="C"),
            entries,
            places,
            pushes,
            turns,
        )
        return entries, places, pushes, turns


def compile_cones(tree: Tree, sites: Sequence[Site]) -> ConeGenerators:
    """Generators of all sites as flat arrays; a site's grip is added to its first point."""
    names = [site.name for site in sites]
    for name in names:
        if names.count(name) > 1:
            raise BadModel(f"two contact sites are named '{name}': give one of them another name")
    points: list[_Point] = [
        point for number, site in enumerate(sites) for point in _points(tree, number, site)
    ]
    rows = [(i, point, e) for i, point in enumerate(points) for e in range(len(point.push))]
    arrays = ConeArrays(
        body=np.array([point.body for point in points], np.int64),
        place=_rows([point.place for point in points]),
        start=_ends([len(point.push) for point in points]),
        frame=np.array([point.frame for _, point, _ in rows], np.int64),
        push=_rows([point.push[e] for _, point, e in rows]),
        turn=_rows([point.turn[e] for _, point, e in rows]),
        reach=_ends([len(point.axes) for point in points]),
        axis=np.array([axis for point in points for axis in point.axes], np.int64),
        sign=np.array([sign for point in points for sign in point.signs], dtype=np.float64),
        slot=np.array([slot for point in points for slot in point.slots], np.int64).reshape(-1, 2),
        first=_ends([len(point.coordinates) for _, point, _ in rows]),
        coordinate=np.array([j for _, point, _ in rows for j in point.coordinates], np.int64),
    )
    return ConeGenerators(
        tree=tree,
        sites=tuple(sites),
        arrays=arrays,
        site=np.array([point.site for _, point, _ in rows], np.int64),
        point=np.array([i for i, _, _ in rows], np.int64),
        normal=np.array([point.normal[e] for _, point, e in rows], dtype=np.float64),
        lower=np.array([point.lower[e] for _, point, e in rows], dtype=np.float64),
        cost=np.array([point.cost[e] for _, point, e in rows], dtype=np.float64),
        names=tuple(f"{point.label} generator {e}" for _, point, e in rows),
        weight=np.array(
            [subject_weight(tree, site.body, site.against) for site in sites], dtype=np.float64
        ),
    )


class _Point(NamedTuple):
    """One point of a site: where it is, its generators, and the axes it has power on."""

    site: int
    label: str
    body: int
    frame: int
    place: Array
    push: Array
    turn: Array
    normal: Array
    lower: Array
    cost: Array
    axes: list[int]
    signs: list[float]
    coordinates: list[int]
    slots: list[list[int]]


def _points(tree: Tree, number: int, site: Site) -> list[_Point]:
    where = f"contact site '{site.name}': the model"
    body = tree.body_number(site.body, where)
    frame = tree.body_number(site.cone.frame, where)
    axes, signs, coordinates, slots = _reached(tree, site)
    result = []
    for j, place in enumerate(site.points):
        push, turn, lower, cost = site.cone.generators()
        # What one unit of force along the direction costs does not depend on how many points share
        # it.
        cost = cost * len(site.points)
        if j == 0 and site.cone.grip > 0.0:
            push = np.vstack([push, np.zeros((3, 3))])
            turn = np.vstack([turn, site.cone.grip * np.eye(3)])
            lower = np.append(lower, np.full(3, -np.inf))
            cost = np.append(cost, np.ones(3))
        normal = np.zeros(len(push)) if site.cone.direction is None else push @ site.cone.direction
        # Tangents are across the direction but for rounding.
        normal[np.abs(normal) < 1e-12] = 0.0
        label = f"{site.name} point {j}"
        result.append(
            _Point(
                number,
                label,
                body,
                frame,
                place,
                push,
                turn,
                normal,
                lower,
                cost,
                axes,
                signs,
                coordinates,
                slots,
            )
        )
    return result


def _rows(vectors: list[Array]) -> Array:
    return np.array(vectors, dtype=np.float64).reshape(-1, 3)


def _ends(counts: list[int]) -> NDArray[np.int64]:
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _reached(tree: Tree, site: Site) -> tuple[list[int], list[float], list[int], list[list[int]]]:
    """Axes between the two bodies of a contact with their signs, the coordinates, and which of them
    each axis has. What both bodies hang on feels a force and its reaction at one place not at all.
    """
    supports = tree.supports[tree.body_index[site.body]]
    other = tree.supports[tree.body_number(site.against, f"contact site '{site.name}': the model")]
    axes = [int(number) for number in np.flatnonzero(supports != other)]
    pairs = [[int(j) for j in tree.arrays.axis_coordinate[axis]] for axis in axes]
    touched = sorted({j for pair in pairs for j in pair if j >= 0})
    slots = [[touched.index(j) if j >= 0 else -1 for j in pair] for pair in pairs]
    return axes, [1.0 if supports[axis] else -1.0 for axis in axes], touched, slots


def subject_weight(tree: Tree, *bodies: str) -> float:
    """Weight of the heaviest subject or object that bodies belong to: all that hangs on one joint
    to the ground [N].
    """
    root = tree.roots
    mass = tree.arrays.mass
    gravity = float(np.linalg.norm(tree.arrays.gravity)) or STANDARD_GRAVITY
    ends = {int(root[tree.body_index[name]]) for name in bodies} - {0}
    heaviest = max((float(mass[root == end].sum()) for end in ends), default=0.0)
    return gravity * (heaviest or float(mass.sum()) or 1.0)


@kernel
def contact_columns(T, P, coordinates, entries, places, pushes, turns):
    """Fill what `ConeGenerators.evaluate` returns, frame by frame."""
    bodies = T.parent.shape[0]
    axes = T.axis_kind.shape[0]
    R = np.empty((bodies, 3, 3))
    p = np.empty((bodies, 3))
    w = np.empty((axes, 3))
    o = np.empty((axes, 3))
    dphi = np.empty((axes, 2))
    for frame in range(coordinates.shape[0]):
        body_poses(T, coordinates[frame], R, p, w, o, dphi)
        push = pushes[frame]
        turn = turns[frame]
        out = entries[frame]
        for e in range(out.shape[0]):
            out[e] = 0.0
        for i in range(P.body.shape[0]):
            x = plus(vector(p, P.body[i]), turned(matrix(R, P.body[i]), vector(P.place, i)))
            put_vector(places[frame], i, x)
            for g in range(P.start[i], P.start[i + 1]):
                r = matrix(R, P.frame[g])
                put_vector(push, g, turned(r, vector(P.push, g)))
                put_vector(turn, g, turned(r, vector(P.turn, g)))
            for a in range(P.reach[i], P.reach[i + 1]):
                index = P.axis[a]
                direction = vector(w, index)
                turns_it = T.axis_kind[index] == ROTATION
                move = cross(direction, minus(x, vector(o, index))) if turns_it else direction
                for g in range(P.start[i], P.start[i + 1]):
                    power = dot(move, vector(push, g))
                    if turns_it:
                        power += dot(direction, vector(turn, g))
                    power *= P.sign[a]
                    for s in range(2):
                        if P.slot[a, s] >= 0:
                            out[P.first[g] + P.slot[a, s]] += dphi[index, s] * power
