"""How many independent samples there are in series whose frames depend on each other."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from scipy.fft import irfft, next_fast_len, rfft

from myomorph.model.arrays import Array


def effective_samples(runs: Sequence[Array]) -> float:
    """Independent samples that tell the variance of series (frames, n): N / sum_k rho_k^2 (Bartlett 1946).

    The lags k are of either sign, to half the longest run. White noise through an ideal low-pass has two
    samples a period of its cutoff.
    """
    length = max(len(run) for run in runs)
    size = next_fast_len(2 * length)
    covariance = sum(irfft(np.abs(rfft(run, size, axis=0)) ** 2, size, axis=0).sum(axis=1) for run in runs)
    rho = np.asarray(covariance)[: max(length // 2, 1)]
    rho = rho / rho[0] if rho[0] > 0.0 else np.eye(1, len(rho))[0]
    return float(sum(run.size for run in runs) / (2.0 * np.square(rho).sum() - 1.0))
