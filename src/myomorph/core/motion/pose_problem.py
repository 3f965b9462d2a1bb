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
    X,
    Y,
    Z,
    add_gradient,
    add_pair,
    add_tasks,
)
from myomorph.core.rigid.coordinates import KIND, SINES, WIDTH, Ints, evaluate_at, fold_dependents
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.tree import ROTATION
from myomorph.core.rigid.vectors import cross, minus, vector


class PoseProblem(NamedTuple):
    """What is minimised, and what may move.

    Arrays of shape (free,) are by place in `free`: `lower[i]` is the bound of coordinate `free[i]`.
    Arrays of shape (coordinates,) have all coordinates of the model.

    Attributes
    ----------
    free : (free,) numbers of the coordinates that are solved for
    lower, upper : (free,) their bounds [rad or m]
    unit : (coordinates,) by which changes are measured, see `coordinate_units` [rad or m]
    fixed : (frames, coordinates) values of those that are not free [rad or m]
    posture : (coordinates,) what coordinates that no task shows are pulled to [rad or m]
    tasks : arrays of each kind of task, markers and coordinates first
    ties : what closes the loops, None of an open model
    """

    free: Ints
    lower: Array
    upper: Array
    unit: Array
    fixed: Array
    posture: Array
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
def mean_curvature(P, work):
    """Mean Gauss-Newton diagonal of the tasks of bodies.

    It is taken in units, D_j unit_j^2, over the free coordinates that these tasks see move.
    """
    total = 0.0
    moved = 0
    for j in P.free:
        shared = work.D[j] - work.direct[j]
        if shared > 0.0:
            total += shared * P.unit[j] ** 2
            moved += 1
    return total / moved if moved > 0 else 1.0


@bare
def gradient_and_hessian(T, P, frame, c, work):
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
    H = work.H
    g = work.g
    D = work.D
    direct = work.direct
    fields = work.fields
    points = work.points
    for i in range(c.shape[0]):
        g[i] = D[i] = direct[i] = 0.0
        for j in range(c.shape[0]):
            H[i, j] = 0.0
    for b in range(points.shape[0]):
        for i in range(points.shape[1]):
            points[b, i] = 0.0
    work.has_rows[0] = False
    # Points relative to one of the body keep the squares small wherever the laboratory's origin is.
    for i in range(3):
        work.origin[i] = work.p[-1, i]
    cost = add_tasks(P.tasks, c, frame, work)
    has_rows = work.has_rows[0]
    axis_fields(T, c, work)
    for b in range(T.parent.shape[0] - 1, 0, -1):
        S = points[b]
        if S[WEIGHT] > 0.0 or has_rows:
            for axis in range(T.axis_start[b + 1] - 1, T.axis_start[b] - 1, -1):
                w0 = fields[axis, 0]
                w1 = fields[axis, 1]
                w2 = fields[axis, 2]
                v0 = fields[axis, 3]
                v1 = fields[axis, 4]
                v2 = fields[axis, 5]
                F0 = S[WEIGHT] * v0 + w1 * S[Z] - w2 * S[Y]
                F1 = S[WEIGHT] * v1 + w2 * S[X] - w0 * S[Z]
                F2 = S[WEIGHT] * v2 + w0 * S[Y] - w1 * S[X]
                N0 = S[Y] * v2 - S[Z] * v1 + (S[YY] + S[ZZ]) * w0 - S[XY] * w1 - S[XZ] * w2
                N1 = S[Z] * v0 - S[X] * v2 - S[XY] * w0 + (S[XX] + S[ZZ]) * w1 - S[YZ] * w2
                N2 = S[X] * v1 - S[Y] * v0 - S[XZ] * w0 - S[YZ] * w1 + (S[XX] + S[YY]) * w2
                trace = S[X_EX] + S[Y_EY] + S[Z_EZ]
                Q0 = (
                    v1 * S[EZ]
                    - v2 * S[EY]
                    + S[X_EX] * w0
                    + S[X_EY] * w1
                    + S[X_EZ] * w2
                    - trace * w0
                )
                Q1 = (
                    v2 * S[EX]
                    - v0 * S[EZ]
                    + S[Y_EX] * w0
                    + S[Y_EY] * w1
                    + S[Y_EZ] * w2
                    - trace * w1
                )
                Q2 = (
                    v0 * S[EY]
                    - v1 * S[EX]
                    + S[Z_EX] * w0
                    + S[Z_EY] * w1
                    + S[Z_EZ] * w2
                    - trace * w2
                )
                slope_along_axis = v0 * S[EX] + v1 * S[EY] + v2 * S[EZ]
                slope_along_axis += (
                    w0 * (S[Y_EZ] - S[Z_EY]) + w1 * (S[Z_EX] - S[X_EZ]) + w2 * (S[X_EY] - S[Y_EX])
                )
                if has_rows:
                    rows = work.rows[b]
                    field = fields[axis]
                    N0 += row_product(rows[0], field)
                    N1 += row_product(rows[1], field)
                    N2 += row_product(rows[2], field)
                    F0 += row_product(rows[3], field)
                    F1 += row_product(rows[4], field)
                    F2 += row_product(rows[5], field)
                    slope_along_axis += row_product(work.row_gradient[b], field)
                add_gradient(T, work, H, g, axis, slope_along_axis)
                a = axis
                h = b
                while h > 0:
                    while a >= T.axis_start[h]:
                        plain = fields[a, 3] * F0 + fields[a, 4] * F1 + fields[a, 5] * F2
                        plain += fields[a, 0] * N0 + fields[a, 1] * N1 + fields[a, 2] * N2
                        curved = fields[a, 0] * Q0 + fields[a, 1] * Q1 + fields[a, 2] * Q2
                        add_pair(T, work, H, D, axis, a, plain, curved)
                        a -= 1
                    h = T.parent[h]
                    a = T.axis_start[h + 1] - 1
            for i in range(S.shape[0]):
                points[T.parent[b], i] += S[i]
        if has_rows:
            gather_rows(work.rows, work.row_gradient, b, T.parent[b])
    for i in range(c.shape[0]):
        for j in range(i):
            H[j, i] = H[i, j]
    fold_dependents(T, c, H, g, D)
    for j in P.free:
        H[j, j] += direct[j]
        D[j] += direct[j]
    return cost


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
