"""Markers and the root's residual of each frame.

And how they change with the coordinates and their rates.
"""

from __future__ import annotations

import numpy as np

from myomorph.core.rigid.coordinates import State, couple, couple_rates
from myomorph.core.rigid.dynamics import body_wrenches
from myomorph.core.rigid.kernels import bare, kernel
from myomorph.core.rigid.kinematics import RateArrays, body_poses, body_rates, pose_room
from myomorph.core.rigid.vectors import cross, matrix, minus, plus, turned, vector

STEP = 1e-6  # Step of the differences in coordinates and their rates [rad, m and 1/s of them]


@kernel
def predict_frames(T, body, location, c, cdot, cddot, seen, measured, places, residual):
    """Fill markers and root residuals of all frames.

    Dependent coordinates of `c`, `cdot`, `cddot` and `seen` are set in place.

    Parameters
    ----------
    T : arrays of the tree
    body, location : (markers,), (markers, 3) of the markers on their bodies [m]
    c, cdot, cddot : (frames, coordinates) of the mass
    seen : (frames, coordinates) that markers show
    measured : (frames, 6) moment about the ground's origin [N m] and force [N] of the external
        wrenches
    places : (frames, markers, 3) filled with positions in ground [m]
    residual : (frames, 6) filled with moment about the base's origin [N m] and force [N]
    """
    n = T.parent.shape[0]
    pose = pose_room(T)
    rates = np.empty((6, n, 3))
    for frame in range(c.shape[0]):
        soft = differ(c[frame], seen[frame])
        couple(T, c[frame])
        couple_rates(T, c[frame], cdot[frame], cddot[frame])
        body_poses(T, c[frame], pose)
        root_residual(
            T,
            c[frame],
            cdot[frame],
            cddot[frame],
            pose,
            measured[frame],
            rates,
            residual[frame],
        )
        couple(T, seen[frame])
        if soft:
            body_poses(T, seen[frame], pose)
        put_places(body, location, pose.R, pose.p, places[frame])


@kernel
def difference_frames(
    T,
    body,
    location,
    free,
    c,
    cdot,
    cddot,
    seen,
    measured,
    by_value,
    by_rate,
    by_acceleration,
    moved,
):
    """Differentiate residuals and markers of every frame in the free coordinates.

    By differences; the residual is linear in accelerations, so that their step of 1 has no error.

    Parameters
    ----------
    T : arrays of the tree
    body, location : (markers,), (markers, 3) of the markers on their bodies [m]
    free : (free,) coordinates
    c, cdot, cddot : (frames, coordinates) of the mass
    seen : (frames, coordinates) that markers show
    measured : (frames, 6) moment about the ground's origin [N m] and force [N]
    by_value, by_rate, by_acceleration : (frames, 6, free) filled, of the residual
    moved : (frames, free, 3 markers) filled, of the markers in `seen`
    """
    n = T.parent.shape[0]
    m = body.shape[0]
    pose = pose_room(T)
    rates = np.empty((6, n, 3))
    at = np.empty((m, 3))
    r = np.empty(6)
    base = np.empty(6)
    base_at = np.empty((m, 3))
    x = np.empty(c.shape[1])
    v = np.empty(c.shape[1])
    a = np.empty(c.shape[1])
    for frame in range(c.shape[0]):
        # Rates and accelerations first: they share the poses of the frame.
        soft = differ(c[frame], seen[frame])
        body_poses(T, seen[frame], pose)
        put_places(body, location, pose.R, pose.p, base_at)
        if soft:
            body_poses(T, c[frame], pose)
        root_residual(T, c[frame], cdot[frame], cddot[frame], pose, measured[frame], rates, base)
        for change in range(2 * free.shape[0]):
            i = change % free.shape[0]
            restore(c[frame], cdot[frame], cddot[frame], x, v, a)
            # The residual is linear in accelerations: a step of 1 has no error.
            step = STEP if change < free.shape[0] else 1.0
            if change < free.shape[0]:
                v[free[i]] += step
            else:
                a[free[i]] += step
            couple_rates(T, x, v, a)
            root_residual(T, x, v, a, pose, measured[frame], rates, r)
            for q in range(6):
                if change < free.shape[0]:
                    by_rate[frame, q, i] = (r[q] - base[q]) / step
                else:
                    by_acceleration[frame, q, i] = (r[q] - base[q]) / step
        for i in range(free.shape[0]):
            restore(c[frame], cdot[frame], cddot[frame], x, v, a)
            x[free[i]] += STEP
            couple(T, x)
            couple_rates(T, x, v, a)
            body_poses(T, x, pose)
            root_residual(T, x, v, a, pose, measured[frame], rates, r)
            if soft:
                x[:] = seen[frame]
                x[free[i]] += STEP
                couple(T, x)
                body_poses(T, x, pose)
            put_places(body, location, pose.R, pose.p, at)
            for q in range(6):
                by_value[frame, q, i] = (r[q] - base[q]) / STEP
            for marker in range(m):
                for q in range(3):
                    moved[frame, i, 3 * marker + q] = (at[marker, q] - base_at[marker, q]) / STEP


@bare
def restore(c, cdot, cddot, x, v, a):
    """Copy a frame's coordinates and rates."""
    for j in range(c.shape[0]):
        x[j] = c[j]
        v[j] = cdot[j]
        a[j] = cddot[j]


@bare
def differ(c, seen):
    """Return whether markers depend on other coordinates than the mass: both poses are needed."""
    apart = 0.0
    for j in range(c.shape[0]):
        apart += abs(c[j] - seen[j])
    return apart > 0.0


@bare
def put_places(body, location, R, p, places):
    """Fill positions of markers in ground.

    Parameters
    ----------
    body, location : (markers,), (markers, 3) on their bodies [m]
    R, p : (bodies, 3, 3), (bodies, 3) poses of the bodies [m]
    places : (markers, 3) filled
    """
    for m in range(body.shape[0]):
        at = plus(vector(p, body[m]), turned(matrix(R, body[m]), vector(location, m)))
        for i in range(3):
            places[m, i] = at[i]


@bare
def root_residual(T, c, cdot, cddot, pose, measured, rates, residual):
    """Fill what the motion needs less what was measured: moment about the base and force.

    Parameters
    ----------
    T : arrays of the tree
    c, cdot, cddot : (coordinates,)
    pose : of `body_poses`
    measured : (6,) moment about the ground's origin [N m] and force [N]
    rates : (6, bodies, 3) scratch
    residual : (6,) filled with moment about the base's origin [N m] and force [N]
    """
    body_motion = RateArrays(omega=rates[0], v=rates[1], alpha=rates[2], a=rates[3])
    f = rates[4]
    m = rates[5]
    body_rates(T, State(c=c, cdot=cdot, cddot=cddot), pose, body_motion)
    body_wrenches(T, pose, body_motion, f, m)
    force = (0.0, 0.0, 0.0)
    moment = (0.0, 0.0, 0.0)
    for b in range(1, T.parent.shape[0]):
        force = plus(force, vector(f, b))
        moment = plus(moment, vector(m, b))
    force = minus(force, (measured[3], measured[4], measured[5]))
    moment = minus(moment, (measured[0], measured[1], measured[2]))
    moment = minus(moment, cross(vector(pose.p, 1), force))
    for i in range(3):
        residual[i] = moment[i]
        residual[3 + i] = force[i]
