"""Markers and the root's residual of each frame, and their slopes in coordinates and rates."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.rigid.coordinates import Ints, State, couple, couple_rates
from myomorph.core.rigid.dynamics import body_wrenches
from myomorph.core.rigid.kernels import bare, inner, kernel
from myomorph.core.rigid.kinematics import (
    PoseArrays,
    RateArrays,
    body_poses,
    body_rates,
    pose_room,
)
from myomorph.core.rigid.tree import TreeArrays
from myomorph.core.rigid.vectors import cross, matrix, minus, plus, turned, vector

STEP = 1e-6  # Step of the differences in coordinates and their rates [rad, m and 1/s of them]


class PlacedMarkers(NamedTuple):
    """Markers on their bodies.

    Attributes
    ----------
    body : (markers,) number of the body
    location : (markers, 3) on it [m]
    """

    body: Ints
    location: Array


class Setting(NamedTuple):
    """A body at a point: what all frames are predicted with.

    Attributes
    ----------
    tree : its arrays
    markers : on its bodies
    """

    tree: TreeArrays
    markers: PlacedMarkers


class Rates(NamedTuple):
    """Coordinates of all frames with their rates; predicting sets the dependent ones in place.

    Attributes
    ----------
    c, cdot, cddot : (frames, coordinates) of the mass
    shown : (frames, coordinates) that markers show
    """

    c: Array
    cdot: Array
    cddot: Array
    shown: Array

    def frames(self, chosen: slice) -> Rates:
        """Return views of some frames."""
        return Rates(
            c=self.c[chosen],
            cdot=self.cdot[chosen],
            cddot=self.cddot[chosen],
            shown=self.shown[chosen],
        )

    def copy(self) -> Rates:
        """Return copies of all arrays."""
        return Rates(
            c=self.c.copy(),
            cdot=self.cdot.copy(),
            cddot=self.cddot.copy(),
            shown=self.shown.copy(),
        )


class RateSlopes(NamedTuple):
    """Slopes in the free coordinates.

    Attributes
    ----------
    by_value, by_rate, by_acceleration : (frames, 6, free) of the residual
    markers : (frames, free, 3 markers) of the markers, in the coordinates that they show
    """

    by_value: Array
    by_rate: Array
    by_acceleration: Array
    markers: Array

    def frames(self, chosen: slice) -> RateSlopes:
        """Return views of some frames."""
        return RateSlopes(
            by_value=self.by_value[chosen],
            by_rate=self.by_rate[chosen],
            by_acceleration=self.by_acceleration[chosen],
            markers=self.markers[chosen],
        )


class _Work(NamedTuple):
    """Scratch arrays of one frame.

    Attributes
    ----------
    state : coordinates that are changed
    pose : of these
    rates : (6, bodies, 3) see `_root_residual`
    residual, base_residual : (6,) with and without a change
    places, base_places : (markers, 3) with and without it [m]
    """

    state: State
    pose: PoseArrays
    rates: Array
    residual: Array
    base_residual: Array
    places: Array
    base_places: Array


@inner
def _work_room(T, markers, coordinates):
    """Make the scratch arrays of one frame."""
    count = markers.body.shape[0]
    return _Work(
        state=State(
            c=np.empty(coordinates), cdot=np.empty(coordinates), cddot=np.empty(coordinates)
        ),
        pose=pose_room(T),
        rates=np.empty((6, T.parent.shape[0], 3)),
        residual=np.empty(6),
        base_residual=np.empty(6),
        places=np.empty((count, 3)),
        base_places=np.empty((count, 3)),
    )


@kernel
def predict_frames(setting, motion, measured, places, residual):
    """Fill markers and root residuals of all frames.

    Dependent coordinates of the motion are set in place.

    Parameters
    ----------
    setting : `Setting`
    motion : `Rates`
    measured : (frames, 6) moment about the ground's origin [N m] and force [N] of the external
        wrenches
    places : (frames, markers, 3) filled with positions in ground [m]
    residual : (frames, 6) filled with moment about the base's origin [N m] and force [N]
    """
    T = setting.tree
    pose = pose_room(T)
    rates = np.empty((6, T.parent.shape[0], 3))
    for frame in range(motion.c.shape[0]):
        state = State(c=motion.c[frame], cdot=motion.cdot[frame], cddot=motion.cddot[frame])
        shown = motion.shown[frame]
        soft = _differ(state.c, shown)
        couple(T, state.c)
        couple_rates(T, state.c, state.cdot, state.cddot)
        body_poses(T, state.c, pose)
        _root_residual(T, state, pose, measured[frame], rates, residual[frame])
        couple(T, shown)
        if soft:
            body_poses(T, shown, pose)
        _put_places(setting.markers, pose, places[frame])


@kernel
def difference_frames(setting, free, motion, measured, slopes):
    """Differentiate residuals and markers of every frame in the free coordinates.

    Parameters
    ----------
    setting : `Setting`
    free : (free,) coordinates
    motion : `Rates`, dependent coordinates consistent
    measured : (frames, 6) moment about the ground's origin [N m] and force [N]
    slopes : `RateSlopes`, filled
    """
    T = setting.tree
    markers = setting.markers
    work = _work_room(T, markers, motion.c.shape[1])
    for frame in range(motion.c.shape[0]):
        state = State(c=motion.c[frame], cdot=motion.cdot[frame], cddot=motion.cddot[frame])
        shown = motion.shown[frame]
        soft = _differ(state.c, shown)
        body_poses(T, shown, work.pose)
        _put_places(markers, work.pose, work.base_places)
        if soft:
            body_poses(T, state.c, work.pose)
        _root_residual(T, state, work.pose, measured[frame], work.rates, work.base_residual)
        # Rates and accelerations first: they share the poses of the frame.
        by_rate = slopes.by_rate[frame]
        by_acceleration = slopes.by_acceleration[frame]
        _difference_rates(T, free, state, measured[frame], work, by_rate, by_acceleration)
        by_value = slopes.by_value[frame]
        for i in range(free.shape[0]):
            _step_value(T, free[i], state, measured[frame], work, by_value[:, i])
            if soft:
                _pose_shown(T, free[i], shown, work)
            _put_places(markers, work.pose, work.places)
            moved = slopes.markers[frame, i]
            for marker in range(markers.body.shape[0]):
                for axis in range(3):
                    off = work.places[marker, axis] - work.base_places[marker, axis]
                    moved[3 * marker + axis] = off / STEP


@bare
def _difference_rates(T, free, state, measured, work, by_rate, by_acceleration):
    """Differentiate the residual of a frame in rates and accelerations.

    Parameters
    ----------
    free : (free,) coordinates
    state : of the frame
    measured : (6,) moment about the ground's origin [N m] and force [N]
    work : with the pose of the frame, and the residual without a change
    by_rate, by_acceleration : (6, free) filled
    """
    for i in range(free.shape[0]):
        _restore(state, work.state)
        work.state.cdot[free[i]] += STEP
        couple_rates(T, work.state.c, work.state.cdot, work.state.cddot)
        _root_residual(T, work.state, work.pose, measured, work.rates, work.residual)
        for row in range(6):
            by_rate[row, i] = (work.residual[row] - work.base_residual[row]) / STEP
    for i in range(free.shape[0]):
        _restore(state, work.state)
        # The residual is linear in accelerations: a step of 1 has no error.
        work.state.cddot[free[i]] += 1.0
        couple_rates(T, work.state.c, work.state.cdot, work.state.cddot)
        _root_residual(T, work.state, work.pose, measured, work.rates, work.residual)
        for row in range(6):
            by_acceleration[row, i] = (work.residual[row] - work.base_residual[row]) / 1.0


@bare
def _step_value(T, coordinate, state, measured, work, slope):
    """Differentiate the residual of a frame in one coordinate, whose step stays in `work`.

    Parameters
    ----------
    coordinate : number
    state : of the frame
    measured : (6,) moment about the ground's origin [N m] and force [N]
    work : with the residual without a change; state and pose get the step
    slope : (6,) filled
    """
    _restore(state, work.state)
    work.state.c[coordinate] += STEP
    couple(T, work.state.c)
    couple_rates(T, work.state.c, work.state.cdot, work.state.cddot)
    body_poses(T, work.state.c, work.pose)
    _root_residual(T, work.state, work.pose, measured, work.rates, work.residual)
    for row in range(6):
        slope[row] = (work.residual[row] - work.base_residual[row]) / STEP


@bare
def _pose_shown(T, coordinate, shown, work):
    """Pose the bodies as markers show them, with a step of one coordinate.

    Parameters
    ----------
    coordinate : number
    shown : (coordinates,) that markers show
    work : whose pose is filled
    """
    changed = work.state.c
    for j in range(changed.shape[0]):
        changed[j] = shown[j]
    changed[coordinate] += STEP
    couple(T, changed)
    body_poses(T, changed, work.pose)


@bare
def _restore(state, changed):
    """Copy a frame's coordinates and rates (coordinates,) over those that were changed."""
    for j in range(state.c.shape[0]):
        changed.c[j] = state.c[j]
        changed.cdot[j] = state.cdot[j]
        changed.cddot[j] = state.cddot[j]


