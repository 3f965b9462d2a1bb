"""One frame of all muscle paths: lengths, lengthening velocities and moment arms.

A path is a chain of nodes: its points that are active, and two more for each surface it touches. The
rules by which OpenSim lets a path touch several surfaces are those of `GeometryPath` (4.6). It keeps
the last wrap from frame to frame but loses it before it is used, so frames do not depend on history.

A quirk of OpenSim 4.6 is kept, since it changes lengths by millimeters where a path has two surfaces
or more: within a frame, the place in ground of a point on a surface is that of the pass in which it
was first asked for, though later passes move it (`_seen`). Lengths and directions use the place first
seen, the force acts at the last one. MuJoCo's tendons take the branch of `_tendon_nodes`.
"""

from __future__ import annotations

import math
from typing import NamedTuple

import numpy as np

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

CYLINDER, SPHERE, ELLIPSOID, TORUS = range(4)
NODE_LOCAL, NODE_OBJECT, NODE_POINT, NODE_WRAP, NODE_END = range(5)
NODE_WEIGHT, NODE_ARC = 3, 4
MOST_PASSES = 8
SETTLED = 0.0005
COINCIDENT = 1e-14
SLACK = 1e-5


class PathScratch(NamedTuple):
    """Room to work in, one per thread.

    Attributes
    ----------
    x : (nodes, 5) place in ground [m], NODE_WEIGHT: share in the length of what follows the node,
        NODE_ARC: length on the surface up to a node that leaves it [m]
    node : (nodes, 5) NODE_LOCAL: number of the body among the muscle's, NODE_OBJECT: surface,
        NODE_POINT: row of `point`, NODE_WRAP: row of `wrap`, NODE_END: row of `seen`; -1 for none
    seen : (2 wraps, 4) places first seen of the points on surfaces [m], and 1 once they are
    turns : (2, wraps) order of the wraps, and their latest results
    pull : (muscle's bodies, 6) force of unit tension and its moment about the ground's origin
    pose : (surfaces, 12) rotation row by row and place in ground
    slopes : (couplers, 2)
    ends : (3, 3) of `wrap_tendon`: both ends of the arc, the side point; or of `_move`
    """

    x: Array
    node: Ints
    seen: Array
    turns: Ints
    pull: Array
    pose: Array
    slopes: Array
    ends: Array


@inner
def path_scratch(P):
    """Room for `path_frame`."""
    nodes, wraps, bodies = P.sizes[0] + 2, P.sizes[1], P.sizes[2]
    return PathScratch(
        np.zeros((nodes, 5)),
        np.zeros((nodes, 5), np.int64),
        np.zeros((2 * wraps, 4)),
        np.zeros((2, wraps), np.int64),
        np.zeros((bodies, 6)),
        np.zeros((P.object.shape[0], 12)),
        np.zeros((P.coupler.shape[0], 2)),
        np.zeros((3, 3)),
    )


@inner
def path_frame(P, c, cdot, R, p, w, o, dphi, S, lengths, velocities, arms):
    """Lengths, velocities and moment arms of all muscles in one frame.

    Parameters
    ----------
    P : `PathArrays`
    c, cdot : (coordinates,) values and speeds, dependent values consistent; dependent speeds are not read
    R, p, w, o, dphi : as `body_poses` fills them
    S : from `path_scratch`
    lengths, velocities : (muscles,) filled [m, m/s]
    arms : (moment arms,) filled in the order of the pattern; a coordinate that others follow has what
        reaches the muscle through them included, one that follows has its own share [m/rad or m/m]
    """
    coupler_slopes(P, c, S.slopes)
    _place_objects(P.object, P.object_pose, R, p, S.pose)
    for m in range(P.start.shape[0] - 1):
        count = _point_nodes(P, m, c, R, p, S.x, S.node, S.ends)
        first, stop = P.start[m, WRAPS], P.start[m + 1, WRAPS]
        if stop > first:
            for i in range(2 * (stop - first)):
                S.seen[i, 3] = 0.0
            if P.wrap[first, AFTER] >= 0:
                count = _tendon_nodes(P, m, R, p, S, count)
            else:
                count = _wrapped_nodes(P, m, S, count)
        lengths[m] = _length(S.x, S.node, S.seen, count)
        for k in range(P.start[m, ARMS], P.start[m + 1, ARMS]):
            arms[k] = 0.0
        _pulls(P, m, c, R, S.x, S.node, S.seen, S.pull, S.ends, count, arms)
        _gather(P, m, w, o, dphi, S.pull, S.slopes, arms)
        speed = 0.0
        for k in range(P.start[m, ARMS], P.start[m + 1, ARMS]):
            if P.arm[k, 1] == 1:
                speed -= arms[k] * cdot[P.arm[k, 0]]
        velocities[m] = speed


