"""Normal equations over all frames in lengths and shifts of markers, the angles eliminated.

The angles of a frame appear in no other frame: they are eliminated frame by frame (Schur
complement), and what is left is a problem of the shared unknowns alone. With A = J_q^T W J_q = L
L^T of a frame, the reduced normal equations are H - E^T E and g - E^T e, where

    [E e] = L^-1 J_q^T W [J_s r]

The shared unknowns s are the lengths and three shifts for each marker.
"""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.motion.pose_problem import PoseProblem, row_of
from myomorph.core.motion.stretch import Stretch, marker_slopes, slope_room
from myomorph.core.motion.tasks.markers import MarkerArrays, seen_weight
from myomorph.core.rigid.kernels import in_place, kernel

FRAMES_AT_ONCE = 64  # Frames whose eliminated angles are held in memory together
# Weight of a loop's gap relative to a marker's: its angles follow the lengths to about one part in
# a million
TIED = 1e6
AT_BOUND = 1e-9  # Share of 1 plus its size by which a coordinate may be off the bound it lies at


class StretchedProblem(NamedTuple):
    """A pose problem, and how its markers move with the lengths of bodies.

    Attributes
    ----------
    pose : the problem, markers first and coordinates second among its tasks
    stretch : of its markers
    tied : points of the loops, in pairs, as markers
    tied_stretch : of these points
    posture_weight : weight of the posture relative to the mean curvature [-]
    """

    pose: PoseProblem
    stretch: Stretch
    tied: MarkerArrays
    tied_stretch: Stretch
    posture_weight: float


class BlockSums(NamedTuple):
    """Sums that `frame_blocks` adds to, and arrays that it fills.

    Attributes
    ----------
    H : (shared, shared) lower triangle, added to
    g : (shared,) added to
    eliminated : (frames variables, shared + 1) filled with [E e], of the frames summed at once; 0
        for coordinates at a bound
    errors : (all frames, markers) filled [m], NaN where unseen
    """

    H: Array
    g: Array
    eliminated: Array
    errors: Array


class FrameEquations(NamedTuple):
    """Sums of one frame, and those of the shared unknowns.

    Attributes
    ----------
    A : (variables, variables) of the angles, lower triangle
    E : (variables, shared + 1) between angles and shared unknowns, and the angles' right side
    H : (shared, shared) lower triangle
    g : (shared,)
    """

    A: Array
    E: Array
    H: Array
    g: Array


class WeighedRows(NamedTuple):
    """Rows of the markers of a frame, times the roots of their weights.

    Attributes
    ----------
    misfit : (3 markers,) model less recording [m], 0 where unseen
    Jq : (3 markers, variables) derivatives in the free coordinates [m/rad or 1]
    """

    misfit: Array
    Jq: Array


@kernel
def frame_blocks(T, problem, frames, c, sums):
    """Sum over frames the normal equations of the shared unknowns, with the angles eliminated.

    Loops, whose gap the angles close whatever the lengths, count as residuals of weight `TIED` that
    are zero.

    Parameters
    ----------
    T : arrays of the tree
    problem : `StretchedProblem`
    frames : the first, and the one behind the last
    c : (all frames, coordinates) consistent [rad or m]
    sums : `BlockSums`
    """
    pose = problem.pose
    markers = pose.tasks[0]
    n = c.shape[1]
    size = pose.free.shape[0]
    lengths = sums.H.shape[0] - 3 * markers.body.shape[0]
    room = slope_room(T, markers.body.shape[0], lengths, n)
    tied_room = slope_room(T, problem.tied.body.shape[0], lengths, n)
    rows = WeighedRows(
        misfit=np.empty(3 * markers.body.shape[0]), Jq=np.empty((3 * markers.body.shape[0], size))
    )
    A = np.empty((size, size))
    for frame in range(frames[0], frames[1]):
        at = c[frame]
        start = (frame - frames[0]) * size
        equations = FrameEquations(A=A, E=sums.eliminated[start : start + size], H=sums.H, g=sums.g)
        equations.E[:] = 0.0
        A[:] = 0.0
        marker_slopes(T, markers, problem.stretch, at, room)
        for m in range(markers.body.shape[0]):
            seen, distance = _weigh_marker(markers, pose.free, frame, m, room, rows)
            sums.errors[frame, m] = distance
            if seen:
                _add_shared(markers, m, room, rows, equations)
                _add_angles(markers, m, room, rows, equations)
        stiffness = problem.posture_weight * _mean_curvature(pose, A)
        _add_coordinates(pose, frame, at, equations)
        if problem.tied.body.shape[0] > 0:
            marker_slopes(T, problem.tied, problem.tied_stretch, at, tied_room)
            add_ties(pose.free, tied_room.by_length, tied_room.by_coordinate, equations)
        _add_posture(pose, frame, at, stiffness, equations)
        _eliminate(A, equations.E)


@in_place
def _weigh_marker(markers, free, frame, m, room, rows):
    """Multiply the rows of a marker by the root of its weight, 0 where it is unseen.

    Returns whether it is seen, and the distance between model and recording [m].
    """
    y = markers.observed[frame, m]
    seen = markers.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2])
    root = np.sqrt(markers.weight[m]) if seen else 0.0
    square = 0.0
    for i in range(3):
        row = 3 * m + i
        e = room.places[m, i] - y[i]
        square += e * e
        rows.misfit[row] = root * e if seen else 0.0
        for a in range(free.shape[0]):
            rows.Jq[row, a] = root * room.by_coordinate[row, free[a]]
        for a in range(room.by_length.shape[1]):
            room.by_length[row, a] *= root
    return seen, np.sqrt(square)


