"""Lags at which two recordings explain each other, then offset and drift refined."""

from __future__ import annotations

from typing import NamedTuple

import numpy as np
import scipy

from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.motion.filters import lowpass
from myomorph.core.motion.splines import Spline, natural_spline

SAMPLES = 4.0  # Frames that are kept for every period of the cutoff
CANDIDATES = 5
NEAR = 0.3  # A lag that explains less than the best by more than this share is no candidate
LEAST_EXPLAINED = 0.1
REACH = 0.15  # Time either way that the lag of a piece is looked for [s]
DENSE = 40.0  # Samples for every period of the cutoff through which the other recording is splined
FINEST = 25.0  # Frames a second that are kept at least
RIM = 1.0  # Periods of the cutoff by which what is not used reaches into what is
SETTLING = 3.0
"""Periods of the cutoff after which a filter has forgotten an end by four digits: differentiated
markers are rough.
"""


@read_only
class Compared:
    """Two recordings prepared for comparison.

    Attributes
    ----------
    time : (frames,) on the reference clock [s]
    rows : (frames, signals, parameters) on the reference clock, zero where unusable
    usable : (frames,) whether the filtered rows hold
    spline : (signals,) of the other recording over its own time
    slope : (signals,) its derivative [per s]
    start, end : of what the other recording's filter has settled for, on its own clock [s]
    middle : of what both cover, on the reference clock [s]
    spread : (signals,) standard deviation of the other recording
    """

    time: Array
    rows: Array
    usable: np.ndarray
    spline: Spline
    slope: Spline
    start: float
    end: float
    middle: float
    spread: Array

    @property
    def step(self) -> float:
        """Time between frames [s]."""
        return float(np.median(np.diff(self.time)))

    @property
    def weights(self) -> Array:
        """Factors (signals,) that make every signal of the other recording vary by 1.

        0 for one that does not vary.
        """
        varies = self.spread > 1e-12 * self.spread.max(initial=0.0)
        return np.where(varies, 1.0 / np.where(varies, self.spread, 1.0), 0.0)

    def places(self, lag: Array) -> Array:
        """Convert the times of the frames to the other clock.

            s = t + a + b (t - middle)

        Parameters
        ----------
        lag : (2,) a [s] and b [s/s]

        Returns
        -------
        (frames,) [s]
        """
        return self.time + lag[0] + lag[1] * (self.time - self.middle)

    def within(self, lag: Array) -> np.ndarray:
        """Find usable frames that lie in the other recording.

        Parameters
        ----------
        lag : (2,) a [s] and b [s/s]

        Returns
        -------
        (frames,) whether a frame is one
        """
        places = self.places(lag)
        return self.usable & (places > self.start) & (places < self.end)


def main_frequency(time: Array, other_time: Array, other: Array) -> float:
    """Estimate the frequency of the other recording's strongest oscillation.

        f = sum f P^2 / sum P^2

    over frequencies below a quarter of the reference's rate. Squared power, because noise has
    little of it.

    Parameters
    ----------
    time : (frames,) of the reference [s]
    other_time : (samples,) [s]
    other : (samples, signals), which count alike whatever their size

    Returns
    -------
    [Hz], at least two periods in the recording
    """
    rate = (len(other_time) - 1) / float(other_time[-1] - other_time[0])
    spread = np.std(other, axis=0)
    values = (other - other.mean(axis=0)) / np.where(spread > 0, spread, 1.0)
    squared = np.sum(
        np.abs(scipy.fft.rfft(values * np.hanning(len(values))[:, None], axis=0)) ** 4, axis=1
    )
    frequencies = np.arange(len(squared)) * rate / len(values)
    squared = squared * (frequencies < 0.25 * (len(time) - 1) / float(time[-1] - time[0]))
    return float(
        max((frequencies @ squared) / max(squared.sum(), 1e-300), 2.0 * rate / len(values))
    )


