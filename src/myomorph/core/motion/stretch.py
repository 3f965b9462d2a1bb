"""Derivatives of marker positions in the lengths of bodies, and normal equations over all frames.

For fixed angles the position of a marker is linear in the factors of the bodies between it and the
ground and in its location on its body:

    x = sum over the chain of R (factor * offset) + R_b (factor * location + shift),

so that the derivatives below are exact. The angles of a frame appear in no other frame: they are
eliminated frame by frame (Schur complement), and what is left is a problem of the shared unknowns
alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import GROUND, Axis, Model
from myomorph.core.model.scale import scale, slides_freely
from myomorph.core.motion.lengths import Length
from myomorph.core.motion.tasks.loops import Ties
from myomorph.core.motion.tasks.markers import MarkerArrays, seen_weight
from myomorph.core.rigid.coordinates import Ints, evaluate_at, gather_dependents
from myomorph.core.rigid.kernels import bare, in_place, kernel
from myomorph.core.rigid.kinematics import body_poses, pose_room
from myomorph.core.rigid.tree import ROTATION, compile_tree
from myomorph.core.rigid.vectors import about, along, cross, matrix, minus, product, turned, vector

FRAMES_AT_ONCE = 64  # Frames whose eliminated angles are held in memory together
# Weight of a loop's gap beside a marker's: its angles follow the lengths to one part in about a
# million
TIED = 1e6


class Stretch(NamedTuple):
    """Derivatives of the tree's constants in the factors of the bodies.

    Attributes
    ----------
    pre : (axes, 3, 6) of `pre_p` in the factors (x, y, z) of the parent and of the body itself [m]
    post : (bodies, 3, 6) of `post_p` in the same [m]
    travel : (axes, 3) relative growth of a sliding axis's motion with the factors of the parent [-]
    column : (bodies, 3) number of the length that scales a body along an axis, -1 for none
    location : (markers, 3) on the bodies of the model before it is scaled [m]
    """

    pre: Array
    post: Array
    travel: Array
    column: Ints
    location: Array


def skeleton(model: Model) -> Model:
    """Remove what does not move markers: muscles, surfaces, actuators and drawings.

    Parameters
    ----------
    model : of any body

    Returns
    -------
    the model with bodies, joints, markers and couplers alone
    """
    bodies = tuple(replace(body, meshes=()) for body in model.bodies)
    return replace(
        model,
        bodies=bodies,
        muscles=(),
        wrap_objects=(),
        actuators=(),
        frames=(),
        ground_meshes=(),
        kept=(),
        passive_torques=(),
        bushings=(),
    )


def stretch_of(model: Model, lengths: Sequence[Length], markers: Sequence[str]) -> Stretch:
    """Differentiate a model's constants in the factors of its bodies.

    They are linear functions of the factors, so that differences are exact.

    Parameters
    ----------
    model : before it is scaled
    lengths : that scale its bodies
    markers : names of those whose locations are wanted

    Returns
    -------
    the derivatives, without the growth of sliding axes (`with_travel`)
    """
    bare = skeleton(model)
    tree = compile_tree(bare)
    arrays = tree.arrays
    depth = np.zeros(len(arrays.parent), np.int64)
    for b in range(1, len(depth)):
        depth[b] = depth[arrays.parent[b]] + 1
    pre = np.zeros((len(arrays.axis_kind), 3, 6))
    post = np.zeros((len(depth), 3, 6))
    of_axis = arrays.axis_body
    # Parent and child are never both of even depth, so all joints can be differenced at once.
    for parity in (0, 1):
        grown = [body for body, b in tree.body_index.items() if b > 0 and depth[b] % 2 == parity]
        for i in range(3):
            factors = {body: 1.0 + np.eye(3)[i] for body in grown}
            other = compile_tree(scale(bare, factors)).arrays
            at_pre = i + 3 * (depth[of_axis] % 2 == parity)
            at_post = i + 3 * (depth % 2 == parity)
            pre[np.arange(len(of_axis)), :, at_pre] = other.pre_p - arrays.pre_p
            post[np.arange(len(depth)), :, at_post] = other.post_p - arrays.post_p
    column = np.full((len(depth), 3), -1, np.int64)
    for number, length in enumerate(lengths):
        for body, axis in length.stretched:
            column[tree.body_index[body], axis] = number
    location = np.array([model.marker(name).location for name in markers]).reshape(-1, 3)
    return Stretch(
        pre=pre, post=post, travel=np.zeros((len(of_axis), 3)), column=column, location=location
    )


def with_travel(stretch: Stretch, model: Model, values: Array) -> Stretch:
    """Add the growth of sliding axes at the factors reached.

    With the axis u and the factors s of the parent, a motion that an angle drives grows by sum
    |u_i| s_i, one that a coupler drives by |u * s| (the rules of `scale`). Their relative growth in
    a factor s_i is

        |u_i| / sum |u_j| s_j     and     u_i^2 s_i / |u * s|^2

    A sliding axis of its own does not grow.

    Parameters
    ----------
    stretch : the derivatives
    model : whose axes these are
    values : (lengths,) factors [-]

    Returns
    -------
    the same derivatives with `travel`
    """
    tree = compile_tree(model)
    travel = np.zeros_like(stretch.travel)
    padded = np.append(values, 1.0)
    moving = [axis for joint in _in_tree_order(model) for axis in joint if axis.function.arity]
    for index, axis in enumerate(moving):
        if axis.kind != "translation":
            continue
        size = padded[stretch.column[tree.arrays.parent[tree.arrays.axis_body[index]]]]
        if not slides_freely(axis.function):
            travel[index] = np.abs(axis.vector) / float(np.abs(axis.vector) @ size)
        elif axis.coordinates[0] in model.dependent_coordinates:
            travel[index] = (
                axis.vector**2 * size / float((axis.vector * size) @ (axis.vector * size))
            )
    return stretch._replace(travel=travel)


def _in_tree_order(model: Model) -> list[tuple[Axis, ...]]:
    """Collect the axes of each joint in the order of the tree's bodies."""
    joints = {joint.child: joint.axes for joint in model.joints}
    return [joints[body] for body in model.body_names if body != GROUND]


