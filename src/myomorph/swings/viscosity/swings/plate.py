"""The plate under a swinging limb: its wrench about the joint's center and its clock.

The clock is found although hands hold the limb.
"""

from __future__ import annotations

from dataclasses import dataclass, replace

import numpy as np
from scipy.ndimage import binary_dilation

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import Wrenches
from myomorph.core.motion.clocks import SIGNIFICANT, Clock, ClockOptions, fit_clock
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.splines import natural_spline
from myomorph.swings.viscosity.swings.recording import (
    REACH,
    CarriedLimb,
    force_mismatch,
    touched_frames,
)

ANTI_ALIAS = 0.4
"""Cutoff of the low-pass before samples are thinned out, as part of the new rate: at a quarter of
it, where limbs swing and filters cut, it takes less than 1 in 10^3.
"""


COMPARED = 4.0  # Low-pass at which clocks are compared [Hz]
CUTOFF = 6.0  # Low-pass of what looks for lags and for hands [Hz]: limbs swing at about 1 Hz.
# Share of the wrench that the motion explains, from which two clocks are taken as brought together.
AGREES = 0.98
# How far off a clock is first looked for [s]: a swing further away looks much the same, only
# smaller.
AROUND = 0.3
SEARCH = 2.0
LAG = 0.05  # Offsets that are tried where no clock so near agrees, and their distance [s].
AS_GOOD = 1.1  # Of lags that leave up to this much more than the best, the smallest is taken.
MAX_LAG_FRAMES = 500  # Frames on which every lag is judged.
# Squared distance of offset and drift from zero, in SDs, that chance passes 1 time in 20, and once
# in 1,000: a clock that is off by little is corrected only beyond the second, for what a small
# correction may spoil is no less than what it removes.
CHANCE = 6.0
SURE = 13.8
LARGE_CLOCK_ERROR = 2e-3  # Lag of a recording from which the first is enough [s].
MIN_CLOCK_ERROR = 5e-4  # Largest lag of a recording that is left as it is [s].


def wrench_about(wrenches: Wrenches, center: Array) -> Array:
    """Return the moment about a point and the force of all wrenches together.

    A point of application that is unknown counts only where there is a force.

    Parameters
    ----------
    wrenches : to sum
    center : (3,) point, in ground [m]

    Returns
    -------
    (samples, 6) moment [N m] and force [N] in ground; NaN where one is missing
    """
    still = (wrenches.forces == 0.0).all(axis=2)[..., None]
    arms = np.where(still & ~np.isfinite(wrenches.points), 0.0, wrenches.points - center)
    moments = np.where(still & ~np.isfinite(wrenches.torques), 0.0, wrenches.torques) + np.cross(
        arms, wrenches.forces
    )
    return np.concatenate([moments.sum(axis=1), wrenches.forces.sum(axis=1)], axis=1)