@bare
def _differ(c, shown):
    """Return whether markers depend on other coordinates than the mass: both poses are needed."""
    apart = 0.0
    for j in range(c.shape[0]):
        apart += abs(c[j] - shown[j])
    return apart > 0.0


@bare
def _put_places(markers, pose, places):
    """Fill positions of markers in ground.

    Parameters
    ----------
    markers : `PlacedMarkers`
    pose : of `body_poses`
    places : (markers, 3) filled [m]
    """
    for marker in range(markers.body.shape[0]):
        body = markers.body[marker]
        arm = turned(matrix(pose.R, body), vector(markers.location, marker))
        place = plus(vector(pose.p, body), arm)
        for axis in range(3):
            places[marker, axis] = place[axis]


@bare
def _root_residual(T, state, pose, measured, rates, residual):
    """Fill what the motion needs less what was measured: moment about the base and force.

        f = sum_b f_b - f_measured
        m = sum_b m_b - m_measured - p x f

    with the wrenches f_b, m_b of all bodies about the ground's origin, and the base's origin p.

    Parameters
    ----------
    T : arrays of the tree
    state : coordinates with rates
    pose : of `body_poses`
    measured : (6,) moment about the ground's origin [N m] and force [N]
    rates : (6, bodies, 3) scratch
    residual : (6,) filled with moment about the base's origin [N m] and force [N]
    """
    body_motion = RateArrays(omega=rates[0], v=rates[1], alpha=rates[2], a=rates[3])
    forces = rates[4]
    moments = rates[5]
    body_rates(T, state, pose, body_motion)
    body_wrenches(T, pose, body_motion, forces, moments)
    force = (0.0, 0.0, 0.0)
    moment = (0.0, 0.0, 0.0)
    for body in range(1, T.parent.shape[0]):
        force = plus(force, vector(forces, body))
        moment = plus(moment, vector(moments, body))
    force = minus(force, (measured[3], measured[4], measured[5]))
    moment = minus(moment, (measured[0], measured[1], measured[2]))
    moment = minus(moment, cross(vector(pose.p, 1), force))
    for axis in range(3):
        residual[axis] = moment[axis]
        residual[3 + axis] = force[axis]