class Reference(NamedTuple):
    """The recording on whose clock times are wanted.

    Attributes
    ----------
    time : (frames,) [s]
    rows : (frames, signals, parameters), not used where NaN
    used : (frames,) whether a frame is used; None uses all
    """

    time: Array
    rows: Array
    used: np.ndarray | None = None


class Recorded(NamedTuple):
    """The other recording.

    Attributes
    ----------
    time : (samples,) on its clock [s]
    values : (samples, signals)
    """

    time: Array
    values: Array


def compare(reference: Reference, recorded: Recorded, cutoff: float) -> Compared:
    """Filter both recordings alike and thin the frames to what the cutoff needs.

    Parameters
    ----------
    reference : the recording in whose signals the other is linear
    recorded : the other
    cutoff : of the low-pass [Hz]

    Returns
    -------
    both recordings, comparable

    Raises
    ------
    BadData : fewer than 20 samples, shapes that do not match, an unsteady clock, NaN in the other
        recording, or no run of frames that is long enough for the filter
    """
    time = np.asarray(reference.time, dtype=np.float64)
    other_time = np.asarray(recorded.time, dtype=np.float64)
    _checked(time, other_time, recorded.values, reference.rows)
    start = float(other_time[0])
    end = float(other_time[-1])
    rate = (len(time) - 1) / float(time[-1] - time[0])
    finite = np.asarray(np.isfinite(reference.rows).all(axis=(1, 2)))
    rows, usable = _filtered(reference.rows, finite, rate, cutoff)
    if reference.used is not None:
        # Through the filter, frames feel those nearby: the rim of what is used is left out.
        rim = 2 * int(np.ceil(RIM * rate / cutoff)) + 1
        used = np.asarray(reference.used, dtype=np.int8)
        usable &= scipy.ndimage.minimum_filter1d(used, rim, mode="nearest") > 0
    if not usable.any():
        raise BadData(
            f"no run of frames without gaps is long enough for a low-pass filter at {cutoff:g} Hz"
        )
    other_rate = (len(other_time) - 1) / (end - start)
    few = max(1, int(other_rate / (DENSE * cutoff)))
    other = lowpass(recorded.values, other_rate, cutoff)[::few]
    start = start + SETTLING / cutoff
    end = end - SETTLING / cutoff
    thin = max(1, int(rate / max(SAMPLES * cutoff, FINEST)))
    time = time[::thin]
    rows = rows[::thin]
    usable = usable[::thin]
    spline = natural_spline(other_time[::few], other, degree=3)
    return Compared(
        time=time,
        rows=np.where(usable[:, None, None], rows, 0.0),
        usable=usable,
        spline=spline,
        slope=spline.derivative(1),
        start=start,
        end=end,
        middle=0.5 * (max(time[0], start) + min(time[-1], end)),
        spread=other.std(axis=0),
    )


def _checked(time: Array, other_time: Array, other: Array, rows: Array) -> None:
    """Refuse recordings whose lengths, shapes, values or steps do not allow a comparison."""
    if len(time) < 20 or len(other_time) < 20:
        raise BadData(f"{len(time)} and {len(other_time)} samples: too few to compare clocks")
    if rows.shape[:2] != (len(time), other.shape[1]) or len(other) != len(other_time):
        raise BadData(
            f"expected rows ({len(time)}, {other.shape[1]}, parameters) and {len(other_time)}"
            f" samples, but got {rows.shape} and {len(other)}"
        )
    if not np.isfinite(other).all():
        raise BadData(
            "the other recording has values that are not finite: fill the gaps or choose another"
            " time"
        )
    for clock in (time, other_time):
        steps = np.diff(clock)
        if steps.min() <= 0 or steps.max() > 1.5 * np.median(steps):
            raise BadData(
                "clocks are compared over recordings of a steady rate: this one has missing frames"
            )


