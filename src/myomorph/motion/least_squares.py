"""One frame of inverse kinematics: bounded weighted least squares with analytic Jacobians."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
from numba import njit

from myomorph.model.spatial import Array
from myomorph.rigid.coordinates import Ints, evaluate
from myomorph.rigid.kinematics import body_poses, couple
from myomorph.rigid.tree import ROTATION


class MarkerArrays(NamedTuple):
    """What is tracked and what may move.

    Attributes
    ----------
    body, location, weight : (markers,), (markers, 3) [m], (markers,)
    reach_start, reach : the coordinates that move marker m's body are
        reach[reach_start[m]] ... reach[reach_start[m + 1] - 1]
    axis_start, axes : likewise the axes between the ground and its body
    axis_slot : (len(axes), 2) position of each axis's coordinates within the marker's reach, -1 for none
    free : (variables,) coordinates that are solved for
    lower, upper : (variables,) bounds [rad or m]
    task_weight : (coordinates,) weight of each coordinate's task, 0 for none
    """

    body: Ints
    location: Array
    weight: Array
    reach_start: Ints
    reach: Ints
    axis_start: Ints
    axes: Ints
    axis_slot: Ints
    free: Ints
    lower: Array
    upper: Array
    task_weight: Array


@njit(cache=True, nogil=True)
def solve_frames(
    T, K, observed, targets, posture, posture_weight, tolerance, most, start, c_out, errors, converged, iterations
):
    """Inverse kinematics frame after frame, each starting from the one before.

    Parameters
    ----------
    observed : (frames, markers, 3) [m], NaN where unseen
    targets : (frames, coordinates) of the coordinate tasks; locked and prescribed coordinates take theirs
    posture, posture_weight : (coordinates,) and its weight relative to the mean curvature
    tolerance, most : largest last step [rad or m], and iterations allowed
    start : (coordinates,) where the first frame starts
    c_out, errors, converged, iterations : filled, (frames, coordinates), (frames, markers), (frames,) twice
    """
    n = start.shape[0]
    work = new_work(T, n)
    c = start.copy()
    for frame in range(observed.shape[0]):
        hold(K, targets[frame], c)
        done, count, _ = solve_frame(
            T, K, observed[frame], targets[frame], posture, posture_weight, tolerance, most, c, work
        )
        converged[frame], iterations[frame] = done, count
        c_out[frame, :] = c
        marker_distances(T, K, observed[frame], c, work, errors[frame])


@njit(cache=True, nogil=True)
def hold(K, target, c):
    """Put the coordinates that are not solved for at their targets."""
    fixed = np.ones(c.shape[0], np.bool_)
    for j in K.free:
        fixed[j] = False
    for j in range(c.shape[0]):
        if fixed[j]:
            c[j] = target[j]


@njit(cache=True, nogil=True)
def new_work(T, n):
    """Scratch arrays of one solver: poses, axes, normal equations, trial point."""
    bodies, axes = T.parent.shape[0], T.axis_kind.shape[0]
    return (
        np.empty((bodies, 3, 3)),
        np.empty((bodies, 3)),
        np.empty((axes, 3)),
        np.empty((axes, 3)),
        np.empty((axes, 2)),
        np.empty((n, n)),
        np.empty(n),
        np.empty((n + 1, n)),
        np.empty(n),
        np.empty(n),
        np.empty((3, n)),
    )


@njit(cache=True, nogil=True)
def solve_frame(T, K, observed, target, posture, posture_weight, tolerance, most, c, work):
    """Levenberg-Marquardt steps inside the bounds, from c in place.

    Returns whether the last step was within `tolerance`, the iterations, and the cost
    sum_m w_m |x_m - y_m|^2 / sum_m w_m + sum_j v_j (c_j - target_j)^2 + posture term.
    """
    R, p, w, o, dphi, H, g, L, step, trial, _ = work
    F = K.free
    damping = 1e-9
    for i in range(F.shape[0]):
        c[F[i]] = min(max(c[F[i]], K.lower[i]), K.upper[i])
    couple(T, c)
    body_poses(T, c, R, p, w, o, dphi)
    scale, cost = normal_equations(T, K, observed, target, c, work)
    stiffness = posture_weight * scale
    cost += posture_cost(K, c, posture, stiffness)
    for count in range(1, most + 1):
        for i in range(F.shape[0]):
            g[F[i]] += stiffness * (c[F[i]] - posture[F[i]])
            H[F[i], F[i]] += stiffness
        accepted, size = False, 0.0
        while not accepted and damping < 1e6:
            size = bounded_step(K, H, g, c, damping, L, step)
            if size <= tolerance:
                for i in range(F.shape[0]):
                    c[F[i]] += step[i]
                couple(T, c)
                return True, count, cost
            for j in range(c.shape[0]):
                trial[j] = c[j]
            for i in range(F.shape[0]):
                trial[F[i]] += step[i]
            couple(T, trial)
            body_poses(T, trial, R, p, w, o, dphi)
            reached = marker_cost(K, observed, target, trial, R, p) + posture_cost(K, trial, posture, stiffness)
            if reached <= cost:
                accepted = True
                damping = max(damping * 0.1, 1e-12)
            else:
                damping = max(damping * 10.0, 1e-6)
        if not accepted:
            return False, count, cost
        for j in range(c.shape[0]):
            c[j] = trial[j]
        flat = cost - reached <= 1e-14 * cost
        _, cost = normal_equations(T, K, observed, target, c, work)
        cost += posture_cost(K, c, posture, stiffness)
        if flat:
            return True, count, cost
    return False, most, cost


@njit(cache=True, nogil=True)
def posture_cost(K, c, posture, stiffness):
    """Pull towards the posture, which places what no marker shows."""
    total = 0.0
    for j in K.free:
        total += stiffness * (c[j] - posture[j]) ** 2
    return total


@njit(cache=True, nogil=True)
def seen_weight(K, observed):
    """Sum of the weights of the markers seen."""
    total = 0.0
    for m in range(K.body.shape[0]):
        if np.isfinite(observed[m, 0] + observed[m, 1] + observed[m, 2]):
            total += K.weight[m]
    return total


@njit(cache=True, nogil=True)
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


@njit(cache=True, nogil=True)
def normal_equations(T, K, observed, target, c, work):
    """H = J^T W J and g = J^T W e in the independent coordinates; poses are those of c.

    Returns the mean diagonal entry of H over the variables that markers move, and the cost.
    """
    R, p, w, o, dphi, H, g, _, _, _, block = work
    n = c.shape[0]
    for i in range(n):
        g[i] = 0.0
        for j in range(n):
            H[i, j] = 0.0
    cost, weights = 0.0, seen_weight(K, observed)
    for m in range(K.body.shape[0]):
        y = observed[m]
        if not (K.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2])):
            continue
        b, location, weight = K.body[m], K.location[m], K.weight[m] / weights
        x0 = p[b, 0] + R[b, 0, 0] * location[0] + R[b, 0, 1] * location[1] + R[b, 0, 2] * location[2]
        x1 = p[b, 1] + R[b, 1, 0] * location[0] + R[b, 1, 1] * location[1] + R[b, 1, 2] * location[2]
        x2 = p[b, 2] + R[b, 2, 0] * location[0] + R[b, 2, 1] * location[1] + R[b, 2, 2] * location[2]
        e0, e1, e2 = x0 - y[0], x1 - y[1], x2 - y[2]
        cost += weight * (e0 * e0 + e1 * e1 + e2 * e2)
        first, count = K.reach_start[m], K.reach_start[m + 1] - K.reach_start[m]
        for s in range(count):
            block[0, s] = block[1, s] = block[2, s] = 0.0
        for a in range(K.axis_start[m], K.axis_start[m + 1]):
            k = K.axes[a]
            u0, u1, u2 = w[k, 0], w[k, 1], w[k, 2]
            if T.axis_kind[k] == ROTATION:
                r0, r1, r2 = x0 - o[k, 0], x1 - o[k, 1], x2 - o[k, 2]
                u0, u1, u2 = u1 * r2 - u2 * r1, u2 * r0 - u0 * r2, u0 * r1 - u1 * r0
            for side in range(2):
                s = K.axis_slot[a, side]
                if s >= 0:
                    block[0, s] += dphi[k, side] * u0
                    block[1, s] += dphi[k, side] * u1
                    block[2, s] += dphi[k, side] * u2
        for s in range(count):
            b0, b1, b2 = weight * block[0, s], weight * block[1, s], weight * block[2, s]
            i = K.reach[first + s]
            g[i] += b0 * e0 + b1 * e1 + b2 * e2
            for t in range(s + 1):
                H[i, K.reach[first + t]] += b0 * block[0, t] + b1 * block[1, t] + b2 * block[2, t]
    # Each marker's reach is ascending, so only the lower triangle has been filled.
    for i in range(n):
        for j in range(i):
            H[j, i] = H[i, j]
    fold_couplers(T, c, H, g)
    total, moved = 0.0, 0
    for j in K.free:
        if H[j, j] > 0.0:
            total += H[j, j]
            moved += 1
    for j in K.free:
        H[j, j] += K.task_weight[j]
        g[j] += K.task_weight[j] * (c[j] - target[j])
        cost += K.task_weight[j] * (c[j] - target[j]) ** 2
    return (total / moved if moved > 0 else 1.0), cost


@njit(cache=True, nogil=True)
def fold_couplers(T, c, H, g):
    """Carry rows and columns of dependent coordinates over to those they follow: G^T H G, G^T g."""
    for k in range(T.coupler_coordinate.shape[0] - 1, -1, -1):
        d, i, j = T.coupler_coordinate[k], T.coupler_source[k, 0], T.coupler_source[k, 1]
        _, d1, d2, _, _, _ = evaluate(
            T.functions, T.coupler_function[k], c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0
        )
        for side in range(2):
            s = i if side == 0 else j
            slope = d1 if side == 0 else d2
            if s >= 0:
                g[s] += slope * g[d]
                for t in range(c.shape[0]):
                    H[s, t] += slope * H[d, t]
                for t in range(c.shape[0]):
                    H[t, s] += slope * H[t, d]


@njit(cache=True, nogil=True)
def bounded_step(K, H, g, c, damping, L, step):
    """Damped Newton step of the variables, those at a bound and pushed outwards held.

    Variables that would leave their bounds are stopped there and the rest is solved again. Returns the
    largest entry of the step.
    """
    F = K.free
    n = F.shape[0]
    held = np.zeros(n, np.bool_)
    for i in range(n):
        step[i] = 0.0
        slack = 1e-12 * (1.0 + abs(c[F[i]]))
        if (c[F[i]] <= K.lower[i] + slack and g[F[i]] > 0.0) or (c[F[i]] >= K.upper[i] - slack and g[F[i]] < 0.0):
            held[i] = True
    while True:
        index = np.flatnonzero(~held)
        size = index.shape[0]
        for a in range(size):
            i = F[index[a]]
            for b in range(a + 1):
                L[a, b] = H[i, F[index[b]]]
            L[a, a] += damping * H[i, i] + 1e-14
            right = -g[i]
            for b in range(n):
                if held[b] and step[b] != 0.0:
                    right -= H[i, F[b]] * step[b]
            L[size, a] = right
        solve_in_place(L, size)
        left = False
        for a in range(size):
            i = index[a]
            step[i] = L[size, a]
            reached = c[F[i]] + step[i]
            if reached < K.lower[i] or reached > K.upper[i]:
                step[i] = (K.lower[i] if reached < K.lower[i] else K.upper[i]) - c[F[i]]
                held[i] = True
                left = True
        if not left:
            break
    largest = 0.0
    for i in range(n):
        largest = max(largest, abs(step[i]))
    return largest


@njit(cache=True, nogil=True)
def solve_in_place(L, n):
    """Cholesky factor of the lower triangle of L (n, n), then the solution of row n, in place.

    A pivot that is not positive (a variable that nothing determines) leaves its variable at zero.
    """
    for j in range(n):
        pivot = L[j, j]
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        # An infinite pivot makes the variable's column, and so its part of the solution, vanish.
        root = np.sqrt(pivot) if pivot > 1e-15 else np.inf
        L[j, j] = root
        for i in range(j + 1, n + 1):
            total = L[i, j]
            for k in range(j):
                total -= L[i, k] * L[j, k]
            L[i, j] = total / root
    for j in range(n - 1, -1, -1):
        total = L[n, j]
        for k in range(j + 1, n):
            total -= L[k, j] * L[n, k]
        L[n, j] = total / L[j, j]


@njit(cache=True, nogil=True)
def marker_distances(T, K, observed, c, work, out):
    """Distance of every marker from where it was seen (markers,) [m], NaN where unseen."""
    R, p, w, o, dphi, _, _, _, _, _, _ = work
    body_poses(T, c, R, p, w, o, dphi)
    for m in range(K.body.shape[0]):
        b, x = K.body[m], K.location[m]
        total = 0.0
        for i in range(3):
            e = p[b, i] + R[b, i, 0] * x[0] + R[b, i, 1] * x[1] + R[b, i, 2] * x[2] - observed[m, i]
            total += e * e
        out[m] = np.sqrt(total)