@inner
def coupler_slopes(P, c, slopes):
    """Fill slopes (couplers, 2) of the dependent coordinates in those they follow."""
    for k in range(P.coupler.shape[0]):
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
def _point_nodes(P, m, c, R, p, nodes_x, nodes, ends):
    """Put the active points of muscle m in the chain; returns how many."""
    count = 0
    for k in range(P.start[m, POINTS], P.start[m + 1, POINTS]):
        j = P.point[k, COORDINATE]
        if j >= 0 and not P.place[k, LOW] - SLACK <= c[j] <= P.place[k, HIGH] + SLACK:
            continue
        x, y, z = P.place[k, 0], P.place[k, 1], P.place[k, 2]
        v = P.point[k, MOVING]
        if v >= 0:
            _move(P.moving, P.moving_range, P.functions, v, c, ends)
            x, y, z = ends[0, 0], ends[0, 1], ends[0, 2]
        b = P.point[k, BODY]
        for i in range(3):
            nodes_x[count, i] = R[b, i, 0] * x + R[b, i, 1] * y + R[b, i, 2] * z + p[b, i]
        nodes_x[count, NODE_WEIGHT], nodes_x[count, NODE_ARC] = P.place[k, WEIGHT], 0.0
        nodes[count, NODE_LOCAL], nodes[count, NODE_OBJECT] = P.point[k, LOCAL], -1
        nodes[count, NODE_POINT], nodes[count, NODE_WRAP], nodes[count, NODE_END] = k, -1, -1
        count += 1
    return count


@inner
def _move(moving, ranges, functions, v, c, out):
    """Fill out (2, 3) with the place of moving point v in its body, and its derivative in the coordinates."""
    for i in range(3):
        j = moving[v, 3 + i]
        low, high = ranges[v, 2 * i], ranges[v, 2 * i + 1]
        at = min(max(c[j], low), high) if j >= 0 else 0.0
        out[0, i], slope, _, _, _, _ = evaluate(functions, moving[v, i], at, 0.0)
        # Beyond the range the point stands still.
        out[1, i] = slope if j >= 0 and low <= c[j] <= high else 0.0


@inner
def _insert(x, node, at, count, local, surface, wrap, end, r, s, arc):
    """Put both ends of an arc into the chain after node `at`; `end` is the first one's row of `seen`."""
    for k in range(count - 1, at, -1):
        for i in range(5):
            x[k + 2, i], node[k + 2, i] = x[k, i], node[k, i]
    for i in range(3):
        x[at + 1, i], x[at + 2, i] = r[i], s[i]
    for k in range(at + 1, at + 3):
        x[k, NODE_WEIGHT] = x[at, NODE_WEIGHT]
        node[k, NODE_LOCAL], node[k, NODE_OBJECT] = local, surface
        node[k, NODE_POINT], node[k, NODE_WRAP], node[k, NODE_END] = -1, wrap, end + k - at - 1
    x[at + 1, NODE_ARC], x[at + 2, NODE_ARC] = 0.0, arc
    return count + 2


@inner
def _without(x, node, count, wrap):
    """Take the nodes of a wrap out of the chain."""
    for k in range(count - 1):
        if node[k, NODE_WRAP] == wrap:
            for n in range(k, count - 2):
                for i in range(5):
                    x[n, i], node[n, i] = x[n + 2, i], node[n + 2, i]
            return count - 2
    return count


@inner
def _tendon_nodes(P, m, R, p, S, count):
    """Wrap the chain in the way of MuJoCo: each surface between the two points around it."""
    rotation = np.empty((3, 3))
    for k in range(P.start[m, WRAPS], P.start[m + 1, WRAPS]):
        at = 0
        while S.node[at, NODE_POINT] != P.start[m, POINTS] + P.wrap[k, AFTER]:
            at += 1
        b, g = P.wrap[k, SIDE_BODY], P.wrap[k, OBJECT]
        for i in range(3):
            for j in range(3):
                rotation[i, j] = S.pose[g, 3 * i + j]
            if b >= 0:
                side = P.wrap_side[k]
                S.ends[2, i] = R[b, i, 0] * side[0] + R[b, i, 1] * side[1] + R[b, i, 2] * side[2] + p[b, i]
        arc = wrap_tendon(
            S.x[at, :3],
            S.x[at + 1, :3],
            0 if P.object[g, KIND] == SPHERE else 1,
            P.object_size[g, 0],
            rotation,
            S.pose[g, 9:],
            S.ends[2],
            b >= 0,
            S.ends[:2],
        )
        if arc >= 0.0:
            r = (S.ends[0, 0], S.ends[0, 1], S.ends[0, 2])
            s = (S.ends[1, 0], S.ends[1, 1], S.ends[1, 2])
            end = 2 * (k - P.start[m, WRAPS])
            count = _insert(S.x, S.node, at, count, P.wrap[k, OBJECT_LOCAL], g, k, end, r, s, arc)
    return count