def tied_markers(ties: Ties | None) -> MarkerArrays:
    """Describe the points of ties as markers, first and second in turn; none without ties.

    Parameters
    ----------
    ties : pairs of points that loops hold together

    Returns
    -------
    markers of weight 0, seen in no frame
    """
    body = np.zeros(0, np.int64)
    location = np.zeros((0, 3))
    if ties is not None:
        body = np.column_stack([ties.body_1, ties.body_2]).ravel()
        location = np.stack([ties.point_1, ties.point_2], axis=1).reshape(-1, 3)
    return MarkerArrays(
        body=body,
        location=location,
        weight=np.zeros(len(body)),
        observed=np.empty((0, len(body), 3)),
        errors=np.empty((0, len(body))),
    )


@bare
def marker_slopes(T, K, S, c, R, p, w, o, dphi, grown, places, by_length, by_coordinate):
    """Fill the markers' positions in one frame and their derivatives in lengths and coordinates.

    Derivatives in independent coordinates include their dependent ones.

    Parameters
    ----------
    T : arrays of the tree
    K : arrays of the markers
    S : `Stretch`
    c : (coordinates,) consistent [rad or m]
    R, p, w, o, dphi : scratch as in `body_poses`; R (bodies, 3, 3) and p (bodies, 3) [m] are the
        poses
    grown : (bodies, 3, lengths) filled with the derivatives of the bodies' origins [m]
    places : (markers, 3) filled with positions in ground [m]
    by_length : (3 markers, lengths) filled with their derivatives [m]
    by_coordinate : (3 markers, coordinates) filled with their derivatives [m/rad or 1]
    """
    body_poses(T, c, R, p, w, o, dphi)
    lengths = grown.shape[2]
    grown[0] = 0.0
    for b in range(1, T.parent.shape[0]):
        h = T.parent[b]
        r = matrix(R, h)
        for i in range(3):
            for j in range(lengths):
                grown[b, i, j] = grown[h, i, j]
        for axis in range(T.axis_start[b], T.axis_start[b + 1]):
            add_offset(S.column, S.pre[axis], h, b, r, grown[b])
            r = product(r, matrix(T.pre_R, axis))
            i = T.axis_coordinate[axis, 0]
            j = T.axis_coordinate[axis, 1]
            q = evaluate_at(T.functions, T.axis_function[axis], i, j, c)[0]
            if T.axis_kind[axis] == ROTATION:
                r = product(r, about(vector(T.axis_vector, axis), q))
            else:
                for t in range(3):
                    column = S.column[h, t]
                    if column >= 0:
                        for i in range(3):
                            grown[b, i, column] += w[axis, i] * q * S.travel[axis, t]
        add_offset(S.column, S.post[b], h, b, r, grown[b])
    by_coordinate[:] = 0.0
    for m in range(K.body.shape[0]):
        b = K.body[m]
        x = along(vector(p, b), 1.0, turned(matrix(R, b), vector(K.location, m)))
        for i in range(3):
            places[m, i] = x[i]
            for j in range(lengths):
                by_length[3 * m + i, j] = grown[b, i, j]
            for t in range(3):
                if S.column[b, t] >= 0:
                    by_length[3 * m + i, S.column[b, t]] += R[b, i, t] * S.location[m, t]
        h = b
        while h > 0:
            for axis in range(T.axis_start[h], T.axis_start[h + 1]):
                u = vector(w, axis)
                moved = cross(u, minus(x, vector(o, axis))) if T.axis_kind[axis] == ROTATION else u
                for t in range(2):
                    j = T.axis_coordinate[axis, t]
                    if j >= 0:
                        for i in range(3):
                            by_coordinate[3 * m + i, j] += dphi[axis, t] * moved[i]
            h = T.parent[h]
    gather_dependents(T, c, by_coordinate)


