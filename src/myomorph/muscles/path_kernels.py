"""All muscle paths, frame by frame: lengths, lengthening velocities and moment arms.

A path is a chain of nodes: its points that are active, and two more for each surface it touches. The
rules by which OpenSim lets a path touch several surfaces are those of `GeometryPath` (4.6). It keeps
the last wrap from frame to frame but loses it before it is used, so frames do not depend on history.

A quirk of OpenSim 4.6 is kept, since it changes lengths by millimeters where a path has two surfaces
or more: within a frame, the place in ground of a point on a surface is that of the pass in which it
was first asked for, though later passes move it (`_look_at`). Lengths and directions use the place first
seen, the force acts at the last one. MuJoCo's tendons take the branch of `_tendon_nodes`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np
from numba import njit

from myomorph.model.spatial import Array
from myomorph.muscles.path_arrays import (
    ACTIVE,
    AFTER,
    ARMS,
    AXES,
    AXIS,
    BODIES,
    BODY,
    COORDINATE,
    FIRST,
    FOLLOWS,
    HIGH,
    KIND,
    LAST,
    LOCAL,
    LOW,
    METHOD,
    MOVING,
    OBJECT,
    OBJECT_BODY,
    OBJECT_LOCAL,
    POINTS,
    ROTATES,
    SIDE,
    SIDE_BODY,
    SLOT_1,
    SLOT_2,
    SUPPORT,
    SUPPORT_STOP,
    TREE_AXIS,
    WEIGHT,
    WRAPS,
)
from myomorph.muscles.vectors import inner
from myomorph.muscles.wrap_cylinder import INSIDE, MANDATORY, NO_WRAP, WRAPPED, wrap_cylinder
from myomorph.muscles.wrap_ellipsoid import wrap_ellipsoid
from myomorph.muscles.wrap_sphere import wrap_sphere
from myomorph.muscles.wrap_tendon import wrap_tendon
from myomorph.muscles.wrap_torus import wrap_torus
from myomorph.rigid.coordinates import Ints, evaluate
from myomorph.rigid.kinematics import body_poses, couple

CYLINDER, SPHERE, ELLIPSOID, TORUS = range(4)
NODE_LOCAL, NODE_OBJECT, NODE_POINT, NODE_WRAP, NODE_END = range(5)
NODE_WEIGHT, NODE_ARC, SEEN = 3, 4, 5
MOST_PASSES = 8
SETTLED = 0.0005
COINCIDENT = 1e-14
SLACK = 1e-5


class PathScratch(NamedTuple):
    """Room to work in, one per thread.

    Attributes
    ----------
    x : (nodes, 8) place in ground [m], NODE_WEIGHT: share in the length of what follows the node,
        NODE_ARC: length on the surface up to a node that leaves it [m], SEEN ...: place at which
        OpenSim takes the node to be in ground [m]
    node : (nodes, 5) NODE_LOCAL: number of the body among the muscle's, NODE_OBJECT: surface,
        NODE_POINT: row of `point`, NODE_WRAP: row of `wrap`, NODE_END: row of `seen`; -1 for none
    seen : (2 wraps, 4) places first seen of the points on surfaces [m], and 1 once they are
    turns : (2, wraps) order of the wraps, and their latest results
    pull : (muscle's bodies, 6) force of unit tension and its moment about the ground's origin
    pose : (surfaces, 12) rotation row by row and place in ground
    slopes : (couplers, 2)
    moved : (moving points, 6) place in the body [m], and its derivative in the coordinates
    ends : (9, 3) the arguments of `wrap_tendon`
    """

    x: Array
    node: Ints
    seen: Array
    turns: Ints
    pull: Array
    pose: Array
    slopes: Array
    moved: Array
    ends: Array


@njit(cache=True, nogil=True)
def path_scratch(P):
    """Room for `path_frames`."""
    nodes, wraps, bodies = P.sizes[0] + 2, P.sizes[1], P.sizes[2]
    return PathScratch(
        np.zeros((nodes, 8)),
        np.zeros((nodes, 5), np.int64),
        np.zeros((2 * wraps, 4)),
        np.zeros((2, wraps), np.int64),
        np.zeros((bodies, 6)),
        np.zeros((P.object.shape[0], 12)),
        np.zeros((P.coupler.shape[0], 2)),
        np.zeros((P.moving.shape[0], 6)),
        np.zeros((9, 3)),
    )


@njit(cache=True, nogil=True, error_model="numpy")
def path_frames(T, P, c, cdot, lengths, velocities, arms):
    """Lengths, velocities and moment arms of all muscles, frame by frame.

    Parameters
    ----------
    T, P : `TreeArrays`, `PathArrays`
    c, cdot : (frames, coordinates) values, of which dependent ones are set here, and speeds, of which
        dependent ones are not read
    lengths, velocities : (frames, muscles) filled [m, m/s]
    arms : (frames, moment arms) filled in the order of the pattern; a coordinate that others follow has
        what reaches the muscle through them included, one that follows has its own share [m/rad or m/m]
    """
    # Taken out of the bundles once: taking them out in a loop counts references each time, which cost
    # more than the arithmetic.
    start, point, place, moving = P.start, P.point, P.place, P.moving
    wrap, surface, size, side = P.wrap, P.object, P.object_size, P.wrap_side
    axis, support, arm, follow, fixed_pose = P.axis, P.support, P.arm, P.follow, P.object_pose
    S = path_scratch(P)
    x, node, seen, turns, pull = S.x, S.node, S.seen, S.turns, S.pull
    pose, slopes, moved = S.pose, S.slopes, S.moved
    rotation, out, rows = S.ends[:3], S.ends[3:5], (S.ends[5], S.ends[6], S.ends[7], S.ends[8])
    bodies, axes = T.parent.shape[0], T.axis_kind.shape[0]
    R, p = np.empty((bodies, 3, 3)), np.empty((bodies, 3))
    w, o, dphi = np.empty((axes, 3)), np.empty((axes, 3)), np.empty((axes, 2))
    for f in range(c.shape[0]):
        here, speeds, row = c[f], cdot[f], arms[f]
        couple(T, here)
        body_poses(T, here, R, p, w, o, dphi)
        coupler_slopes(P, here, slopes)
        _move_points(P, here, moved)
        _place_objects(surface, fixed_pose, R, p, pose)
        for m in range(start.shape[0] - 1):
            first = start[m, POINTS]
            count = _point_nodes(point, place, moved, first, start[m + 1, POINTS], here, R, p, x, node)
            begin, end = start[m, WRAPS], start[m + 1, WRAPS]
            if end > begin:
                for i in range(2 * (end - begin)):
                    seen[i, 3] = 0.0
                if wrap[begin, AFTER] >= 0:
                    count = _tendon_nodes(
                        wrap,
                        side,
                        surface,
                        size,
                        begin,
                        end,
                        first,
                        R,
                        p,
                        x,
                        node,
                        seen,
                        pose,
                        rotation,
                        rows,
                        out,
                        count,
                    )
                else:
                    count = _wrapped_nodes(wrap, surface, size, begin, end, first, x, node, seen, turns, pose, count)
            lengths[f, m] = _length(x, node, count)
            begin, end = start[m, ARMS], start[m + 1, ARMS]
            for k in range(begin, end):
                row[k] = 0.0
            for b in range(start[m + 1, BODIES] - start[m, BODIES]):
                for i in range(6):
                    pull[b, i] = 0.0
            _pulls(point, moving, moved, R, x, node, pull, count, begin, row)
            _gather(axis, support, start[m, AXES], start[m + 1, AXES], w, o, dphi, pull, begin, row)
            for q in range(start[m, FOLLOWS], start[m + 1, FOLLOWS]):
                k, own = follow[q, 0], row[begin + follow[q, 1]]
                for i in range(2):
                    if follow[q, 2 + i] >= 0:
                        row[begin + follow[q, 2 + i]] += slopes[k, i] * own
            speed = 0.0
            for k in range(begin, end):
                if arm[k, 1] == 1:
                    speed -= row[k] * speeds[arm[k, 0]]
            velocities[f, m] = speed


@inner
def coupler_slopes(P, c, slopes):
    """Fill slopes (couplers, 2) of the dependent coordinates in those they follow."""
    for k in range(slopes.shape[0]):
        i, j = P.coupler[k, 1], P.coupler[k, 2]
        x, y = c[i] if i >= 0 else 0.0, c[j] if j >= 0 else 0.0
        _, slopes[k, 0], slopes[k, 1], _, _, _ = evaluate(P.functions, P.coupler[k, 0], x, y)


@inner
def _place_objects(rows, poses, R, p, placed):
    """Poses of all surfaces in ground."""
    for k in range(rows.shape[0]):
        b = rows[k, OBJECT_BODY]
        for i in range(3):
            x = p[b, i]
            for j in range(3):
                x += R[b, i, j] * poses[k, 9 + j]
                placed[k, 3 * i + j] = (
                    R[b, i, 0] * poses[k, j] + R[b, i, 1] * poses[k, 3 + j] + R[b, i, 2] * poses[k, 6 + j]
                )
            placed[k, 9 + i] = x


@inner
def _point_nodes(point, place, moved, start, stop, c, R, p, x, node):
    """Put a muscle's active points in the chain; returns how many."""
    count = 0
    for k in range(start, stop):
        j = point[k, COORDINATE]
        if j >= 0 and not place[k, LOW] - SLACK <= c[j] <= place[k, HIGH] + SLACK:
            continue
        u0, u1, u2 = place[k, 0], place[k, 1], place[k, 2]
        v = point[k, MOVING]
        if v >= 0:
            u0, u1, u2 = moved[v, 0], moved[v, 1], moved[v, 2]
        b = point[k, BODY]
        for i in range(3):
            x[count, i] = R[b, i, 0] * u0 + R[b, i, 1] * u1 + R[b, i, 2] * u2 + p[b, i]
            x[count, SEEN + i] = x[count, i]
        x[count, NODE_WEIGHT], x[count, NODE_ARC] = place[k, WEIGHT], 0.0
        node[count, NODE_LOCAL], node[count, NODE_OBJECT] = point[k, LOCAL], -1
        node[count, NODE_POINT], node[count, NODE_WRAP], node[count, NODE_END] = k, -1, -1
        count += 1
    return count


@inner
def _move_points(P, c, moved):
    """Fill moved (moving points, 6): place in the body, and its derivative in the coordinates."""
    for v in range(moved.shape[0]):
        for i in range(3):
            j = P.moving[v, 3 + i]
            low, high = P.moving_range[v, 2 * i], P.moving_range[v, 2 * i + 1]
            at = min(max(c[j], low), high) if j >= 0 else 0.0
            moved[v, i], slope, _, _, _, _ = evaluate(P.functions, P.moving[v, i], at, 0.0)
            # Beyond the range the point stands still.
            moved[v, 3 + i] = slope if j >= 0 and low <= c[j] <= high else 0.0


@inner
def _insert(x, node, seen, at, count, local, surface, wrap, end, r, s, arc):
    """Put both ends of an arc into the chain after node `at`; `end` is the first one's row of `seen`."""
    for k in range(count - 1, at, -1):
        for i in range(8):
            x[k + 2, i] = x[k, i]
        for i in range(5):
            node[k + 2, i] = node[k, i]
    for i in range(3):
        x[at + 1, i], x[at + 2, i] = r[i], s[i]
    for k in range(at + 1, at + 3):
        row = end + k - at - 1
        x[k, NODE_WEIGHT] = x[at, NODE_WEIGHT]
        node[k, NODE_LOCAL], node[k, NODE_OBJECT] = local, surface
        node[k, NODE_POINT], node[k, NODE_WRAP], node[k, NODE_END] = -1, wrap, row
        for i in range(3):
            x[k, SEEN + i] = seen[row, i] if seen[row, 3] == 1.0 else x[k, i]
    x[at + 1, NODE_ARC], x[at + 2, NODE_ARC] = 0.0, arc
    return count + 2


@inner
def _without(x, node, count, wrap):
    """Take the nodes of a wrap out of the chain."""
    for k in range(count - 1):
        if node[k, NODE_WRAP] == wrap:
            for n in range(k, count - 2):
                for i in range(8):
                    x[n, i] = x[n + 2, i]
                for i in range(5):
                    node[n, i] = node[n + 2, i]
            return count - 2
    return count


@inner
def _tendon_nodes(
    wrap, wrap_side, surface, size, start, stop, points, R, p, x, node, seen, pose, rotation, rows, out, count
):
    """Wrap the chain in the way of MuJoCo: each surface between the two points around it.

    `rotation` (3, 3), `rows` (4 of (3,)) and `out` (2, 3) are room for the arguments of `wrap_tendon`.
    """
    before, after, center, side = rows
    for k in range(start, stop):
        at = 0
        while node[at, NODE_POINT] != points + wrap[k, AFTER]:
            at += 1
        b, g = wrap[k, SIDE_BODY], wrap[k, OBJECT]
        for i in range(3):
            before[i], after[i], center[i] = x[at, i], x[at + 1, i], pose[g, 9 + i]
            for j in range(3):
                rotation[i, j] = pose[g, 3 * i + j]
            if b >= 0:
                side[i] = p[b, i]
                for j in range(3):
                    side[i] += R[b, i, j] * wrap_side[k, j]
        kind = 0 if surface[g, KIND] == SPHERE else 1
        arc = wrap_tendon(before, after, kind, size[g, 0], rotation, center, side, b >= 0, out)
        if arc >= 0.0:
            r, s = _placed(out, 0 * k), _placed(out, 0 * k + 1)
            count = _insert(x, node, seen, at, count, wrap[k, OBJECT_LOCAL], g, k, 2 * (k - start), r, s, arc)
    return count


@inner
def _wrapped_nodes(wrap, surface, size, start, stop, points, x, node, seen, turns, pose, count):
    """Wrap the chain in the way of OpenSim: surface after surface, until the length settles."""
    wraps = stop - start
    for i in range(wraps):
        turns[0, i] = i
    before, turn = math.inf, 0
    left = MOST_PASSES if wraps > 1 else 1
    while left > 0:
        left -= 1
        for i in range(wraps):
            k = start + turns[0, i]
            g = wrap[k, OBJECT]
            turns[1, i] = NO_WRAP
            count = _without(x, node, count, k)
            first, last = _between_points(node, count, points + wrap[k, FIRST], points + wrap[k, LAST])
            if surface[g, ACTIVE] == 1:
                if first < 0:
                    # OpenSim then leaves the path as it is, with what later surfaces had before.
                    left = -1
                    break
                turns[1, i], at, arc, r, s = _best_wrap(
                    surface, size, pose, g, wrap[k, METHOD], x, node, seen, first, last, wraps
                )
                if at >= 0:
                    count = _insert(x, node, seen, at, count, wrap[k, OBJECT_LOCAL], g, k, 2 * (k - start), r, s, arc)
        if left > 0:
            for n in range(count):
                _look_at(x, node, seen, n)
            length = _length(x, node, count)
            if abs(length - before) < SETTLED:
                left = 0
            elif turn == 0 and turns[1, 0] == NO_WRAP and turns[1, 1] == INSIDE:
                turns[0, 0], turns[0, 1] = 1, 0
                count = _without(x, node, count, start)
            before, turn = length, 1
    return count


@inner
def _between_points(node, count, low, high):
    """Nodes of the first and last active points in a range of points, -1 where there is none."""
    first, last = -1, -1
    for n in range(count):
        if low <= node[n, NODE_POINT] <= high:
            if first < 0:
                first = n
            last = n
    return first, last


@inner
def _best_wrap(surface, size, pose, g, method, x, node, seen, first, last, wraps):
    """The segment on which a surface lengthens the path least, or the first that runs through it.

    Returns the last code, the node before the segment (-1 for none), arc, and both ends in ground.
    """
    none = (0.0, 0.0, 0.0)
    least, at, best_arc, best_r, best_s = math.inf, -1, 0.0, none, none
    kind, axis, side = surface[g, KIND], surface[g, AXIS], surface[g, SIDE]
    sizes = (size[g, 0], size[g, 1], size[g, 2])
    code = NO_WRAP
    for i in range(first, last):
        if node[i, NODE_OBJECT] >= 0 and node[i, NODE_OBJECT] == node[i + 1, NODE_OBJECT]:
            continue
        a, b = _into(pose, g, _placed(x, i)), _into(pose, g, _placed(x, i + 1))
        if kind == CYLINDER:
            code, arc, r, s = wrap_cylinder(a, b, sizes[0], sizes[1], axis, side, wraps == 1)
        elif kind == SPHERE:
            code, arc, r, s = wrap_sphere(a, b, sizes[0], axis, side)
        elif kind == ELLIPSOID:
            code, arc, r, s = wrap_ellipsoid(a, b, sizes, method, axis, side)
        else:
            code, arc, r, s = wrap_torus(a, b, sizes[0], sizes[1], axis, side, wraps == 1)
        if code == MANDATORY:
            at, best_arc, best_r, best_s = i, arc, r, s
            break
        if code == WRAPPED:
            _look_at(x, node, seen, i)
            _look_at(x, node, seen, i + 1)
            a, b = _into(pose, g, _seen(x, i)), _into(pose, g, _seen(x, i + 1))
            longer = _between(a, r) + arc + _between(b, s) - _between(a, b)
            if longer < least:
                least, at, best_arc, best_r, best_s = longer, i, arc, r, s
    return code, at, best_arc, _out_of(pose, g, best_r), _out_of(pose, g, best_s)


@inner
def _between(a, b):
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return math.sqrt(x * x + y * y + z * z)


@inner
def _look_at(x, node, seen, i):
    """Ask for node i's place in ground: for the rest of the frame OpenSim takes it to stay there."""
    end = node[i, NODE_END]
    if end >= 0 and seen[end, 3] == 0.0:
        seen[end, 0], seen[end, 1], seen[end, 2], seen[end, 3] = x[i, 0], x[i, 1], x[i, 2], 1.0


@inner
def _seen(x, i):
    return x[i, SEEN], x[i, SEEN + 1], x[i, SEEN + 2]


@inner
def _placed(x, i):
    return x[i, 0], x[i, 1], x[i, 2]


@inner
def _into(pose, g, a):
    """A point in ground, in the frame of surface g."""
    x, y, z = a[0] - pose[g, 9], a[1] - pose[g, 10], a[2] - pose[g, 11]
    return (
        pose[g, 0] * x + pose[g, 3] * y + pose[g, 6] * z,
        pose[g, 1] * x + pose[g, 4] * y + pose[g, 7] * z,
        pose[g, 2] * x + pose[g, 5] * y + pose[g, 8] * z,
    )


@inner
def _out_of(pose, g, a):
    """A point in the frame of surface g, in ground."""
    return (
        pose[g, 0] * a[0] + pose[g, 1] * a[1] + pose[g, 2] * a[2] + pose[g, 9],
        pose[g, 3] * a[0] + pose[g, 4] * a[1] + pose[g, 5] * a[2] + pose[g, 10],
        pose[g, 6] * a[0] + pose[g, 7] * a[1] + pose[g, 8] * a[2] + pose[g, 11],
    )


@inner
def _length(x, node, count):
    total = 0.0
    for i in range(count - 1):
        on_surface = node[i, NODE_OBJECT] >= 0 and node[i, NODE_OBJECT] == node[i + 1, NODE_OBJECT]
        part = x[i + 1, NODE_ARC] if on_surface else _between(_seen(x, i), _seen(x, i + 1))
        total += x[i, NODE_WEIGHT] * part
    return total


@inner
def _pulls(point, moving, moved, R, x, node, pull, count, arm, arms):
    """Add force and moment of unit tension to each body of the muscle; what moves points goes into `arms`."""
    for n in range(count - 1):
        k, j = node[n, NODE_POINT], node[n + 1, NODE_POINT]
        v = point[k, MOVING] if k >= 0 else -1
        u = point[j, MOVING] if j >= 0 else -1
        if node[n, NODE_LOCAL] == node[n + 1, NODE_LOCAL] and v < 0 and u < 0:
            continue
        start, stop = _seen(x, n), _seen(x, n + 1)
        length = _between(start, stop)
        if length < COINCIDENT:
            continue
        scale = x[n, NODE_WEIGHT] / length
        f0, f1, f2 = scale * (stop[0] - start[0]), scale * (stop[1] - start[1]), scale * (stop[2] - start[2])
        _pull(pull, node[n, NODE_LOCAL], x, n, f0, f1, f2)
        _pull(pull, node[n + 1, NODE_LOCAL], x, n + 1, -f0, -f1, -f2)
        if v >= 0:
            _work(moving, moved, v, R, point[k, BODY], f0, f1, f2, arm, arms)
        if u >= 0:
            _work(moving, moved, u, R, point[j, BODY], -f0, -f1, -f2, arm, arms)


@inner
def _pull(pull, b, x, n, f0, f1, f2):
    """Add a force at node n to body b of the muscle."""
    x0, x1, x2 = x[n, 0], x[n, 1], x[n, 2]
    pull[b, 0] += f0
    pull[b, 1] += f1
    pull[b, 2] += f2
    pull[b, 3] += x1 * f2 - x2 * f1
    pull[b, 4] += x2 * f0 - x0 * f2
    pull[b, 5] += x0 * f1 - x1 * f0


@inner
def _work(moving, moved, v, R, b, f0, f1, f2, arm, arms):
    """Add the work of a force on moving point v of body b, per unit of the coordinates that move it."""
    for i in range(3):
        if moving[v, 6 + i] >= 0:
            share = R[b, 0, i] * f0 + R[b, 1, i] * f1 + R[b, 2, i] * f2
            arms[arm + moving[v, 6 + i]] += moved[v, 3 + i] * share


@inner
def _gather(axis, support, start, stop, w, o, dphi, pull, arm, arms):
    """Add what the forces do along the axes that lie between the muscle's bodies."""
    for q in range(start, stop):
        f0, f1, f2, m0, m1, m2 = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(axis[q, SUPPORT], axis[q, SUPPORT_STOP]):
            b = support[n]
            f0 += pull[b, 0]
            f1 += pull[b, 1]
            f2 += pull[b, 2]
            m0 += pull[b, 3]
            m1 += pull[b, 4]
            m2 += pull[b, 5]
        k = axis[q, TREE_AXIS]
        if axis[q, ROTATES] == 1:
            x0, x1, x2 = o[k, 0], o[k, 1], o[k, 2]
            f0, f1, f2 = m0 - (x1 * f2 - x2 * f1), m1 - (x2 * f0 - x0 * f2), m2 - (x0 * f1 - x1 * f0)
        work = w[k, 0] * f0 + w[k, 1] * f1 + w[k, 2] * f2
        if axis[q, SLOT_1] >= 0:
            arms[arm + axis[q, SLOT_1]] += dphi[k, 0] * work
        if axis[q, SLOT_2] >= 0:
            arms[arm + axis[q, SLOT_2]] += dphi[k, 1] * work
