"""The model compiled to flat arrays: bodies, moving axes, functions and couplers in tree order."""

from __future__ import annotations

from dataclasses import dataclass, field
from functools import cached_property
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel, check_name
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import GROUND, Axis, Coupler, Joint, Model, index_of
from myomorph.core.model.series import Motion
from myomorph.core.model.shapes import Coordinates
from myomorph.core.model.shown import shown
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.coordinates import FunctionArrays, Ints, compile_functions, couple_frames

ROTATION = 0
TRANSLATION = 1
KINDS = {"rotation": ROTATION, "translation": TRANSLATION}
Flags = NDArray[np.bool_]


class TreeArrays(NamedTuple):
    """Bodies, moving axes, functions and couplers as the kernels read them.

    Body 0 is the ground, and a parent comes before its children. The pose of a body is its
    parent's, then for each of its axes the constant `pre` of the axis and the motion of the axis,
    then the constant `post` of the body. Axes that do not move are part of these constants.

    Attributes
    ----------
    parent : (bodies,) number of the parent, -1 for the ground
    axis_start : (bodies + 1,) body b has the axes axis_start[b] ... axis_start[b + 1] - 1
    pre_R : (axes, 3, 3) constant rotation before an axis
    pre_p : (axes, 3) constant translation before an axis [m]
    pre_is_shift : (axes,) whether pre_R is the identity
    post_R : (bodies, 3, 3) constant rotation after the last axis
    post_p : (bodies, 3) constant translation after the last axis [m]
    axis_kind : (axes,) `ROTATION` or `TRANSLATION`
    axis_vector : (axes, 3) unit vectors
    axis_body : (axes,) the body that each belongs to
    axis_function : (axes,) row in `functions`
    axis_coordinate : (axes, 2) the coordinates that the function takes, -1 for none
    functions : of axes, then of couplers
    coupler_coordinate : (couplers,) the dependent coordinate, in an order of evaluation
    coupler_function : (couplers,) row in `functions`
    coupler_source : (couplers, 2) the coordinates that it follows, -1 for none
    mass : (bodies,) [kg]
    mass_center : (bodies, 3) in the body [m]
    inertia : (bodies, 3, 3) about the mass center, in the body [kg m^2]
    gravity : (3,) in ground [m/s^2]
    """

    parent: Ints
    axis_start: Ints
    pre_R: Array
    pre_p: Array
    pre_is_shift: Flags
    post_R: Array
    post_p: Array
    axis_kind: Ints
    axis_vector: Array
    axis_body: Ints
    axis_function: Ints
    axis_coordinate: Ints
    functions: FunctionArrays
    coupler_coordinate: Ints
    coupler_function: Ints
    coupler_source: Ints
    mass: Array
    mass_center: Array
    inertia: Array
    gravity: Array


class LoopArrays(NamedTuple):
    """Constraints that close loops.

    A point of one body stays on a point of another. A weld keeps their frames parallel, too.

    Attributes
    ----------
    body_1, body_2 : (loops,) numbers of the bodies
    point_1, point_2 : (loops, 3) constrained points in their bodies [m]
    turn_1, turn_2 : (loops, 3, 3) rotations of the constrained frames in their bodies
    row : (loops + 1,) loop i has the rows row[i] ... row[i + 1] - 1: three of a point [m], or of a
        weld three of its rotation [rad], then three of its point [m]
    """

    body_1: Ints
    body_2: Ints
    point_1: Array
    point_2: Array
    turn_1: Array
    turn_2: Array
    row: Ints


class MovingAxis(NamedTuple):
    """An axis that moves a body, on its way into the arrays.

    Attributes
    ----------
    pre : constant transform between the axis before it, or the parent, and this one
    axis : of the joint
    body : number of the body that it moves
    """

    pre: Transform
    axis: Axis
    body: int


class JointChains(NamedTuple):
    """What lies between bodies and their parents, as of `TreeArrays`.

    Attributes
    ----------
    moving : axes that move, body by body
    parent : of each body, -1 for the ground
    axis_start : of each body, and the number of axes
    post : constant transform after the last axis of each body
    """

    moving: list[MovingAxis]
    parent: list[int]
    axis_start: list[int]
    post: list[Transform]


