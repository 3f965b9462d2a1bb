"""One frame of inverse kinematics after the other: damped Newton steps inside the bounds."""

from __future__ import annotations

import numpy as np

from myomorph.motion.marker_cost import (
    marker_cost,
    marker_distances,
    mean_curvature,
    new_work,
    normal_equations,
    seen_weight,
)
from myomorph.rigid.couplers import couple
from myomorph.rigid.kernels import in_place, inner, kernel
from myomorph.rigid.kinematics import body_poses

SCOUT = 16
"""Frames between the poses that are tracked first; a gap of so many frames ends at one of them."""


@kernel
def solve_frames(
    T,
    K,
    observed,
    targets,
    posture,
    posture_weight,
    tolerance,
    most,
    starts,
    c_out,
    errors,
    cost,
    converged,
    iterations,
):
    """Inverse kinematics frame after frame, each starting from the one before; frames without markers are left out.

    Parameters
    ----------
    observed : (frames, markers, 3) [m], NaN where unseen
    targets : (frames, coordinates) of the coordinate tasks; locked and prescribed coordinates take theirs
    posture, posture_weight : (coordinates,) and its weight relative to the mean curvature
    tolerance, most : largest last step, in units of the coordinates, and iterations allowed
    starts : (poses, coordinates) of every `SCOUT`-th frame: where the first frame starts, and the first after a gap
    c_out, errors : filled, (frames, coordinates) and (frames, markers)
    cost, converged, iterations : filled, (frames,)
    """
    n = starts.shape[1]
    work = new_work(T, n)
    c, before = starts[0].copy(), starts[0].copy()
    run, unseen = 0, 0
    for frame in range(observed.shape[0]):
        if seen_weight(K, observed[frame]) == 0.0:
            run, unseen = 0, unseen + 1
            converged[frame], iterations[frame], cost[frame] = False, 0, 0.0
            for j in range(n):
                c_out[frame, j] = c[j]
            for m in range(errors.shape[1]):
                errors[frame, m] = np.nan
            continue
        if unseen >= SCOUT:
            resume(K, observed, starts, frame, c)
        if run >= 2:
            # Straight on from the last two frames: the start is nearer, the step count smaller.
            for j in range(n):
                c[j] = 2.0 * c[j] - before[j]
        run, unseen = run + 1, 0
        hold(K, targets[frame], c)
        converged[frame], iterations[frame], cost[frame] = solve_frame(
            T, K, observed[frame], targets[frame], posture, posture_weight, tolerance, most, c, work
        )
        for j in range(n):
            before[j] = c_out[frame - 1, j] if frame > 0 else c[j]
            c_out[frame, j] = c[j]
        marker_distances(T, K, observed[frame], c, work, errors[frame])


