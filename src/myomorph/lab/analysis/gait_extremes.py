"""Largest and smallest values and ranges of gait curves, of each stride by itself."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Literal, get_args

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.analysis.gait_curves import KEYS, GaitCurves
from myomorph.lab.analysis.stride_spread import StrideSpread, stride_spreads

Extreme = Literal["largest", "smallest", "range"]
EXTREMES: tuple[Extreme, ...] = get_args(Extreme)

ExtremeTable = Mapping[tuple[str, Extreme], StrideSpread]
"""By variable of `KEYS` and extreme."""


def gait_extremes(curves: GaitCurves, side: str) -> ExtremeTable:
    """Return extremes of the curves of a side, with how strides differ.

    Parameters
    ----------
    curves : of both sides over their strides
    side : "right" or "left"

    Returns
    -------
    those that are known in at least one stride
    """
    largest, smallest = _ends(curves.of(side))
    if side in curves.peak_force:
        largest[:, KEYS.index("vertical_force")] = curves.peak_force[side]
    values = {"largest": largest, "smallest": smallest, "range": largest - smallest}
    spreads = {extreme: stride_spreads(values[extreme]) for extreme in EXTREMES}
    return FrozenMap(
        {
            (key, extreme): spreads[extreme][index]
            for index, key in enumerate(KEYS)
            for extreme in EXTREMES
            if spreads[extreme][index].count
        }
    )


def _ends(values: Array) -> tuple[Array, Array]:
    """Return largest and smallest values over the samples.

    Parameters
    ----------
    values : (strides, samples, variables), NaN where not known

    Returns
    -------
    (strides, variables) each, NaN for what is known nowhere in a stride
    """
    known = np.isfinite(values).any(axis=1)
    largest = np.where(known, np.nan_to_num(values, nan=-np.inf).max(axis=1), np.nan)
    smallest = np.where(known, np.nan_to_num(values, nan=np.inf).min(axis=1), np.nan)
    return largest, smallest
