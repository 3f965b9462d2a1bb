"""Several clocks to one: markers, forces and EMG at common times."""

from __future__ import annotations

from dataclasses import replace
from typing import TypeVar

import numpy as np

from myomorph.core.model.arguments import check_argument
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.splines import natural_spline

LOADED = 0.02  # Part of its largest force above which a plate's center of pressure is believed
# Samples beyond the wanted times that a cubic spline is made of: 0.27^40 is less than rounding
REACH = 40
SAME_LENGTH = 1.5  # Recordings of one length differ by fewer samples of the slower
# Ratios of usual rates below 1: of 50, 60, 100, 120, 200, 240, 250 and 300 Hz
USUAL_RATIOS = (0.4, 5 / 12, 0.5, 0.6, 2 / 3, 0.75, 0.8, 5 / 6)
RATE_ERROR = 0.01  # Of a ratio and of a start, as a share of the motion's time
MIN_SAMPLES = 20  # Samples of the slower from which on an equal length is no chance

SeriesKind = TypeVar("SeriesKind", bound=Series)


def cut(series: SeriesKind, start: float, end: float) -> SeriesKind:
    """Keep the frames with start <= time <= end [s], a hundredth of a frame of rounding allowed.

    Parameters
    ----------
    series : any series over time
    start, end : of what is kept [s]

    Returns
    -------
    the same kind of series, its derivatives too

    Raises
    ------
    BadData : no frame is left, saying what times exist

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.differentiate(mm.read_motion("reach.mot", model), cutoff=6.0)
    >>> len(motion), len(mm.cut(motion, 0.1, 0.3))
    (61, 21)
    """
    if len(series) == 0:
        raise BadData("the recording has no frames")
    slack = 0.01 * float(np.median(np.diff(series.time))) if len(series) > 1 else 1e-9
    kept = (series.time >= start - slack) & (series.time <= end + slack)
    if not kept.any():
        raise BadData(
            f"no frames between {start:g} and {end:g} s: the recording runs from {series.time[0]:g}"
            f" to {series.time[-1]:g} s"
        )
    return series.frames(kept)


def resample_wrenches(wrenches: Wrenches, time: Array, cutoff: float | None = None) -> Wrenches:
    """External forces at other times, by natural cubic splines as OpenSim's `ExternalForce`.

    Where a center of pressure is unknown (NaN, unloaded plate), or with a filter, the moment about
    the ground's origin is interpolated or filtered instead of the point, which is the same wrench
    and has no jumps; the point is then that of the nearest sample that bears load.

    Source: Forsythe, Malcolm and Moler 1977, cubic splines; Seth et al. 2018.

    Parameters
    ----------
    wrenches : external forces (samples, wrenches, 3) [N], [m], [N m], as recorded
    time : (frames,) [s]
    cutoff : low-pass at this frequency first, with the filter of the kinematics [Hz]; None for none

    Returns
    -------
    the same at `time` (frames, wrenches, 3)

    Raises
    ------
    BadData
        where `time` reaches beyond the recorded forces

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> motion = mm.read_motion("reach.mot", model)
    >>> loads = mm.read_loads("reach_grf.xml", model, motion)
    >>> mm.resample_wrenches(loads, motion.time[::2]).forces.shape
    (31, 1, 3)
    """
    check_argument("wrenches", wrenches, Wrenches)
    if len(wrenches) == 0:
        raise BadData("the external forces have no frames")
    slack = 1.5 * float(np.median(np.diff(wrenches.time))) if len(wrenches) > 1 else 1e-9
    if time[0] < wrenches.time[0] - slack or time[-1] > wrenches.time[-1] + slack:
        raise BadData(
            f"external forces run from {wrenches.time[0]:g} to {wrenches.time[-1]:g} s, the motion"
            f" from {time[0]:g} to {time[-1]:g} s: {_other_rate(wrenches.time, time)}cut the motion"
            " with --time START END, or move the forces with --force-shift SECONDS"
        )
    forces = wrenches.forces
    points = wrenches.points
    torques = wrenches.torques
    if cutoff is None and np.isfinite(points).all():
        points = _splined(wrenches.time, points, time)
        return replace(
            wrenches,
            time=time,
            forces=_splined(wrenches.time, forces, time),
            points=points,
            torques=_splined(wrenches.time, torques, time),
        )
    # The moment about the ground's origin is smooth where a center of pressure jumps or is unknown.
    moments = np.nan_to_num(torques) + np.cross(np.nan_to_num(points), forces)
    if cutoff is not None:
        rate = 1.0 / np.diff(wrenches.time).mean()
        forces = lowpass(forces, rate, cutoff)
        moments = lowpass(moments, rate, cutoff)
    points = _loaded_points(wrenches, time)
    forces = _splined(wrenches.time, forces, time)
    moments = _splined(wrenches.time, moments, time)
    torques = moments - np.cross(points, forces)
    return replace(wrenches, time=time, forces=forces, points=points, torques=torques)


OF_A_THOUSAND = 0.2
"""Part by which a ratio of lengths may differ from a thousand, where a unit explains it."""


def _other_rate(times: Array, time: Array) -> str:
    """Ask for rates where forces begin with the motion and last a usual ratio of its time.

    Parameters
    ----------
    times : (samples,) of the forces [s]
    time : (frames,) of the motion [s]
    """
    lasts = float(time[-1] - time[0])
    starts_with_it = abs(times[0] - time[0]) < RATE_ERROR * lasts
    share = float(times[-1] - times[0]) / lasts if lasts > 0.0 else 1.0
    for word, thousand in (("motion", 1e-3), ("forces", 1e3)):
        if abs(share / thousand - 1.0) < OF_A_THOUSAND:
            return f"are the times of the {word} in milliseconds? Give them in s; else "
    usual = any(abs(share / ratio - 1.0) < RATE_ERROR for ratio in USUAL_RATIOS)
    if not (starts_with_it and usual):
        return ""
    return f"they last {share:.2g} times as long: check whether both rates are right in Hz; else "