class Rates(NamedTuple):
    """Time derivatives of all coordinates, in the model's order.

    Attributes
    ----------
    velocities : (frames, coordinates) [rad/s or m/s]
    accelerations : (frames, coordinates) [rad/s^2 or m/s^2]
    """

    velocities: Coordinates
    accelerations: Coordinates


@shown
@dataclass(frozen=True, eq=False)
class Tree:
    """A model and its arrays.

    Attributes
    ----------
    model : that was compiled
    arrays : as the kernels read them
    body_index : number of each body in the arrays by name, the ground 0
    """

    model: Model
    arrays: TreeArrays
    body_index: dict[str, int] = field(repr=False)

    def body_number(self, name: str, where: str = "the model") -> int:
        """Look up the number of a body in the arrays.

        Parameters
        ----------
        name : of the body
        where : what should have it, for the error

        Raises
        ------
        UnknownName : there is no such body
        """
        check_name("body", name, self.body_index, where)
        return self.body_index[name]

    @cached_property
    def defaults(self) -> Array:
        """(coordinates,) default value of every coordinate [rad or m]."""
        values = [coordinate.default for coordinate in self.model.coordinates]
        return np.array(values, dtype=np.float64)

    @cached_property
    def independent(self) -> Ints:
        """Indices of the coordinates that no coupler drives."""
        driven = self.model.dependent_coordinates
        names = self.model.coordinate_names
        return np.array([i for i, name in enumerate(names) if name not in driven], np.int64)

    @cached_property
    def supports(self) -> Flags:
        """(bodies, axes) whether an axis lies between the ground and a body."""
        arrays = self.arrays
        table = np.zeros((len(arrays.parent), len(arrays.axis_kind)), dtype=np.bool_)
        for body in range(1, len(arrays.parent)):
            table[body] = table[arrays.parent[body]]
            table[body, arrays.axis_start[body] : arrays.axis_start[body + 1]] = True
        return table

    @cached_property
    def roots(self) -> Ints:
        """(bodies,) the body next to the ground that each hangs on: one per subject or object."""
        roots = np.arange(len(self.arrays.parent))
        for body, parent in enumerate(self.arrays.parent):
            if parent > 0:
                roots[body] = roots[parent]
        return roots

    def hanging(self, body: str) -> Flags:
        """Flag the bodies that hang on a body, itself included.

        Parameters
        ----------
        body : its name

        Returns
        -------
        (bodies,)
        """
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

    def coordinates_of(self, motion: Motion) -> Coordinates:
        """Values of a motion in the model's order, dependent coordinates set by their couplers.

        Parameters
        ----------
        motion : what it lacks stands at the model's default

        Returns
        -------
        (frames, coordinates) [rad or m]
        """
        values = np.tile(self.defaults, (len(motion), 1))
        self._put(motion.names, motion.values, values)
        couple_frames(self.arrays, values)
        return values

    def rates_of(self, motion: Motion) -> Rates:
        """Velocities and accelerations of a motion in the model's order, dependent ones not set.

        Parameters
        ----------
        motion : what it lacks has a rate of 0
        """
        shape = (len(motion), len(self.model.coordinates))
        rates = Rates(velocities=np.zeros(shape), accelerations=np.zeros(shape))
        for values, filled in zip((motion.velocities, motion.accelerations), rates, strict=True):
            if values is not None:
                self._put(motion.names, values, filled)
        return rates

    def _put(self, names: tuple[str, ...], values: Array, filled: Coordinates) -> None:
        """Copy columns into the model's order.

        Parameters
        ----------
        names : of the coordinates that `values` has
        values : (frames, names)
        filled : (frames, coordinates) changed where the motion has a coordinate
        """
        columns = {name: i for i, name in enumerate(names)}
        for j, name in enumerate(self.model.coordinate_names):
            if name in columns:
                filled[:, j] = values[:, columns[name]]


def compile_tree(model: Model) -> Tree:
    """Compile a model to flat arrays; the same model compiles once."""
    return _latest(model)


