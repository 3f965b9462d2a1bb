"""Spatio-temporal parameters of a walk, by side, each as the mean over its strides with an
interval.
"""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.interval import Interval
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.cycles import band
from myomorph.lab.analysis.strides import Stride, Strides

UNITS: Mapping[str, str] = {
    "Walking speed": "m/s",
    "Cadence": "steps/min",
    "Stride time": "s",
    "Step time": "s",
    "Stride length": "m",
    "Step length": "m",
    "Step width": "m",
    "Stance": "% of the stride",
    "Double support": "% of the stride",
}
LEVEL = 0.9


def gait_parameters(strides: Strides) -> dict[str, dict[str, Interval]]:
    """By parameter of `UNITS` and side ("right", "left"): the mean, and its interval of 90 % by
    Student's t.
    """
    limbs = {split_side(limb)[1]: limb for limb in strides.strikes}
    table: dict[str, dict[str, Interval]] = {name: {} for name in UNITS}
    for side, limb in limbs.items():
        other = next((name for name in strides.strikes if name != limb), "")
        rows = [_values(stride, strides, other) for stride in strides.of(limb)]
        for index, name in enumerate(UNITS):
            values = np.array([row[index] for row in rows])
            values = values[np.isfinite(values)]
            if len(values):
                limits = band(values[:, None], LEVEL)
                table[name][side] = Interval(
                    float(values.mean()), float(limits.low[0]), float(limits.high[0])
                )
    return table


def _values(stride: Stride, strides: Strides, other: str) -> tuple[float, ...]:
    """One stride's numbers, in the order of `UNITS`."""
    nan = float("nan")
    struck = [time for time in strides.strikes.get(other, ()) if stride.start < time < stride.stop]
    step = stride.stop - struck[-1] if struck else nan
    double = nan
    lifted = [
        time
        for time in strides.lifts.get(other, ())
        if struck and stride.start <= time <= struck[0]
    ]
    if lifted and stride.lift > struck[0]:
        double = 100.0 * (lifted[0] - stride.start + stride.lift - struck[0]) / stride.duration
    lengths = stride.length, stride.step, stride.width
    return (
        stride.speed,
        120.0 / stride.duration,
        stride.duration,
        step,
        *lengths,
        100.0 * stride.duty,
        double,
    )
