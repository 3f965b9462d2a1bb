"""Derivatives of marker positions in the lengths of bodies.

For fixed angles the position of a marker is linear in the factors of the bodies between it and the
ground and in its location on its body:

    x = sum over the chain of R (factor * offset) + R_b (factor * location + shift),

so that the derivatives below are exact. `frame_blocks` makes normal equations of them.
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
from myomorph.core.motion.tasks.markers import MarkerArrays
from myomorph.core.rigid.coordinates import Ints, evaluate_at, gather_dependents
from myomorph.core.rigid.kernels import bare, in_place, inner, kernel
from myomorph.core.rigid.kinematics import PoseArrays, body_poses, pose_room
from myomorph.core.rigid.tree import ROTATION, compile_tree
from myomorph.core.rigid.vectors import about, along, cross, matrix, minus, product, turned, vector


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


class SlopeRoom(NamedTuple):
    """Arrays of one frame that `marker_slopes` fills.

    Attributes
    ----------
    R, p, w, o, dphi : poses of bodies and axes, as `body_poses` fills them
    origins : (bodies, 3, lengths) derivatives of the bodies' origins [m]
    places : (markers, 3) positions in ground [m]
    by_length : (3 markers, lengths) their derivatives [m]
    by_coordinate : (3 markers, coordinates) their derivatives [m/rad or 1]
    """

    R: Array
    p: Array
    w: Array
    o: Array
    dphi: Array
    origins: Array
    places: Array
    by_length: Array
    by_coordinate: Array


@inner
def slope_room(T, markers, lengths, coordinates):
    """Make room for a number of markers, of lengths and of coordinates."""
    pose = pose_room(T)
    return SlopeRoom(
        R=pose.R,
        p=pose.p,
        w=pose.w,
        o=pose.o,
        dphi=pose.dphi,
        origins=np.empty((T.parent.shape[0], 3, lengths)),
        places=np.empty((markers, 3)),
        by_length=np.empty((3 * markers, lengths)),
        by_coordinate=np.empty((3 * markers, coordinates)),
    )


@bare
def marker_slopes(T, markers, stretch, c, room):
    """Fill the markers' positions in one frame and their derivatives in lengths and coordinates.

    Derivatives in independent coordinates include their dependent ones.

    Parameters
    ----------
    T : arrays of the tree
    markers : `MarkerArrays`
    stretch : `Stretch`
    c : (coordinates,) consistent [rad or m]
    room : `SlopeRoom`, filled
    """
    body_poses(T, c, PoseArrays(R=room.R, p=room.p, w=room.w, o=room.o, dphi=room.dphi))
    for i in range(3):
        for j in range(room.origins.shape[2]):
            room.origins[0, i, j] = 0.0
    for b in range(1, T.parent.shape[0]):
        _stretch_origin(T, stretch, c, b, room)
    for row in range(room.by_coordinate.shape[0]):
        for j in range(room.by_coordinate.shape[1]):
            room.by_coordinate[row, j] = 0.0
    for m in range(markers.body.shape[0]):
        _differentiate_marker(T, markers, stretch, m, room)
    gather_dependents(T, c, room.by_coordinate)


@in_place
def _stretch_origin(T, stretch, c, b, room):
    """Fill the derivatives of the origin of body b from those of its parent.

    Along the joint r is the rotation to ground of what comes next.
    """
    parent = T.parent[b]
    r = matrix(room.R, parent)
    origin = room.origins[b]
    for i in range(3):
        for j in range(origin.shape[1]):
            origin[i, j] = room.origins[parent, i, j]
    for axis in range(T.axis_start[b], T.axis_start[b + 1]):
        _add_offset(stretch.column, stretch.pre[axis], parent, b, r, origin)
        r = product(r, matrix(T.pre_R, axis))
        first = T.axis_coordinate[axis, 0]
        second = T.axis_coordinate[axis, 1]
        q = evaluate_at(T.functions, T.axis_function[axis], first, second, c)[0]
        if T.axis_kind[axis] == ROTATION:
            r = product(r, about(vector(T.axis_vector, axis), q))
        else:
            _add_travel(stretch, parent, axis, q, room.w, origin)
    _add_offset(stretch.column, stretch.post[b], parent, b, r, origin)


@bare
def _add_travel(stretch, parent, axis, q, w, origin):
    """Add the derivatives of a sliding axis's motion in the factors of the parent.

    Parameters
    ----------
    stretch : `Stretch`
    parent, axis : their numbers
    q : the motion [m]
    w : (axes, 3) directions in ground
    origin : (3, lengths) added to [m]
    """
    for t in range(3):
        column = stretch.column[parent, t]
        if column >= 0:
            for i in range(3):
                origin[i, column] += w[axis, i] * q * stretch.travel[axis, t]


@bare
def _add_offset(column, slopes, parent, b, r, origin):
    """Add the derivatives of an offset between parent and child in their factors.

    Parameters
    ----------
    column : (bodies, 3) of `Stretch`
    slopes : (3, 6) derivatives in the parent's frame [m]
    parent, b : numbers of parent and child
    r : rotation from the offset's frame to ground
    origin : (3, lengths) added to [m]
    """
    for t in range(6):
        at = column[parent, t] if t < 3 else column[b, t - 3]
        if at >= 0:
            moved = turned(r, (slopes[0, t], slopes[1, t], slopes[2, t]))
            for i in range(3):
                origin[i, at] += moved[i]


@in_place
def _differentiate_marker(T, markers, stretch, m, room):
    """Fill position and derivatives of marker m; those in coordinates are added to zeros."""
    b = markers.body[m]
    x = along(vector(room.p, b), 1.0, turned(matrix(room.R, b), vector(markers.location, m)))
    for i in range(3):
        room.places[m, i] = x[i]
        for j in range(room.by_length.shape[1]):
            room.by_length[3 * m + i, j] = room.origins[b, i, j]
        for t in range(3):
            column = stretch.column[b, t]
            if column >= 0:
                room.by_length[3 * m + i, column] += room.R[b, i, t] * stretch.location[m, t]
    h = b
    while h > 0:
        for axis in range(T.axis_start[h], T.axis_start[h + 1]):
            u = vector(room.w, axis)
            moved = cross(u, minus(x, vector(room.o, axis))) if T.axis_kind[axis] == ROTATION else u
            _add_motion(T, axis, moved, m, room.dphi, room.by_coordinate)
        h = T.parent[h]


@bare
def _add_motion(T, axis, moved, m, dphi, by_coordinate):
    """Add how an axis, at whose rate 1 marker m has the velocity `moved`, follows coordinates."""
    for t in range(2):
        j = T.axis_coordinate[axis, t]
        if j >= 0:
            for i in range(3):
                by_coordinate[3 * m + i, j] += dphi[axis, t] * moved[i]


@kernel
def slopes_of_frame(T, markers, stretch, c):
    """Compute the positions of markers in one frame and their derivatives, as `marker_slopes`.

    Parameters
    ----------
    T : arrays of the tree
    markers : `MarkerArrays`
    stretch : `Stretch`
    c : (coordinates,) consistent [rad or m]

    Returns
    -------
    positions (markers, 3) [m], then derivatives (3 markers, lengths) [m] and (3 markers,
    coordinates) [m/rad or 1]
    """
    room = slope_room(T, markers.body.shape[0], stretch.column.max() + 1, c.shape[0])
    marker_slopes(T, markers, stretch, c, room)
    return room.places, room.by_length, room.by_coordinate
