"""Peaks of measured forces are of all samples: over strides too."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Series
from myomorph.lab.analysis.strides import Stride
from myomorph.lab.study.trial.trial_strides import TrialStrides, by_side, maxima_by_side

TIME = np.arange(0.0, 2.0, 0.001)


class Part:
    """Strides of both feet, as a part of a recording has them."""

    strides = tuple(
        Stride(
            limb=limb,
            start=start,
            lift=start + 0.6,
            stop=start + 1.0,
            length=1.0,
            width=0.1,
            seen=1.0,
            source="plates",
        )
        for limb, start in (("foot_r", 0.0), ("foot_l", 0.5))
    )

    def of(self, limb: str) -> tuple[Stride, ...]:
        return tuple(stride for stride in self.strides if stride.limb == limb)


def test_a_spike_between_samples_of_the_curve_is_the_peak_of_its_stride():
    strides = TrialStrides(trial="run", limbs=("foot_r", "foot_l"), parts=(Part(),))
    force = np.full((len(TIME), 2), 500.0)
    # 4 ms long, half way between two of the 101 samples of the stride.
    force[:, 0] += 1000.0 * np.exp(-(((TIME - 0.105) / 0.002) ** 2))
    force[:, 1] += 800.0 * np.exp(-(((TIME - 0.615) / 0.002) ** 2))
    series = Series(TIME, ("calcn_r", "calcn_l"), force)
    maxima = maxima_by_side(series, strides)
    assert maxima.shape == (1, 2)
    assert maxima[0] == pytest.approx([1500.0, 1300.0])
    cycles = by_side(series, strides)
    assert cycles.values[0].max(axis=0).max() < 1000.0


def test_what_is_not_known_has_no_peak():
    strides = TrialStrides(trial="run", limbs=("foot_r", "foot_l"), parts=(Part(),))
    force = np.full((len(TIME), 1), np.nan)
    assert np.isnan(maxima_by_side(Series(TIME, ("calcn_r",), force), strides)).all()
