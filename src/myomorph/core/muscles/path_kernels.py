"""All muscle paths, frame by frame: lengths, lengthening velocities and moment arms."""

from __future__ import annotations

import numpy as np

from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles import path_chain as chain
from myomorph.core.rigid.coordinates import couple, evaluate, evaluate_at
from myomorph.core.rigid.kernels import in_place, inner, kernel
from myomorph.core.rigid.kinematics import body_poses, pose_room
from myomorph.core.rigid.vectors import (
    cross,
    dot,
    matrix,
    minus,
    plus,
    put_vector,
    times,
    turned,
    vector,
)

MIN_PART = 1e-14  # Length of a straight part that pulls [m]
SLACK = 1e-5  # Beyond its range in which a coordinate still gives the path a point [rad or m]


@inner
def path_scratch(paths):
    """Make scratch arrays for `path_frames`, one set per thread.

    Returns
    -------
    x : (nodes, 8) position in ground [m], NODE_WEIGHT: share in the length of what follows the
        node, NODE_ARC: length on the surface up to a node that leaves it [m], SEEN ...: position at
        which OpenSim takes the node to be in ground [m]
    node : (nodes, 5) NODE_LOCAL: number of the body among the muscle's, NODE_OBJECT: surface,
        NODE_POINT: row of `point`, NODE_WRAP: row of `wrap`, NODE_END: row of `seen`, -1 for none
    seen : (2 wraps, 4) positions first seen of the points on surfaces [m], and 1 once they are
    turns : (2, wraps) order of the wraps, and their latest results
    pull : (muscle's bodies, 6) force of unit tension and its moment about the ground's origin
    pose : (surfaces, 12) rotation row by row and position in ground
    slopes : (couplers, 2)
    moved : (moving points, 6) position in the body [m], and its derivative in the coordinates
    ends : (9, 3) arguments of `wrap_tendon`
    """
    nodes = paths.sizes[0] + 2
    wraps = paths.sizes[1]
    bodies = paths.sizes[2]
    return (
        np.zeros((nodes, 8)),
        np.zeros((nodes, 5), np.int64),
        np.zeros((2 * wraps, 4)),
        np.zeros((2, wraps), np.int64),
        np.zeros((bodies, 6)),
        np.zeros((paths.object.shape[0], 12)),
        np.zeros((paths.coupler.shape[0], 2)),
        np.zeros((paths.moving.shape[0], 6)),
        np.zeros((9, 3)),
    )


