"""What inverse kinematics minimises: cost, gradient and exact Hessian of the markers, one frame."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array
from myomorph.rigid.coordinates import KIND, SINES, WIDTH, Ints, evaluate
from myomorph.rigid.kernels import in_place, inner
from myomorph.rigid.kinematics import body_poses
from myomorph.rigid.tree import ROTATION


class MarkerArrays(NamedTuple):
    """What is tracked and what may move.

    Attributes
    ----------
    body, location, weight : (markers,), (markers, 3) [m], (markers,)
    free : (variables,) coordinates that are solved for
    lower, upper : (variables,) bounds [rad or m]
    task_weight : (coordinates,) weight of each coordinate's task, 0 for none
    unit : (coordinates,) by what changes of each are measured [rad or m]; see `coordinate_units`
    """

    body: Ints
    location: Array
    weight: Array
    free: Ints
    lower: Array
    upper: Array
    task_weight: Array
    unit: Array


class Work(NamedTuple):
    """Scratch arrays of one solver.

    Attributes
    ----------
    R, p, w, o, dphi : poses and axes of `body_poses`
    H, g, D : Hessian and gradient of half the cost, and the diagonal of its Gauss-Newton part
    L, step, trial : factor, step and trial point
    sums : (bodies, 22) of `marker_sums`, gathered from the leaves
    axis : (axes, 6) of `axis_fields`
    curvature : (axes, 3) second derivatives of the axes' motions
    """

    R: Array
    p: Array
    w: Array
    o: Array
    dphi: Array
    H: Array
    g: Array
    D: Array
    L: Array
    step: Array
    trial: Array
    sums: Array
    axis: Array
    curvature: Array


@inner
def new_work(T, n):
    """Scratch arrays for a tree of n coordinates."""
    bodies, axes = T.parent.shape[0], T.axis_kind.shape[0]
    return Work(
        np.empty((bodies, 3, 3)),
        np.empty((bodies, 3)),
        np.empty((axes, 3)),
        np.empty((axes, 3)),
        np.empty((axes, 2)),
        np.empty((n, n)),
        np.empty(n),
        np.empty(n),
        np.empty((n + 1, n)),
        np.empty(n),
        np.empty(n),
        np.empty((bodies, 22)),
        np.empty((axes, 6)),
        np.empty((axes, 3)),
    )


@inner
def seen_weight(K, observed):
    """Sum of the weights of the markers seen."""
    total = 0.0
    for m in range(K.body.shape[0]):
        if np.isfinite(observed[m, 0] + observed[m, 1] + observed[m, 2]):
            total += K.weight[m]
    return total


@inner
def marker_cost(K, observed, target, c, R, p):
    """Weighted mean square of marker distances plus the coordinate tasks."""
    total, weights = 0.0, seen_weight(K, observed)
    for m in range(K.body.shape[0]):
        y = observed[m]
        if K.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2]):
            b, x = K.body[m], K.location[m]
            for i in range(3):
                e = p[b, i] + R[b, i, 0] * x[0] + R[b, i, 1] * x[1] + R[b, i, 2] * x[2] - y[i]
                total += K.weight[m] / weights * e * e
    for j in K.free:
        total += K.task_weight[j] * (c[j] - target[j]) ** 2
    return total


@in_place
def mean_curvature(K, D):
    """Mean Gauss-Newton diagonal of the marker cost, in units, over the variables that markers move."""
    total, moved = 0.0, 0
    for j in K.free:
        own = D[j] - K.task_weight[j]
        if own > 0.0:
            total += own * K.unit[j] ** 2
            moved += 1
    return total / moved if moved > 0 else 1.0


@inner
def normal_equations(T, K, observed, target, c, work):
    """Hessian H and gradient g of half the cost in the independent coordinates; poses are those of c.

    Axis k moves a marker at x by J_k = v_k + w_k x x (w_k = 0 for a translation). With the marker's
    error e, g_k = sum J_k . e, and for an axis i that comes before or is k,
    H_ik = sum J_i . J_k + w_i . sum J_k x e; a curved axis function adds phi'' sum J_k . e. All these
    sums run over the markers beyond k and follow from the sums of 1, x, x x^T, e and x e^T, which are
    gathered body by body from the leaves: the cost does not grow with markers times axes. The
    diagonal of the Gauss-Newton part goes to D. Returns the cost.
    """
    H, g, D, axis, sums = work.H, work.g, work.D, work.axis, work.sums
    for i in range(c.shape[0]):
        g[i] = D[i] = 0.0
        for j in range(c.shape[0]):
            H[i, j] = 0.0
    # Places relative to a point of the body keep the squares small wherever the laboratory's origin is.
    z0, z1, z2 = work.p[-1, 0], work.p[-1, 1], work.p[-1, 2]
    cost = marker_sums(K, observed, work, z0, z1, z2)
    axis_fields(T, c, work, z0, z1, z2)
    for b in range(T.parent.shape[0] - 1, 0, -1):
        S = sums[b]
        if S[0] > 0.0:
            for k in range(T.axis_start[b + 1] - 1, T.axis_start[b] - 1, -1):
                w0, w1, w2, v0, v1, v2 = axis[k, 0], axis[k, 1], axis[k, 2], axis[k, 3], axis[k, 4], axis[k, 5]
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
                add_gradient(T, work, k, along)
                a, h = k, b
                while h > 0:
                    while a >= T.axis_start[h]:
                        plain = axis[a, 3] * F0 + axis[a, 4] * F1 + axis[a, 5] * F2
                        plain += axis[a, 0] * N0 + axis[a, 1] * N1 + axis[a, 2] * N2
                        curved = axis[a, 0] * Q0 + axis[a, 1] * Q1 + axis[a, 2] * Q2
                        add_pair(T, work, k, a, plain, curved)
                        a -= 1
                    h = T.parent[h]
                    a = T.axis_start[h + 1] - 1
            for i in range(S.shape[0]):
                sums[T.parent[b], i] += S[i]
    for i in range(c.shape[0]):
        for j in range(i):
            H[j, i] = H[i, j]
    fold_couplers(T, c, H, g, D)
    for j in K.free:
        H[j, j] += K.task_weight[j]
        D[j] += K.task_weight[j]
        g[j] += K.task_weight[j] * (c[j] - target[j])
        cost += K.task_weight[j] * (c[j] - target[j]) ** 2
    return cost


@in_place
def marker_sums(K, observed, work, z0, z1, z2):
    """Weighted sums over each body's markers: 1, x (3), x x^T (upper 6), e (3), x e^T (9). Returns the cost."""
    sums = work.sums
    for b in range(sums.shape[0]):
        for i in range(sums.shape[1]):
            sums[b, i] = 0.0
    cost, weights = 0.0, seen_weight(K, observed)
    for m in range(K.body.shape[0]):
        y = observed[m]
        if not (K.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2])):
            continue
        b, at, weight = K.body[m], K.location[m], K.weight[m] / weights
        R, p, S = work.R[b], work.p[b], sums[b]
        x0 = p[0] + R[0, 0] * at[0] + R[0, 1] * at[1] + R[0, 2] * at[2]
        x1 = p[1] + R[1, 0] * at[0] + R[1, 1] * at[1] + R[1, 2] * at[2]
        x2 = p[2] + R[2, 0] * at[0] + R[2, 1] * at[1] + R[2, 2] * at[2]
        e0, e1, e2 = weight * (x0 - y[0]), weight * (x1 - y[1]), weight * (x2 - y[2])
        cost += (e0 * e0 + e1 * e1 + e2 * e2) / weight
        x0, x1, x2 = x0 - z0, x1 - z1, x2 - z2
        S[0] += weight
        S[1] += weight * x0
        S[2] += weight * x1
        S[3] += weight * x2
        S[4] += weight * x0 * x0
        S[5] += weight * x0 * x1
        S[6] += weight * x0 * x2
        S[7] += weight * x1 * x1
        S[8] += weight * x1 * x2
        S[9] += weight * x2 * x2
        S[10] += e0
        S[11] += e1
        S[12] += e2
        S[13] += x0 * e0
        S[14] += x0 * e1
        S[15] += x0 * e2
        S[16] += x1 * e0
        S[17] += x1 * e1
        S[18] += x1 * e2
        S[19] += x2 * e0
        S[20] += x2 * e1
        S[21] += x2 * e2
    return cost