@in_place
def _add_shared(markers, m, room, rows, equations):
    """Add the weighed rows of a marker to the sums of the shared unknowns, H and g."""
    H = equations.H
    g = equations.g
    lengths = room.by_length.shape[1]
    root = np.sqrt(markers.weight[m])
    shift = lengths + 3 * m
    b = markers.body[m]
    for i in range(3):
        row = 3 * m + i
        for a in range(lengths):
            slope = room.by_length[row, a]
            g[a] += slope * rows.misfit[row]
            for column in range(a + 1):
                H[a, column] += slope * room.by_length[row, column]
            for t in range(3):
                H[shift + t, a] += slope * root * room.R[b, i, t]
        for t in range(3):
            g[shift + t] += root * room.R[b, i, t] * rows.misfit[row]
        H[shift + i, shift + i] += markers.weight[m]


@in_place
def _add_angles(markers, m, room, rows, equations):
    """Add the weighed rows of a marker to the sums of the angles, A and E."""
    A = equations.A
    E = equations.E
    lengths = room.by_length.shape[1]
    root = np.sqrt(markers.weight[m])
    shift = lengths + 3 * m
    b = markers.body[m]
    for i in range(3):
        row = 3 * m + i
        for a in range(A.shape[0]):
            slope = rows.Jq[row, a]
            if slope == 0.0:
                continue
            for column in range(a + 1):
                A[a, column] += slope * rows.Jq[row, column]
            for column in range(lengths):
                E[a, column] += slope * room.by_length[row, column]
            for t in range(3):
                E[a, shift + t] += slope * root * room.R[b, i, t]
            E[a, E.shape[1] - 1] += slope * rows.misfit[row]


@in_place
def _mean_curvature(problem, A):
    """Mean curvature of the markers, in units, over the angles that they see move."""
    total = 0.0
    moved = 0
    for a in range(A.shape[0]):
        if A[a, a] > 0.0:
            total += A[a, a] * problem.unit[problem.free[a]] ** 2
            moved += 1
    return total / moved if moved else 1.0


@in_place
def _add_coordinates(problem, frame, c, equations):
    """Add the pulls of coordinates to values; like the markers', they are sums, not means."""
    free = problem.free
    A = equations.A
    E = equations.E
    pulled = problem.tasks[1]
    total = seen_weight(problem.tasks[0], frame)
    for a in range(free.shape[0]):
        A[a, a] += total * pulled.weight[free[a]]
        E[a, E.shape[1] - 1] += (
            total * pulled.weight[free[a]] * (c[free[a]] - pulled.value[frame, free[a]])
        )


@in_place
def _add_posture(problem, frame, c, stiffness, equations):
    """Add the pull to the posture, and leave out the angles that lie at a bound."""
    free = problem.free
    A = equations.A
    E = equations.E
    posture = row_of(problem.posture, frame)
    for a in range(free.shape[0]):
        pull = stiffness / problem.unit[free[a]] ** 2
        A[a, a] += pull
        E[a, E.shape[1] - 1] += pull * (c[free[a]] - problem.posture[posture, free[a]])
        slack = AT_BOUND * (1.0 + abs(c[free[a]]))
        if c[free[a]] <= problem.lower[a] + slack or c[free[a]] >= problem.upper[a] - slack:
            for other in range(free.shape[0]):
                A[max(a, other), min(a, other)] = 0.0
            A[a, a] = 1.0
            E[a] = 0.0


@in_place
def add_ties(free, by_length, by_coordinate, equations):
    """Add the squares of the gaps between pairs of tied points, at the weight `TIED`.

    Parameters
    ----------
    free : (variables,) numbers of the free coordinates
    by_length : (3 points, lengths) derivatives of the points, first and second in turn [m]
    by_coordinate : (3 points, coordinates) derivatives of the points [m/rad or 1]
    equations : `FrameEquations`
    """
    A = equations.A
    E = equations.E
    H = equations.H
    for number in range(by_length.shape[0] // 2):
        row = 6 * (number // 3) + number % 3
        for a in range(by_length.shape[1]):
            slope = TIED * (by_length[row + 3, a] - by_length[row, a])
            for column in range(a + 1):
                H[a, column] += slope * (by_length[row + 3, column] - by_length[row, column])
        for a in range(free.shape[0]):
            slope = TIED * (by_coordinate[row + 3, free[a]] - by_coordinate[row, free[a]])
            if slope == 0.0:
                continue
            for other in range(a + 1):
                A[a, other] += slope * (
                    by_coordinate[row + 3, free[other]] - by_coordinate[row, free[other]]
                )
            for column in range(by_length.shape[1]):
                E[a, column] += slope * (by_length[row + 3, column] - by_length[row, column])


@in_place
def _eliminate(A, E):
    """Replace A by its Cholesky factor L (lower triangle) and E by L^-1 E.

    Parameters
    ----------
    A : (variables, variables) lower triangle, positive definite
    E : (variables, shared + 1)
    """
    for a in range(A.shape[0]):
        for column in range(a + 1):
            for j in range(column):
                A[a, column] -= A[a, j] * A[column, j]
            A[a, column] = (
                A[a, column] / A[column, column] if column < a else np.sqrt(max(A[a, a], 1e-300))
            )
        for column in range(a):
            factor = A[a, column]
            if factor != 0.0:
                for j in range(E.shape[1]):
                    E[a, j] -= factor * E[column, j]
        for j in range(E.shape[1]):
            E[a, j] /= A[a, a]