def compile_tree_as(model: Model, like: Model) -> Tree:
    """Compile a model that differs from another in joint frames, masses and inertias alone.

    What was compiled of the other is used again. Where both frames of a joint moved,

        pre = (P' P^-1) pre,   post = post (C C'^-1)

    with P, C the frames on parent and child before and P', C' now.

    Parameters
    ----------
    model : to compile
    like : the other one, with the same parts in the same order
    """
    tree = compile_tree(like)
    arrays = tree.arrays._replace(
        pre_R=tree.arrays.pre_R.copy(),
        pre_p=tree.arrays.pre_p.copy(),
        pre_is_shift=tree.arrays.pre_is_shift.copy(),
        post_R=tree.arrays.post_R.copy(),
        post_p=tree.arrays.post_p.copy(),
        mass=_masses(model),
        mass_center=_mass_centers(model),
        inertia=_inertias(model),
    )
    previous = {joint.child: joint for joint in like.joints}
    for joint in model.joints:
        _move_joint(arrays, tree.body_index[joint.child], previous[joint.child], joint)
    compiled = Tree(model=model, arrays=arrays, body_index=tree.body_index)
    _latest.put(model, compiled)
    return compiled


def _move_joint(arrays: TreeArrays, body: int, previous: Joint, joint: Joint) -> None:
    """Move the frames of a joint in the arrays, in place.

    Parameters
    ----------
    arrays : of the tree that has the previous joint
    body : number of the joint's child
    previous, joint : before and now
    """
    same_parent_frame = joint.parent_frame is previous.parent_frame
    if same_parent_frame and joint.child_frame is previous.child_frame:
        return
    on_parent = joint.parent_frame @ previous.parent_frame.inverse()
    on_child = previous.child_frame @ joint.child_frame.inverse()

    first = arrays.axis_start[body]
    if first == arrays.axis_start[body + 1]:
        # A joint that does not move is one constant transform.
        post = Transform(arrays.post_R[body], arrays.post_p[body]) @ on_child
        arrays.post_R[body] = on_parent.rotation @ post.rotation
        arrays.post_p[body] = on_parent.apply(post.translation)
        return
    arrays.pre_R[first] = on_parent.rotation @ arrays.pre_R[first]
    arrays.pre_p[first] = on_parent.apply(arrays.pre_p[first])
    arrays.pre_is_shift[first] = False
    arrays.post_p[body] += arrays.post_R[body] @ on_child.translation
    arrays.post_R[body] = arrays.post_R[body] @ on_child.rotation


def _compile(model: Model) -> Tree:
    """Compile a model to flat arrays."""
    names = model.coordinate_names
    body_index = {GROUND: 0} | {body.name: i + 1 for i, body in enumerate(model.bodies)}
    chains = _joint_chains(model, body_index)
    moving = chains.moving
    pre = [item.pre for item in moving]

    couplers = _evaluation_order(model.couplers)
    functions = [item.axis.function for item in moving]
    functions += [coupler.function for coupler in couplers]
    arrays = TreeArrays(
        parent=np.array(chains.parent, np.int64),
        axis_start=np.array(chains.axis_start, np.int64),
        pre_R=_stack([frame.rotation for frame in pre], (3, 3)),
        pre_p=_stack([frame.translation for frame in pre], (3,)),
        pre_is_shift=np.array([_is_shift(frame) for frame in pre], np.bool_),
        post_R=_stack([frame.rotation for frame in chains.post], (3, 3)),
        post_p=_stack([frame.translation for frame in chains.post], (3,)),
        axis_kind=np.array([KINDS[item.axis.kind] for item in moving], np.int64),
        axis_vector=_stack([_direction(item.axis) for item in moving], (3,)),
        axis_body=np.array([item.body for item in moving], np.int64),
        axis_function=np.arange(len(moving), dtype=np.int64),
        axis_coordinate=_sources([item.axis.coordinates for item in moving], names),
        functions=compile_functions(functions),
        coupler_coordinate=_dependents(couplers, names),
        coupler_function=np.arange(len(moving), len(functions), dtype=np.int64),
        coupler_source=_sources([coupler.independents for coupler in couplers], names),
        mass=_masses(model),
        mass_center=_mass_centers(model),
        inertia=_inertias(model),
        gravity=np.array(model.gravity),
    )
    return Tree(model=model, arrays=arrays, body_index=body_index)


