"""EMG envelopes over the strides of the side that a channel was measured on."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.series import Emg
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.cycles import over_cycles
from myomorph.lab.analysis.gait_curves import SAMPLES, known_mean
from myomorph.lab.analysis.strides import Stride


@read_only
class EmgStrides:
    """One channel over the strides of its side.

    Attributes
    ----------
    channel : name
    muscle : channel without its side, which both sides share
    side : "right" or "left"
    values : (strides, SAMPLES) over the largest value of their mean, NaN where not known
    """

    channel: str
    muscle: str
    side: str
    values: Array

    def __post_init__(self) -> None:
        freeze(self, values=(-1, SAMPLES))


def emg_strides(
    emg: Emg, strides: Mapping[str, Sequence[Stride]], muscles: Mapping[str, Sequence[str]]
) -> list[EmgStrides]:
    """Cut channels into strides.

    Parameters
    ----------
    emg : envelopes
    strides : by side
    muscles : of the model that a channel was measured on, by channel

    Returns
    -------
    channels whose side is known and that were measured during a stride
    """
    found = []
    for index, channel in enumerate(emg.names):
        muscle, side = _muscle_and_side(channel, muscles.get(channel, ()))
        spans = [(stride.start, stride.stop) for stride in strides.get(side, ())]
        if not spans:
            continue
        values = over_cycles(emg.columns([index]), spans, SAMPLES).values[:, :, 0]
        highest = np.nanmax(known_mean(values), initial=0.0)
        if highest > 0.0:
            scaled = values / highest
            found.append(EmgStrides(channel=channel, muscle=muscle, side=side, values=scaled))
    return found


def _muscle_and_side(channel: str, muscles: Sequence[str]) -> tuple[str, str]:
    """Return a channel without its side, and the side that its name or its muscles have."""
    base, side = split_side(channel)
    if not side:
        # As in soleus_l_activation
        stem, _, ending = channel.rpartition("_")
        inner, side = split_side(stem)
        base = f"{inner}_{ending}" if side else base
    sides = {split_side(muscle)[1] for muscle in muscles}
    if not side and len(sides) == 1:
        side = sides.pop()
    return base, side