@bare
def add_offset(column, slopes, h, b, r, grown):
    """Add the derivatives of an offset between parent and child in their factors.

    Parameters
    ----------
    column : (bodies, 3) of `Stretch`
    slopes : (3, 6) derivatives in the parent's frame [m]
    h, b : numbers of parent and child
    r : rotation from the offset's frame to ground
    grown : (3, lengths) added to [m]
    """
    for t in range(6):
        at = column[h, t] if t < 3 else column[b, t - 3]
        if at >= 0:
            moved = turned(r, (slopes[0, t], slopes[1, t], slopes[2, t]))
            for i in range(3):
                grown[i, at] += moved[i]


@kernel
def frame_blocks(T, P, S, tied, tied_S, first, last, posture_weight, c, H, g, eliminated, errors):
    """Sum over frames the normal equations of the shared unknowns, with the angles eliminated.

    With A = J_q^T W J_q = L L^T of a frame, the reduced normal equations are H - E^T E and g - E^T
    e, where [E e] = L^-1 J_q^T W [J_s r]. The shared unknowns s are the lengths and three shifts
    for each marker. Loops, whose gap the angles close whatever the lengths, count as residuals of
    weight `TIED` that are zero.

    Parameters
    ----------
    T : arrays of the tree
    P : the pose problem, markers first and coordinates second among its tasks
    S : `Stretch` of the markers
    tied, tied_S : points of the loops, in pairs, as markers, and their `Stretch`
    first, last : frames [first, last)
    posture_weight : weight of the posture relative to the mean curvature [-]
    c : (frames, coordinates) consistent [rad or m]
    H : (shared, shared) lower triangle, added to
    g : (shared,) added to
    eliminated : ((last - first) variables, shared + 1) filled with [E e], zero for coordinates at a
        bound
    errors : (frames, markers) filled [m], NaN where unseen
    """
    K = P.tasks[0]
    tasks = P.tasks[1]
    F = P.free
    n = c.shape[1]
    markers = K.body.shape[0]
    size = F.shape[0]
    shared = H.shape[0]
    rows = 3 * markers
    lengths = shared - 3 * markers
    R, p, w, o, dphi = pose_room(T)
    grown = np.empty((T.parent.shape[0], 3, lengths))
    places = np.empty((markers, 3))
    by_length = np.empty((rows, lengths))
    by_coordinate = np.empty((rows, n))
    A = np.empty((size, size))
    Jq = np.empty((rows, size))
    misfit = np.empty(rows)
    ties = tied.body.shape[0]
    tied_places = np.empty((ties, 3))
    tied_length = np.empty((3 * ties, lengths))
    tied_coordinate = np.empty((3 * ties, n))
    for frame in range(first, last):
        at = c[frame]
        marker_slopes(T, K, S, at, R, p, w, o, dphi, grown, places, by_length, by_coordinate)
        total = seen_weight(K, frame)
        E = eliminated[(frame - first) * size : (frame - first + 1) * size]
        E[:] = 0.0
        A[:] = 0.0
        add_markers(
            K, F, frame, R, places, by_length, by_coordinate, misfit, Jq, A, E, H, g, errors[frame]
        )
        curvature = 0.0
        moved = 0
        for a in range(size):
            if A[a, a] > 0.0:
                curvature += A[a, a] * P.unit[F[a]] ** 2
                moved += 1
            A[a, a] += total * tasks.weight[F[a]]
            E[a, shared] += total * tasks.weight[F[a]] * (at[F[a]] - tasks.value[frame, F[a]])
        stiffness = posture_weight * (curvature / moved if moved else 1.0)
        if tied.body.shape[0] > 0:
            marker_slopes(
                T,
                tied,
                tied_S,
                at,
                R,
                p,
                w,
                o,
                dphi,
                grown,
                tied_places,
                tied_length,
                tied_coordinate,
            )
            add_ties(F, tied_length, tied_coordinate, A, E, H)
        for a in range(size):
            pull = stiffness / P.unit[F[a]] ** 2
            A[a, a] += pull
            E[a, shared] += pull * (at[F[a]] - P.posture[F[a]])
            slack = 1e-9 * (1.0 + abs(at[F[a]]))
            if at[F[a]] <= P.lower[a] + slack or at[F[a]] >= P.upper[a] - slack:
                for index in range(size):
                    A[max(a, index), min(a, index)] = 0.0
                A[a, a] = 1.0
                E[a] = 0.0
        eliminate(A, E)