def refuse_other_times(what: str, times: Array, time: Array) -> None:
    """Refuse values whose times are not the motion's, to a microsecond.

    Parameters
    ----------
    what : name of the values, for the error
    times : (samples,) of the values [s]
    time : (frames,) of the motion [s]

    Raises
    ------
    BadData : the numbers of frames or their times differ
    """
    if len(times) != len(time) or np.max(np.abs(times - time), initial=0.0) > 1e-6:
        raise BadData(
            f"{what} have {len(times)} frames from {times[:1]} s, the motion {len(time)} from"
            f" {time[:1]} s: both must have the same times, so resample them to its times first"
        )


def clock_shift(time: Array, other: Array) -> float | None:
    """Find the shift that puts other times on the clock of a motion.

    Programs that write a motion or a table anew often begin at zero, while the other file goes on
    counting. Two that last equally long, to one and a half samples of the slower, are of one
    recording; these are shifted where they share less than half of it.

    Parameters
    ----------
    time : (frames,) of the motion [s]
    other : (samples,) [s]

    Returns
    -------
    added to `other` [s]: 0 where they share time, None where nothing shows it
    """
    step = max(
        (float(np.median(np.diff(times))) for times in (time, other) if len(times) > 1), default=0.0
    )
    apart = float(time[0] - other[0])
    lasts = float(time[-1] - time[0]), float(other[-1] - other[0])
    common = min(time[-1], other[-1]) - max(time[0], other[0])
    alike = abs(lasts[0] - lasts[1]) <= SAME_LENGTH * step and min(lasts) > MIN_SAMPLES * step
    # Less is left to the checks of forces, which see what the body needs.
    if alike and common < 0.5 * min(lasts):
        return apart
    return None if common < 0.0 else 0.0


def _loaded_points(wrenches: Wrenches, time: Array) -> Array:
    """Take points of application from the nearest samples that bear load.

    Parameters
    ----------
    wrenches : external forces (samples, wrenches, 3)
    time : (frames,) [s]

    Returns
    -------
    (frames, wrenches, 3) [m], the ground's origin for a plate that never bears load
    """
    points = np.zeros((len(time), len(wrenches.names), 3))
    sizes = np.linalg.norm(wrenches.forces, axis=2)
    for e in range(len(wrenches.names)):
        known = np.isfinite(wrenches.points[:, e]).all(axis=1)
        loaded = np.flatnonzero(known & (sizes[:, e] > LOADED * sizes[:, e].max(initial=0.0)))
        if loaded.size:
            after = np.minimum(np.searchsorted(wrenches.time[loaded], time), loaded.size - 1)
            before = np.maximum(after - 1, 0)
            nearer = wrenches.time[loaded[after]] - time < time - wrenches.time[loaded[before]]
            points[:, e] = wrenches.points[np.where(nearer, loaded[after], loaded[before]), e]
    return points


def _splined(time: Array, values: Array, at: Array) -> Array:
    """Interpolate values (samples, ...) by a natural cubic spline, below four samples by lines.

    Parameters
    ----------
    time : (samples,) [s]
    values : (samples, ...)
    at : (frames,) ascending [s]; held at the ends

    Returns
    -------
    (frames, ...)
    """
    if len(time) < 4:
        flat = values.reshape(len(time), -1)
        columns = [np.interp(at, time, column) for column in flat.T]
        return np.array(columns).T.reshape(len(at), *values.shape[1:])
    # A spline forgets what lies further off: each sample counts for a quarter of the one before it.
    first = max(int(np.searchsorted(time, at[0])) - REACH, 0)
    last = int(np.searchsorted(time, at[-1])) + REACH
    time = time[first:last]
    values = values[first:last]
    return natural_spline(time, values, degree=3)(np.clip(at, time[0], time[-1]))


def torques_at(torques: Series, motion: Motion) -> Series:
    """Interpolate torques at the motion's times, by natural cubic splines.

    Parameters
    ----------
    torques : over time (samples, torques) [N m]
    motion : whose times are wanted

    Returns
    -------
    (frames, torques) [N m]; the same values where the times are the same

    Raises
    ------
    BadData : the motion reaches beyond the torques by more than half a sample
    """
    time = motion.time
    torque_time = torques.time
    if len(torque_time) == len(time) and np.max(np.abs(torque_time - time), initial=0.0) <= 1e-6:
        return Series(time, torques.names, torques.values)
    slack = 1e-6 if len(torque_time) < 2 else 0.5 * float(np.median(np.diff(torque_time)))
    if (
        not len(torque_time)
        or time[0] < torque_time[0] - slack
        or time[-1] > torque_time[-1] + slack
    ):
        span = (
            f"from {torque_time[0]:g} to {torque_time[-1]:g} s"
            if len(torque_time)
            else "over no time"
        )
        raise BadData(
            f"torques run {span}, the motion from {time[0]:g} to {time[-1]:g} s: cut the motion"
            " with --time START END"
        )
    at = np.clip(time, torque_time[0], torque_time[-1])
    if len(torque_time) < 4:
        values = np.column_stack(
            [np.interp(at, torque_time, column) for column in torques.values.T]
        )
    else:
        values = natural_spline(torque_time, torques.values, degree=3)(at)
    return Series(time, torques.names, values)
