"""The noise of a recording: how far each marker or coordinate errs, and for how long alike."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.fit.correlation import correlation_times
from myomorph.core.fit.trends import detrended
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData, check_name

MIN_FRAMES = 30  # Fewer show no correlation
FLOOR_BAND = 0.8  # From this share of half the sampling rate on, a spectrum is noise alone
MIN_BAND = 8  # Frequencies that a floor needs


def residual_sd(squares: float, count: int, explained: float) -> float:
    """Estimate the standard deviation of noise from what a fit left.

        sqrt(sum of squares / (count - explained))

    Parameters
    ----------
    squares : sum of squares of the residuals
    count : of recorded numbers
    explained : of them, as many as the fit can follow: unknowns less what their priors hold

    Returns
    -------
    in the residuals' unit; infinite where nothing is left

    Examples
    --------
    >>> from myomorph.core.fit.noise import residual_sd
    >>> residual_sd(squares=8.0, count=10, explained=8.0)
    2.0
    """
    freedom = count - explained
    return float(np.sqrt(squares / freedom)) if freedom > 0.0 else np.inf


@read_only
class RecordingNoise:
    """Errors of each item of a recording, as far as they are known; NaN is "not known".

    Attributes
    ----------
    names : of markers or coordinates
    unit : of the standard deviations
    sd : (items,) standard deviation along one axis
    correlation_time : (items,) time over which errors are one independent sample [s]
    floor : (items,) standard deviation of the white part alone, from the spectrum's floor
    gaps : (items,) share of the frames in which an item is missing
    """

    names: tuple[str, ...]
    unit: str
    sd: Array
    correlation_time: Array
    floor: Array
    gaps: Array

    def sd_of(self, name: str) -> float | None:
        """Look up the standard deviation of one item, None where it is not known."""
        check_name("item", name, self.names, "the noise of the recording")
        value = float(self.sd[self.names.index(name)])
        return value if np.isfinite(value) else None

    def with_floor(self, values: Array) -> RecordingNoise:
        """Add the spectrum's floor.

        Parameters
        ----------
        values : (frames, items, axes) recorded, NaN where missing

        Returns
        -------
        the noise with the floor of each item
        """
        return replace(self, floor=spectrum_floor(values))

    @property
    def known(self) -> bool:
        """Whether the standard deviation of any item is known."""
        return bool(np.isfinite(self.sd).any())

    @property
    def sentence(self) -> str:
        """The noise in words."""
        if not self.known:
            return "the noise of the recording is not known"
        middle = float(np.nanmedian(self.sd))
        alike = float(np.nanmedian(self.correlation_time))
        return f"noise {middle:.3g} {self.unit} (median), correlated over {alike:.2g} s"


def noise_of_residuals(
    names: Sequence[str],
    time: Array,
    residuals: Array,
    unit: str,
    explained: float = 0.0,
) -> RecordingNoise:
    """Estimate the noise of a recording from what a fit left of it.

    Parameters
    ----------
    names : of the items
    time : (frames,) evenly spaced [s]
    residuals : (frames, items, axes) fitted less recorded, as by inverse kinematics; NaN where
        missing
    unit : of the residuals
    explained : share of the recorded numbers that the fit can follow, so that their errors are not
        in the residuals; from 0.8 on the residuals show no noise

    Returns
    -------
    what is known of each item; the spectrum's floor not yet, see `RecordingNoise.with_floor`

    Raises
    ------
    BadData : names, time and residuals do not belong together

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> left = np.random.default_rng(0).normal(scale=0.002, size=(500, 1, 3))
    >>> found = mm.fit.noise_of_residuals(("heel",), np.arange(500) / 100.0, left, "m")
    >>> round(found.sd_of("heel"), 3)
    0.002
    """
    frames, items, axes = residuals.shape
    if items != len(names) or frames != len(time):
        raise BadData(
            f"{len(names)} names and {len(time)} times of residuals {residuals.shape}: expected"
            " (frames, items, axes)"
        )
    sd = np.full(items, np.nan)
    alike = np.full(items, np.nan)
    step = float(np.median(np.diff(time))) if frames > 1 else np.nan
    seen = np.asarray(np.isfinite(residuals).all(axis=2))
    for item in range(items):
        if seen[:, item].sum() < MIN_FRAMES or explained >= 0.8:
            continue
        own = residuals[:, item]
        count = axes * int(seen[:, item].sum())
        squares = float(np.sum(own[seen[:, item]] ** 2))
        sd[item] = residual_sd(squares, count, explained * count)
        alike[item] = step * float(np.median(correlation_times([own])))
    return RecordingNoise(
        names=tuple(names),
        unit=unit,
        sd=sd,
        correlation_time=alike,
        floor=np.full(items, np.nan),
        gaps=1.0 - seen.mean(axis=0) if frames else np.ones(items),
    )


def spectrum_floor(values: Array) -> Array:
    """White noise of signals, from what is left of their spectrum near half the sampling rate.

    The mean square of n samples of white noise is spread evenly over all frequencies, so that the
    part above a share s of half the rate holds 1 - s of it. Movement has nothing there; a low-pass
    of the recording may, and then the floor is no lower bound of the noise below.

    Parameters
    ----------
    values : (frames, items, axes); NaN where missing

    Returns
    -------
    (items,) standard deviation along one axis in the unit of the values, NaN where too few frames
    in a row show it

    Examples
    --------
    >>> import numpy as np
    >>> from myomorph.core.fit.noise import spectrum_floor
    >>> time = np.arange(2000)[:, None, None] / 100.0
    >>> noise = np.random.default_rng(0).normal(scale=0.002, size=(2000, 1, 3))
    >>> spectrum_floor(np.sin(2.0 * np.pi * time) + noise).round(3)
    array([0.002])
    """
    floor = np.full(values.shape[1], np.nan)
    for item in range(values.shape[1]):
        own = values[:, item]
        pieces = runs(np.asarray(np.isfinite(own).all(axis=1)))
        start, stop = max(pieces, key=lambda piece: piece[1] - piece[0], default=(0, 0))
        frames = stop - start
        if frames * 0.5 * (1.0 - FLOOR_BAND) < MIN_BAND:
            continue
        # A window lets little of the slow movement leak into fast frequencies.
        window = np.hanning(frames)
        smooth = detrended(own[start:stop]) * window[:, None]
        power = np.square(np.abs(np.fft.rfft(smooth, axis=0))) / np.square(window).sum()
        band = power[int(FLOOR_BAND * (len(power) - 1)) : -1]
        floor[item] = np.sqrt(np.mean(band))
    return floor
