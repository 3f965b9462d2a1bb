"""What all paths of a model read in one frame: poses of bodies and surfaces, and moving points."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.muscles import path_arrays as columns
from myomorph.core.muscles.wrap.surface import Half, Surface
from myomorph.core.rigid.coordinates import couple, evaluate, evaluate_at
from myomorph.core.rigid.kernels import bare, in_place, inner, kernel
from myomorph.core.rigid.kinematics import PoseArrays, body_poses, pose_room
from myomorph.core.rigid.vectors import matrix, plus, product, turned, vector

CENTER = 9  # Column of `PathFrame.surfaces` and `PathArrays.object_pose`, after the rotation


class PathFrame(NamedTuple):
    """One frame of a motion, as paths read it.

    Attributes
    ----------
    bodies : their poses, and those of the axes
    surfaces : (surfaces, 12) rotation to ground, row by row, and center in ground [m]
    moved : (moving points, 6) position of each in its body [m], and its derivative in the
        coordinates [m/rad or m/m]
    slopes : (couplers, 2) of the dependent coordinates in those they follow
    """

    bodies: PoseArrays
    surfaces: Array
    moved: Array
    slopes: Array


@inner
def frame_room(T, paths):
    """Make the `PathFrame` that `place_frame` fills, of `TreeArrays` T and `PathArrays`."""
    return PathFrame(
        bodies=pose_room(T),
        surfaces=np.zeros((paths.object.shape[0], 12)),
        moved=np.zeros((paths.moving.shape[0], 6)),
        slopes=np.zeros((paths.coupler.shape[0], 2)),
    )


@bare
def place_frame(T, paths, c, frame):
    """Compute a frame.

    Parameters
    ----------
    T, paths : `TreeArrays`, `PathArrays`
    c : (coordinates,) of which dependent ones are set here [rad or m]
    frame : `PathFrame`, filled
    """
    couple(T, c)
    body_poses(T, c, frame.bodies)
    coupler_slopes(paths, c, frame.slopes)
    _move_points(paths, c, frame.moved)
    _place_surfaces(paths.object, paths.object_pose, frame.bodies, frame.surfaces)


@bare
def coupler_slopes(paths, c, slopes):
    """Fill slopes (couplers, 2) of the dependent coordinates in those they follow.

    Parameters
    ----------
    paths : `PathArrays`
    c : (coordinates,) consistent values
    slopes : filled
    """
    coupler = paths.coupler
    functions = paths.functions
    for index in range(slopes.shape[0]):
        function = coupler[index, 0]
        i = coupler[index, 1]
        j = coupler[index, 2]
        _, slopes[index, 0], slopes[index, 1], _, _, _ = evaluate_at(functions, function, i, j, c)


@kernel
def slopes_of_couplers(paths, c, slopes):
    """`coupler_slopes` of frames: c (frames, coordinates), slopes (frames, couplers, 2) filled."""
    for frame in range(c.shape[0]):
        coupler_slopes(paths, c[frame], slopes[frame])


@in_place
def _move_points(paths, c, moved):
    """Fill `moved` (moving points, 6), see `PathFrame`."""
    moving = paths.moving
    limits = paths.moving_range
    functions = paths.functions
    for v in range(moved.shape[0]):
        for i in range(3):
            j = moving[v, 3 + i]
            low = limits[v, 2 * i]
            high = limits[v, 2 * i + 1]
            at = min(max(c[j], low), high) if j >= 0 else 0.0
            moved[v, i], slope, _, _, _, _ = evaluate(functions, moving[v, i], at, 0.0)
            # Beyond the range the point stands still.
            moved[v, 3 + i] = slope if j >= 0 and low <= c[j] <= high else 0.0


@in_place
def _place_surfaces(surfaces, poses, bodies, placed):
    """Fill `placed` (surfaces, 12) with R_b R and p_b + R_b p, by the pose of each one's body b."""
    R = bodies.R
    p = bodies.p
    for index in range(surfaces.shape[0]):
        b = surfaces[index, columns.OBJECT_BODY]
        rotation = product(matrix(R, b), _rotation(poses, index))
        for i in range(9):
            placed[index, i] = rotation[i]
        for i in range(3):
            x = p[b, i]
            for j in range(3):
                x += R[b, i, j] * poses[index, CENTER + j]
            placed[index, CENTER + i] = x


@bare
def _rotation(poses, index):
    """Read the rotation of a pose, the first nine of its columns."""
    return (
        poses[index, 0],
        poses[index, 1],
        poses[index, 2],
        poses[index, 3],
        poses[index, 4],
        poses[index, 5],
        poses[index, 6],
        poses[index, 7],
        poses[index, 8],
    )


@bare
def surface_at(paths, frame, index):
    """Read a surface of a frame.

    Parameters
    ----------
    paths : `PathArrays`
    frame : `PathFrame`
    index : number of the surface

    Returns
    -------
    `Surface`
    """
    row = paths.object
    placed = frame.surfaces
    return Surface(
        kind=row[index, columns.KIND],
        size=vector(paths.object_size, index),
        half=Half(axis=row[index, columns.AXIS], side=row[index, columns.SIDE]),
        rotation=_rotation(placed, index),
        center=(placed[index, CENTER], placed[index, CENTER + 1], placed[index, CENTER + 2]),
    )


@in_place
def point_at(point, place, frame, index):
    """Position of a path point in ground, R_b x + p_b, of body b [m].

    Parameters
    ----------
    point, place : of `PathArrays`
    frame : `PathFrame`
    index : row of both
    """
    moving = point[index, columns.MOVING]
    b = point[index, columns.BODY]
    x = vector(frame.moved, moving) if moving >= 0 else vector(place, index)
    bodies = frame.bodies
    return plus(turned(matrix(bodies.R, b), x), vector(bodies.p, b))