@inner
def resume(K, observed, starts, frame, c):
    """Put c at the nearest of the poses tracked first that is seen; the one to come goes before the one that was."""
    for k in (-(-frame // SCOUT), frame // SCOUT):
        if k < starts.shape[0] and k * SCOUT < observed.shape[0] and seen_weight(K, observed[k * SCOUT]) > 0.0:
            # One by one: an assignment of a slice would bring in the compilation of its error's text.
            for j in range(c.shape[0]):
                c[j] = starts[k, j]
            return


@inner
def hold(K, target, c):
    """Put the coordinates that are not solved for at their targets."""
    fixed = np.ones(c.shape[0], np.bool_)
    for j in K.free:
        fixed[j] = False
    for j in range(c.shape[0]):
        if fixed[j]:
            c[j] = target[j]


@in_place
def solve_frame(T, K, observed, target, posture, posture_weight, tolerance, most, c, work):
    """Damped Newton steps inside the bounds, from c in place.

    Returns whether the last step was within `tolerance`, the iterations, and the cost
    sum_m w_m |x_m - y_m|^2 / sum_m w_m + sum_j v_j (c_j - target_j)^2 + posture term.
    """
    F, H, D, g, trial = K.free, work.H, work.D, work.g, work.trial
    damping = 0.0
    for i in range(F.shape[0]):
        c[F[i]] = min(max(c[F[i]], K.lower[i]), K.upper[i])
    couple(T, c)
    body_poses(T, c, work.R, work.p, work.w, work.o, work.dphi)
    cost = normal_equations(T, K, observed, target, c, work)
    stiffness = posture_weight * mean_curvature(K, D)
    cost += posture_cost(K, c, posture, stiffness)
    for count in range(1, most + 1):
        for i in range(F.shape[0]):
            square = K.unit[F[i]] ** 2
            g[F[i]] += stiffness / square * (c[F[i]] - posture[F[i]])
            H[F[i], F[i]] += stiffness / square
        accepted, reached = False, cost
        while not accepted and damping < 1e6:
            size = bounded_step(K, work, c, damping)
            if size < 0.0:
                damping = max(damping * 10.0, 1e-4)
                continue
            for j in range(c.shape[0]):
                trial[j] = c[j]
            for i in range(F.shape[0]):
                trial[F[i]] += work.step[i]
            couple(T, trial)
            # An undamped Newton step of size s leaves an error of the order of s^2.
            if size <= tolerance or (damping == 0.0 and size * size <= 0.01 * tolerance):
                for j in range(c.shape[0]):
                    c[j] = trial[j]
                return True, count, cost
            body_poses(T, trial, work.R, work.p, work.w, work.o, work.dphi)
            reached = marker_cost(K, observed, target, trial, work.R, work.p)
            reached += posture_cost(K, trial, posture, stiffness)
            if reached <= cost:
                accepted = True
                damping = damping * 0.1 if damping > 1e-6 else 0.0
            else:
                damping = max(damping * 10.0, 1e-4)
        if not accepted:
            return False, count, cost
        for j in range(c.shape[0]):
            c[j] = trial[j]
        flat = cost - reached <= 1e-13 * cost
        cost = normal_equations(T, K, observed, target, c, work)
        cost += posture_cost(K, c, posture, stiffness)
        if flat:
            return True, count, cost
    return False, most, cost


@inner
def posture_cost(K, c, posture, stiffness):
    """Pull towards the posture, which places what no marker shows."""
    total = 0.0
    for j in K.free:
        total += stiffness * ((c[j] - posture[j]) / K.unit[j]) ** 2
    return total


@in_place
def bounded_step(K, work, c, damping):
    """Damped Newton step of the variables, those at a bound and pushed outwards held.

    Variables that would leave their bounds are stopped there and the rest is solved again. Returns the
    largest entry of the step, in units, or -1 where the damped Hessian is not positive definite.
    """
    F, H, g, D, L, step = K.free, work.H, work.g, work.D, work.L, work.step
    n = F.shape[0]
    held = np.zeros(n, np.bool_)
    for i in range(n):
        step[i] = 0.0
        slack = 1e-12 * (1.0 + abs(c[F[i]]))
        if (c[F[i]] <= K.lower[i] + slack and g[F[i]] > 0.0) or (c[F[i]] >= K.upper[i] - slack and g[F[i]] < 0.0):
            held[i] = True
    index = np.empty(n, np.int64)
    while True:
        size = 0
        for i in range(n):
            if not held[i]:
                index[size] = i
                size += 1
        for a in range(size):
            i = F[index[a]]
            for b in range(a + 1):
                L[a, b] = H[i, F[index[b]]]
            L[a, a] += damping * D[i]
            right = -g[i]
            for b in range(n):
                if held[b] and step[b] != 0.0:
                    right -= H[i, F[b]] * step[b]
            L[size, a] = right
        if not solve_in_place(L, size):
            return -1.0
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
        largest = max(largest, abs(step[i]) / K.unit[F[i]])
    return largest


@inner
def solve_in_place(L, n):
    """Cholesky factor of the lower triangle of L (n, n), then the solution of row n, in place.

    A variable that nothing determines (an empty pivot from the start) stays at zero. Returns False
    where another pivot is not positive.
    """
    for j in range(n):
        given = L[j, j]
        pivot = given
        for k in range(j):
            pivot -= L[j, k] * L[j, k]
        if given == 0.0:
            # An infinite pivot makes the variable's column, and so its part of the solution, vanish.
            root = np.inf
        elif pivot <= 1e-14 * given:
            return False
        else:
            root = np.sqrt(pivot)
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
    return True
