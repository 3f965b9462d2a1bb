"""A sensor that turns on its body at one moment of a recording: its errors step there."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.arrays import Array, read_only

MIN_FRAMES = 6  # On either side of a step
MIN_STEP = 0.05  # Smaller ones may be those of skin and movement [rad]
MIN_SHARE = 0.3  # Of a sensor's squared errors that its step makes


@read_only
class ErrorStep:
    """The largest step of the errors of sensors.

    Attributes
    ----------
    sensor : number of it
    time : from which on its errors are others [s]
    vector : (3,) by which they are, a rotation vector in the axes of its body [rad]
    """

    sensor: int
    time: float
    vector: Array


def largest_step(time: Array, errors: Array) -> ErrorStep | None:
    """Find the sensor whose mean error differs most before and after one moment.

    Of n frames, k of them before the moment, the step s of the means takes

        k (n - k) / n |s|^2

    off the sum of squares about the mean.

    Parameters
    ----------
    time : (frames,) [s]
    errors : (frames, sensors, 3) rotation vectors in the axes of the bodies [rad], NaN where a
        sensor reports nothing

    Returns
    -------
    None where no step is far above noise
    """
    best: ErrorStep | None = None
    most = 0.0
    for sensor in range(errors.shape[1]):
        known = np.isfinite(errors[:, sensor, 0])
        count = int(known.sum())
        if count < 2 * MIN_FRAMES:
            continue
        centered = errors[known, sensor] - errors[known, sensor].mean(axis=0)
        before = np.arange(1, count)[:, None]
        # Sums to either side of each moment are each other's opposites.
        steps = -np.cumsum(centered, axis=0)[:-1] * count / (before * (count - before))
        taken = (before * (count - before))[:, 0] / count * (steps**2).sum(axis=1)
        taken[: MIN_FRAMES - 1] = 0.0
        taken[count - MIN_FRAMES :] = 0.0
        moment = int(np.argmax(taken))
        size = float(np.linalg.norm(steps[moment]))
        share = taken[moment] / max(float((centered**2).sum()), 1e-12)
        if size > MIN_STEP and share > MIN_SHARE and taken[moment] > most:
            most = float(taken[moment])
            start = float(0.5 * (time[known][moment] + time[known][moment + 1]))
            best = ErrorStep(sensor=sensor, time=start, vector=steps[moment])
    return best