@kernel
def path_frames(T, paths, surfaces, tendons, c, cdot, lengths, velocities, arms, pulls, nodes):
    """Lengths, velocities and moment arms of all muscles, frame by frame.

    Moment arms by virtual work: unit tension pulls with (f, m) on each body, and

        r_j = sum over axes of dphi/dc_j (w . (m - o x f) or w . f),   ldot = -sum r_j cdot_j

    with the sums of f and m over the muscle's bodies that hang on the axis.

    Parameters
    ----------
    T, paths : `TreeArrays`, `PathArrays`
    surfaces, tendons : 1 where a path wraps by the rules of OpenSim or of MuJoCo, else None, for
        which they are not compiled: they are half of this kernel
    c, cdot : (frames, coordinates) values, of which dependent ones are set here, and speeds, of
        which dependent ones are not read
    lengths, velocities : (frames, muscles) filled [m], [m/s]
    arms : (frames, moment arms) filled in the order of the pattern; a coordinate that others follow
        has what reaches the muscle through them included, a dependent one its own share [m/rad or
        m/m]
    pulls : (frames, muscles' bodies, 6) filled with what unit tension does to each body of each
        muscle, a force and its moment about the ground's origin [1, m], and `arms` then holds only
        the work of points that move in their bodies; with 0 bodies where not requested
    nodes : (frames, muscles, nodes, 4) filled with the positions of each path's points and of both
        ends of its arcs in ground, and the length of the arc that ends there, 0 for a straight part
        [m]; what is beyond the path's last point is left; with 0 muscles where not requested
    """
    # Taken out of the bundles once: taking them out in a loop counts references each time, which
    # cost more than the arithmetic.
    start = paths.start
    point = paths.point
    place = paths.place
    moving = paths.moving
    wrap = paths.wrap
    surface = paths.object
    size = paths.object_size
    side = paths.wrap_side
    axis = paths.axis
    support = paths.support
    arm = paths.arm
    follow = paths.follow
    fixed_pose = paths.object_pose
    x, node, seen, turns, pull, pose, slopes, moved, ends = path_scratch(paths)
    rotation = ends[:3]
    out = ends[3:5]
    rows = (ends[5], ends[6], ends[7], ends[8])
    body_pose = pose_room(T)
    R = body_pose.R
    p = body_pose.p
    w = body_pose.w
    o = body_pose.o
    dphi = body_pose.dphi
    for f in range(c.shape[0]):
        here = c[f]
        speeds = cdot[f]
        row = arms[f]
        couple(T, here)
        body_poses(T, here, body_pose)
        coupler_slopes(paths, here, slopes)
        _move_points(paths, here, moved)
        _place_objects(surface, fixed_pose, R, p, pose)
        for m in range(start.shape[0] - 1):
            first = start[m, columns.POINTS]
            count = _point_nodes(
                point, place, moved, first, start[m + 1, columns.POINTS], here, R, p, x, node
            )
            begin = start[m, columns.WRAPS]
            end = start[m + 1, columns.WRAPS]
            if end > begin:
                for i in range(2 * (end - begin)):
                    seen[i, 3] = 0.0
                by_mujoco = wrap[begin, columns.AFTER] >= 0
                # Numba leaves out a branch whose condition is None by type, if nothing else stands
                # in the condition.
                if tendons is not None:  # noqa: SIM102
                    if by_mujoco:
                        count = chain.tendon_nodes(
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
                if surfaces is not None:  # noqa: SIM102
                    if not by_mujoco:
                        count = chain.wrapped_nodes(
                            wrap,
                            surface,
                            size,
                            begin,
                            end,
                            first,
                            x,
                            node,
                            seen,
                            turns,
                            pose,
                            count,
                        )
            lengths[f, m] = chain.chain_length(x, node, count)
            if nodes.shape[1] > 0:
                _put_nodes(x, node, count, nodes[f, m])
            begin = start[m, columns.ARMS]
            end = start[m + 1, columns.ARMS]
            for index in range(begin, end):
                row[index] = 0.0
            for b in range(start[m + 1, columns.BODIES] - start[m, columns.BODIES]):
                for i in range(6):
                    pull[b, i] = 0.0
            _pulls(point, moving, moved, R, x, node, pull, count, begin, row)
            if pulls.shape[1] > 0:
                for b in range(start[m, columns.BODIES], start[m + 1, columns.BODIES]):
                    for i in range(6):
                        pulls[f, b, i] = pull[b - start[m, columns.BODIES], i]
            else:
                _gather(
                    axis,
                    support,
                    start[m, columns.AXES],
                    start[m + 1, columns.AXES],
                    w,
                    o,
                    dphi,
                    pull,
                    begin,
                    row,
                )
            _hand_on(
                follow, slopes, start[m, columns.FOLLOWS], start[m + 1, columns.FOLLOWS], begin, row
            )
            speed = 0.0
            for index in range(begin, end):
                if arm[index, 1] == 1:
                    speed -= row[index] * speeds[arm[index, 0]]
            velocities[f, m] = speed


@in_place
def _put_nodes(x, node, count, table):
    """Fill `table` (nodes, 4) with positions of a path's points and arcs that end there."""
    for n in range(count):
        for i in range(3):
            table[n, i] = x[n, i]
        arc = (
            n > 0
            and node[n, chain.NODE_OBJECT] >= 0
            and node[n, chain.NODE_OBJECT] == node[n - 1, chain.NODE_OBJECT]
        )
        table[n, 3] = x[n, chain.NODE_ARC] if arc else 0.0


@in_place
def _hand_on(follow, slopes, start, stop, arm, arms):
    """Add what reaches coordinates through those that follow them: r_i += g_i r_d."""
    for row in range(start, stop):
        coupler = follow[row, 0]
        dependent_arm = arms[arm + follow[row, 1]]
        for i in range(2):
            if follow[row, 2 + i] >= 0:
                arms[arm + follow[row, 2 + i]] += slopes[coupler, i] * dependent_arm


@inner
def coupler_slopes(paths, c, slopes):
    """Fill slopes (couplers, 2) of the dependent coordinates in those they follow."""
    for index in range(slopes.shape[0]):
        function = paths.coupler[index, 0]
        i = paths.coupler[index, 1]
        j = paths.coupler[index, 2]
        _, slopes[index, 0], slopes[index, 1], _, _, _ = evaluate_at(
            paths.functions, function, i, j, c
        )


@inner
def _place_objects(rows, poses, R, p, placed):
    """Fill `placed` (surfaces, 12) with the poses of all surfaces in ground."""
    for index in range(rows.shape[0]):
        b = rows[index, columns.OBJECT_BODY]
        for i in range(3):
            x = p[b, i]
            for j in range(3):
                x += R[b, i, j] * poses[index, 9 + j]
                placed[index, 3 * i + j] = (
                    R[b, i, 0] * poses[index, j]
                    + R[b, i, 1] * poses[index, 3 + j]
                    + R[b, i, 2] * poses[index, 6 + j]
                )
            placed[index, 9 + i] = x


@inner
def _point_nodes(point, place, moved, start, stop, c, R, p, x, node):
    """Put a muscle's active points in the chain; returns how many."""
    count = 0
    for index in range(start, stop):
        j = point[index, columns.COORDINATE]
        if (
            j >= 0
            and not place[index, columns.LOW] - SLACK <= c[j] <= place[index, columns.HIGH] + SLACK
        ):
            continue
        v = point[index, columns.MOVING]
        b = point[index, columns.BODY]
        at = vector(moved, v) if v >= 0 else vector(place, index)
        put_vector(x, count, plus(turned(matrix(R, b), at), vector(p, b)))
        for i in range(3):
            x[count, chain.SEEN + i] = x[count, i]
        x[count, chain.NODE_WEIGHT] = place[index, columns.WEIGHT]
        x[count, chain.NODE_ARC] = 0.0
        node[count, chain.NODE_LOCAL] = point[index, columns.LOCAL]
        node[count, chain.NODE_OBJECT] = -1
        node[count, chain.NODE_POINT] = index
        node[count, chain.NODE_WRAP] = -1
        node[count, chain.NODE_END] = -1
        count += 1
    return count


@inner
def _move_points(paths, c, moved):
    """Fill moved (moving points, 6): place in the body, and its derivative in the coordinates."""
    for v in range(moved.shape[0]):
        for i in range(3):
            j = paths.moving[v, 3 + i]
            low = paths.moving_range[v, 2 * i]
            high = paths.moving_range[v, 2 * i + 1]
            at = min(max(c[j], low), high) if j >= 0 else 0.0
            moved[v, i], slope, _, _, _, _ = evaluate(paths.functions, paths.moving[v, i], at, 0.0)
            # Beyond the range the point stands still.
            moved[v, 3 + i] = slope if j >= 0 and low <= c[j] <= high else 0.0


@inner
def _pulls(point, moving, moved, R, x, node, pull, count, arm, arms):
    """Add force and moment of unit tension to each body of the muscle.

    Each straight part pulls its ends towards each other, with its weight; parts within one body do
    nothing, unless their points move in it.

    Parameters
    ----------
    pull : (muscle's bodies, 6) added to
    arm : column of the muscle's first moment arm in `arms`, to which the work of moving points is
        added
    """
    for n in range(count - 1):
        i = node[n, chain.NODE_POINT]
        j = node[n + 1, chain.NODE_POINT]
        v = point[i, columns.MOVING] if i >= 0 else -1
        u = point[j, columns.MOVING] if j >= 0 else -1
        if node[n, chain.NODE_LOCAL] == node[n + 1, chain.NODE_LOCAL] and v < 0 and u < 0:
            continue
        start = chain.seen_at(x, n)
        stop = chain.seen_at(x, n + 1)
        length = chain.between(start, stop)
        if length < MIN_PART:
            continue
        scale = x[n, chain.NODE_WEIGHT] / length
        force = times(scale, minus(stop, start))
        back = times(-1.0, force)
        _pull(pull, node[n, chain.NODE_LOCAL], x, n, force)
        _pull(pull, node[n + 1, chain.NODE_LOCAL], x, n + 1, back)
        if v >= 0:
            _work(moving, moved, v, R, point[i, columns.BODY], force, arm, arms)
        if u >= 0:
            _work(moving, moved, u, R, point[j, columns.BODY], back, arm, arms)


@inner
def _pull(pull, b, x, n, force):
    """Add a force at node n to body b of the muscle."""
    moment = cross(vector(x, n), force)
    for i in range(3):
        pull[b, i] += force[i]
        pull[b, 3 + i] += moment[i]


@inner
def _work(moving, moved, v, R, b, force, arm, arms):
    """Add the work of a force on moving point v of body b, per unit of its coordinates."""
    for i in range(3):
        if moving[v, 6 + i] >= 0:
            share = R[b, 0, i] * force[0] + R[b, 1, i] * force[1] + R[b, 2, i] * force[2]
            arms[arm + moving[v, 6 + i]] += moved[v, 3 + i] * share


@inner
def _gather(axis, support, start, stop, w, o, dphi, pull, arm, arms):
    """Add what the forces do along the axes that lie between the muscle's bodies."""
    for q in range(start, stop):
        force = (0.0, 0.0, 0.0)
        moment = (0.0, 0.0, 0.0)
        for n in range(axis[q, columns.SUPPORT], axis[q, columns.SUPPORT_STOP]):
            b = support[n]
            force = plus(force, vector(pull, b))
            moment = plus(moment, (pull[b, 3], pull[b, 4], pull[b, 5]))
        index = axis[q, columns.TREE_AXIS]
        along = (
            minus(moment, cross(vector(o, index), force))
            if axis[q, columns.ROTATES] == 1
            else force
        )
        work = dot(vector(w, index), along)
        if axis[q, columns.SLOT_1] >= 0:
            arms[arm + axis[q, columns.SLOT_1]] += dphi[index, 0] * work
        if axis[q, columns.SLOT_2] >= 0:
            arms[arm + axis[q, columns.SLOT_2]] += dphi[index, 1] * work
