"""Inverse kinematics as the kernels read it, with gradient and Hessian of its cost.

That is: tasks, what may move, and loops that stay closed.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from myomorph.core.model.arrays import Array
from myomorph.core.motion.tasks.coordinates import CoordinateArrays
from myomorph.core.motion.tasks.loops import Ties
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.motion.tasks.task import (
    EX,
    EY,
    EZ,
    WEIGHT,
    X_EX,
    X_EY,
    X_EZ,
    XX,
    XY,
    XZ,
    Y_EX,
    Y_EY,
    Y_EZ,
    YY,
    YZ,
    Z_EX,
    Z_EY,
    Z_EZ,
    ZZ,
    HalfCost,
    X,
    Y,
    Z,
    add_gradient,
    add_pair,
    add_tasks,
)
from myomorph.core.rigid.coordinates import KIND, SINES, WIDTH, Ints, evaluate_at, fold_dependents
from myomorph.core.rigid.kernels import bare, in_place
from myomorph.core.rigid.tree import ROTATION
from myomorph.core.rigid.vectors import cross, dot, minus, plus, vector


class PoseProblem(NamedTuple):
    """The cost of inverse kinematics, and the coordinates that may move.

    Arrays of shape (free,) are by place in `free`: `lower[i]` is the bound of coordinate `free[i]`.
    Arrays of shape (coordinates,) have all coordinates of the model.

    Attributes
    ----------
    free : (free,) numbers of the coordinates that are solved for
    lower, upper : (free,) their bounds [rad or m]
    unit : (coordinates,) by which changes are measured, see `coordinate_units` [rad or m]
    fixed : (frames, coordinates) values of those that are not free [rad or m]
    posture : (frames, coordinates), or one row for all frames, what coordinates that no task shows
        are pulled to [rad or m]
    pull : (frames, coordinates), or one row for all frames, weight of that pull beside the weak one
        of all, in units; 0 for none [m^2]
    tasks : arrays of each kind of task, markers and coordinates first
    ties : what closes the loops, None of an open model
    """

    free: Ints
    lower: Array
    upper: Array
    unit: Array
    fixed: Array
    posture: Array
    pull: Array
    tasks: tuple[Any, ...]
    ties: Ties | None

    @property
    def markers(self) -> MarkerArrays:
        """Markers and where they were seen."""
        return self.tasks[0]

    @property
    def coordinates(self) -> CoordinateArrays:
        """Values that coordinates are pulled to."""
        return self.tasks[1]

    def with_markers(self, **fields: Any) -> PoseProblem:
        """Return the problem with other fields of its markers."""
        return self._replace(tasks=(self.markers._replace(**fields), *self.tasks[1:]))

    def with_coordinates(self, **fields: Any) -> PoseProblem:
        """Return the problem with other fields of its coordinates' values."""
        return self._replace(
            tasks=(self.markers, self.coordinates._replace(**fields), *self.tasks[2:])
        )


@bare
def row_of(values, frame):
    """Return the row that a frame has in an array of one row for each frame, or for all."""
    return frame if values.shape[0] > 1 else 0


@bare
def mean_curvature(problem, work):
    """Mean Gauss-Newton diagonal of the tasks of bodies.

    It is taken in units, D_j unit_j^2, over the free coordinates that these tasks see move.
    """
    total = 0.0
    moved = 0
    for j in problem.free:
        shared = work.D[j] - work.direct[j]
        if shared > 0.0:
            total += shared * problem.unit[j] ** 2
            moved += 1
    return total / moved if moved > 0 else 1.0


