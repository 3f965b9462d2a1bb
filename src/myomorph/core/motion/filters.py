"""Low-pass filter and derivatives, with OpenSim's conventions so that numbers agree."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion
from myomorph.core.motion.splines import Spline, natural_spline
from myomorph.core.rigid.kernels import kernel

# Samples beyond an end after which a quintic spline does not feel it: 0.43^60 is less than rounding
REACH = 60


def lowpass(values: Array, rate: float, cutoff: float) -> Array:
    """Low-pass values without lag, by a third-order Butterworth forwards and backwards.

    Each pass halves the power at the cutoff, so the two together pass half the amplitude there (-6
    dB); OpenSim does not correct for that. Well below the rate,

        gain = 1 / (1 + (f / cutoff)^6)

    A cutoff at or above half the rate is lowered to 0.49 of the rate, as OpenSim does. Both ends
    are extended by half the length, point-reflected at the end points.

    Parameters
    ----------
    values : (frames, ...) finite, at a steady rate
    rate : of the frames [Hz]
    cutoff : [Hz]

    Returns
    -------
    (frames, ...) filtered

    Raises
    ------
    BadData : a cutoff that is not above 0, fewer than 4 frames, or values that are not finite
    """
    padded, pad = _lowpass_padded(np.asarray(values, dtype=np.float64), rate, cutoff)
    return padded[pad : pad + len(values)]


def _lowpass_padded(values: Array, rate: float, cutoff: float) -> tuple[Array, int]:
    """Filter values with their extensions at both ends.

    Parameters
    ----------
    values : (frames, ...)
    rate : [Hz]
    cutoff : [Hz]

    Returns
    -------
    (frames + 2 pad, ...) filtered, and pad
    """
    frames = len(values)
    if not cutoff > 0.0:
        raise BadData(f"cutoff {cutoff} Hz: expected a positive frequency")
    if frames < 4:
        raise BadData(f"a low-pass filter needs at least 4 frames, but got {frames}")
    if not np.isfinite(values).all():
        raise BadData("a low-pass filter needs finite values, but some are NaN or infinite")
    pad = frames // 2
    before = 2.0 * values[0] - values[pad:0:-1]
    after = 2.0 * values[-1] - values[-2 : -2 - pad : -1]
    padded = np.concatenate([before, values, after])
    once = _one_pass(padded, rate, min(cutoff, 0.49 * rate))
    return _one_pass(once[::-1], rate, min(cutoff, 0.49 * rate))[::-1], pad


def _one_pass(x: Array, rate: float, cutoff: float) -> Array:
    """Filter forwards by a third-order Butterworth, its first three outputs equal to the input.

    By the bilinear transform with w = tan(pi cutoff / rate) the poles of 1 / ((s + 1)(s^2 + s + 1))
    give

        b = w^3 [1, 3, 3, 1] / ((w + 1)(w^2 + w + 1))

    Parameters
    ----------
    x : (samples, ...)
    rate : [Hz]
    cutoff : below half the rate [Hz]

    Returns
    -------
    (samples, ...)
    """
    w = np.tan(np.pi * cutoff / rate)
    scale = (w + 1.0) * (w * w + w + 1.0)
    b = w**3 * np.array([1.0, 3.0, 3.0, 1.0]) / scale
    a = np.array(
        [
            1.0,
            (3 * w**3 + 2 * w**2 - 2 * w - 3) / scale,
            (3 * w**3 - 2 * w**2 - 2 * w + 3) / scale,
            (w - 1) * (w * w - w + 1) / scale,
        ]
    )
    columns = np.array(x.reshape(len(x), -1), dtype=np.float64)
    # State of the transposed direct form whose past inputs and outputs are the first three samples.
    state = np.zeros((3, columns.shape[1]))
    for i in range(3):
        for j in range(i + 1, 4):
            state[i] += (b[j] - a[j]) * columns[2 - (j - i - 1)]
    _third_order(b, a, columns, state)
    return columns.reshape(x.shape)


@kernel
def _third_order(b, a, x, state):
    """Filter from the fourth sample on, in place: the transposed direct form II.

        y_n = b_0 x_n + s_1,   s_i = b_i x_n - a_i y_n + s_(i+1)

    `scipy.signal.lfilter` does the same, but takes longer to import than all the rest of a command.

    Parameters
    ----------
    b, a : (4,) coefficients, a_0 = 1
    x : (samples, columns) overwritten
    state : (3, columns) before the fourth sample, overwritten
    """
    for i in range(3, len(x)):
        for j in range(x.shape[1]):
            value = x[i, j]
            output = state[0, j] + b[0] * value
            state[0, j] = state[1, j] + b[1] * value - a[1] * output
            state[1, j] = state[2, j] + b[2] * value - a[2] * output
            state[2, j] = b[3] * value - a[3] * output
            x[i, j] = output


def differentiate(motion: Motion, cutoff: float | None = None) -> Motion:
    """Differentiate a motion twice, low-pass filtered first where a cutoff is specified.

    Natural quintic splines through every coordinate, as OpenSim's inverse dynamics; of a filtered
    motion, through the filter's extensions too, so that the ends of the spline lie outside the
    motion. Each gap-free run of frames is differentiated by itself; frames that are NaN stay NaN,
    and so do runs shorter than six.

    Source: Woltring 1986, natural splines.

    Parameters
    ----------
    motion : coordinates at evenly spaced times (frames, coordinates) [rad or m], NaN in gaps
    cutoff : of the low-pass filter [Hz]; None for none

    Returns
    -------
    motion with `velocities` [rad/s or m/s] and `accelerations` [rad/s^2 or m/s^2], each (frames,
    coordinates)

    Raises
    ------
    BadData : no run of six frames is free of gaps

    Examples
    --------
    >>> import myomorph as mm
    >>> motion = mm.read_motion("reach.mot", mm.read_model("arm.osim"))
    >>> found = mm.differentiate(motion, cutoff=6.0)
    >>> found.velocities.shape, found.accelerations.shape
    ((61, 2), (61, 2))
    """
    check_argument("motion", motion, Motion)
    seen = np.all(np.isfinite(motion.values), axis=1)
    values = np.full(motion.values.shape, np.nan)
    velocities = np.full(motion.values.shape, np.nan)
    accelerations = np.full(motion.values.shape, np.nan)
    long = [slice(start, stop) for start, stop in runs(seen) if stop - start > 5]
    if not long:
        raise BadData(
            f"derivatives need six frames in a row without gaps: the motion has {int(seen.sum())}"
            " in all"
        )
    for run in long:
        time = motion.time[run]
        part = motion.values[run]
        spline = (
            natural_spline(time, part) if cutoff is None else _lowpass_spline(time, part, cutoff)
        )
        values[run] = part if cutoff is None else spline(time)
        velocity = spline.derivative()
        velocities[run] = velocity(time)
        accelerations[run] = velocity.derivative()(time)
    return replace(motion, values=values, velocities=velocities, accelerations=accelerations)


def _lowpass_spline(time: Array, values: Array, cutoff: float) -> Spline:
    """Fit a spline through filtered values and part of the filter's extensions.

    Values at uneven times go through one at even times first, as in OpenSim's `Storage`.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, coordinates) [rad or m]
    cutoff : [Hz]

    Returns
    -------
    a spline that reaches beyond the frames by up to `REACH` samples
    """
    step = np.diff(time)
    if step.max() - step.min() >= 1e-3 * step.mean():
        even = np.linspace(time[0], time[-1], int(np.ceil((time[-1] - time[0]) / step.min())) + 1)
        time, values = even, natural_spline(time, values)(even)
    mean = float(time[-1] - time[0]) / (len(time) - 1)
    padded, pad = _lowpass_padded(values, 1.0 / mean, cutoff)
    reach = min(pad, REACH)
    outside = mean * np.arange(1, reach + 1)
    wide = np.concatenate([time[0] - outside[::-1], time, time[-1] + outside])
    return natural_spline(wide, padded[pad - reach : len(padded) - pad + reach])
