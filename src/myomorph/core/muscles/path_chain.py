"""A muscle's path as a chain of nodes: the rules by which it touches one surface or several.

The chain has a node for each active point, and two more for each surface the path touches. The
rules are those of OpenSim's `GeometryPath` (4.6). It keeps the last wrap from frame to frame but
loses it before it is used, so frames do not depend on history.

A quirk of OpenSim 4.6 is kept, since it changes lengths by millimeters where a path has two
surfaces or more: within a frame, the place in ground of a point on a surface is that of the pass in
which it was first asked for, though later passes move it (`_look_at`). Lengths and directions use
the place first seen, the force acts at the last one. OpenSim's lengthening speed then has a part
that is no rate of length (it is not zero when the whole body turns); ours is -sum r qdot. MuJoCo's
tendons take `tendon_nodes`.
"""

from __future__ import annotations

import math

from myomorph.core.muscles.path_arrays import (
    ACTIVE,
    AFTER,
    AXIS,
    FIRST,
    KIND,
    LAST,
    METHOD,
    OBJECT,
    OBJECT_LOCAL,
    SIDE,
    SIDE_BODY,
)
from myomorph.core.muscles.wrap_cylinder import (
    INSIDE,
    MANDATORY,
    NO_WRAP,
    WRAPPED,
    Half,
    wrap_cylinder,
)
from myomorph.core.muscles.wrap_ellipsoid import wrap_ellipsoid
from myomorph.core.muscles.wrap_sphere import wrap_sphere
from myomorph.core.muscles.wrap_tendon import NO_SIDE, wrap_tendon
from myomorph.core.muscles.wrap_torus import wrap_torus
from myomorph.core.rigid.kernels import bare, inner
from myomorph.core.rigid.vectors import minus, norm, plus, turned, turned_back, vector

CYLINDER, SPHERE, ELLIPSOID, TORUS = range(4)
# Columns of `node` and `x`, see `path_scratch`
NODE_LOCAL, NODE_OBJECT, NODE_POINT, NODE_WRAP, NODE_END = range(5)
NODE_WEIGHT = 3
NODE_ARC = 4
SEEN = 5
# OpenSim's: passes over several surfaces, and change of length that ends them [m]
MAX_PASSES = 8
TOLERANCE = 0.0005


@inner
def _insert(x, node, seen, at, count, local, surface, wrap, end, r, s, arc):
    """Put both ends of an arc into the chain.

    Parameters
    ----------
    x, node, seen : of `path_scratch`
    at, count : node after which they go, and number of nodes before
    local, surface, wrap : body among the muscle's, surface and row of `wrap`
    end : row of `seen` of the first end; the second has the next
    r, s : both ends in ground [m]
    arc : length between them [m]

    Returns
    -------
    number of nodes after
    """
    for index in range(count - 1, at, -1):
        for i in range(8):
            x[index + 2, i] = x[index, i]
        for i in range(5):
            node[index + 2, i] = node[index, i]
    for i in range(3):
        x[at + 1, i] = r[i]
        x[at + 2, i] = s[i]
    for index in range(at + 1, at + 3):
        row = end + index - at - 1
        x[index, NODE_WEIGHT] = x[at, NODE_WEIGHT]
        node[index, NODE_LOCAL] = local
        node[index, NODE_OBJECT] = surface
        node[index, NODE_POINT] = -1
        node[index, NODE_WRAP] = wrap
        node[index, NODE_END] = row
        for i in range(3):
            x[index, SEEN + i] = seen[row, i] if seen[row, 3] == 1.0 else x[index, i]
    x[at + 1, NODE_ARC] = 0.0
    x[at + 2, NODE_ARC] = arc
    return count + 2


@inner
def _without(x, node, count, wrap):
    """Take the nodes of a wrap out of the chain; returns how many are left."""
    for index in range(count - 1):
        if node[index, NODE_WRAP] == wrap:
            for n in range(index, count - 2):
                for i in range(8):
                    x[n, i] = x[n + 2, i]
                for i in range(5):
                    node[n, i] = node[n + 2, i]
            return count - 2
    return count