@bare
def gradient_and_hessian(T, problem, frame, c, work):
    """Gradient g and full Hessian H of half the cost in the independent coordinates.

    Half the cost of points x_m with weights a_m that should lie at y_m is half of
    sum_m a_m |x_m - y_m|^2. All positions are relative to `work.origin`, and e_m = a_m (x_m - y_m)
    is the weighted error; below, the index m is left out, and * is the cross product. Where its
    function phi_k grows by 1, axis k moves a point by

        J_k = w_k * r = v_k + w_k * x,   r = x - o_k,   v_k = o_k * w_k

    with the direction w_k of a rotation and the point r relative to o_k, a point on the axis. For a
    translation w_k is 0 and v_k its direction. The slope along the axis is then

        s_k = sum J_k . e = v_k . sum e + w_k . sum x * e

    An axis i between the ground and k, or k itself, moves axis k and the point as one rigid body,
    so that dJ_k/dphi_i = w_i * J_k, and the second derivative along both axes is

        H_ik = sum a J_i . J_k + sum e . (w_i * J_k) = v_i . F + w_i . (N + Q)
        F = sum a J_k,   N = sum a x * J_k,   Q = sum J_k * e

    Here v_i . F + w_i . N is the Gauss-Newton part, and w_i . Q the rest. With J_k put in,

        F = v_k sum a + w_k * sum a x
        N = (sum a x) * v_k + (tr(A) 1 - A) w_k,   A = sum a x x^T
        Q = v_k * sum e + (B - tr(B) 1) w_k,       B = sum x e^T

    All sums run over the points that k moves. They follow from those of a, a x, a x x^T, e and
    x e^T, which `add_tasks` fills for each body and which are gathered here from the leaves to the
    ground: the work does not grow with points times axes.

    Where tasks have added rows, residuals r with slopes J in the twist of a body, so that axis k
    changes r by J . (w_k, v_k), then sum J J^T (w_k, v_k) adds to (N, F), and sum J r . (w_k, v_k)
    to s_k, with the weights in both sums. `add_gradient` and `add_pair` carry s_k and H_ik from the
    axes to their coordinates; where phi_k is curved, phi_k'' s_k adds to the Hessian.

    Poses in `work` are those of c. g and H go to `work.g` and `work.H`, the diagonal of the
    Gauss-Newton part to `work.D`. Returns the cost.
    """
    half = HalfCost(H=work.H, g=work.g, D=work.D)
    _reset(work, half)
    cost = add_tasks(problem.tasks, c, frame, work)
    has_rows = work.has_rows[0]
    axis_fields(T, c, work)
    for b in range(T.parent.shape[0] - 1, 0, -1):
        if work.points[b, WEIGHT] > 0.0 or has_rows:
            for axis in range(T.axis_start[b + 1] - 1, T.axis_start[b] - 1, -1):
                _add_axis(T, work, half, b, axis)
            for i in range(work.points.shape[1]):
                work.points[T.parent[b], i] += work.points[b, i]
        if has_rows:
            gather_rows(work.rows, work.row_gradient, b, T.parent[b])
    for i in range(c.shape[0]):
        for j in range(i):
            half.H[j, i] = half.H[i, j]
    fold_dependents(T, c, half.H, half.g, half.D)
    for j in problem.free:
        half.H[j, j] += work.direct[j]
        half.D[j] += work.direct[j]
    return cost


@bare
def _reset(work, half):
    """Set what tasks add to to 0.

    Points relative to one of the body keep the squares small wherever the laboratory's origin is.
    """
    for i in range(half.g.shape[0]):
        half.g[i] = half.D[i] = work.direct[i] = 0.0
        for j in range(half.g.shape[0]):
            half.H[i, j] = 0.0
    for b in range(work.points.shape[0]):
        for i in range(work.points.shape[1]):
            work.points[b, i] = 0.0
    work.has_rows[0] = False
    for i in range(3):
        work.origin[i] = work.p[-1, i]


@in_place
def _add_axis(T, work, half, b, axis):
    """Add the slope along an axis of body b, and the curvature with each axis it hangs from.

    H_ik = v_i . F + w_i . N + w_i . Q
    """
    sums = work.points[b]
    field = work.fields[axis]
    w = (field[0], field[1], field[2])
    v = (field[3], field[4], field[5])
    F = _force(sums, w, v)
    N = _moment(sums, w, v)
    Q = _remainder(sums, w, v)
    slope = _slope(sums, w, v)
    if work.has_rows[0]:
        rows = work.rows[b]
        N = plus(N, _products(rows, 0, field))
        F = plus(F, _products(rows, 3, field))
        slope += row_product(work.row_gradient[b], field)
    add_gradient(T, work, half, axis, slope)
    nearer = axis
    h = b
    while h > 0:
        while nearer >= T.axis_start[h]:
            w_i = vector(work.fields, nearer)
            v_i = (work.fields[nearer, 3], work.fields[nearer, 4], work.fields[nearer, 5])
            plain = dot(v_i, F) + dot(w_i, N)
            add_pair(T, work, half, (axis, nearer), (plain, dot(w_i, Q)))
            nearer -= 1
        h = T.parent[h]
        nearer = T.axis_start[h + 1] - 1


