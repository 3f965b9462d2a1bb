"""A task of inverse kinematics, and the sums that tasks add to.

The problem of a frame is the sum of its tasks,

    minimise  sum_t cost_t(c)   over the free coordinates c, within their bounds, so that every loop
    stays closed

A kind of task is a class derived from `Task` with four kernels, one file. Its values (one for each
marker, sensor or coordinate) are compiled together into one named tuple of arrays, so that the
Newton loop of `myomorph.core.motion.newton`, compiled once for each combination of kinds, adds up
whatever it is handed. A kind from outside the package is compiled together with the same loop when
it is first used.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any, ClassVar, NamedTuple, Self

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.rigid.kernels import bare, inner, overload
from myomorph.core.rigid.tree import Tree
from myomorph.core.rigid.vectors import cross, minus

# Columns of `Work.points`, sums over the points of a body: of their weights; of weight times their
# position x relative to `Work.origin`, and times x x^T, a symmetric matrix, of which the upper
# triangle is held; of their weighted error e, and of x e^T, where X_EY is x_0 e_1
WEIGHT = 0
X, Y, Z = range(1, 4)
XX, XY, XZ, YY, YZ, ZZ = range(4, 10)
EX, EY, EZ = range(10, 13)
X_EX, X_EY, X_EZ, Y_EX, Y_EY, Y_EZ, Z_EX, Z_EY, Z_EZ = range(13, 22)
POINT_SUMS = 22  # How many they are


class TaskKernels(NamedTuple):
    """The kernels of a kind of task, made with `myomorph.core.rigid.kernels.bare`.

    All read the arrays of the kind, the named tuple `arrays` that `Task.together` returns, and the
    number of a frame; `c` are the coordinates, dependent ones consistent, and `work` the sums and
    scratch arrays, whose poses are those at c. `shown` (arrays, frame): whether the frame has a
    measurement of this kind, or is left out; `cost` (arrays, c, frame, work); `add`: the same, and
    half its gradient and half its curvature are added to the sums; `keep`: called at the solution
    of a frame, to store its residuals in `arrays`.
    """

    arrays: type
    shown: Callable[..., Any]
    cost: Callable[..., Any]
    add: Callable[..., Any]
    keep: Callable[..., Any]


class Task:
    """A summand of the cost of inverse kinematics; derived classes set `kernels`.

    Where the arrays have a field `errors`, (frames, ...), the residuals stored there are those of
    the result.
    """

    kernels: ClassVar[TaskKernels]

    def __init_subclass__(cls) -> None:
        super().__init_subclass__()
        TASKS[cls.kernels.arrays] = cls

    @classmethod
    def together(cls, tasks: Sequence[Self], tree: Tree, targets: Array) -> Any:
        """Compile all tasks of this kind into arrays as the kernels read them.

        Parameters
        ----------
        tasks : of this kind, may be none
        tree : of the model
        targets : (frames, coordinates) reference values of the coordinates [rad or m], see
            `coordinate_targets`

        Returns
        -------
        named tuple of arrays, writable and in C order
        """
        raise NotImplementedError


TASKS: dict[type, type[Task]] = {}
"""Each kind of task, by the class of its arrays."""


def per_frame(values: Array, frames: int, what: str) -> Array:
    """Copy values of each frame as kernels read them.

    Parameters
    ----------
    values : (frames, ...)
    frames : number of frames of the markers
    what : name of the values, for the error

    Returns
    -------
    (frames, ...) in C order

    Raises
    ------
    BadData : the values have another number of frames than the markers
    """
    values = np.array(values, dtype=np.float64, order="C")
    if len(values) != frames:
        raise BadData(
            f"{what}: {len(values)} frames, but the markers have {frames}: resample them to the"
            " markers' times"
        )
    return values


class Work(NamedTuple):
    """Sums that tasks add to, and scratch arrays of one solver.

    There are n coordinates. Of the arrays that hold something for each free coordinate, by its
    place in `PoseProblem.free`, only the first entries are used.

    Sums over bodies have points relative to `origin`, so that they stay exact far from the
    ground's. A residual r of a body, with slopes J in the body's twist (its angular velocity and
    the velocity at `origin`), is a row: it adds J J^T and J r.
    """

    # Poses of bodies and of the axes that move them, as `body_poses` fills them
    R: Array  # (bodies, 3, 3)
    p: Array  # (bodies, 3) [m]
    w: Array  # (axes, 3)
    o: Array  # (axes, 3) [m]
    dphi: Array  # (axes, 2)

    # Half the cost, over all n coordinates
    H: Array  # (n, n) Hessian, lower triangle
    g: Array  # (n,) gradient
    D: Array  # (n,) diagonal of the Gauss-Newton part of H
    direct: Array  # (n,) curvature of tasks of single independent coordinates, in H and D

    # The Newton step; of these `trial` has all coordinates, the others have the free ones
    L: Array  # (n + 1, n) factor of H, rows and columns by place in `solved`
    step: Array  # (free,)
    trial: Array  # (n,) coordinates after the step
    held: Array  # (free,) whether a coordinate is at a bound before the step
    stopped: Array  # (free,) ... and within it
    late: Array  # (free,) whether a coordinate is solved for last, where loops are closed
    solved: Array  # (free,) places in `free` of the coordinates that are solved for

    # Sums over points and rows of each body
    origin: Array  # (3,) in ground [m]
    points: Array  # (bodies, POINT_SUMS) columns WEIGHT to Z_EZ
    rows: Array  # (bodies, 6, 6) sums of J J^T
    row_gradient: Array  # (bodies, 6) sums of J r
    has_rows: Array  # (1,) whether any row was added

    # Derivatives of the axes
    fields: Array  # (axes, 6) of `axis_fields`
    curvature: Array  # (axes, 3) second derivatives of the axes' motions


@inner
def new_work(T, n):
    """Make sums and scratch arrays for a tree of n coordinates."""
    bodies = T.parent.shape[0]
    axes = T.axis_kind.shape[0]
    return Work(
        R=np.empty((bodies, 3, 3)),
        p=np.empty((bodies, 3)),
        w=np.empty((axes, 3)),
        o=np.empty((axes, 3)),
        dphi=np.empty((axes, 2)),
        H=np.empty((n, n)),
        g=np.empty(n),
        D=np.empty(n),
        direct=np.empty(n),
        L=np.empty((n + 1, n)),
        step=np.empty(n),
        trial=np.empty(n),
        held=np.empty(n, np.bool_),
        stopped=np.empty(n, np.bool_),
        late=np.empty(n, np.bool_),
        solved=np.empty(n, np.int64),
        origin=np.empty(3),
        points=np.empty((bodies, POINT_SUMS)),
        rows=np.zeros((bodies, 6, 6)),
        row_gradient=np.zeros((bodies, 6)),
        has_rows=np.zeros(1, np.bool_),
        fields=np.empty((axes, 6)),
        curvature=np.empty((axes, 3)),
    )


@bare
def add_row(work, body, slope, residual, weight):
    """Add weight residual^2 with Gauss-Newton curvature and return it.

    `slope` (6,) is that of the residual in the body's angular velocity and velocity at
    `work.origin`.
    """
    if not work.has_rows[0]:
        work.has_rows[0] = True
        for b in range(work.rows.shape[0]):
            for i in range(6):
                work.row_gradient[b, i] = 0.0
                for j in range(6):
                    work.rows[b, i, j] = 0.0
    for i in range(6):
        work.row_gradient[body, i] += weight * residual * slope[i]
        for j in range(6):
            work.rows[body, i, j] += weight * slope[i] * slope[j]
    return weight * residual * residual


class HalfCost(NamedTuple):
    """Derivatives of half a cost by the coordinates.

    Attributes
    ----------
    H : (coordinates, coordinates) Hessian, lower triangle
    g : (coordinates,) gradient
    D : (coordinates,) diagonal of the Gauss-Newton part of H
    """

    H: Array
    g: Array
    D: Array


@bare
def add_gradient(T, work, half, axis, slope_along_axis):
    """Add the gradient through an axis to `half.g`, and the curvature of its function to `half.H`.

    An axis moves by a function phi of one coordinate i or of two, i and j. With the slope s of half
    the cost along phi, `slope_along_axis`,

        g_i += dphi/dc_i s,   H_ij += d^2 phi/(dc_i dc_j) s
    """
    H = half.H
    g = half.g
    i = T.axis_coordinate[axis, 0]
    j = T.axis_coordinate[axis, 1]
    g[i] += work.dphi[axis, 0] * slope_along_axis
    H[i, i] += work.curvature[axis, 0] * slope_along_axis
    if j >= 0:
        g[j] += work.dphi[axis, 1] * slope_along_axis
        H[j, j] += work.curvature[axis, 2] * slope_along_axis
        H[max(i, j), min(i, j)] += work.curvature[axis, 1] * slope_along_axis


@bare
def add_pair(T, work, half, axes, second_derivative):
    """Add to `half` between the coordinates of two axes, one nearer to the ground than the other.

    Parameters
    ----------
    T : arrays of the tree
    work : with the slopes of the axes' functions
    half : its H and D are added to
    axes : numbers of the farther and of the nearer axis, or twice that of one
    second_derivative : of half the cost along both axes, its Gauss-Newton part and the rest
    """
    farther, nearer = axes
    plain, curved = second_derivative
    for s in range(2):
        i = T.axis_coordinate[farther, s]
        if i < 0:
            break
        for t in range(2):
            j = T.axis_coordinate[nearer, t]
            # Two coordinates of one axis pair up both ways: the lower triangle takes one of them.
            if j < 0 or (nearer == farther and i < j):
                continue
            share = work.dphi[farther, s] * work.dphi[nearer, t]
            if i == j and nearer != farther:
                share *= 2.0
            half.H[max(i, j), min(i, j)] += share * (plain + curved)
            if i == j:
                half.D[i] += share * plain


@bare
def point_slope(work, x, direction):
    """Slope for `add_row` of the component along a direction of a body's point.

    The point x [m] and the direction are in ground.
    """
    arm = cross(minus(x, (work.origin[0], work.origin[1], work.origin[2])), direction)
    return (arm[0], arm[1], arm[2], direction[0], direction[1], direction[2])


@bare
def angle_slope(direction):
    """Slope for `add_row` of a rotation of a body about a direction in ground."""
    return (direction[0], direction[1], direction[2], 0.0, 0.0, 0.0)


@bare
def no_residual(arrays, c, frame, work):
    """`TaskKernels.keep` of a kind that stores nothing."""
    return


# Each of the next four does one thing for every kind of task. What stands in their bodies runs
# where kernels are `interpreted`. Numba has no loop over values of different types, so for compiled
# code the overloads below them unroll that loop at compile time: for the types of `tasks`, each
# writes the call of the first kind's kernel, and behind it itself for the kinds that are left. A
# problem with three kinds thus compiles to three calls in a row, without a choice at run time.


def shown(tasks: tuple[Any, ...], frame: int) -> bool:
    """Return whether a frame has a measurement of any task; for kernels."""
    return any(_kernels_of(arrays).shown(arrays, frame) for arrays in tasks)


def sum_of_costs(tasks: tuple[Any, ...], c: Array, frame: int, work: Work) -> float:
    """Return the cost of all tasks; for kernels.

    Parameters
    ----------
    tasks : arrays of each kind of task
    c : (coordinates,) dependent ones consistent [rad or m]
    frame : number of the frame
    work : with the poses at c

    Returns
    -------
    sum of all costs [m^2]
    """
    return _sum_from_last([_kernels_of(arrays).cost(arrays, c, frame, work) for arrays in tasks])


def add_tasks(tasks: tuple[Any, ...], c: Array, frame: int, work: Work) -> float:
    """Add half the gradient and curvature of all tasks to `work`; for kernels.

    Parameters
    ----------
    tasks : arrays of each kind of task
    c : (coordinates,) dependent ones consistent [rad or m]
    frame : number of the frame
    work : with the poses at c; its sums are added to

    Returns
    -------
    sum of all costs [m^2]
    """
    return _sum_from_last([_kernels_of(arrays).add(arrays, c, frame, work) for arrays in tasks])


def keep_residuals(tasks: tuple[Any, ...], c: Array, frame: int, work: Work) -> None:
    """Let all tasks store their residuals; for kernels.

    Parameters
    ----------
    tasks : arrays of each kind of task
    c : (coordinates,) solution of the frame [rad or m]
    frame : number of the frame
    work : with the poses at c
    """
    for arrays in tasks:
        _kernels_of(arrays).keep(arrays, c, frame, work)


def _kernels_of(arrays: Any) -> TaskKernels:
    return TASKS[type(arrays)].kernels


def _sum_from_last(costs: Sequence[float]) -> float:
    """Sum in the order of the unrolled calls: the first to the sum of those behind it."""
    return sum(reversed(costs), 0.0)


@overload(shown)
def _shown(tasks, frame):
    first = TASKS[tasks[0].instance_class].kernels.shown
    if len(tasks) == 1:
        return lambda tasks, frame: first(tasks[0], frame)
    return lambda tasks, frame: first(tasks[0], frame) or shown(tasks[1:], frame)


@overload(sum_of_costs)
def _sum_of_costs(tasks, c, frame, work):
    first = TASKS[tasks[0].instance_class].kernels.cost
    if len(tasks) == 1:
        return lambda tasks, c, frame, work: first(tasks[0], c, frame, work)
    return lambda tasks, c, frame, work: (
        first(tasks[0], c, frame, work) + sum_of_costs(tasks[1:], c, frame, work)
    )


@overload(add_tasks)
def _add_tasks(tasks, c, frame, work):
    first = TASKS[tasks[0].instance_class].kernels.add
    if len(tasks) == 1:
        return lambda tasks, c, frame, work: first(tasks[0], c, frame, work)
    return lambda tasks, c, frame, work: (
        first(tasks[0], c, frame, work) + add_tasks(tasks[1:], c, frame, work)
    )


@overload(keep_residuals)
def _keep_residuals(tasks, c, frame, work):
    first = TASKS[tasks[0].instance_class].kernels.keep
    if len(tasks) == 1:
        return lambda tasks, c, frame, work: first(tasks[0], c, frame, work)

    def each(tasks, c, frame, work):
        first(tasks[0], c, frame, work)
        keep_residuals(tasks[1:], c, frame, work)

    return each
