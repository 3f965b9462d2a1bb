"""How alike successive errors are, and so how many of them count: the one autocorrelation time."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array


def autocovariance(runs: Sequence[Array]) -> Array:
    """Sum products of values that lie a lag apart, over runs.

    Values are errors about 0. What is missing (NaN) counts as zero, which takes nothing from the
    lags' mean.

    Parameters
    ----------
    runs : (frames, columns) each, evenly spaced in time

    Returns
    -------
    (lags, columns) from lag 0 to the longest run's length less 1
    """
    longest = max(len(run) for run in runs)
    covariance = np.zeros((longest, runs[0].shape[1]))
    for run in runs:
        frames = len(run)
        values = np.where(np.isfinite(run), run, 0.0)
        spectrum = np.fft.rfft(values, 2 * frames, axis=0)
        covariance[:frames] += np.fft.irfft(np.abs(spectrum) ** 2, 2 * frames, axis=0)[:frames]
    return covariance


def correlation_times(runs: Sequence[Array], together: bool = False) -> Array:
    """Frames that say as much about a mean as one independent frame.

        1 + 2 sum_k rho_k

    with the autocorrelation rho at lags k. Pairs of successive lags are summed as long as they are
    positive, for further ones are noise. So many independent frames are there as all frames over
    this time.

    Source: Geyer 1992, Practical Markov chain Monte Carlo, Statistical Science 7(4):473.

    Parameters
    ----------
    runs : (frames, columns) errors about 0, evenly spaced in time; NaN where missing
    together : whether all columns have one correlation

    Returns
    -------
    (columns,) [frames], 1 or more; (1,) of all columns together

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.correlation import correlation_times
    >>> white = np.random.default_rng(0).normal(size=(5000, 1))
    >>> bool(correlation_times([white])[0] < 1.1)
    True
    """
    covariance = autocovariance(runs)
    if together:
        covariance = covariance.sum(axis=1, keepdims=True)
    pairs = len(covariance) // 2
    if not pairs:
        return np.ones(covariance.shape[1])
    rho = covariance / np.maximum(covariance[0], 1e-300)
    sums = rho[: 2 * pairs].reshape(pairs, 2, -1).sum(axis=1)
    positive = np.cumprod(sums > 0.0, axis=0)
    return np.maximum(2.0 * (sums * positive).sum(axis=0) - 1.0, 1.0)


def variance_samples(runs: Sequence[Array]) -> float:
    """Independent samples that tell the variance of all columns together.

        N / sum_k rho_k^2

    over lags k of either sign, to half the longest run. White noise through an ideal low-pass has
    two samples a period of its cutoff.

    Source: Bartlett 1946, On the theoretical specification and sampling properties of
    autocorrelated time-series, Supplement to the Journal of the Royal Statistical Society 8(1):27.

    Parameters
    ----------
    runs : (frames, columns) errors about 0, evenly spaced in time

    Returns
    -------
    their number, at most that of all values

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.correlation import variance_samples
    >>> white = np.random.default_rng(0).normal(size=(5000, 1))
    >>> bool(variance_samples([np.repeat(white, 2, axis=0)]) < 7000)
    True
    """
    covariance = autocovariance(runs).sum(axis=1)
    rho = covariance[: max(len(covariance) // 2, 1)]
    rho = rho / rho[0] if rho[0] > 0.0 else np.eye(1, len(rho))[0]
    return float(sum(run.size for run in runs) / (2.0 * np.square(rho).sum() - 1.0))
