"""A low-pass filter without lag for what is looked at and not computed with.

It needs neither Numba nor `scipy.signal`, which take longer to import than a walk to solve: finding
out which movement a recording shows costs next to nothing.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array


def smooth_both_ways(values: Array, rate: float, cutoff: float, padding: int) -> Array:
    """Low-pass values by a second-order Butterworth forwards and backwards.

    Both ends are extended, point-reflected at the end points. So `scipy.signal.sosfiltfilt` does
    with the sections of `scipy.signal.butter(2, cutoff, fs=rate)`.

    Parameters
    ----------
    values : (frames, ...) at a steady rate, NaN in gaps, which spread over the whole column
    rate : of the frames [Hz]
    cutoff : below half the rate [Hz]
    padding : frames of each extension, fewer than there are

    Returns
    -------
    (frames, ...) filtered
    """
    before = 2.0 * values[0] - values[padding:0:-1]
    after = 2.0 * values[-1] - values[-2 : -2 - padding : -1]
    extended = np.concatenate([before, values, after])
    columns = extended.reshape(len(extended), -1)
    section = _Section.lowpass(rate, cutoff)
    for number, column in enumerate(columns.T.tolist()):
        forwards = section.filtered(column)
        columns[:, number] = section.filtered(forwards[::-1])[::-1]
    return extended[padding : padding + len(values)]


@dataclass(frozen=True, kw_only=True)
class _Section:
    """A second-order recursion, y_n = b (x_n + 2 x_(n-1) + x_(n-2)) - a_1 y_(n-1) - a_2 y_(n-2).

    Attributes
    ----------
    gain : b
    first, second : a_1 and a_2
    """

    gain: float
    first: float
    second: float

    @staticmethod
    def lowpass(rate: float, cutoff: float) -> _Section:
        """Design a Butterworth low-pass.

        By the bilinear transform with w = tan(pi cutoff / rate), the poles of
        1 / (s^2 + sqrt(2) s + 1) give

            b = w^2 / d,  a_1 = 2 (w^2 - 1) / d,  a_2 = (w^2 - sqrt(2) w + 1) / d,
            d = w^2 + sqrt(2) w + 1

        Parameters
        ----------
        rate : of the samples [Hz]
        cutoff : at which half the power passes [Hz]
        """
        w = float(np.tan(np.pi * cutoff / rate))
        damping = float(np.sqrt(2.0)) * w
        scale = w * w + damping + 1.0
        return _Section(
            gain=w * w / scale,
            first=2.0 * (w * w - 1.0) / scale,
            second=(w * w - damping + 1.0) / scale,
        )

    def filtered(self, samples: Sequence[float]) -> list[float]:
        """Filter samples as if all before the first were equal to it."""
        last_input = earlier_input = samples[0]
        last_output = earlier_output = samples[0]
        outputs = []
        for sample in samples:
            output = (
                self.gain * (sample + 2.0 * last_input + earlier_input)
                - self.first * last_output
                - self.second * earlier_output
            )
            outputs.append(output)
            earlier_input = last_input
            last_input = sample
            earlier_output = last_output
            last_output = output
        return outputs