def on_clock(time: Array, values: Array, frames: Array) -> Array:
    """Interpolate values to other times.

    Samples that come faster than the frames pass a zero-lag low-pass at `ANTI_ALIAS` of the frames'
    rate first.

    Parameters
    ----------
    time : (samples,) [s]
    values : (samples, columns)
    frames : (frames,) times wanted [s]

    Returns
    -------
    (frames, columns); NaN outside the samples and at their gaps

    Raises
    ------
    BadData : fewer than four finite samples
    """
    known = np.isfinite(values).all(axis=1)
    if known.sum() < 4:
        raise BadData(
            f"the wrench on the base has {int(known.sum())} finite samples of {len(values)}: 4 are"
            " needed"
        )
    filled = np.array(values)
    for column in filled.T:
        column[~known] = np.interp(time[~known], time[known], column[known])
    rate = (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else np.inf
    wanted = (len(frames) - 1) / float(frames[-1] - frames[0]) if len(frames) > 1 else np.inf
    reach = 0.5 / wanted
    if rate > 1.5 * wanted:
        filled = lowpass(filled, rate, ANTI_ALIAS * wanted)
        reach = 1.0 / (ANTI_ALIAS * wanted)
    inside = (frames >= time[0] - 1e-9) & (frames <= time[-1] + 1e-9)
    result = np.full((len(frames), values.shape[1]), np.nan)
    result[inside] = natural_spline(time, filled, degree=3)(
        np.clip(frames[inside], time[0], time[-1])
    )
    if not known.all():
        near = binary_dilation(~known, iterations=max(1, round(reach * rate)))
        nearest = np.clip(np.searchsorted(time, frames), 0, len(time) - 1)
        result[near[nearest]] = np.nan
    return result


def lowpass_runs(values: Array, rate: float, cutoff: float | None) -> Array:
    """Filter every gap-free run of rows by itself.

    Runs shorter than six are lost, as those of the motion.

    Parameters
    ----------
    values : (samples, columns), NaN in gaps
    rate : of the samples [Hz]
    cutoff : of the low-pass [Hz]; None for none

    Returns
    -------
    (samples, columns)
    """
    if cutoff is None:
        return values
    result = np.full(values.shape, np.nan)
    for start, stop in runs(np.asarray(np.isfinite(values).all(axis=1))):
        if stop - start > 5:
            result[start:stop] = lowpass(values[start:stop], rate, cutoff)
    return result


@read_only
@dataclass(frozen=True, eq=False, kw_only=True)
class WrenchFit:
    """How a motion and a wrench are compared.

    Attributes
    ----------
    options : of the fit
    used : (frames,) False in frames in which the limb is touched
    turned : (frames, 6, turns) what small rotations of the plate's axes make of the wrench: they
        are left open too, since they would pass for an offset
    """

    options: ClockOptions | None = None
    used: np.ndarray | None = None
    turned: Array | None = None


def wrench_clock(
    time: Array, rows: Array, wrench_time: Array, wrench: Array, fit: WrenchFit | None = None
) -> Clock:
    """Fit the plate's clock: offset and drift that leave the least of wrench = rows phi + constant.

    phi and the constant are unknown. The wrench knows the motion it comes from, whatever the masses
    are ([S] step 1), so it is its own synchronisation signal. The constant takes what the plate was
    tared with. Rows and wrench are low-pass filtered alike, so neither needs to be filtered before
    (`ClockOptions.cutoff`).

    Parameters
    ----------
    time : (frames,) of the rows [s]
    rows : (frames, 6, parameters) as `SwingRecording.wrench_rows`
    wrench_time : (samples,) on the plate's clock [s]
    wrench : (samples, 6) moment [N m] and force [N]
    fit : how they are compared

    Returns
    -------
    clock

    Raises
    ------
    BadData : rows or wrench of another shape
    """
    fit = fit or WrenchFit()
    if rows.ndim != 3 or rows.shape[1] != 6 or wrench.shape[1:] != (6,):
        raise BadData(
            f"expected rows (frames, 6, parameters) and a wrench (samples, 6), got {rows.shape},"
            f" {wrench.shape}"
        )
    constant = np.broadcast_to(np.eye(6), (len(time), 6, 6))
    columns = [rows, constant]
    if fit.turned is not None:
        columns.append(fit.turned)
    known = np.concatenate(columns, axis=2)
    return fit_clock(time, known, wrench_time, wrench, fit.options, fit.used)


def _of_turned_axes(wrench: Array, origin: Array) -> Array:
    """Return the change of the wrench with small rotations of a plate's axes.

    Parameters
    ----------
    wrench : (frames, 6) moment about the joint's center and force
    origin : (3,) what the plate's own moments are about, from the center [m]

    Returns
    -------
    (frames, 6, 3) of a rotation about each axis [1/rad]
    """
    axes = np.eye(3)
    force = wrench[:, None, 3:]
    own_moment = wrench[:, None, :3] - np.cross(origin, force)
    turned_force = np.cross(axes, force)
    turned_moment = np.cross(axes, own_moment) + np.cross(origin, turned_force)
    return np.concatenate([turned_moment, turned_force], axis=2).swapaxes(1, 2)


@read_only
class SwingRows:
    """Motion of a limb as rows of the wrench that it makes.

    Attributes
    ----------
    time : (frames,) of the motion [s]
    rows : (frames, 6, parameters) as `SwingRecording.wrench_rows`
    slow : (frames, 6, parameters) the rows filtered at `CUTOFF`
    whole : (frames,) whether a frame is out of the reach of the filter's ends
    """

    time: Array
    rows: Array
    slow: Array
    whole: np.ndarray


def plate_clock(
    swing: SwingRows, wrench_time: Array, wrench: Array, origin: Array, share: float
) -> tuple[Clock, list[str]]:
    """Return offset and drift of the plate, or the clock as it is where nothing speaks against it.

    Frames in which a hand carries the limb mislead the fit, and can be recognized only once the
    clocks agree. So the clock as given is tried first; where the motion then does not explain the
    wrench, the lag at which most frames agree (least median mismatch of the force) is the start.

    Parameters
    ----------
    swing : the limb's motion
    wrench_time : (samples,) on the plate's clock [s]
    wrench : (samples, 6) moment [N m] and force [N]
    origin : (3,) what the plate's moments are about, from the joint's center [m]
    share : as `TrackingOptions.touch`

    Returns
    -------
    clock, and warnings
    """
    known = np.asarray(np.isfinite(wrench).all(axis=1))
    start, end = np.flatnonzero(known)[[0, -1]]
    part = slice(start, end + 1)
    plate_time = wrench_time[part]
    values = wrench[part].copy()
    for column in values.T:
        column[~known[part]] = np.interp(
            plate_time[~known[part]], plate_time[known[part]], column[known[part]]
        )
    best = _fitted(swing, plate_time, values, share, 0.0)
    if best.explained < AGREES:
        lag = _best_lag(swing, plate_time, values)
        other = _fitted(swing, plate_time, values, share, lag)
        best = other if other.explained > best.explained else best
    if best.explained < AGREES:
        explained = f"{100 * best.explained:.0f} %"
        return Clock(), [
            f"the clocks cannot be compared: the motion explains only {explained} of the wrench"
        ]
    try:
        best = _refined(swing, plate_time, values, origin, share, best.offset)
    except BadData:
        return Clock(), ["the clocks cannot be compared: too little of the swing shows both"]
    sizes = np.sqrt(np.diag(best.covariance)).clip(min=1e-12)
    doubt = float(np.square(np.array([best.offset, best.drift]) / sizes).sum())
    lag = float(np.abs(best.times(swing.time) - swing.time).max())
    if doubt < (CHANCE if lag > LARGE_CLOCK_ERROR else SURE) or lag < MIN_CLOCK_ERROR:
        return Clock(), []
    drifts = (
        f", and drifts {1e6 * best.drift:+.0f} ± {1e6 * best.drift_sd:.0f} ppm"
        if best.drift
        else ""
    )
    off = f"{1000 * best.offset:+.2f} ± {1000 * best.offset_sd:.2f} ms off the markers'{drifts}"
    return best, [f"the plate's clock is {off}: corrected"]


def _fitted(swing: SwingRows, plate_time: Array, wrench: Array, share: float, lag: float) -> Clock:
    """Fit the clock to the frames that nobody touches if the plate lags by `lag` [s]."""
    seen, force = _filtered(swing, plate_time + lag, wrench)
    if seen.sum() < 6:
        return Clock()
    carried = CarriedLimb(time=swing.time, rows=swing.slow, wrench=force, candidates=seen)
    (hand,) = touched_frames([carried], share, 0.5 * REACH / CUTOFF)
    fit = WrenchFit(options=ClockOptions(search=AROUND, cutoff=CUTOFF), used=seen & ~hand)
    try:
        clock = wrench_clock(swing.time, swing.rows, plate_time + lag, wrench, fit)
    except BadData:
        return Clock(explained=0.0)
    return replace(clock, offset=clock.offset + lag, epoch=clock.epoch - lag)


def _refined(
    swing: SwingRows, plate_time: Array, wrench: Array, origin: Array, share: float, lag: float
) -> Clock:
    """Fit the clock near a lag [s] that brings motion and wrench together, with the axes open.

    The axes are the plate's. Noise of differentiated markers moves an offset, by more the faster
    what is compared. So what half the cutoff would give counts as an error too.
    """
    seen, force = _filtered(swing, plate_time + lag, wrench)
    carried = CarriedLimb(time=swing.time, rows=swing.slow, wrench=force, candidates=seen)
    (hand,) = touched_frames([carried], share, 0.5 * REACH / CUTOFF)
    turned = _of_turned_axes(force, origin)

    def compared(options: ClockOptions) -> Clock:
        fit = WrenchFit(options=options, used=seen & ~hand, turned=turned)
        return wrench_clock(swing.time, swing.rows, plate_time + lag, wrench, fit)

    options = ClockOptions(search=LAG, cutoff=COMPARED)
    clock = compared(options)
    # A drift that chance may have made would only spoil the ends of the recording.
    if abs(clock.drift) < SIGNIFICANT * clock.drift_sd:
        options = replace(options, drift=False)
        clock = compared(options)
    slower = compared(replace(options, cutoff=0.5 * COMPARED))
    apart = np.array([slower.offset - clock.offset, slower.drift - clock.drift])
    return replace(
        clock,
        offset=clock.offset + lag,
        epoch=clock.epoch - lag,
        covariance=clock.covariance + np.diag(np.square(apart)),
    )


def _filtered(swing: SwingRows, plate_time: Array, wrench: Array) -> tuple[np.ndarray, Array]:
    """Return frames on which motion and wrench are known, and the wrench there.

    It has passed the filter of the motion.
    """
    time = swing.time
    force = on_clock(plate_time, wrench, time)
    known = np.asarray(np.isfinite(force).all(axis=1))
    if known.sum() >= 6:
        span = slice(int(np.flatnonzero(known)[0]), int(np.flatnonzero(known)[-1]) + 1)
        force[span] = lowpass(force[span], 1.0 / float(np.median(np.diff(time))), CUTOFF)
    return np.asarray(swing.whole & known), np.where(known[:, None], force, 0.0)


def _best_lag(swing: SwingRows, plate_time: Array, wrench: Array) -> float:
    """Return the lag at which the median frame's force is explained best [s].

    What is left is taken relative to how the force varies.
    """
    time = swing.time
    lags = LAG * np.arange(-round(SEARCH / LAG), round(SEARCH / LAG) + 1)
    thin = swing.whole & (np.arange(len(time)) % max(1, len(time) // MAX_LAG_FRAMES) == 0)
    step = float(np.median(np.diff(time)))
    even = np.arange(plate_time[0], plate_time[-1], step)
    force = lowpass(on_clock(plate_time, wrench[:, 3:], even), 1.0 / step, CUTOFF)
    left = []
    for lag in lags:
        there = time - lag
        seen = thin & (there >= even[0]) & (there <= even[-1])
        if 2 * seen.sum() < thin.sum():
            left.append(np.inf)
            continue
        moved = np.stack([np.interp(there, even, column) for column in force.T], axis=1)
        mismatch, _ = force_mismatch([swing.slow[:, 3:, :4]], [moved], [seen])
        left.append(
            float(
                np.median(np.linalg.norm(mismatch[0][seen], axis=1)) / max(moved[seen].std(), 1e-9)
            )
        )
    good = lags[np.array(left) <= AS_GOOD * min(left)]
    return float(good[np.argmin(np.abs(good))])