@in_place
def add_markers(K, F, frame, R, places, by_length, by_coordinate, misfit, Jq, A, E, H, g, errors):
    """Add the markers seen in a frame to the sums of angles A, shared unknowns H, g and both E.

    Parameters
    ----------
    K : arrays of the markers
    F : (variables,) numbers of the free coordinates
    frame : number of the frame
    R : (bodies, 3, 3) rotations to ground
    places : (markers, 3) positions on the model [m]
    by_length : (3 markers, lengths) [m], overwritten: rows times the root of the marker's weight
    by_coordinate : (3 markers, coordinates) [m/rad or 1]
    misfit, Jq : (3 markers,) and (3 markers, variables) scratch
    A : (variables, variables) lower triangle, added to
    E : (variables, shared + 1) added to
    H : (shared, shared) lower triangle, added to
    g : (shared,) added to
    errors : (markers,) filled [m], NaN where unseen
    """
    lengths = by_length.shape[1]
    size = A.shape[0]
    shared = E.shape[1] - 1
    for m in range(places.shape[0]):
        y = K.observed[frame, m]
        seen = K.weight[m] > 0.0 and np.isfinite(y[0] + y[1] + y[2])
        square = 0.0
        root = np.sqrt(K.weight[m]) if seen else 0.0
        for i in range(3):
            e = places[m, i] - y[i]
            square += e * e
            misfit[3 * m + i] = root * e if seen else 0.0
        errors[m] = np.sqrt(square)
        for i in range(3 * m, 3 * m + 3):
            for a in range(size):
                Jq[i, a] = root * by_coordinate[i, F[a]]
            for a in range(lengths):
                by_length[i, a] *= root
        if not seen:
            continue
        d = lengths + 3 * m
        b = K.body[m]
        for i in range(3):
            row = 3 * m + i
            for a in range(lengths):
                slope = by_length[row, a]
                g[a] += slope * misfit[row]
                for column in range(a + 1):
                    H[a, column] += slope * by_length[row, column]
                for t in range(3):
                    H[d + t, a] += slope * root * R[b, i, t]
            for t in range(3):
                g[d + t] += root * R[b, i, t] * misfit[row]
            H[d + i, d + i] += K.weight[m]
            for a in range(size):
                slope = Jq[row, a]
                if slope == 0.0:
                    continue
                for column in range(a + 1):
                    A[a, column] += slope * Jq[row, column]
                for column in range(lengths):
                    E[a, column] += slope * by_length[row, column]
                for t in range(3):
                    E[a, d + t] += slope * root * R[b, i, t]
                E[a, shared] += slope * misfit[row]


