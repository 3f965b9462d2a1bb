"""Usual duration of a stride by the paths of feet, whichever way the body goes."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array, runs

LONGEST = 0.6  # Of a recording: a longer period is not seen to repeat
LIKENESS = 0.3  # Autocorrelation of paths a stride apart, 1 where all are alike
FIRST = 0.5  # Share of the largest autocorrelation that the first peak reaches
MIN_FRAMES = 8  # Frames in which a foot must be seen


def stride_period(time: Array, feet: Sequence[Array]) -> float:
    """Find the lag at which feet do again what they did, as the trunk sees them.

    The autocorrelation of a path r about its mean, over all feet,

        A(s) = mean over t of r(t) . r(t + s)

    falls below 0 at half a stride and is largest again after a whole one. It does not change where
    the body turns slowly.

    Parameters
    ----------
    time : (frames,) evenly spaced [s]
    feet : of each foot its path (frames, 3) as the trunk sees it [m], NaN where unseen

    Returns
    -------
    [s], NaN where the recording shows no two strides that are alike
    """
    step = float(np.median(np.diff(time)))
    likeness = _autocorrelation([foot for foot in feet if _is_seen(foot)], len(time))
    lags = min(len(likeness), int(LONGEST * len(time)))
    below = np.flatnonzero(likeness[:lags] < 0.0)
    if not len(below):
        return float("nan")
    later = likeness[below[0] : lags]
    largest = float(later.max())
    if largest < LIKENESS:
        return float("nan")
    # Where a body stops, a lag of several strides may be likelier than one.
    start, stop = runs(later > FIRST * largest)[0]
    peak = start + int(np.argmax(later[start:stop]))
    # One that still rises at the end was not seen.
    return float((below[0] + peak) * step) if peak + 1 < len(later) else float("nan")


def _is_seen(foot: Array) -> bool:
    return bool(np.isfinite(foot[:, 0]).sum() >= MIN_FRAMES)


def _autocorrelation(feet: Sequence[Array], frames: int) -> Array:
    """Autocorrelation of paths over lags, relative to that of lag 0.

    Parameters
    ----------
    feet : of each foot (frames, 3), NaN where unseen
    frames : number of them

    Returns
    -------
    (lags,)
    """
    sums = np.zeros(frames)
    counts = np.zeros(frames)
    size = 2 * frames
    for foot in feet:
        seen = np.isfinite(foot[:, 0])
        path = np.where(seen[:, None], foot - foot[seen].mean(axis=0), 0.0)
        spectrum = np.abs(np.fft.rfft(path, size, axis=0)) ** 2
        sums += np.fft.irfft(spectrum.sum(axis=1), size)[:frames]
        counts += np.fft.irfft(np.abs(np.fft.rfft(seen, size)) ** 2, size)[:frames]
    known = counts > 0.5
    means = np.where(known, sums / np.maximum(counts, 1.0), 0.0)
    return means / means[0] if frames and means[0] > 0.0 else np.zeros(frames)


def mean_rate(time: Array, values: Array, window: float) -> Array:
    """Mean rate of change over a window about each time.

    At the ends of a recording the window stays within it, as long as everywhere else.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, n), NaN where unknown: there the line between its neighbors counts
    window : [s]

    Returns
    -------
    (frames, n) per second
    """
    lasting = float(time[-1] - time[0])
    window = min(window, lasting)
    starts = np.clip(time - 0.5 * window, time[0], time[-1] - window)
    known = np.isfinite(values[:, 0])
    columns = [
        np.interp(starts + window, time[known], column[known])
        - np.interp(starts, time[known], column[known])
        for column in values.T
    ]
    return np.stack(columns, axis=1) / max(window, 1e-12)
