"""Key poses of a stride: strike, the middle of the stance, and what ends it."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.gait_curves import GaitCurves
from myomorph.lab.analysis.strides import Stride, Strides
from myomorph.lab.report.trial.answer.main_result import KeyPose

BEFORE = 0.01
"""Push-off is pictured so long before the other foot strikes [s]."""
LATE = 0.85
"""Share of the stance at which it is pictured where that strike was not seen."""


def stance_poses(gait: GaitCurves, strides: Strides, last: str) -> tuple[KeyPose, ...]:
    """Three poses of the stance in the middle of the recording, of the right foot where possible.

    Parameters
    ----------
    gait : with the strides of both sides
    strides : of the recording, with all strikes
    last : "push-off", before the other foot strikes, or "toe off", the last contact
    """
    stride, side = _middle_stride(gait)
    if stride is None:
        return ()
    lift = stride.lift if np.isfinite(stride.lift) else stride.start + 0.6 * stride.duration
    end = lift if last == "toe off" else _before_other(stride, lift, strides)
    times = (stride.start, 0.5 * (stride.start + lift), end)
    words = (f"{side} foot strike", "mid stance", last)
    return tuple(
        KeyPose(time, word, 100.0 * (time - stride.start) / stride.duration)
        for time, word in zip(times, words, strict=True)
    )


def _middle_stride(gait: GaitCurves) -> tuple[Stride | None, str]:
    """Return the middle one of the right strides, else of the left ones, and its side."""
    for side in ("right", "left"):
        own = gait.strides[side]
        if own:
            return own[len(own) // 2], side
    return None, ""


def _before_other(stride: Stride, lift: float, strides: Strides) -> float:
    """Just before the other foot strikes within the stance, else late in it [s]."""
    side = split_side(stride.limb)[1]
    others = [limb for limb in strides.strikes if split_side(limb)[1] not in ("", side)]
    strikes = [
        float(time)
        for limb in others
        for time in strides.strikes[limb]
        if stride.start + 0.3 * (lift - stride.start) < time < lift
    ]
    return min(strikes) - BEFORE if strikes else stride.start + LATE * (lift - stride.start)