@in_place
def axis_fields(T, c, work, z0, z1, z2):
    """Velocity field (w, v) of every axis about the point z, and the curvature of its function."""
    axis, curvature = work.axis, work.curvature
    for k in range(T.axis_kind.shape[0]):
        u0, u1, u2 = work.w[k, 0], work.w[k, 1], work.w[k, 2]
        if T.axis_kind[k] == ROTATION:
            r0, r1, r2 = work.o[k, 0] - z0, work.o[k, 1] - z1, work.o[k, 2] - z2
            axis[k, 0], axis[k, 1], axis[k, 2] = u0, u1, u2
            axis[k, 3], axis[k, 4], axis[k, 5] = u2 * r1 - u1 * r2, u0 * r2 - u2 * r0, u1 * r0 - u0 * r1
        else:
            axis[k, 0] = axis[k, 1] = axis[k, 2] = 0.0
            axis[k, 3], axis[k, 4], axis[k, 5] = u0, u1, u2
        curvature[k, 0] = curvature[k, 1] = curvature[k, 2] = 0.0
        f = T.axis_function[k]
        if T.functions.table[f, KIND] == SINES or T.functions.table[f, WIDTH] > 2:
            i, j = T.axis_coordinate[k, 0], T.axis_coordinate[k, 1]
            _, _, _, d11, d12, d22 = evaluate(T.functions, f, c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0)
            curvature[k, 0], curvature[k, 1], curvature[k, 2] = d11, d12, d22


