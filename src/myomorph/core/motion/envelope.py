"""Raw EMG to envelopes: notch, band-pass, rectify, low-pass, scale to a largest value."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import ClassVar

import numpy as np
import scipy

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.series import Emg, Series


@dataclass(frozen=True)
class EnvelopeOptions:
    """Filters of EMG envelopes.

    Attributes
    ----------
    band : pass band of the raw signal [Hz]; its upper end is lowered to 0.45 of the rate
    cutoff : cutoff frequency of the low-pass filter of the rectified raw EMG [Hz]
    order : order of the Butterworth filters, each run forwards and backwards
    notch : mains frequency, which is removed with its harmonics [Hz]; by default nothing is removed
    notch_width : half-power width of each notch [Hz]
    """

    SETTING_PREFIX: ClassVar[str] = "emg_"

    band: tuple[float, float] = (20.0, 450.0)
    cutoff: float = 6.0
    order: int = 4
    notch: float | None = None
    notch_width: float = 2.0

    def __post_init__(self) -> None:
        if not (0.0 < self.band[0] < self.band[1] and self.cutoff > 0.0 and self.order >= 1):
            raise BadData(
                f"envelope with band {self.band[0]:g} to {self.band[1]:g} Hz, cutoff"
                f" {self.cutoff:g} Hz, order {self.order}: expected a rising band, a cutoff above 0"
                " and an order from 1"
            )
        if self.notch is not None and not (self.notch > self.notch_width > 0.0):
            raise BadData(
                f"notch at {self.notch:g} Hz, {self.notch_width:g} Hz wide: expected a width below"
                " its place"
            )


def envelopes(
    raw: Series, options: EnvelopeOptions | None = None, maxima: Mapping[str, float] | None = None
) -> Emg:
    """Linear envelopes of raw EMG (samples, channels), each channel scaled to a largest value.

    Source: Merletti 1999.

    Parameters
    ----------
    raw : EMG as recorded (samples, channels) in any unit, its rate at least twice the filters'
        frequencies [Hz]
    options : frequencies of the filters [Hz]; see `EnvelopeOptions`
    maxima : largest envelope of each channel in the units of `raw`, as `largest` finds it in
        reference trials (a maximum voluntary contraction); None takes each channel's own

    Returns
    -------
    envelopes (samples, channels), 1 at the largest value [-]

    Raises
    ------
    BadData
        where the recording is too short or too slow for the filters, or a maximum is not above 0
    UnknownName
        a channel is missing from `maxima`

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> time = np.arange(0.0, 2.0, 0.001)
    >>> burst = np.sin(np.pi * time) ** 2 * np.sin(700.0 * time)
    >>> found = mm.envelopes(mm.Series(time, ("flexor",), burst[:, None]))
    >>> len(found), float(found["flexor"].max())
    (2000, 1.0)
    """
    smoothed = linear_envelope(raw, options)
    peak = smoothed.values.max(axis=0)
    if maxima is not None:
        for name in raw.names:
            check_name("EMG channel", name, maxima, "the reference of maxima")
            if not maxima[name] > 0.0:
                raise BadData(
                    f"EMG channel '{name}': its largest value in the reference is {maxima[name]:g}"
                )
        peak = np.array([maxima[name] for name in raw.names])
    return Emg(raw.time, raw.names, smoothed.values / np.where(peak > 0.0, peak, 1.0))


def linear_envelope(raw: Series, options: EnvelopeOptions | None = None) -> Series:
    """Compute linear envelopes in the units of the raw EMG.

    Zero-lag notches where requested, zero-lag Butterworth band-pass, absolute value, zero-lag
    Butterworth low-pass. Unknown samples (NaN) count as silence, the channel's median.

    Source: Merletti 1999, standards for reporting EMG data.

    Parameters
    ----------
    raw : EMG as recorded (samples, channels) in any unit
    options : frequencies of the filters [Hz]; see `EnvelopeOptions`

    Returns
    -------
    (samples, channels), 0 or more, in the same unit

    Raises
    ------
    BadData : the recording is too short or too slow for the filters
    """
    # Brings SciPy: loaded only where it is needed.
    options = options or EnvelopeOptions()
    rate = raw.rate
    low, high = options.band
    high = min(high, 0.45 * rate)
    if not len(raw) > 30 * options.order or not low < high:
        raise BadData(
            f"EMG of {len(raw)} samples at {rate:g} Hz: expected at least {30 * options.order + 1}"
            f" samples and a rate above {low / 0.45:g} Hz"
        )
    if not options.cutoff < 0.5 * rate:
        raise BadData(
            f"envelopes with a cutoff of {options.cutoff:g} Hz: expected below half the rate of"
            f" {rate:g} Hz"
        )
    known = np.isfinite(raw.values)
    # Silence is the channel's own level: a gap set to 0 would be a step of the amplifier's offset.
    level = [
        np.median(column[use]) if use.any() else 0.0
        for column, use in zip(raw.values.T, known.T, strict=True)
    ]
    signal = np.where(known, raw.values - level, 0.0)
    for notch in _notches(options, rate, high):
        signal = scipy.signal.sosfiltfilt(notch, signal, axis=0)
    band = scipy.signal.butter(options.order, (low, high), "bandpass", fs=rate, output="sos")
    smooth = scipy.signal.butter(options.order, options.cutoff, "lowpass", fs=rate, output="sos")
    smoothed = scipy.signal.sosfiltfilt(
        smooth, np.abs(scipy.signal.sosfiltfilt(band, signal, axis=0)), axis=0
    )
    return Series(raw.time, raw.names, np.clip(smoothed, 0.0, None))


def largest(trials: Sequence[Series], options: EnvelopeOptions | None = None) -> dict[str, float]:
    """Find the largest envelope of each channel over reference trials of raw EMG.

    Parameters
    ----------
    trials : raw EMG (samples, channels) in any unit
    options : frequencies of the filters [Hz]; see `EnvelopeOptions`

    Returns
    -------
    by channel, in the same unit

    Raises
    ------
    BadData : a trial is too short or too slow for the filters
    """
    result: dict[str, float] = {}
    for trial in trials:
        for name, peak in zip(
            trial.names, linear_envelope(trial, options).values.max(axis=0), strict=True
        ):
            result[name] = max(result.get(name, 0.0), float(peak))
    return result


def _notches(options: EnvelopeOptions, rate: float, high: float) -> list[Array]:
    """Design the notches at the mains and at its harmonics within the band.

    Parameters
    ----------
    options : frequency and width of the notches [Hz]
    rate : of the samples [Hz]
    high : end of the band [Hz]

    Returns
    -------
    second-order sections (1, 6) of each
    """
    # Half a second to import, for raw EMG only.
    if options.notch is None:
        return []
    places = np.arange(options.notch, high, options.notch)
    notches = (
        scipy.signal.iirnotch(place, place / options.notch_width, fs=rate) for place in places
    )
    return [scipy.signal.tf2sos(*notch) for notch in notches]