@inner
def _wrapped_nodes(P, m, S, count):
    """Wrap the chain in the way of OpenSim: surface after surface, until the length settles."""
    start = P.start[m, WRAPS]
    wraps = P.start[m + 1, WRAPS] - start
    order, result = S.turns[0], S.turns[1]
    for i in range(wraps):
        order[i] = i
    before = math.inf
    for turn in range(MOST_PASSES if wraps > 1 else 1):
        for i in range(wraps):
            k = start + order[i]
            g = P.wrap[k, OBJECT]
            result[i] = NO_WRAP
            count = _without(S.x, S.node, count, k)
            if P.object[g, ACTIVE] == 0:
                continue
            points = P.start[m, POINTS]
            first, last = _between_points(S.node, count, points + P.wrap[k, FIRST], points + P.wrap[k, LAST])
            if first < 0:
                return count
            result[i], at, arc, r, s = _best_wrap(
                P.object[g], P.object_size[g], S.pose[g], P.wrap[k, METHOD], S.x, S.node, S.seen, first, last, wraps
            )
            if at >= 0:
                end = 2 * (k - start)
                count = _insert(S.x, S.node, at, count, P.wrap[k, OBJECT_LOCAL], g, k, end, r, s, arc)
        if wraps == 1:
            return count
        length = _length(S.x, S.node, S.seen, count)
        if abs(length - before) < SETTLED:
            return count
        before = length
        if turn == 0 and result[0] == NO_WRAP and result[1] == INSIDE:
            order[0], order[1] = 1, 0
            count = _without(S.x, S.node, count, start)
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
def _best_wrap(row, size, pose, method, x, node, seen, first, last, wraps):
    """The segment on which a surface lengthens the path least, or the first that runs through it.

    Returns the last code, the node before the segment (-1 for none), arc, and both ends in ground.
    """
    none = (0.0, 0.0, 0.0)
    least, at, best_arc, best_r, best_s = math.inf, -1, 0.0, none, none
    kind, axis, side = row[KIND], row[AXIS], row[SIDE]
    sizes = (size[0], size[1], size[2])
    code = NO_WRAP
    for i in range(first, last):
        if node[i, NODE_OBJECT] >= 0 and node[i, NODE_OBJECT] == node[i + 1, NODE_OBJECT]:
            continue
        a, b = _into(pose, (x[i, 0], x[i, 1], x[i, 2])), _into(pose, (x[i + 1, 0], x[i + 1, 1], x[i + 1, 2]))
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
            a, b = _into(pose, _seen(x, node, seen, i)), _into(pose, _seen(x, node, seen, i + 1))
            longer = _between(a, r) + arc + _between(b, s) - _between(a, b)
            if longer < least:
                least, at, best_arc, best_r, best_s = longer, i, arc, r, s
    return code, at, best_arc, _out_of(pose, best_r), _out_of(pose, best_s)


@inner
def _between(a, b):
    x, y, z = b[0] - a[0], b[1] - a[1], b[2] - a[2]
    return math.sqrt(x * x + y * y + z * z)


@inner
def _seen(x, node, seen, i):
    """Where OpenSim takes node i to be in ground: the place at which it was first asked for."""
    end = node[i, NODE_END]
    if end < 0:
        return x[i, 0], x[i, 1], x[i, 2]
    if seen[end, 3] == 0.0:
        seen[end, 0], seen[end, 1], seen[end, 2], seen[end, 3] = x[i, 0], x[i, 1], x[i, 2], 1.0
    return seen[end, 0], seen[end, 1], seen[end, 2]


@inner
def _into(pose, a):
    """A point in ground, in the frame of a surface."""
    x, y, z = a[0] - pose[9], a[1] - pose[10], a[2] - pose[11]
    return (
        pose[0] * x + pose[3] * y + pose[6] * z,
        pose[1] * x + pose[4] * y + pose[7] * z,
        pose[2] * x + pose[5] * y + pose[8] * z,
    )


