"""Poses of segments over time, as programs without markers record them."""

from __future__ import annotations

from dataclasses import replace

from myomorph.core.model.arrays import Array, freeze, read_only


@read_only
class SegmentPoses:
    """Poses of the segments of a body over time, in the laboratory.

    Attributes
    ----------
    time : (frames,) ascending [s]
    names : one per segment
    rotations : (frames, segments, 3, 3) from the segment to the laboratory, NaN where unknown
    origins : (frames, segments, 3) [m], NaN where unknown
    """

    time: Array
    names: tuple[str, ...]
    rotations: Array
    origins: Array

    def __post_init__(self) -> None:
        shape = (len(self.time), len(self.names), 3)
        freeze(self, time=(-1,), rotations=(*shape, 3), origins=shape)

    def __len__(self) -> int:
        return len(self.time)

    def rotated(self, rotation: Array) -> SegmentPoses:
        """Express the poses in another frame.

        Parameters
        ----------
        rotation : (3, 3) whose rows are the axes of the frame in the laboratory

        Returns
        -------
        the poses
        """
        return replace(self, rotations=rotation @ self.rotations, origins=self.origins @ rotation.T)
