"""Friction cones by their generators, and the generalized forces of every generator.

A linearised cone is kept by its generators: a force inside it is a sum of generators with
amplitudes z >= 0, so that a cone is no more than a bound. The column of a generator is J^T (f; m)
at a point of a body, less the same on what it touches where that is a body: force and reaction act
at one place.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Site
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.rigid.kernels import bare, kernel
from myomorph.core.rigid.kinematics import body_poses, pose_room
from myomorph.core.rigid.tree import ROTATION, Tree
from myomorph.core.rigid.vectors import cross, dot, matrix, minus, plus, put_vector, turned, vector


class ConeArrays(NamedTuple):
    """Contact points and the generators of their cones, as the kernel reads them.

    Attributes
    ----------
    body : (points,) numbers in the tree
    place : (points, 3) in the body's frame [m]
    start : (points + 1,) generators of point i are start[i] ... start[i + 1] - 1
    frame : (generators,) body in whose axes a generator is written
    push : (generators, 3) force of one unit of a generator [1]
    turn : (generators, 3) moment of one unit of a generator [m]
    reach : (points + 1,) axes that a force at point i has power on are reach[i] ... reach[i + 1] -
        1
    axis : (reached,) number of the axis
    sign : (reached,) 1 below the body, -1 below what it touches
    slot : (reached, 2) which of a generator's entries the axis's coordinates are, -1 for none
    first : (generators + 1,) entries of generator g are first[g] ... first[g + 1] - 1
    coordinate : (entries,) of each entry
    """

    body: NDArray[np.int64]
    place: Array
    start: NDArray[np.int64]
    frame: NDArray[np.int64]
    push: Array
    turn: Array
    reach: NDArray[np.int64]
    axis: NDArray[np.int64]
    sign: Array
    slot: NDArray[np.int64]
    first: NDArray[np.int64]
    coordinate: NDArray[np.int64]


class GeneratorForces(NamedTuple):
    """Columns of all generators in some frames, and where and how they push.

    Attributes
    ----------
    entries : (frames, entries) generalized forces of one unit of force, on `ConeArrays.coordinate`
    places : (frames, points, 3) in ground [m]
    pushes, turns : (frames, generators, 3) force and moment about the place, in ground [1], [m]
    """

    entries: Array
    places: Array
    pushes: Array
    turns: Array


@read_only
class ConeGenerators:
    """Generators of the cones of all sites.

    Attributes
    ----------
    site, point : (generators,) site and point of each; points are numbered over all sites
    normal : (generators,) force along the cone's direction of one unit of the generator
    lower : (generators,) least amplitude: 0, or -inf where the opposite generator is allowed too
    cost : (generators,) of amplitude^2, so that one unit of force along the direction costs 1 in
        all
    names : (generators,) such as "heel_r point 0 generator 3"
    weight : (sites,) of the body that the site belongs to, unit of its amplitudes [N]
    """

    tree: Tree
    sites: tuple[Site, ...]
    arrays: ConeArrays
    site: NDArray[np.int64]
    point: NDArray[np.int64]
    normal: Array
    lower: Array
    cost: Array
    names: tuple[str, ...]
    weight: Array

    def __len__(self) -> int:
        return len(self.site)

    def evaluate(self, coordinates: Array) -> GeneratorForces:
        """Columns of all generators, and where and how they push.

        Parameters
        ----------
        coordinates : (frames, coordinates) in the model's order, dependent ones consistent

        Returns
        -------
        entries, places, pushes and turns of all frames
        """
        frames = len(coordinates)
        arrays = self.arrays
        forces = GeneratorForces(
            entries=np.empty((frames, len(arrays.coordinate))),
            places=np.empty((frames, len(arrays.body), 3)),
            pushes=np.empty((frames, len(self), 3)),
            turns=np.empty((frames, len(self), 3)),
        )
        contact_columns(self.tree.arrays, arrays, np.array(coordinates, order="C"), *forces)
        return forces


def compile_cones(tree: Tree, sites: Sequence[Site]) -> ConeGenerators:
    """Make flat arrays of the generators of all sites; a site's grip is added to its first point.

    Raises
    ------
    BadModel : two sites have one name
    UnknownName : a site's body is not in the model
    """
    _refuse_one_name_twice(sites)
    points = [point for number, site in enumerate(sites) for point in _points(tree, number, site)]
    of_generator = np.repeat(np.arange(len(points)), [len(point.push) for point in points])
    names = [f"{point.label} generator {e}" for point in points for e in range(len(point.push))]
    weight = [subject_weight(tree, site.body, site.against) for site in sites]
    return ConeGenerators(
        tree=tree,
        sites=tuple(sites),
        arrays=_arrays(points, of_generator),
        site=np.array([point.site for point in points], np.int64)[of_generator],
        point=of_generator.astype(np.int64),
        normal=_joined([point.normal for point in points]),
        lower=_joined([point.lower for point in points]),
        cost=_joined([point.cost for point in points]),
        names=tuple(names),
        weight=np.array(weight, dtype=np.float64),
    )


def _arrays(points: Sequence[_Point], of_generator: NDArray[np.int64]) -> ConeArrays:
    """Points and generators for the kernel; `of_generator` (generators,) their points."""
    reached = [point.reached for point in points]
    entries = [len(reached[number].coordinates) for number in of_generator]
    coordinates = [reached[number].coordinates for number in of_generator]
    return ConeArrays(
        body=np.array([point.body for point in points], np.int64),
        place=_joined([point.place for point in points], 3),
        start=_ends([len(point.push) for point in points]),
        frame=np.array([point.frame for point in points], np.int64)[of_generator],
        push=_joined([point.push for point in points], 3),
        turn=_joined([point.turn for point in points], 3),
        reach=_ends([len(item.axes) for item in reached]),
        axis=_joined([item.axes for item in reached]).astype(np.int64),
        sign=_joined([item.signs for item in reached]),
        slot=_joined([item.slots for item in reached], 2).astype(np.int64),
        first=_ends(entries),
        coordinate=_joined(coordinates).astype(np.int64),
    )


def _joined(parts: Sequence[ArrayLike], *shape: int) -> Array:
    """Join items of a shape, (items, *shape) also where there is none."""
    arrays = [np.asarray(part, dtype=np.float64).reshape(-1, *shape) for part in parts]
    return np.concatenate([np.zeros((0, *shape)), *arrays])


def _refuse_one_name_twice(sites: Sequence[Site]) -> None:
    names = [site.name for site in sites]
    for name in names:
        if names.count(name) > 1:
            raise BadModel(f"two contact sites are named '{name}': give one of them another name")


class _Reached(NamedTuple):
    """Axes between the two bodies of a contact.

    Attributes
    ----------
    axes : their numbers
    signs : 1 below the body, -1 below what it touches
    coordinates : that the axes have, ascending
    slots : per axis, which of `coordinates` its two are, -1 for none
    """

    axes: list[int]
    signs: list[float]
    coordinates: list[int]
    slots: list[list[int]]


class _Point(NamedTuple):
    """One point of a site: where it is, its generators, and the axes it has power on.

    Attributes
    ----------
    site, body, frame : numbers of the site, of its body and of the body whose axes the cone has
    label : such as "heel_r point 0"
    place : (3,) on the body [m]
    push, turn : (generators, 3) force and moment of one unit [1], [m]
    normal, lower, cost : (generators,) as of `ConeGenerators`
    """

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
    reached: _Reached


def _points(tree: Tree, number: int, site: Site) -> list[_Point]:
    """Points of a site with their generators; `number` is that of the site."""
    where = f"contact site '{site.name}': the model"
    body = tree.body_number(site.body, where)
    frame = tree.body_number(site.cone.frame, where)
    reached = _reached(tree, site)
    points = []
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
        points.append(
            _Point(
                site=number,
                label=f"{site.name} point {j}",
                body=body,
                frame=frame,
                place=place,
                push=push,
                turn=turn,
                normal=normal,
                lower=lower,
                cost=cost,
                reached=reached,
            )
        )
    return points


def _ends(counts: Sequence[int]) -> NDArray[np.int64]:
    """Where runs of so many items begin and end, (runs + 1,)."""
    return np.concatenate([[0], np.cumsum(counts)]).astype(np.int64)


def _reached(tree: Tree, site: Site) -> _Reached:
    """Find the axes between the two bodies of a contact.

    What both bodies hang on feels a force and its reaction at one place not at all.
    """
    supports = tree.supports[tree.body_index[site.body]]
    other = tree.supports[tree.body_number(site.against, f"contact site '{site.name}': the model")]
    axes = [int(number) for number in np.flatnonzero(supports != other)]
    pairs = [[int(j) for j in tree.arrays.axis_coordinate[axis]] for axis in axes]
    coordinates = sorted({j for pair in pairs for j in pair if j >= 0})
    return _Reached(
        axes=axes,
        signs=[1.0 if supports[axis] else -1.0 for axis in axes],
        coordinates=coordinates,
        slots=[[coordinates.index(j) if j >= 0 else -1 for j in pair] for pair in pairs],
    )


def subject_weight(tree: Tree, *bodies: str) -> float:
    """Weight of the heaviest subject or object that bodies belong to [N].

    A subject or an object is all that hangs on one joint to the ground.
    """
    root = tree.roots
    mass = tree.arrays.mass
    gravity = float(np.linalg.norm(tree.arrays.gravity)) or STANDARD_GRAVITY
    ends = {int(root[tree.body_index[name]]) for name in bodies} - {0}
    heaviest = max((float(mass[root == end].sum()) for end in ends), default=0.0)
    return gravity * (heaviest or float(mass.sum()) or 1.0)


@kernel
def contact_columns(  # page: arrays over frames, as `GeneratorForces` names them
    T, cones, coordinates, entries, places, pushes, turns
):
    """Fill what `ConeGenerators.evaluate` returns, frame by frame.

    Parameters
    ----------
    T, cones : arrays of the tree, `ConeArrays`
    coordinates : (frames, coordinates)
    entries, places, pushes, turns : filled, as of `GeneratorForces`
    """
    pose = pose_room(T)
    for frame in range(coordinates.shape[0]):
        body_poses(T, coordinates[frame], pose)
        out = entries[frame]
        for e in range(out.shape[0]):
            out[e] = 0.0
        for i in range(cones.body.shape[0]):
            b = cones.body[i]
            x = plus(vector(pose.p, b), turned(matrix(pose.R, b), vector(cones.place, i)))
            put_vector(places[frame], i, x)
            for g in range(cones.start[i], cones.start[i + 1]):
                r = matrix(pose.R, cones.frame[g])
                put_vector(pushes[frame], g, turned(r, vector(cones.push, g)))
                put_vector(turns[frame], g, turned(r, vector(cones.turn, g)))
            _add_power(T, cones, i, x, pose, pushes[frame], turns[frame], out)


@bare
def _add_power(T, cones, i, x, pose, push, turn, out):
    """Add what the generators of point i do along the axes that it has power on.

    Of a generator with push f and turn m at a place x, the power per unit speed of an axis w
    through o is w . f of a translation and (w x (x - o)) . f + w . m of a rotation.

    Parameters
    ----------
    x : place of the point, in ground [m]
    pose : of `body_poses`
    push, turn : (generators, 3) in ground [1], [m]
    out : (entries,) added to
    """
    for a in range(cones.reach[i], cones.reach[i + 1]):
        index = cones.axis[a]
        direction = vector(pose.w, index)
        rotates = T.axis_kind[index] == ROTATION
        move = cross(direction, minus(x, vector(pose.o, index))) if rotates else direction
        for g in range(cones.start[i], cones.start[i + 1]):
            power = dot(move, vector(push, g))
            if rotates:
                power += dot(direction, vector(turn, g))
            power *= cones.sign[a]
            for s in range(2):
                if cones.slot[a, s] >= 0:
                    out[cones.first[g] + cones.slot[a, s]] += pose.dphi[index, s] * power
