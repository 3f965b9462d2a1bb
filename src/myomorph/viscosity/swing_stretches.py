"""Stretches of a swing that are left out of identification and predicted from their first frame."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array
from myomorph.viscosity.passive_law import PassiveLaw
from myomorph.viscosity.swing_motion import SwingMotion, angles_apart, measured_motion, swing_forward
from myomorph.viscosity.swing_sums import SwingSums
from myomorph.viscosity.swings import SwingRecording


@dataclass(frozen=True, eq=False)
class Stretch:
    """Whole swings of one recording that follow each other.

    Attributes
    ----------
    frames : of the recording
    blocks : their numbers in the sums of all recordings
    """

    recording: SwingRecording
    frames: slice
    blocks: np.ndarray

    @property
    def seconds(self) -> float:
        """Length [s]."""
        time = self.recording.time[self.frames]
        return float(time[-1] - time[0])

    def training(self, blocks: int) -> Array:
        """(blocks,) one for every swing but those of the stretch."""
        counts = np.ones(blocks)
        counts[self.blocks] = 0.0
        return counts

    @property
    def measured(self) -> SwingMotion:
        """As it was measured."""
        return measured_motion(self.recording, self.frames)

    def predicted(self, parameters: Array, law: PassiveLaw) -> SwingMotion:
        """As a limb with a passive law would have swung from the first frame."""
        return swing_forward(self.recording, self.frames, parameters, law)

    def errors(self, predicted: SwingMotion, free_offset: bool) -> Array:
        """(3,) mean square of angle [rad^2], moment [(N m)^2] and force [N^2], measured less predicted.

        Parameters
        ----------
        free_offset : the plate's zero is not known, so that only changes of the wrench are compared
        """
        measured = self.measured
        wrench = measured.wrench - predicted.wrench
        if free_offset:
            wrench = wrench - wrench.mean(axis=0)
        angle = np.mean(angles_apart(measured.rotations, predicted.rotations) ** 2)
        square = np.square(wrench)
        return np.array([angle, square[:, :3].sum(axis=1).mean(), square[:, 3:].sum(axis=1).mean()])


def stretches(recordings: Sequence[SwingRecording], sums: SwingSums, horizon: float, count: int) -> list[Stretch]:
    """Up to `count` stretches of at least `horizon` [s], spread over the recordings.

    Where no two are so long, single swings; where there are no two of these either, none.

    Parameters
    ----------
    sums : of the recordings, its blocks single swings
    """
    for least in (horizon, 0.0):
        found = _every(recordings, sums, least)
        if len(found) > 1:
            chosen = np.unique(np.linspace(0, len(found) - 1, min(count, len(found))).round().astype(int))
            return [found[i] for i in chosen]
    return []


def _every(recordings: Sequence[SwingRecording], sums: SwingSums, least: float) -> list[Stretch]:
    found: list[Stretch] = []
    joined: list[int] = []
    for block, (number, use) in enumerate(zip(sums.trial, sums.uses, strict=True)):
        follows = joined and sums.trial[joined[-1]] == number and sums.uses[joined[-1]][-1] + 1 == use[0]
        joined = [*joined, block] if follows else [block]
        if use[-1] - use[0] + 1 != len(use):
            joined = []
            continue
        one, frames = recordings[number], slice(int(sums.uses[joined[0]][0]), int(use[-1]) + 1)
        if frames.stop - frames.start > 1 and one.time[frames.stop - 1] - one.time[frames.start] >= least:
            found.append(Stretch(one, frames, np.array(joined)))
            joined = []
    return found
