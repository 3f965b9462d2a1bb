"""A force sensor in the handle of a carried object.

Its orientation on the object and its clock follow from the object's own motion.

While nothing but hands holds an object of mass m, they push it with m (a - g). The sensor of one
handle measures its share of that. Two hands can also squeeze the object along the line between
them, which moves nothing, so with two hands only what lies across that line is known: for frames t
and the line's direction e in the object's axes,

    Q f(t - offset) = share m R^T (a + R'' c - g) + lambda(t) e + constant,

with R, a the object's orientation and acceleration, c the point of the object whose acceleration
counts, Q the sensor's axes in the object, and lambda free in every frame.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from scipy.optimize import least_squares

import myomorph as mm
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.spatial import axis_rotation, vector_from_rotation
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.splines import natural_spline

STARTS = 3
"""Random turns that are tried beside the one that the linear problem gives."""

LEAST_TURN = 0.1
"""The object must turn or be accelerated by that share of gravity for its handle's orientation to
show.
"""

BLOCK = 0.2
"""Time over which residuals go together, for the standard deviations [s]."""


@read_only
@dataclass(frozen=True, eq=False)
class ObjectMotion:
    """Motion of a rigid object.

    Attributes
    ----------
    time : (frames,) [s]
    rotations : (frames, 3, 3) of the object's axes, those of the laboratory in the reference pose
    places : (frames, 3) of the markers' middle [m]
    accelerations : (frames, 3) of the middle [m/s^2]
    turning : (frames, 3, 3) second derivative of the rotations [1/s^2]
    residual : (frames,) root mean square distance of the markers from the rigid object [m]
    cutoff : of the low-pass filter [Hz]
    """

    time: Array
    rotations: Array
    places: Array
    accelerations: Array
    turning: Array
    residual: Array
    cutoff: float


@read_only
@dataclass(frozen=True, eq=False)
class HandleFit:
    """How a handle's sensor sits on the object, and how well that explains its force.

    Attributes
    ----------
    rotation : (3, 3) the sensor's axes in the object's, as columns
    rotation_sd : (3,) of a rotation vector about the object's axes [rad]
    share : mass that this handle carries [kg]
    share_sd : [kg]
    point : (3,) of the object whose acceleration counts, from the markers' middle [m]
    offset, offset_sd : what is added to the sensor's time [s]
    constant : (3,) force that the sensor reads beside the tare, in its axes [N]
    squeeze : (frames,) force along the line between the hands [N], zero with one hand
    residuals : (frames, 3) of the force in the object's axes [N]
    """

    rotation: Array
    rotation_sd: Array
    share: float
    share_sd: float
    point: Array
    offset: float
    offset_sd: float
    constant: Array
    squeeze: Array
    residuals: Array

    @property
    def rms(self) -> float:
        """Root mean square of the residuals [N]."""
        return float(np.sqrt(np.mean(np.sum(self.residuals**2, axis=1))))


@dataclass(frozen=True, kw_only=True, eq=False)
class HandleForce:
    """Force of the hand on the object, in the sensor's axes.

    Attributes
    ----------
    time : (samples,) [s]
    values : (samples, 3) tared [N]
    constant : whether the tare left something to be estimated; it is distinguished from the
        orientation only where the object rotates
    """

    time: Array
    values: Array
    constant: bool = False


def object_motion(
    markers: mm.Markers, names: tuple[str, ...], cutoff: float, reference: int = 0
) -> ObjectMotion:
    """Compute the rigid motion of an object by its markers, low-pass filtered.

    Every frame is solved by Kabsch 1976.

    Parameters
    ----------
    markers : with those of the object
    names : of the object's markers
    cutoff : of the low-pass filter [Hz]
    reference : frame in which the object's axes are the laboratory's; every marker must be visible
        in it

    Raises
    ------
    BadData : a marker hidden in the reference, or fewer than three visible in some frame
    """
    values = np.stack([markers[name] for name in names], axis=1)
    seen: np.ndarray = np.isfinite(values[:, :, 0])
    if not seen[reference].all():
        hidden = names[int(np.argmin(seen[reference]))]
        raise mm.BadData(
            f"marker '{hidden}' of the object is not seen in frame {reference}: choose another"
            " reference"
        )
    if seen.sum(axis=1).min() < 3:
        raise mm.BadData(
            "fewer than three markers of the object are seen in frame"
            f" {int(np.argmin(seen.sum(axis=1)))}"
        )
    shape = values[reference] - values[reference].mean(axis=0)
    rotations = np.empty((len(values), 3, 3))
    places = np.empty((len(values), 3))
    residual = np.empty(len(values))
    for k, (row, there) in enumerate(zip(values, seen, strict=True)):
        own = shape[there]
        goal = row[there]
        u, _, vt = np.linalg.svd((goal - goal.mean(axis=0)).T @ (own - own.mean(axis=0)))
        rotations[k] = (u * np.array([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])) @ vt
        places[k] = goal.mean(axis=0) - rotations[k] @ own.mean(axis=0)
        residual[k] = np.sqrt(
            np.mean(np.sum((own @ rotations[k].T + places[k] - goal) ** 2, axis=1))
        )
    smooth = lowpass(np.hstack([rotations.reshape(-1, 9), places]), markers.rate, cutoff)
    spline = natural_spline(markers.time, smooth).derivative(2)(markers.time)
    return ObjectMotion(
        time=frozen_array(markers.time),
        rotations=frozen_array(smooth[:, :9].reshape(-1, 3, 3)),
        places=frozen_array(smooth[:, 9:]),
        accelerations=frozen_array(spline[:, 9:]),
        turning=frozen_array(spline[:, :9].reshape(-1, 3, 3)),
        residual=frozen_array(residual),
        cutoff=cutoff,
    )


def fit_handle(
    motion: ObjectMotion,
    held: np.ndarray,
    force: HandleForce,
    gravity: Array,
    line: Array | None = None,
) -> HandleFit:
    """Fit the orientation of a handle's sensor, the mass it carries and its clock.

    The fit is by least squares over the frames held.

    Parameters
    ----------
    motion : of the object; the force is filtered at its cutoff
    held : (frames,) whether only hands hold the object
    force : of the hand on the object
    gravity : (3,) in the laboratory [m/s^2]
    line : (3,) from hand to hand in the object's axes, None if one hand holds it alone

    Returns
    -------
    HandleFit with deviations by blocks of time

    Raises
    ------
    BadData : too few frames, or an object that neither rotates nor is accelerated
    """
    held = np.asarray(held, dtype=bool)
    if held.sum() < 20:
        raise mm.BadData(f"the object is held in {int(held.sum())} frames: too few")
    time = motion.time[held]
    back = np.swapaxes(motion.rotations[held], 1, 2)
    pull = np.einsum("nij,nj->ni", back, motion.accelerations[held] - gravity)
    size = float(np.linalg.norm(gravity))
    if float(np.linalg.norm(pull - pull.mean(axis=0), axis=1).max()) < LEAST_TURN * size:
        raise mm.BadData(
            "the object neither turns nor is accelerated while it is held: its handle's orientation"
            " about the vertical does not show; tilt it"
        )
    turning = np.einsum("nij,njk->nik", back, motion.turning[held])
    start = force.time[0]
    stop = force.time[-1]
    rate = (len(force.time) - 1) / float(stop - start)
    few = max(1, int(rate / (40.0 * motion.cutoff)))
    filtered = lowpass(force.values, rate, motion.cutoff)
    spline = natural_spline(force.time[::few], filtered[::few], degree=3)
    along = np.zeros((3, 3)) if line is None else np.outer(line, line) / float(line @ line)
    problem = _Held(
        time,
        pull,
        turning,
        lambda at: spline(np.clip(at, start, stop)),
        along,
        force.constant,
    )
    return problem.solved()


def grip_point(force: Array, torque: Array) -> tuple[Array, float]:
    """Return the point (3,) through which the force passes best, and the remaining torque.

    Least squares of torque = point x force; the remainder is the couple of the hand's grip.

    Parameters
    ----------
    force, torque : (samples, 3) about the sensor's origin [N], [N m]

    Returns
    -------
    the point in the sensor's axes [m], and the root mean square of the remaining torque [N m]
    """
    x, y, z = force.T
    zero = np.zeros_like(x)
    slopes = np.stack([zero, z, -y, -z, zero, x, y, -x, zero], axis=1).reshape(-1, 3)
    point = np.linalg.lstsq(slopes, torque.reshape(-1), rcond=None)[0]
    left = torque - np.cross(point, force)
    return point, float(np.sqrt(np.mean(np.sum(left**2, axis=1))))


class _Held:
    """Residuals of a handle's force.

    Parameters: rotation vector, share, point, offset and, if wanted, a constant.
    """

    def __init__(
        self,
        time: Array,
        pull: Array,
        turning: Array,
        force: Callable[[Array], Array],
        along: Array,
        constant: bool,
    ):
        self.time = time
        self.pull = pull
        self.turning = turning
        self.force = force
        self.along = along
        self.across = np.eye(3) - along
        self.constant = constant

    def apart(self, x: Array) -> Array:
        """Measured less expected force (frames, 3) in the object's axes [N]."""
        measured = self.force(self.time - 0.01 * x[7]) - (x[8:11] if self.constant else 0.0)
        expected = x[3] * (self.pull + self.turning @ (0.1 * x[4:7]))
        apart: Array = measured @ _rotation(x[:3]).T - expected
        return apart

    def solved(self) -> HandleFit:
        """Return the best of several starts, with deviations by blocks of time."""
        random = np.random.default_rng(0)
        best = None
        for turn in (self._linear(), *(random.normal(size=3) for _ in range(STARTS))):
            start = np.concatenate([turn, [self._share()], np.zeros(7 if self.constant else 4)])
            found = least_squares(lambda x: (self.apart(x) @ self.across).reshape(-1), start)
            if found.x[3] > 0 and (best is None or found.cost < best.cost):
                best = found
        if best is None:
            raise mm.BadData(
                "the handle's force fits the object's motion only with a negative mass: is its sign"
                " reversed?"
            )
        x = best.x
        covariance = self._covariance(best.jac, best.fun)
        if self.constant:
            # What of the constant lies along the hands' line is squeeze as well: it is left to
            # that.
            x[8:11] = _rotation(x[:3]).T @ self.across @ _rotation(x[:3]) @ x[8:11]
        deviations = np.sqrt(np.diag(covariance))
        apart = self.apart(x)
        direction = self.along[np.argmax(np.diag(self.along))]
        length = float(np.linalg.norm(direction))
        return HandleFit(
            rotation=frozen_array(_rotation(x[:3])),
            rotation_sd=frozen_array(deviations[:3]),
            share=float(x[3]),
            share_sd=float(deviations[3]),
            point=frozen_array(0.1 * x[4:7]),
            offset=float(0.01 * x[7]),
            offset_sd=float(0.01 * deviations[7]),
            constant=frozen_array(x[8:11] if self.constant else np.zeros(3)),
            squeeze=frozen_array(
                apart @ direction / length if length > 0 else np.zeros(len(apart))
            ),
            residuals=frozen_array(apart @ self.across),
        )

    def _share(self) -> float:
        return float(
            np.mean(
                np.linalg.norm(self.force(self.time), axis=1) / np.linalg.norm(self.pull, axis=1)
            )
        )

    def _linear(self) -> Array:
        """Return the rotation vector (3,) of the axes whose pull is linear in the force.

        e . pull = (Q^T e / share) . force.
        """
        across = np.linalg.svd(self.across)[0][:, : round(float(np.trace(self.across)))]
        found = np.linalg.lstsq(self.force(self.time), self.pull @ across, rcond=1e-3)[0]
        # Columns of Q^T across, made orthonormal; a third follows from the other two.
        u, _, vt = np.linalg.svd(found, full_matrices=False)
        columns = u @ vt
        if columns.shape[1] == 2:
            across = np.column_stack((across, np.cross(across[:, 0], across[:, 1])))
            columns = np.column_stack((columns, np.cross(columns[:, 0], columns[:, 1])))
        turn = across @ columns.T
        if np.linalg.det(turn) < 0:
            turn = np.eye(3)
        return vector_from_rotation(turn)

    def _covariance(self, slopes: Array, left: Array) -> Array:
        """Sandwich of block sums."""
        number = np.repeat(np.floor((self.time - self.time[0]) / BLOCK).astype(np.int64), 3)
        scores = np.stack(
            [np.bincount(number, weights=column * left) for column in slopes.T], axis=1
        )
        blocks = len(np.unique(number))
        count = slopes.shape[1]
        inverse = np.linalg.pinv(slopes.T @ slopes)
        covariance: Array = (
            inverse @ (scores.T @ scores) @ inverse * blocks / max(blocks - count, 1)
        )
        return covariance


def _rotation(vector: Array) -> Array:
    angle = float(np.linalg.norm(vector))
    return axis_rotation(vector / angle, angle) if angle > 0 else np.eye(3)