@inner
def tendon_nodes(
    wrap,
    wrap_side,
    surface,
    size,
    start,
    stop,
    points,
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
):
    """Wrap the chain in the way of MuJoCo: each surface between the two points around it.

    Parameters
    ----------
    wrap, wrap_side, surface, size : see `PathArrays`
    start, stop : rows of the muscle's wraps
    points : row of its first point
    R, p : of `body_poses`
    x, node, seen, pose : of `path_scratch`
    rotation, rows, out : (3, 3), 4 of (3,) and (2, 3), scratch for the arguments of `wrap_tendon`
    count : number of nodes before

    Returns
    -------
    number of nodes after
    """
    before, after, center, side = rows
    for index in range(start, stop):
        at = 0
        while node[at, NODE_POINT] != points + wrap[index, AFTER]:
            at += 1
        b = wrap[index, SIDE_BODY]
        g = wrap[index, OBJECT]
        for i in range(3):
            before[i] = x[at, i]
            after[i] = x[at + 1, i]
            center[i] = pose[g, 9 + i]
            for j in range(3):
                rotation[i, j] = pose[g, 3 * i + j]
            if b >= 0:
                side[i] = p[b, i]
                for j in range(3):
                    side[i] += R[b, i, j] * wrap_side[index, j]
        kind = 0 if surface[g, KIND] == SPHERE else 1
        rule = wrap[index, METHOD] if b >= 0 else NO_SIDE
        arc = wrap_tendon(before, after, kind, size[g, 0], rotation, center, side, rule, out)
        if arc >= 0.0:
            r = vector(out, 0 * index)
            s = vector(out, 0 * index + 1)
            count = _insert(
                x,
                node,
                seen,
                at,
                count,
                wrap[index, OBJECT_LOCAL],
                g,
                index,
                2 * (index - start),
                r,
                s,
                arc,
            )
    return count


@inner
def wrapped_nodes(wrap, surface, size, start, stop, points, x, node, seen, turns, pose, count):
    """Wrap the chain in the way of OpenSim: surface after surface, until the length settles.

    Parameters
    ----------
    wrap, surface, size : see `PathArrays`
    start, stop : rows of the muscle's wraps
    points : row of its first point
    x, node, seen, turns, pose : of `path_scratch`
    count : number of nodes before

    Returns
    -------
    number of nodes after
    """
    wraps = stop - start
    for i in range(wraps):
        turns[0, i] = i
    before = math.inf
    turn = 0
    left = MAX_PASSES if wraps > 1 else 1
    while left > 0:
        left -= 1
        for i in range(wraps):
            index = start + turns[0, i]
            g = wrap[index, OBJECT]
            turns[1, i] = NO_WRAP
            count = _without(x, node, count, index)
            first, last = _between_points(
                node, count, points + wrap[index, FIRST], points + wrap[index, LAST]
            )
            if surface[g, ACTIVE] == 1:
                if first < 0:
                    # OpenSim then leaves the path as it is, with what later surfaces had before.
                    left = -1
                    break
                turns[1, i], at, arc, r, s = _best_wrap(
                    surface, size, pose, g, wrap[index, METHOD], x, node, seen, first, last, wraps
                )
                if at >= 0:
                    count = _insert(
                        x,
                        node,
                        seen,
                        at,
                        count,
                        wrap[index, OBJECT_LOCAL],
                        g,
                        index,
                        2 * (index - start),
                        r,
                        s,
                        arc,
                    )
        if left > 0:
            for n in range(count):
                _look_at(x, node, seen, n)
            length = chain_length(x, node, count)
            if abs(length - before) < TOLERANCE:
                left = 0
            elif turn == 0 and turns[1, 0] == NO_WRAP and turns[1, 1] == INSIDE:
                turns[0, 0] = 1
                turns[0, 1] = 0
                count = _without(x, node, count, start)
            before = length
            turn = 1
    return count


@inner
def _between_points(node, count, low, high):
    """Nodes of the first and last active points in a range of points, -1 where there is none."""
    first = -1
    last = -1
    for n in range(count):
        if low <= node[n, NODE_POINT] <= high:
            if first < 0:
                first = n
            last = n
    return first, last