def _filtered(
    rows: Array, usable: np.ndarray, rate: float, cutoff: float
) -> tuple[Array, np.ndarray]:
    """Low-pass rows over each unbroken run.

    Parameters
    ----------
    rows : (frames, signals, parameters)
    usable : (frames,) whether a row is finite
    rate : [Hz]
    cutoff : [Hz]

    Returns
    -------
    filtered rows, and (frames,) whether the filter has settled there
    """
    filtered = np.array(rows, dtype=np.float64)
    kept = np.zeros(len(rows), dtype=bool)
    settling = int(np.ceil(SETTLING * rate / cutoff))
    for start, stop in runs(usable):
        if stop - start > 2 * settling + 4:
            filtered[start:stop] = lowpass(rows[start:stop], rate, cutoff)
            kept[start + settling : stop - settling] = True
    return filtered, kept


def likely_lags(compared: Compared, search: float) -> list[float]:
    """Find lags by the share of variance that any parameters explain, at every lag at once by FFT.

    Parameters
    ----------
    compared : both recordings
    search : largest lag either way [s]

    Returns
    -------
    lags [s], the best first

    Raises
    ------
    BadData : no time in common, or less than 10 % explained at any lag
    """
    first, _ = _peaks(compared, compared.weights, search)
    # A signal that only holds noise would count as much as the others: what each leaves unexplained
    # says.
    left = _left(compared, np.array([first[0], 0.0]))
    weights = np.where(
        compared.weights > 0, 1.0 / np.maximum(left, 1e-3 * compared.spread + 1e-300), 0.0
    )
    peaks, best = _peaks(compared, weights, search)
    if best < LEAST_EXPLAINED:
        raise BadData(
            f"the two recordings do not explain each other at any offset within {search:g} s (at"
            f" best {100 * max(best, 0.0):.0f} % of the variance): are they of one trial? A wider"
            " search may help"
        )
    return list(dict.fromkeys(peaks + first[:2]))


def _peaks(compared: Compared, weights: Array, search: float) -> tuple[list[float], float]:
    """Find the highest peaks of the share explained.

    Parameters
    ----------
    compared : both recordings
    weights : (signals,)
    search : largest lag either way [s]

    Returns
    -------
    lags of the peaks, the highest first [s], and the share at the highest
    """
    most = int(np.ceil(search / compared.step))
    share = _shares_explained(compared, weights, most)
    best = float(share.max())
    edged = np.concatenate([[0.0], share, [0.0]])
    peaks = np.flatnonzero(
        (edged[1:-1] >= edged[:-2]) & (edged[1:-1] > edged[2:]) & (share > best - NEAR)
    )
    peaks = peaks[np.argsort(-share[peaks])][:CANDIDATES]
    return [float((peak - most) * compared.step) for peak in peaks], best


def _shares_explained(compared: Compared, weights: Array, most: int) -> Array:
    """Compute the share of the other recording that the rows explain, at every lag.

    With an orthonormal basis B of what the rows and a constant can explain, and the other recording
    y at a lag,

        share = sum (B^T y)^2 / sum y^2,

    both sums over usable frames: correlations, which FFT gives at every lag.

    Parameters
    ----------
    compared : both recordings
    weights : (signals,)
    most : frames of the largest lag either way

    Returns
    -------
    (2 most + 1,) [-], 0 where few frames are in common

    Raises
    ------
    BadData : no lag brings the recordings together
    """
    frames = len(compared.time)
    around = compared.time[0] + compared.step * np.arange(-most, frames + most)
    inside = (around >= compared.start) & (around <= compared.end)
    if not inside.any():
        raise BadData(
            "the recordings have no time in common: give their times on clocks that start together"
        )
    values = compared.spline(np.clip(around, compared.start, compared.end)) * weights
    values = np.where(inside[:, None], values - values[inside].mean(axis=0), 0.0)
    basis = _centered_basis(compared, weights)
    size = scipy.fft.next_fast_len(len(around) + frames)
    spectra = scipy.fft.rfft(values, size, axis=0)
    explained = np.zeros(2 * most + 1)
    for index in range(basis.shape[2]):
        product = (np.conj(scipy.fft.rfft(basis[:, :, index], size, axis=0)) * spectra).sum(axis=1)
        explained += scipy.fft.irfft(product, size)[: 2 * most + 1] ** 2
    counted = np.conj(scipy.fft.rfft(compared.usable.astype(np.float64), size))

    def over_usable(signal: Array) -> Array:
        """Sum a signal (frames and lags,) over usable frames at every lag."""
        sums: Array = scipy.fft.irfft(counted * scipy.fft.rfft(signal, size), size)
        return sums[: 2 * most + 1]

    power = over_usable((values**2).sum(axis=1))
    common = over_usable(inside.astype(np.float64))
    enough = (common > 0.5 * common.max()) & (power > 1e-9 * power.max())
    return np.where(enough, explained / np.where(enough, power, 1.0), 0.0)


