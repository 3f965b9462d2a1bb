"""Inverse kinematics as the kernels read it: tasks, what may move, loops that stay closed, and the
normal equations.
"""

from __future__ import annotations

from typing import Any, NamedTuple

from myomorph.core.model.arrays import Array
from myomorph.core.motion.tasks.coordinates import CoordinateArrays
from myomorph.core.motion.tasks.loops import Ties
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.motion.tasks.task import add_gradient, add_pair, add_tasks
from myomorph.core.rigid.coordinates import KIND, SINES, WIDTH, Ints, evaluate_at, fold_dependents
from myomorph.core.rigid.kernels import bare
from myomorph.core.rigid.tree import ROTATION
from myomorph.core.rigid.vectors import cross, minus, vector


class PoseProblem(NamedTuple):
    """What is minimised, and what may move: coordinates that are solved for (`free`), their bounds
    [rad or m], the unit by which changes of each coordinate are measured (`coordinate_units`),
    values (frames, coordinates) of the others. `posture` is what coordinates that no task shows are
    pulled to, `tasks` arrays of each kind of task, markers and coordinates first, `ties` what
    closes the loops, None of an open model.
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
        """The problem with other fields of its markers."""
        return self._replace(tasks=(self.markers._replace(**fields), *self.tasks[1:]))

    def with_coordinates(self, **fields: Any) -> PoseProblem:
        """The problem with other fields of its coordinates' values."""
        return self._replace(
            tasks=(self.markers, self.coordinates._replace(**fields), *self.tasks[2:])
        )


@bare
def mean_curvature(P, work):
    """Mean Gauss-Newton diagonal of the tasks of bodies, in units, over the variables that these
    move.
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
def normal_equations(T, P, frame, c, work):
    """Hessian H and gradient g of half the cost in the independent coordinates; poses are those of
    c.

    Axis k moves a point at x by J_k = v_k + w_k x x (w_k = 0 for a translation). With the point's
    error e, g_k = sum J_k . e, and for an axis i that comes before or is k, H_ik = sum J_i . J_k +
    w_i . sum J_k x e; a curved axis function adds phi'' sum J_k . e. All these sums run over the
    points beyond k and follow from the sums of 1, x, x x^T, e and x e^T, which are gathered body by
    body from the leaves: the cost does not grow with points times axes. Rows of slopes in the
    twists of bodies are gathered alike. The diagonal of the Gauss-Newton part goes to D. Returns
    the cost.
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
        if S[0] > 0.0 or has_rows:
            for axis in range(T.axis_start[b + 1] - 1, T.axis_start[b] - 1, -1):
                w0 = fields[axis, 0]
                w1 = fields[axis, 1]
                w2 = fields[axis, 2]
                v0 = fields[axis, 3]
                v1 = fields[axis, 4]
                v2 = fields[axis, 5]
                # F = sum J, N = sum x cross J, Q = sum J cross e, all weighted.
                F0 = S[0] * v0 + w1 * S[3] - w2 * S[2]
                F1 = S[0] * v1 + w2 * S[1] - w0 * S[3]
                F2 = S[0] * v2 + w0 * S[2] - w1 * S[1]
                N0 = S[2] * v2 - S[3] * v1 + (S[7] + S[9]) * w0 - S[5] * w1 - S[6] * w2
                N1 = S[3] * v0 - S[1] * v2 - S[5] * w0 + (S[4] + S[9]) * w1 - S[8] * w2
                N2 = S[1] * v1 - S[2] * v0 - S[6] * w0 - S[8] * w1 + (S[4] + S[7]) * w2
                trace = S[13] + S[17] + S[21]
                Q0 = v1 * S[12] - v2 * S[11] + S[13] * w0 + S[14] * w1 + S[15] * w2 - trace * w0
                Q1 = v2 * S[10] - v0 * S[12] + S[16] * w0 + S[17] * w1 + S[18] * w2 - trace * w1
                Q2 = v0 * S[11] - v1 * S[10] + S[19] * w0 + S[20] * w1 + S[21] * w2 - trace * w2
                along = v0 * S[10] + v1 * S[11] + v2 * S[12]
                along += w0 * (S[18] - S[20]) + w1 * (S[19] - S[15]) + w2 * (S[14] - S[16])
                if has_rows:
                    rows = work.rows[b]
                    field = fields[axis]
                    N0 += row_product(rows[0], field)
                    N1 += row_product(rows[1], field)
                    N2 += row_product(rows[2], field)
                    F0 += row_product(rows[3], field)
                    F1 += row_product(rows[4], field)
                    F2 += row_product(rows[5], field)
                    along += row_product(work.row_gradient[b], field)
                add_gradient(T, work, H, g, axis, along)
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