@inner
def _best_wrap(surface, size, pose, g, method, x, node, seen, first, last, wraps):
    """Find the segment on which a surface lengthens the path least, or the first through it.

    Parameters
    ----------
    surface, size : see `PathArrays`
    g, method : row of the surface, and method of the wrap
    x, node, seen, pose : of `path_scratch`
    first, last : nodes between which the path may touch the surface
    wraps : number of the muscle's wraps

    Returns
    -------
    code : of the last segment, as of `wrap_cylinder`
    at : node before the segment, -1 for none
    arc : length on the surface [m]
    r, s : both ends in ground [m]
    """
    least = math.inf
    at = -1
    best_arc = 0.0
    best_r = (0.0, 0.0, 0.0)
    best_s = (0.0, 0.0, 0.0)
    kind = surface[g, KIND]
    half = Half(axis=surface[g, AXIS], side=surface[g, SIDE])
    sizes = (size[g, 0], size[g, 1], size[g, 2])
    code = NO_WRAP
    for i in range(first, last):
        if node[i, NODE_OBJECT] >= 0 and node[i, NODE_OBJECT] == node[i + 1, NODE_OBJECT]:
            continue
        a = _into(pose, g, vector(x, i))
        b = _into(pose, g, vector(x, i + 1))
        if kind == CYLINDER:
            code, arc, r, s = wrap_cylinder(a, b, sizes[:2], half, wraps == 1)
        elif kind == SPHERE:
            code, arc, r, s = wrap_sphere(a, b, sizes[0], half)
        elif kind == ELLIPSOID:
            code, arc, r, s = wrap_ellipsoid(a, b, sizes, method, half)
        else:
            code, arc, r, s = wrap_torus(a, b, sizes[:2], half, wraps == 1)
        if code == MANDATORY:
            at = i
            best_arc = arc
            best_r = r
            best_s = s
            break
        if code == WRAPPED:
            _look_at(x, node, seen, i)
            _look_at(x, node, seen, i + 1)
            a = _into(pose, g, seen_at(x, i))
            b = _into(pose, g, seen_at(x, i + 1))
            longer = between(a, r) + arc + between(b, s) - between(a, b)
            if longer < least:
                least = longer
                at = i
                best_arc = arc
                best_r = r
                best_s = s
    return code, at, best_arc, _out_of(pose, g, best_r), _out_of(pose, g, best_s)


@bare
def between(a, b):
    """Distance of two points."""
    return norm(minus(b, a))


@inner
def _look_at(x, node, seen, i):
    """Ask for node i's position: for the rest of the frame OpenSim takes it to stay there."""
    end = node[i, NODE_END]
    if end >= 0 and seen[end, 3] == 0.0:
        seen[end, 0] = x[i, 0]
        seen[end, 1] = x[i, 1]
        seen[end, 2] = x[i, 2]
        seen[end, 3] = 1.0


@inner
def seen_at(x, i):
    """Position at which OpenSim takes node i to be in ground."""
    return x[i, SEEN], x[i, SEEN + 1], x[i, SEEN + 2]


@bare
def _into(pose, g, a):
    """Express a point in ground in the frame of surface g."""
    return turned_back(pose[g], minus(a, (pose[g, 9], pose[g, 10], pose[g, 11])))


@bare
def _out_of(pose, g, a):
    """Express a point in the frame of surface g in ground."""
    return plus(turned(pose[g], a), (pose[g, 9], pose[g, 10], pose[g, 11]))


@inner
def chain_length(x, node, count):
    """Length of the path, arcs included [m]."""
    total = 0.0
    for i in range(count - 1):
        on_surface = node[i, NODE_OBJECT] >= 0 and node[i, NODE_OBJECT] == node[i + 1, NODE_OBJECT]
        part = x[i + 1, NODE_ARC] if on_surface else between(seen_at(x, i), seen_at(x, i + 1))
        total += x[i, NODE_WEIGHT] * part
    return total
