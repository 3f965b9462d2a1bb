"""The model compiled to flat arrays: bodies, moving axes, functions and couplers in tree order."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel, check_name
from myomorph.core.model.functions import Function
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import GROUND, Axis, Coupler, Model, index_of
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import FunctionArrays, Ints, compile_functions, couple_frames

ROTATION = 0
TRANSLATION = 1


class TreeArrays(NamedTuple):
    """What the kernels read. Body 0 is the ground; a parent comes before its children.
    The pose of body b is its parent's, then for each of its axes k the constant `pre` of k and the
    motion of k, then the constant `post` of b. Axes that do not move are folded into those.
    """

    parent: Ints  # (bodies,) -1 for the ground
    axis_start: Ints  # (bodies + 1,) the axes of body b are axis_start[b] ... axis_start[b + 1] - 1
    pre_R: Array  # (axes, 3, 3)
    pre_p: Array  # (axes, 3)
    pre_is_shift: np.ndarray  # (axes,) whether pre_R is the identity
    post_R: Array  # (bodies, 3, 3)
    post_p: Array  # (bodies, 3)
    axis_kind: Ints  # (axes,) ROTATION or TRANSLATION
    axis_vector: Array  # (axes, 3) unit vectors
    axis_body: Ints  # (axes,)
    axis_function: Ints  # (axes,) index in `functions`
    axis_coordinate: Ints  # (axes, 2) the coordinates the function takes, -1 for none
    functions: FunctionArrays
    # (couplers,) the dependent coordinate and its function, in an order of evaluation
    coupler_coordinate: Ints
    coupler_function: Ints
    # (couplers, 2) the dependent coordinate, its function and what it follows, in an order of
    # evaluation
    coupler_source: Ints
    mass: Array  # (bodies,)
    mass_center: Array  # (bodies, 3)
    inertia: Array  # (bodies, 3, 3) about the mass center
    gravity: Array  # (3,)


class LoopArrays(NamedTuple):
    """The constraints that close loops: a point of one body stays on a point of another, of a weld
    turned alike.
    """

    # body_1, body_2: (loops,)
    body_1: Ints
    body_2: Ints
    # point_1, point_2: (loops, 3) tied points in their bodies [m]
    point_1: Array
    point_2: Array
    # turn_1, turn_2: (loops, 3, 3) tied frames in their bodies
    turn_1: Array
    turn_2: Array
    # (loops + 1,) loop i has the rows row[i] ... row[i + 1] - 1: three of a point [m], or of a weld
    # three of its turning [rad], then three of its point [m]
    row: Ints


@dataclass(frozen=True, eq=False)
class Tree:
    """A model and its arrays."""

    model: Model
    arrays: TreeArrays
    # number of each body in the arrays, the ground 0
    body_index: dict[str, int] = field(repr=False)

    def body_number(self, name: str, where: str = "the model") -> int:
        """Number of a body in the arrays; raises `UnknownName`, by default of "the model"."""
        check_name("body", name, self.body_index, where)
        return self.body_index[name]

    @cached_property
    def defaults(self) -> Array:
        """(coordinates,) default value of every coordinate [rad or m]."""
        return np.array(
            [coordinate.default for coordinate in self.model.coordinates], dtype=np.float64
        )

    @cached_property
    def independent(self) -> Ints:
        """Indices of the coordinates that no coupler drives."""
        driven = self.model.dependent_coordinates
        return np.array(
            [i for i, name in enumerate(self.model.coordinate_names) if name not in driven],
            np.int64,
        )

    @cached_property
    def supports(self) -> np.ndarray:
        """(bodies, axes) whether an axis lies between the ground and a body."""
        arrays = self.arrays
        table = np.zeros((len(arrays.parent), len(arrays.axis_kind)), dtype=np.bool_)
        for body in range(1, len(arrays.parent)):
            table[body] = table[arrays.parent[body]]
            table[body, arrays.axis_start[body] : arrays.axis_start[body + 1]] = True
        return table

    @cached_property
    def roots(self) -> Ints:
        """(bodies,) the body next to the ground that each hangs on, which separates subjects and
        objects.
        """
        roots = np.arange(len(self.arrays.parent))
        for body, parent in enumerate(self.arrays.parent):
            if parent > 0:
                roots[body] = roots[parent]
        return roots

    def hanging(self, body: str) -> np.ndarray:
        """(bodies,) whether each hangs on a body, itself included."""
        result = np.arange(len(self.arrays.parent)) == self.body_index[body]
        for number, parent in enumerate(self.arrays.parent):
            result[number] |= parent >= 0 and result[parent]
        return result

    @cached_property
    def loops(self) -> LoopArrays:
        """The constraints that close loops."""
        loops = self.model.loops
        sizes = [6 if loop.kind.lower().startswith("weld") else 3 for loop in loops]
        return LoopArrays(
            body_1=np.array([self.body_index[loop.body_1] for loop in loops], np.int64),
            body_2=np.array([self.body_index[loop.body_2] for loop in loops], np.int64),
            point_1=_stack([loop.pose_1.translation for loop in loops], (3,)),
            point_2=_stack([loop.pose_2.translation for loop in loops], (3,)),
            turn_1=_stack([loop.pose_1.rotation for loop in loops], (3, 3)),
            turn_2=_stack([loop.pose_2.rotation for loop in loops], (3, 3)),
            row=np.cumsum([0, *sizes]),
        )

    def coordinates_of(self, motion: Motion) -> Array:
        """(frames, coordinates) a motion's values in the model's order.
        What the motion does not have stands at its default; dependent coordinates follow couplers.
        """
        values = np.tile(self.defaults, (len(motion), 1))
        self._put(motion.names, motion.values, values)
        couple_frames(self.arrays, values)
        return values

    def rates_of(self, motion: Motion) -> tuple[Array, Array]:
        """(frames, coordinates) velocities and accelerations in the model's order, 0 for what the
        motion lacks.
        """
        rates = np.zeros((2, len(motion), len(self.model.coordinates)))
        for values, filled in zip((motion.velocities, motion.accelerations), rates, strict=True):
            if values is not None:
                self._put(motion.names, values, filled)
        return rates[0], rates[1]

    def _put(self, names: tuple[str, ...], values: Array, filled: Array) -> None:
        columns = {name: i for i, name in enumerate(names)}
        for j, name in enumerate(self.model.coordinate_names):
            if name in columns:
                filled[:, j] = values[:, columns[name]]


def compile_tree(model: Model) -> Tree:
    """The model as flat arrays; the same model compiles once."""
    return _latest(model)


def compile_tree_as(model: Model, like: Model) -> Tree:
    """`compile_tree` of a model made of another by changing joint frames, masses, mass centers and
    inertias alone. `like`: the other one, with the same parts in the same order; what was compiled
    of it is used again.
    """
    tree = compile_tree(like)
    T = tree.arrays
    pre_R = T.pre_R.copy()
    pre_p = T.pre_p.copy()
    shift = T.pre_is_shift.copy()
    post_R = T.post_R.copy()
    post_p = T.post_p.copy()
    before = {joint.child: joint for joint in like.joints}
    for joint in model.joints:
        was = before[joint.child]
        b = tree.body_index[joint.child]
        if joint.parent_frame is was.parent_frame and joint.child_frame is was.child_frame:
            continue
        first = T.axis_start[b]
        moved = joint.parent_frame @ was.parent_frame.inverse()
        end = was.child_frame @ joint.child_frame.inverse()
        if first < T.axis_start[b + 1]:
            pre_R[first], pre_p[first] = moved.rotation @ pre_R[first], moved.apply(pre_p[first])
            shift[first] = False
        else:
            end = Transform(post_R[b], post_p[b]) @ end
            post_R[b], post_p[b] = moved.rotation @ end.rotation, moved.apply(end.translation)
            continue
        post_p[b] += post_R[b] @ end.translation
        post_R[b] = post_R[b] @ end.rotation
    arrays = T._replace(
        pre_R=pre_R,
        pre_p=pre_p,
        pre_is_shift=shift,
        post_R=post_R,
        post_p=post_p,
        mass=np.array([0.0] + [body.mass for body in model.bodies]),
        mass_center=_stack([np.zeros(3)] + [body.mass_center for body in model.bodies], (3,)),
        inertia=_stack([np.zeros((3, 3))] + [body.inertia for body in model.bodies], (3, 3)),
    )
    made = Tree(model, arrays, tree.body_index)
    _latest.put(model, made)
    return made


def _compile(model: Model) -> Tree:
    names = model.coordinate_names
    body_index = {GROUND: 0} | {body.name: i + 1 for i, body in enumerate(model.bodies)}
    joints = {joint.child: joint for joint in model.joints}
    functions: list[Function] = []
    axes: list[tuple[Transform, Axis, int]] = []
    parent = [-1]
    axis_start = [0, 0]
    post = [Transform.identity()]
    for body in model.bodies:
        joint = joints[body.name]
        pending = joint.parent_frame
        for axis in joint.axes:
            if axis.function.arity == 0:
                pending = pending @ axis.moved(float(axis.function(0.0)))
                continue
            to_origin = Transform(np.eye(3), axis.origin)
            axes.append((pending @ to_origin, axis, body_index[body.name]))
            functions.append(axis.function)
            pending = to_origin.inverse()
        parent.append(body_index[joint.parent])
        axis_start.append(len(axes))
        post.append(pending @ joint.child_frame.inverse())
    ordered = _evaluation_order(model.couplers)
    arrays = TreeArrays(
        parent=np.array(parent, np.int64),
        axis_start=np.array(axis_start, np.int64),
        pre_R=_stack([pre.rotation for pre, _, _ in axes], (3, 3)),
        pre_p=_stack([pre.translation for pre, _, _ in axes], (3,)),
        pre_is_shift=np.array(
            [bool(np.all(pre.rotation == np.eye(3))) for pre, _, _ in axes], np.bool_
        ),
        post_R=_stack([frame.rotation for frame in post], (3, 3)),
        post_p=_stack([frame.translation for frame in post], (3,)),
        axis_kind=np.array(
            [ROTATION if axis.kind == "rotation" else TRANSLATION for _, axis, _ in axes], np.int64
        ),
        axis_vector=_stack(
            [axis.vector / np.linalg.norm(axis.vector) for _, axis, _ in axes], (3,)
        ),
        axis_body=np.array([body for _, _, body in axes], np.int64),
        axis_function=np.arange(len(axes), dtype=np.int64),
        axis_coordinate=_sources([axis.coordinates for _, axis, _ in axes], names),
        functions=compile_functions(functions + [coupler.function for coupler in ordered]),
        coupler_coordinate=np.array(
            [index_of("coordinate", coupler.dependent, names) for coupler in ordered], np.int64
        ),
        coupler_function=np.arange(len(axes), len(axes) + len(ordered), dtype=np.int64),
        coupler_source=_sources([coupler.independents for coupler in ordered], names),
        mass=np.array([0.0] + [body.mass for body in model.bodies]),
        mass_center=_stack([np.zeros(3)] + [body.mass_center for body in model.bodies], (3,)),
        inertia=_stack([np.zeros((3, 3))] + [body.inertia for body in model.bodies], (3, 3)),
        gravity=np.array(model.gravity),
    )
    return Tree(model, arrays, body_index)


_latest = Latest(_compile)


def _stack(parts: list[Array], shape: tuple[int, ...]) -> Array:
    return np.ascontiguousarray(np.array(parts, dtype=np.float64).reshape((len(parts), *shape)))


def _sources(names_of_each: list[tuple[str, ...]], names: tuple[str, ...]) -> Ints:
    table = np.full((len(names_of_each), 2), -1, dtype=np.int64)
    for row, used in zip(table, names_of_each, strict=True):
        if len(used) > 2:
            raise BadModel(
                f"a function of {len(used)} coordinates ({', '.join(used)}): at most two are built"
            )
        row[: len(used)] = [index_of("coordinate", name, names) for name in used]
    return table


def _evaluation_order(couplers: tuple[Coupler, ...]) -> list[Coupler]:
    """Couplers so that each comes after those that drive what it follows."""
    waiting = list(couplers)
    ordered = []
    while waiting:
        driven = {coupler.dependent for coupler in waiting}
        ready = [coupler for coupler in waiting if not driven & set(coupler.independents)]
        if not ready:
            raise BadModel(f"couplers go round in a circle: {', '.join(sorted(driven))}")
        ordered += ready
        waiting = [coupler for coupler in waiting if coupler not in ready]
    return ordered
