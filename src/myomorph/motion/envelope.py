"""Raw EMG to envelopes: band-pass, rectify, low-pass, scale to the largest value."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from scipy.signal import butter, sosfiltfilt

from myomorph.model.errors import BadData
from myomorph.model.series import Emg, Series


@dataclass(frozen=True)
class EnvelopeOptions:
    """How envelopes are made.

    Attributes
    ----------
    band : pass band of the raw signal [Hz]; its upper end is lowered to 0.45 of the rate
    cutoff : low-pass of the rectified signal [Hz]
    order : of the Butterworth filters, each run forwards and backwards
    """

    band: tuple[float, float] = (20.0, 450.0)
    cutoff: float = 6.0
    order: int = 4


def envelopes(raw: Series, options: EnvelopeOptions | None = None) -> Emg:
    """Linear envelopes of raw EMG (samples, channels), each channel scaled to its largest value.

    Zero-lag Butterworth band-pass, absolute value, zero-lag Butterworth low-pass (Merletti 1999,
    standards for reporting EMG data). Unknown samples (NaN) count as silence.

    Raises
    ------
    BadData
        where the recording is too short or too slow for the filters
    """
    options = options or EnvelopeOptions()
    rate, (low, high) = raw.rate, options.band
    high = min(high, 0.45 * rate)
    if not len(raw) > 30 * options.order or not low < high:
        raise BadData(
            f"EMG of {len(raw)} samples at {rate:g} Hz: expected at least {30 * options.order + 1} samples and a rate "
            f"above {low / 0.45:g} Hz"
        )
    signal = np.nan_to_num(raw.values, nan=0.0, posinf=0.0, neginf=0.0)
    band = butter(options.order, (low, high), "bandpass", fs=rate, output="sos")
    smooth = butter(options.order, options.cutoff, "lowpass", fs=rate, output="sos")
    found = np.clip(sosfiltfilt(smooth, np.abs(sosfiltfilt(band, signal, axis=0)), axis=0), 0.0, None)
    peak = found.max(axis=0)
    return Emg(raw.time, raw.names, found / np.where(peak > 0.0, peak, 1.0))