def _joint_chains(model: Model, body_index: dict[str, int]) -> JointChains:
    """Collect what lies between each body and its parent, in the order of the bodies."""
    joints = {joint.child: joint for joint in model.joints}
    chains = JointChains(moving=[], parent=[-1], axis_start=[0, 0], post=[Transform.identity()])
    for body in model.bodies:
        joint = joints[body.name]
        axes, after_axes = _joint_axes(joint, body_index[body.name])
        chains.moving.extend(axes)
        chains.parent.append(body_index[joint.parent])
        chains.axis_start.append(len(chains.moving))
        chains.post.append(after_axes)
    return chains


def _joint_axes(joint: Joint, body: int) -> tuple[list[MovingAxis], Transform]:
    """Collect the moving axes of a joint, and the constant transform after the last of them.

    An axis turns about its own origin, so a shift stands before it and another back behind it.

    Parameters
    ----------
    body : number of the joint's child
    """
    axes = []
    constant = joint.parent_frame
    for axis in joint.axes:
        if axis.function.arity == 0:
            constant = constant @ axis.moved(float(axis.function(0.0)))
            continue
        to_origin = Transform(np.eye(3), axis.origin)
        axes.append(MovingAxis(pre=constant @ to_origin, axis=axis, body=body))
        constant = to_origin.inverse()
    return axes, constant @ joint.child_frame.inverse()


def _is_shift(transform: Transform) -> bool:
    """Whether a transform rotates nothing."""
    return bool(np.all(transform.rotation == np.eye(3)))


def _direction(axis: Axis) -> Array:
    """(3,) unit vector of an axis."""
    return axis.vector / np.linalg.norm(axis.vector)


def _masses(model: Model) -> Array:
    """(bodies,) masses, 0 of the ground [kg]."""
    return np.array([0.0] + [body.mass for body in model.bodies])


def _mass_centers(model: Model) -> Array:
    """(bodies, 3) mass centers in their bodies [m]."""
    return _stack([np.zeros(3)] + [body.mass_center for body in model.bodies], (3,))


def _inertias(model: Model) -> Array:
    """(bodies, 3, 3) inertias about the mass centers [kg m^2]."""
    return _stack([np.zeros((3, 3))] + [body.inertia for body in model.bodies], (3, 3))


_latest = Latest(_compile)


def _stack(parts: list[Array], shape: tuple[int, ...]) -> Array:
    """Parts of one shape as a contiguous array (parts, *shape), also of no part."""
    return np.ascontiguousarray(np.array(parts, dtype=np.float64).reshape((len(parts), *shape)))


def _dependents(couplers: list[Coupler], names: tuple[str, ...]) -> Ints:
    """(couplers,) numbers of the coordinates that couplers set."""
    numbers = [index_of("coordinate", coupler.dependent, names) for coupler in couplers]
    return np.array(numbers, np.int64)


def _sources(names_of_each: list[tuple[str, ...]], names: tuple[str, ...]) -> Ints:
    """Numbers of the coordinates that functions take.

    Parameters
    ----------
    names_of_each : coordinates of each function
    names : of all coordinates

    Returns
    -------
    (functions, 2), -1 for none

    Raises
    ------
    BadModel : a function takes more than two
    """
    table = np.full((len(names_of_each), 2), -1, dtype=np.int64)
    for row, used in zip(table, names_of_each, strict=True):
        if len(used) > 2:
            raise BadModel(
                f"a function of {len(used)} coordinates ({', '.join(used)}): at most two are"
                " supported"
            )
        row[: len(used)] = [index_of("coordinate", name, names) for name in used]
    return table


def _evaluation_order(couplers: tuple[Coupler, ...]) -> list[Coupler]:
    """Sort couplers so that each comes after those that drive what it follows.

    Raises
    ------
    BadModel : couplers follow each other in a circle
    """
    waiting = list(couplers)
    ordered = []
    while waiting:
        driven = {coupler.dependent for coupler in waiting}
        ready = [coupler for coupler in waiting if not driven & set(coupler.independents)]
        if not ready:
            raise BadModel(
                f"couplers depend on each other in a circle: {', '.join(sorted(driven))}"
            )
        ordered += ready
        waiting = [coupler for coupler in waiting if coupler not in ready]
    return ordered