def _centered_basis(compared: Compared, weights: Array) -> Array:
    """Orthonormalize what the rows and a constant for each signal can explain.

    Parameters
    ----------
    compared : both recordings
    weights : (signals,)

    Returns
    -------
    (frames, signals, k)
    """
    frames, signals, parameters = compared.rows.shape
    design = (compared.rows * weights[:, None]).reshape(-1, parameters)
    constants = np.eye(signals) * compared.usable[:, None, None]
    return orthonormal(np.hstack((design, constants.reshape(-1, signals)))).reshape(
        frames, signals, -1
    )


def orthonormal(design: Array) -> Array:
    """Orthonormalize columns; those that are zero or repeat others are left out.

    Parameters
    ----------
    design : (n, columns)

    Returns
    -------
    (n, k) with k at most the number of columns
    """
    sizes = np.linalg.norm(design, axis=0)
    kept = sizes > 1e-12 * sizes.max(initial=0.0)
    scaled = design[:, kept] / sizes[kept]
    values, vectors = np.linalg.eigh(scaled.T @ scaled)
    sound = values > 1e-10 * values.max(initial=0.0)
    return scaled @ (vectors[:, sound] / np.sqrt(values[sound]))


def drift_of_pieces(compared: Compared, lag: Array, window: float) -> Array:
    """Fit a line through the lags of pieces, found to a fraction of a frame, without outliers.

    Parameters
    ----------
    compared : both recordings
    lag : (2,) to start from, a [s] and b [s/s]
    window : length of a piece; the next begins half of it later [s]

    Returns
    -------
    (2,) a [s] and b [s/s]; `lag` where fewer than three pieces show theirs
    """
    x, y = _lags_of_pieces(compared, lag, window)
    for _ in range(3):
        if len(x) < 3:
            return lag
        slope, level = np.polyfit(x, y, 1)
        off = np.abs(y - level - slope * x)
        kept = off <= max(3.0 * float(np.median(off)), 1e-9)
        x = x[kept]
        y = y[kept]
    return lag + np.array([level, slope])