@inner
def _out_of(pose, a):
    """A point in the frame of a surface, in ground."""
    return (
        pose[0] * a[0] + pose[1] * a[1] + pose[2] * a[2] + pose[9],
        pose[3] * a[0] + pose[4] * a[1] + pose[5] * a[2] + pose[10],
        pose[6] * a[0] + pose[7] * a[1] + pose[8] * a[2] + pose[11],
    )


@inner
def _length(x, node, seen, count):
    total = 0.0
    for i in range(count - 1):
        a, b = _seen(x, node, seen, i), _seen(x, node, seen, i + 1)
        if node[i, NODE_OBJECT] >= 0 and node[i, NODE_OBJECT] == node[i + 1, NODE_OBJECT]:
            total += x[i, NODE_WEIGHT] * x[i + 1, NODE_ARC]
        else:
            total += x[i, NODE_WEIGHT] * _between(a, b)
    return total


@inner
def _pulls(P, m, c, R, x, node, seen, pull, ends, count, arms):
    """Force and moment of unit tension on each body of the muscle; what moves points goes into `arms`."""
    for b in range(P.start[m + 1, BODIES] - P.start[m, BODIES]):
        for i in range(6):
            pull[b, i] = 0.0
    for n in range(count - 1):
        moves = False
        for k in (node[n, NODE_POINT], node[n + 1, NODE_POINT]):
            moves = moves or (k >= 0 and P.point[k, MOVING] >= 0)
        if node[n, NODE_LOCAL] == node[n + 1, NODE_LOCAL] and not moves:
            continue
        start, stop = _seen(x, node, seen, n), _seen(x, node, seen, n + 1)
        length = _between(start, stop)
        if length < COINCIDENT:
            continue
        scale = x[n, NODE_WEIGHT] / length
        for k in range(n, n + 2):
            b = node[k, NODE_LOCAL]
            fx, fy, fz = scale * (stop[0] - start[0]), scale * (stop[1] - start[1]), scale * (stop[2] - start[2])
            pull[b, 0] += fx
            pull[b, 1] += fy
            pull[b, 2] += fz
            pull[b, 3] += x[k, 1] * fz - x[k, 2] * fy
            pull[b, 4] += x[k, 2] * fx - x[k, 0] * fz
            pull[b, 5] += x[k, 0] * fy - x[k, 1] * fx
            v = P.point[node[k, NODE_POINT], MOVING] if node[k, NODE_POINT] >= 0 else -1
            if v >= 0:
                b = P.point[node[k, NODE_POINT], BODY]
                _move(P.moving, P.moving_range, P.functions, v, c, ends)
                for i in range(3):
                    place = P.moving[v, 6 + i]
                    if place >= 0:
                        work = R[b, 0, i] * fx + R[b, 1, i] * fy + R[b, 2, i] * fz
                        arms[P.start[m, ARMS] + place] += ends[1, i] * work
            scale = -scale


@inner
def _gather(P, m, w, o, dphi, pull, slopes, arms):
    """Add what the forces do along the axes, and let dependent coordinates add to those they follow."""
    start = P.start[m, ARMS]
    for q in range(P.start[m, AXES], P.start[m + 1, AXES]):
        fx, fy, fz, mx, my, mz = 0.0, 0.0, 0.0, 0.0, 0.0, 0.0
        for n in range(P.axis[q, SUPPORT], P.axis[q, SUPPORT_STOP]):
            b = P.support[n]
            fx += pull[b, 0]
            fy += pull[b, 1]
            fz += pull[b, 2]
            mx += pull[b, 3]
            my += pull[b, 4]
            mz += pull[b, 5]
        k = P.axis[q, TREE_AXIS]
        if P.axis[q, ROTATES] == 1:
            x, y, z = o[k, 0], o[k, 1], o[k, 2]
            fx, fy, fz = mx - (y * fz - z * fy), my - (z * fx - x * fz), mz - (x * fy - y * fx)
        work = w[k, 0] * fx + w[k, 1] * fy + w[k, 2] * fz
        if P.axis[q, SLOT_1] >= 0:
            arms[start + P.axis[q, SLOT_1]] += dphi[k, 0] * work
        if P.axis[q, SLOT_2] >= 0:
            arms[start + P.axis[q, SLOT_2]] += dphi[k, 1] * work
    for q in range(P.start[m, FOLLOWS], P.start[m + 1, FOLLOWS]):
        k, own = P.follow[q, 0], arms[start + P.follow[q, 1]]
        if P.follow[q, 2] >= 0:
            arms[start + P.follow[q, 2]] += slopes[k, 0] * own
        if P.follow[q, 3] >= 0:
            arms[start + P.follow[q, 3]] += slopes[k, 1] * own