@in_place
def add_gradient(T, work, k, along):
    """Gradient through axis k, and what the curvature of its function adds to the Hessian."""
    i, j = T.axis_coordinate[k, 0], T.axis_coordinate[k, 1]
    work.g[i] += work.dphi[k, 0] * along
    work.H[i, i] += work.curvature[k, 0] * along
    if j >= 0:
        work.g[j] += work.dphi[k, 1] * along
        work.H[j, j] += work.curvature[k, 2] * along
        work.H[max(i, j), min(i, j)] += work.curvature[k, 1] * along


@in_place
def add_pair(T, work, k, a, plain, curved):
    """Lower triangle of the Hessian between the coordinates of axis k and of an earlier axis a (or k)."""
    for s in range(2):
        i = T.axis_coordinate[k, s]
        if i < 0:
            break
        for t in range(2):
            j = T.axis_coordinate[a, t]
            # Two coordinates of one axis pair up both ways: the lower triangle takes one of them.
            if j < 0 or (a == k and i < j):
                continue
            share = work.dphi[k, s] * work.dphi[a, t]
            if i == j and a != k:
                share *= 2.0
            work.H[max(i, j), min(i, j)] += share * (plain + curved)
            if i == j:
                work.D[i] += share * plain


@in_place
def fold_couplers(T, c, H, g, D):
    """Carry what dependent coordinates feel over to those they follow, by the chain rule, in place."""
    for k in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d, i, j = T.coupler_coordinate[k], T.coupler_source[k, 0], T.coupler_source[k, 1]
        _, d1, d2, d11, d12, d22 = evaluate(
            T.functions, T.coupler_function[k], c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0
        )
        for side in range(2):
            s = i if side == 0 else j
            slope = d1 if side == 0 else d2
            if s >= 0:
                g[s] += slope * g[d]
                D[s] += slope * slope * D[d]
                H[s, s] += g[d] * (d11 if side == 0 else d22)
                for t in range(c.shape[0]):
                    H[s, t] += slope * H[d, t]
                for t in range(c.shape[0]):
                    H[t, s] += slope * H[t, d]
        if i >= 0 and j >= 0:
            H[i, j] += g[d] * d12
            H[j, i] += g[d] * d12


@in_place
def marker_distances(T, K, observed, c, work, out):
    """Distance of every marker from where it was seen (markers,) [m], NaN where unseen."""
    body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
    for m in range(K.body.shape[0]):
        b, x = K.body[m], K.location[m]
        total = 0.0
        for i in range(3):
            r = work.R[b, i]
            e = work.p[b, i] + r[0] * x[0] + r[1] * x[1] + r[2] * x[2] - observed[m, i]
            total += e * e
        out[m] = np.sqrt(total)
