"""A recording through inverse kinematics, with its forces on the markers' clock."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.body.identify.recordings import Usable
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.series import Motion


@read_only
class Opened:
    """A trial through inverse kinematics, on the markers' clock, with the frames that count.

    Attributes
    ----------
    trial : as recorded
    motion : by inverse kinematics
    usable : motion and forces on one clock
    distances : (frames, markers) of the markers [m], NaN where unseen
    within : (frames,) of the forces' clock that count, None for all
    shift : added to the times of the forces before they were used [s]
    """

    trial: SubjectTrial
    motion: Motion
    usable: Usable
    distances: Array
    within: np.ndarray | None = None
    shift: float = 0.0

    @property
    def counted(self) -> Usable:
        """The recording, of which no more frames are used than count."""
        if self.within is None:
            return self.usable
        return replace(
            self.usable, recording=replace(self.usable.recording, use=self.usable.use & self.within)
        )