def _lags_of_pieces(compared: Compared, lag: Array, window: float) -> tuple[Array, Array]:
    """Find the further lag of each piece that shows it.

    Parameters
    ----------
    compared : both recordings
    lag : (2,) to start from, a [s] and b [s/s]
    window : length of a piece; the next begins half of it later [s]

    Returns
    -------
    (pieces,) their middles from that of the recordings [s], and (pieces,) their lags [s]
    """
    predicted = _predicted(compared, lag)
    weights = (
        1.0
        / np.maximum(_left(compared, lag), 1e-3 * compared.spread + 1e-300)
        * (compared.weights > 0)
    )
    inside = compared.within(lag)
    places = compared.places(lag)
    frames = max(8, round(window / compared.step))
    middles = []
    lags = []
    for start in range(0, len(places) - frames + 1, max(1, frames // 2)):
        here = np.arange(start, start + frames)[inside[start : start + frames]]
        if len(here) < frames // 2:
            continue
        wanted = (predicted[here] - predicted[here].mean(axis=0)) * weights
        further = _lag_of_piece(compared, places[here], wanted, weights)
        if further is not None:
            middles.append(float(compared.time[here].mean()) - compared.middle)
            lags.append(further)
    return np.array(middles), np.array(lags)


def _lag_of_piece(compared: Compared, places: Array, wanted: Array, weights: Array) -> float | None:
    """Find a piece's further lag by a parabola through the smallest misfits.

    Parameters
    ----------
    compared : both recordings
    places : (n,) times of the piece's frames on the other clock [s]
    wanted : (n, signals) predicted, centered and weighted
    weights : (signals,)

    Returns
    -------
    [s]; None where the smallest misfit is at an end of the search range
    """
    most = int(np.ceil(REACH / compared.step))
    costs = []
    for index in range(-most, most + 1):
        at = np.clip(places + index * compared.step, compared.start, compared.end)
        values = compared.spline(at) * weights
        costs.append(float(np.sum((values - values.mean(axis=0) - wanted) ** 2)))
    least = int(np.argmin(costs))
    if not 0 < least < 2 * most:
        return None
    below, lowest, above = costs[least - 1 : least + 2]
    return (least - most + 0.5 * (below - above) / (below - 2.0 * lowest + above)) * compared.step


def _predicted(compared: Compared, lag: Array) -> Array:
    """Predict the other recording by the rows with the parameters that fit best at a lag.

    Parameters
    ----------
    compared : both recordings
    lag : (2,) a [s] and b [s/s]

    Returns
    -------
    (frames, signals)
    """
    inside = compared.within(lag)
    design = (compared.rows[inside] * compared.weights[:, None]).reshape(-1, compared.rows.shape[2])
    wanted = (compared.spline(compared.places(lag)[inside]) * compared.weights).reshape(-1)
    parameters = np.linalg.lstsq(design, wanted, rcond=1e-9)[0]
    return compared.rows @ parameters


def _left(compared: Compared, lag: Array) -> Array:
    """Compute the standard deviation of what the rows leave of the other recording.

    Parameters
    ----------
    compared : both recordings
    lag : (2,) a [s] and b [s/s]

    Returns
    -------
    (signals,)
    """
    inside = compared.within(lag)
    left = compared.spline(compared.places(lag)[inside]) - _predicted(compared, lag)[inside]
    return left.std(axis=0)


ITERATIONS = 30
MIN_COUNT = 60
SMALLEST = 1e-6
"""Share of its spread below which a signal's residual counts as that: a made recording may leave
nothing.
"""


@read_only
class Refined:
    """Result of the Gauss-Newton iteration.

    Attributes
    ----------
    lag : (2,) a [s] and b [s/s] of `Compared.places`
    covariance : (2, 2) of the lag
    misfit : geometric mean over the signals of what is left, in units of each one's spread [-]
    explained : share of the variance of the signal explained best [-]
    length : time in common [s]
    """

    lag: Array
    covariance: Array
    misfit: float
    explained: float
    length: float

    @property
    def timing_sd(self) -> float:
        """Root mean square of the standard deviation of the lag over the recording [s]."""
        return float(np.sqrt(self.covariance[0, 0] + self.covariance[1, 1] * self.length**2 / 12.0))


def refine(compared: Compared, lag: Array, drift: bool, block: float) -> Refined:
    """Refine offset, and drift if wanted, from a start that is within a fraction of a swing.

    With the orthonormal basis B of the rows, the residual (I - B B^T) y of the other recording y at
    the lag has the slopes (I - B B^T) dy/dt [1, t - middle] (Kaufman's approximation, which leaves
    out how the best parameters change). Each signal weighs what its residual allows.

    Source: Kaufman 1975.

    Parameters
    ----------
    compared : both recordings
    lag : (2,) to start from, a [s] and b [s/s]
    drift : refine b too
    block : residuals further apart are independent [s]

    Returns
    -------
    lag and its covariance

    Raises
    ------
    BadData : too few frames in common
    """
    inside = compared.within(lag)
    frames = int(np.count_nonzero(inside))
    if frames < MIN_COUNT:
        raise BadData(
            f"the recordings share {frames} usable frames: too few to compare their clocks"
        )
    time = compared.time[inside]
    weights = compared.weights
    for _ in range(ITERATIONS):
        left, slopes = _linearized(compared, inside, lag, weights)
        tangent = slopes[:, : 2 if drift else 1]
        step = -np.linalg.lstsq(tangent, left, rcond=None)[0]
        residual = left.reshape(frames, -1) * np.where(
            weights > 0, 1.0 / np.where(weights > 0, weights, 1.0), 0.0
        )
        size = np.sqrt(np.mean(residual**2, axis=0))
        if np.all(np.abs(step) < np.array([1e-9, 1e-11])[: len(step)]):
            break
        lag = lag + np.pad(step, (0, 2 - len(step)))
        weights = np.where(
            weights > 0, 1.0 / np.maximum(size, SMALLEST * compared.spread + 1e-300), 0.0
        )
    shares = (size / np.where(weights > 0, compared.spread, 1.0))[weights > 0]
    return Refined(
        lag=lag,
        covariance=_covariance(tangent, left, time, residual.shape[1], block),
        misfit=float(np.exp(np.mean(np.log(np.maximum(shares, SMALLEST))))),
        explained=1.0 - float(shares.min()) ** 2,
        length=float(time[-1] - time[0]),
    )


def _linearized(
    compared: Compared, inside: np.ndarray, lag: Array, weights: Array
) -> tuple[Array, Array]:
    """Compute the weighted residual at a lag and its slopes, as `refine` has them.

    Parameters
    ----------
    compared : both recordings
    inside : (all frames,) whether a frame takes part
    lag : (2,) a [s] and b [s/s]
    weights : (signals,)

    Returns
    -------
    (frames signals,) residual, and (frames signals, 2) its slopes in a and b
    """
    rows = compared.rows[inside]
    away = (compared.time[inside] - compared.middle)[:, None]
    places = np.clip(compared.places(lag)[inside], compared.start, compared.end)
    basis = orthonormal((rows * weights[:, None]).reshape(-1, rows.shape[2]))
    slopes = compared.slope(places) * weights
    columns = np.stack((compared.spline(places) * weights, slopes, slopes * away), axis=2).reshape(
        -1, 3
    )
    columns = columns - basis @ (basis.T @ columns)
    return columns[:, 0], columns[:, 1:]


def _covariance(tangent: Array, left: Array, time: Array, signals: int, block: float) -> Array:
    """Estimate the covariance of the lag from block sums, which correlation does not deceive.

    With G the tangent, r the residuals and s_k = sum over block k of G^T r, of K blocks (a
    sandwich),

        cov = (G^T G)^-1 (sum_k s_k s_k^T) (G^T G)^-1 K / (K - n)

    Parameters
    ----------
    tangent : (frames signals, n) slopes in a, and b
    left : (frames signals,) residuals
    time : (frames,) [s]
    signals : number of them
    block : length of a block [s]

    Returns
    -------
    (2, 2), zero for a drift that was not refined
    """
    count = tangent.shape[1]
    scores = (tangent * left[:, None]).reshape(len(time), signals, count).sum(axis=1)
    number = np.floor((time - time[0]) / block).astype(np.int64)
    sums = np.stack([np.bincount(number, weights=column) for column in scores.T], axis=1)
    blocks = len(np.unique(number))
    inverse = np.linalg.pinv(tangent.T @ tangent)
    covariance = np.zeros((2, 2))
    covariance[:count, :count] = (
        inverse @ (sums.T @ sums) @ inverse * blocks / max(blocks - count, 1)
    )
    return covariance
