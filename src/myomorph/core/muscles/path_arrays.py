"""Muscle paths compiled to flat arrays: points, surfaces, and coordinates that move muscles.

The tables hold many columns in few arrays, because every array of a bundle costs compilation time
in every kernel that takes it.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel, check_name
from myomorph.core.model.functions import Function
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.paths import (
    MovingPathPoint,
    Muscle,
    PathPoint,
    PathWrap,
    TendonWrap,
    WrapObject,
)
from myomorph.core.muscles.wrap.ellipsoid import AXIAL, HYBRID, MIDPOINT
from myomorph.core.muscles.wrap.tendon import BEFORE_FOUR, FOUR
from myomorph.core.rigid.coordinates import FunctionArrays, Ints, compile_functions
from myomorph.core.rigid.tree import ROTATION, Tree

# Columns of the tables of `PathArrays`
POINTS, WRAPS, BODIES, AXES, ARMS, FOLLOWS = range(6)
BODY, LOCAL, MOVING, COORDINATE = range(4)
X, Y, Z, LOW, HIGH, WEIGHT = range(6)
OBJECT, OBJECT_LOCAL, METHOD, FIRST, LAST, AFTER, SIDE_BODY = range(7)
KIND, OBJECT_BODY, AXIS, SIDE, ACTIVE = range(5)
TREE_AXIS, ROTATES, SLOT_1, SLOT_2, SUPPORT, SUPPORT_STOP = range(6)
KINDS = ("cylinder", "sphere", "ellipsoid", "torus")
METHODS = {"hybrid": HYBRID, "midpoint": MIDPOINT, "axial": AXIAL}


class PathArrays(NamedTuple):
    """Muscle paths as the kernels read them.

    Attributes
    ----------
    start : (muscles + 1, 6) columns POINTS ... FOLLOWS: what belongs to muscle m lies in rows
        start[m, column] ... start[m + 1, column] - 1 of `point`, `wrap`, the bodies of muscles
        (numbered from 0 in each muscle), `axis`, `arm`, `follow`
    point : (points, 4) columns BODY (in the tree), LOCAL (among the muscle's bodies), MOVING (row
        of `moving`), COORDINATE (the path has the point only while that is in its range); -1 for
        none
    place : (points, 6) columns X, Y, Z in the body [m], LOW, HIGH of the coordinate, WEIGHT: share
        in the length of what lies between the point and the next one
    moving : (moving points, 9) functions of x, y, z; their coordinates; the positions of those
        among the muscle's moment arms; -1 for none
    moving_range : (moving points, 6) low and high of each coordinate, to which it is clamped
    functions : of the moving points, then of the couplers
    wrap : (wraps, 7) columns OBJECT, OBJECT_LOCAL (its body among the muscle's), METHOD, FIRST and
        LAST point between which the path may touch it (OpenSim), AFTER: the point before it
        (MuJoCo; -1 for OpenSim's rules), SIDE_BODY (-1 for no side point)
    wrap_side : (wraps, 3) side point in its body [m]
    object : (surfaces, 5) columns KIND (index in `KINDS`), OBJECT_BODY, AXIS and SIDE of the
        constrained half (SIDE 0 for all), ACTIVE
    object_pose : (surfaces, 12) rotation row by row and position in the body [m]
    object_size : (surfaces, 3) [m]
    axis : (muscle axes, 6) columns TREE_AXIS: a moving axis of the tree on which some of the
        muscle's bodies hang and some do not, ROTATES, SLOT_1, SLOT_2: positions of its coordinates
        among the moment arms (-1 for none), SUPPORT, SUPPORT_STOP: range in `support`
    support : numbers, among the muscle's, of the bodies that hang on the axes
    arm : (moment arms, 2) the pattern: a coordinate that can move the muscle; 1 if it is
        independent
    follow : (follows, 4) coupler, position of the dependent's moment arm, positions of those it
        follows
    coupler : (couplers, 3) function, and the coordinates it follows
    sizes : (3,) most points (with those on surfaces), wraps and bodies of a muscle
    """

    start: Ints
    point: Ints
    place: Array
    moving: Ints
    moving_range: Array
    functions: FunctionArrays
    wrap: Ints
    wrap_side: Array
    object: Ints
    object_pose: Array
    object_size: Array
    axis: Ints
    support: Ints
    arm: Ints
    follow: Ints
    coupler: Ints
    sizes: Ints


def path_arrays(model: Model, tree: Tree) -> PathArrays:
    """Compile the paths of a model's muscles.

    Parameters
    ----------
    model : with muscles
    tree : of the model

    Raises
    ------
    BadModel : a path has fewer than two points or a wrap that cannot be built
    UnknownName : a path names a body, coordinate or surface that the model does not have
    """
    builder = _Builder(model, tree)
    for muscle in model.muscles:
        builder.add(muscle)
    return builder.arrays()


def moved_paths(arrays: PathArrays, model: Model) -> PathArrays:
    """Move the points of compiled paths and resize their surfaces.

    Parameters
    ----------
    arrays : of a model with the same parts in the same order
    model : whose points and sizes are taken
    """
    points = (point for muscle in model.muscles for point in muscle.path.points)
    place = arrays.place.copy()
    for row, point in zip(place, points, strict=True):
        if isinstance(point, PathPoint):
            row[: Z + 1] = point.location
    return arrays._replace(place=place, object_size=_sizes(model))


def _sizes(model: Model) -> Array:
    """(surfaces, 3) sizes of the surfaces that paths wrap around [m]."""
    return _floats([[*item.size, 0.0, 0.0][:3] for item in model.wrap_objects], 3)


class _Builder:
    """Collects the rows of `PathArrays` muscle by muscle."""

    def __init__(self, model: Model, tree: Tree):
        self.model = model
        self.tree = tree
        self.objects = {item.name: i for i, item in enumerate(model.wrap_objects)}
        self.free = set(tree.independent.tolist())
        self.start = [[0] * 6]
        self.bodies = 0
        self.most = [0, 0, 0]
        self.point: list[list[int]] = []
        self.place: list[list[float]] = []
        self.moving: list[list[int]] = []
        self.moving_range: list[list[float]] = []
        self.functions: list[Function] = []
        self.wrap: list[list[int]] = []
        self.wrap_side: list[Array] = []
        self.axis: list[list[int]] = []
        self.support: list[int] = []
        self.arm: list[list[int]] = []
        self.follow: list[list[int]] = []

    def add(self, muscle: Muscle) -> None:
        """Add the path of a muscle: bodies, axes between them, points, then wraps."""
        path = muscle.path
        if path.function is not None:
            # It has no points: `path_functions` gives its length and moment arms.
            names = path.function.coordinates
            self._add_axes([], {self._coordinate(name) for name in names})
            self._end_muscle()
            return
        if len(path.points) < 2:
            raise BadModel(
                f"the path of muscle '{muscle.name}' has {len(path.points)} points: expected two or"
                " more"
            )
        if len({isinstance(wrap, TendonWrap) for wrap in path.wraps}) > 1:
            raise BadModel(
                f"the path of muscle '{muscle.name}' mixes the wraps of OpenSim and MuJoCo"
            )
        point_bodies = [self.tree.body_number(point.body) for point in path.points]
        wraps: list[PathWrap | TendonWrap] = list(path.wraps)
        objects = [self._object(wrap.wrap_object) for wrap in wraps]
        wrap_bodies = [self.tree.body_number(self.model.wrap_objects[i].body) for i in objects]
        bodies = sorted({*point_bodies, *wrap_bodies})
        slots = self._add_axes(bodies, self._moving_coordinates(muscle))
        for index, (point, body) in enumerate(zip(path.points, point_bodies, strict=True)):
            self._add_point(point, body, bodies.index(body), _weight(path.divisors, index), slots)
        for wrap, i, body in zip(wraps, objects, wrap_bodies, strict=True):
            self.wrap.append([i, bodies.index(body), *self._rule(wrap, len(path.points))])
            side = wrap.side if isinstance(wrap, TendonWrap) else None
            self.wrap_side.append(np.zeros(3) if side is None else np.asarray(side))
        self.bodies += len(bodies)
        self._end_muscle()
        here = (len(path.points) + 2 * len(path.wraps), len(path.wraps), len(bodies))
        self.most = [max(have, new) for have, new in zip(self.most, here, strict=True)]

    def _end_muscle(self) -> None:
        """Note where the rows of the next muscle begin."""
        counts = (
            len(self.point),
            len(self.wrap),
            self.bodies,
            len(self.axis),
            len(self.arm),
            len(self.follow),
        )
        self.start.append(list(counts))

    def _moving_coordinates(self, muscle: Muscle) -> set[int]:
        """Numbers of the coordinates that move points of a path in their bodies."""
        numbers = set()
        for point in muscle.path.points:
            if isinstance(point, MovingPathPoint):
                numbers |= {self._coordinate(name) for name in point.coordinates}
        return numbers - {-1}

    def _object(self, name: str) -> int:
        """Look up the number of a surface."""
        check_name("wrap object", name, self.objects)
        return self.objects[name]

    def _coordinate(self, name: str) -> int:
        """Look up the number of a coordinate, -1 for ""."""
        return index_of("coordinate", name, self.model.coordinate_names) if name else -1

    def _add_point(
        self,
        point: PathPoint | MovingPathPoint,
        body: int,
        local: int,
        weight: float,
        slots: dict[int, int],
    ) -> None:
        """Add a point of a path.

        Parameters
        ----------
        body, local : number of the point's body in the tree, and among the muscle's bodies
        weight : share in the length of what lies between the point and the next one
        slots : positions of coordinates among the muscle's moment arms
        """
        if isinstance(point, PathPoint):
            self.point.append([body, local, -1, self._coordinate(point.coordinate)])
            self.place.append([*point.location, *point.range, weight])
            return
        self.point.append([body, local, len(self.moving), -1])
        self.place.append([0.0, 0.0, 0.0, -np.inf, np.inf, weight])
        indices = [self._coordinate(name) for name in point.coordinates]
        first = len(self.functions)
        places = [slots[i] if i >= 0 else -1 for i in indices]
        self.moving.append([first, first + 1, first + 2, *indices, *places])
        # OpenSim clamps what a moving point follows to the coordinate's range, clamped or not.
        ranges = [self.model.coordinates[i].range if i >= 0 else (-np.inf, np.inf) for i in indices]
        self.moving_range.append([end for pair in ranges for end in pair])
        self.functions.extend(point.functions)

    def _rule(self, wrap: PathWrap | TendonWrap, points: int) -> list[int]:
        """Columns METHOD ... SIDE_BODY of a wrap."""
        if isinstance(wrap, TendonWrap):
            if not 0 <= wrap.after < points - 1:
                raise BadModel(
                    f"wrap object '{wrap.wrap_object}' stands after point {wrap.after} of {points}"
                )
            body = -1 if wrap.side is None else self.tree.body_number(wrap.side_body)
            return [BEFORE_FOUR if wrap.version < FOUR else FOUR, 0, points - 1, wrap.after, body]
        if wrap.method not in METHODS:
            known = ", ".join(METHODS)
            raise BadModel(
                f"wrap object '{wrap.wrap_object}' has the method '{wrap.method}': expected {known}"
            )
        last = wrap.last if wrap.last >= 1 else points
        return [METHODS[wrap.method], max(wrap.first, 1) - 1, last - 1, -1, -1]

    def _add_axes(self, bodies: list[int], moving: set[int]) -> dict[int, int]:
        """Add the axes between bodies, and the pattern of a muscle's moment arms.

        Parameters
        ----------
        bodies : numbers of the muscle's bodies
        moving : numbers of the coordinates that move its points

        Returns
        -------
        position of each coordinate in the pattern
        """
        arrays = self.tree.arrays
        supports = self.tree.supports[bodies]
        between = np.flatnonzero(supports.any(axis=0) & ~supports.all(axis=0))
        used = moving | {int(j) for j in arrays.axis_coordinate[between].ravel() if j >= 0}
        couplers = list(enumerate(arrays.coupler_coordinate.tolist()))[::-1]
        for coupler, dependent in couplers:
            if dependent in used:
                used |= {int(j) for j in arrays.coupler_source[coupler] if j >= 0}
        slots = {j: position for position, j in enumerate(sorted(used))}
        for axis in between.tolist():
            hanging = np.flatnonzero(supports[:, axis]).tolist()
            positions = [slots.get(int(j), -1) for j in arrays.axis_coordinate[axis]]
            stop = len(self.support) + len(hanging)
            rotates = int(arrays.axis_kind[axis] == ROTATION)
            self.axis.append([axis, rotates, *positions, len(self.support), stop])
            self.support += hanging
        for coupler, dependent in couplers:
            if dependent in slots:
                sources = [slots.get(int(j), -1) for j in arrays.coupler_source[coupler]]
                self.follow.append([coupler, slots[dependent], *sources])
        self.arm += [[j, int(j in self.free)] for j in slots]
        return slots

    def arrays(self) -> PathArrays:
        """Arrays of all paths that were added."""
        couplers = self.model.couplers
        names = self.model.coordinate_names
        tree = self.tree.arrays
        ordered = {
            index_of("coordinate", coupler.dependent, names): coupler.function
            for coupler in couplers
        }
        first = len(self.functions)
        functions = [*self.functions, *(ordered[int(j)] for j in tree.coupler_coordinate)]
        rows = np.arange(first, len(functions))
        objects = self.model.wrap_objects
        return PathArrays(
            start=_ints(self.start, 6),
            point=_ints(self.point, 4),
            place=_floats(self.place, 6),
            moving=_ints(self.moving, 9),
            moving_range=_floats(self.moving_range, 6),
            functions=compile_functions(functions),
            wrap=_ints(self.wrap, 7),
            wrap_side=_floats(self.wrap_side, 3),
            object=_ints([self._object_row(item) for item in objects], 5),
            object_pose=_floats(
                [[*item.pose.rotation.ravel(), *item.pose.translation] for item in objects], 12
            ),
            object_size=_sizes(self.model),
            axis=_ints(self.axis, 6),
            support=np.array(self.support, dtype=np.int64),
            arm=_ints(self.arm, 2),
            follow=_ints(self.follow, 4),
            coupler=np.column_stack([rows, tree.coupler_source]).astype(np.int64),
            sizes=np.array(self.most, dtype=np.int64),
        )

    def _object_row(self, wrap_object: WrapObject) -> list[int]:
        """Row of a surface in `PathArrays.object`."""
        side = 0
        if wrap_object.quadrant:
            side = -1 if wrap_object.quadrant.startswith("-") else 1
        return [
            KINDS.index(wrap_object.kind),
            self.tree.body_number(wrap_object.body),
            "xyz".index(wrap_object.quadrant[-1:] or "x"),
            side,
            wrap_object.active,
        ]


def _weight(divisors: tuple[float, ...], index: int) -> float:
    """Share in the length of what follows a point: 1 / MuJoCo's divisor, 0 for one of 0."""
    if index >= len(divisors):
        return 1.0
    return 1.0 / divisors[index] if divisors[index] else 0.0


def _ints(rows: list, columns: int) -> Ints:
    """Rows as an array (rows, columns), also of no row."""
    return np.array(rows, dtype=np.int64).reshape(len(rows), columns)


def _floats(rows: list, columns: int) -> Array:
    """Rows as an array (rows, columns), also of no row."""
    return np.array(rows, dtype=np.float64).reshape(len(rows), columns)
