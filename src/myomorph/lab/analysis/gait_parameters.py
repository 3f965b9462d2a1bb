"""Spatio-temporal parameters of a walk, by side, each over its strides."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.analysis.stride_spread import StrideSpread, stride_spreads
from myomorph.lab.analysis.strides import Stride, Strides

UNITS: Mapping[str, str] = FrozenMap(
    {
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
)

ParameterTable = Mapping[str, Mapping[str, StrideSpread]]
"""By parameter of `UNITS` and side ("right", "left")."""


def gait_parameters(*recordings: Strides) -> ParameterTable:
    """Return parameters with how strides differ; those known in no stride have no sides.

    Parameters
    ----------
    recordings : strides of one person, together
    """
    table: dict[str, dict[str, StrideSpread]] = {name: {} for name in UNITS}
    for side in SIDES:
        rows = [row for strides in recordings for row in _rows(strides, side)]
        if not rows:
            continue
        for name, spread in zip(UNITS, stride_spreads(np.array(rows)), strict=True):
            if spread.count:
                table[name][side] = spread
    return FrozenMap({name: FrozenMap(sides) for name, sides in table.items()})


def _rows(strides: Strides, side: str) -> list[tuple[float, ...]]:
    """Return the numbers of each stride of a side."""
    limb = next((name for name in strides.strikes if split_side(name)[1] == side), "")
    if not limb:
        return []
    other = next((name for name in strides.strikes if name != limb), "")
    return [_values(stride, strides, other) for stride in strides.of(limb)]


def _values(stride: Stride, strides: Strides, other: str) -> tuple[float, ...]:
    """Return one stride's numbers, in the order of `UNITS`."""
    struck = [time for time in strides.strikes.get(other, ()) if stride.start < time < stride.stop]
    return (
        stride.speed,
        120.0 / stride.duration,
        stride.duration,
        stride.stop - struck[-1] if struck else float("nan"),
        stride.length,
        stride.step,
        stride.width,
        100.0 * stride.duty,
        _double_support(stride, strides, other, struck),
    )


def _double_support(stride: Stride, strides: Strides, other: str, struck: list[float]) -> float:
    """Return the share of a stride in which both feet stand [%], nan where it was not seen."""
    if not struck:
        return float("nan")
    lifted = [time for time in strides.lifts.get(other, ()) if stride.start <= time <= struck[0]]
    if not lifted or not stride.lift > struck[0]:
        return float("nan")
    return 100.0 * (lifted[0] - stride.start + stride.lift - struck[0]) / stride.duration