@bare
def _force(sums, w, v):
    """F = v sum a + w * sum a x, from the sums (POINT_SUMS,) of a body."""
    return (
        sums[WEIGHT] * v[0] + w[1] * sums[Z] - w[2] * sums[Y],
        sums[WEIGHT] * v[1] + w[2] * sums[X] - w[0] * sums[Z],
        sums[WEIGHT] * v[2] + w[0] * sums[Y] - w[1] * sums[X],
    )


@bare
def _moment(sums, w, v):
    """N = (sum a x) * v + (tr(A) 1 - A) w with A = sum a x x^T."""
    return (
        sums[Y] * v[2]
        - sums[Z] * v[1]
        + (sums[YY] + sums[ZZ]) * w[0]
        - sums[XY] * w[1]
        - sums[XZ] * w[2],
        sums[Z] * v[0]
        - sums[X] * v[2]
        - sums[XY] * w[0]
        + (sums[XX] + sums[ZZ]) * w[1]
        - sums[YZ] * w[2],
        sums[X] * v[1]
        - sums[Y] * v[0]
        - sums[XZ] * w[0]
        - sums[YZ] * w[1]
        + (sums[XX] + sums[YY]) * w[2],
    )


@bare
def _remainder(sums, w, v):
    """Q = v * sum e + (B - tr(B) 1) w with B = sum x e^T."""
    trace = sums[X_EX] + sums[Y_EY] + sums[Z_EZ]
    return (
        v[1] * sums[EZ]
        - v[2] * sums[EY]
        + sums[X_EX] * w[0]
        + sums[X_EY] * w[1]
        + sums[X_EZ] * w[2]
        - trace * w[0],
        v[2] * sums[EX]
        - v[0] * sums[EZ]
        + sums[Y_EX] * w[0]
        + sums[Y_EY] * w[1]
        + sums[Y_EZ] * w[2]
        - trace * w[1],
        v[0] * sums[EY]
        - v[1] * sums[EX]
        + sums[Z_EX] * w[0]
        + sums[Z_EY] * w[1]
        + sums[Z_EZ] * w[2]
        - trace * w[2],
    )


@bare
def _slope(sums, w, v):
    """Slope along an axis, s = v . sum e + w . sum x * e."""
    translation = v[0] * sums[EX] + v[1] * sums[EY] + v[2] * sums[EZ]
    moment = (sums[Y_EZ] - sums[Z_EY], sums[Z_EX] - sums[X_EZ], sums[X_EY] - sums[Y_EX])
    return translation + dot(w, moment)


@bare
def _products(rows, first, field):
    """Scalar products of three rows of slopes (6, 6) with the velocity field of an axis (6,)."""
    return (
        row_product(rows[first], field),
        row_product(rows[first + 1], field),
        row_product(rows[first + 2], field),
    )


@bare
def row_product(row, field):
    """Scalar product of a body's row of slopes (6,) with the velocity field of an axis (6,)."""
    total = 0.0
    for i in range(6):
        total += row[i] * field[i]
    return total


@bare
def gather_rows(rows, gradient, body, parent):
    """Add the sums of a body to those of its parent."""
    for i in range(6):
        gradient[parent, i] += gradient[body, i]
        for j in range(6):
            rows[parent, i, j] += rows[body, i, j]


@bare
def axis_fields(T, c, work):
    """Velocity field (w, v) of every axis about `work.origin`, and its function's curvature."""
    fields = work.fields
    curvature = work.curvature
    z = work.origin
    for axis in range(T.axis_kind.shape[0]):
        direction = vector(work.w, axis)
        turns = T.axis_kind[axis] == ROTATION
        w = direction if turns else (0.0, 0.0, 0.0)
        v = cross(minus(vector(work.o, axis), z), direction) if turns else direction
        for i in range(3):
            fields[axis, i] = w[i]
            fields[axis, 3 + i] = v[i]
            curvature[axis, i] = 0.0
        f = T.axis_function[axis]
        if T.functions.table[f, KIND] == SINES or T.functions.table[f, WIDTH] > 2:
            i = T.axis_coordinate[axis, 0]
            j = T.axis_coordinate[axis, 1]
            _, _, _, d11, d12, d22 = evaluate_at(T.functions, f, i, j, c)
            curvature[axis, 0] = d11
            curvature[axis, 1] = d12
            curvature[axis, 2] = d22