@in_place
def eliminate(A, E):
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


@in_place
def add_ties(F, by_length, by_coordinate, A, E, H):
    """Add the squares of the gaps between pairs of tied points, at the weight `TIED`.

    Parameters
    ----------
    F : (variables,) numbers of the free coordinates
    by_length : (3 points, lengths) derivatives of the points [m]
    by_coordinate : (3 points, coordinates) derivatives of the points [m/rad or 1]
    A : (variables, variables) lower triangle, added to
    E : (variables, shared + 1) added to
    H : (shared, shared) lower triangle, added to
    """
    lengths = by_length.shape[1]
    for first in range(0, by_length.shape[0], 6):
        for row in range(first, first + 3):
            for a in range(lengths):
                slope = TIED * (by_length[row + 3, a] - by_length[row, a])
                for index in range(a + 1):
                    H[a, index] += slope * (by_length[row + 3, index] - by_length[row, index])
            for a in range(F.shape[0]):
                slope = TIED * (by_coordinate[row + 3, F[a]] - by_coordinate[row, F[a]])
                if slope != 0.0:
                    for index in range(a + 1):
                        A[a, index] += slope * (
                            by_coordinate[row + 3, F[index]] - by_coordinate[row, F[index]]
                        )
                    for index in range(lengths):
                        E[a, index] += slope * (by_length[row + 3, index] - by_length[row, index])


@kernel
def slopes_of_frame(T, K, S, c):
    """Compute the positions of markers in one frame and their derivatives, as `marker_slopes`.

    Parameters
    ----------
    T : arrays of the tree
    K : arrays of the markers
    S : `Stretch`
    c : (coordinates,) consistent [rad or m]

    Returns
    -------
    positions (markers, 3) [m], then derivatives (3 markers, lengths) [m] and (3 markers,
    coordinates) [m/rad or 1]
    """
    R, p, w, o, dphi = pose_room(T)
    markers = K.body.shape[0]
    lengths = S.column.max() + 1
    grown = np.empty((T.parent.shape[0], 3, lengths))
    places = np.empty((markers, 3))
    by_length = np.empty((3 * markers, lengths))
    by_coordinate = np.empty((3 * markers, c.shape[0]))
    marker_slopes(T, K, S, c, R, p, w, o, dphi, grown, places, by_length, by_coordinate)
    return places, by_length, by_coordinate
