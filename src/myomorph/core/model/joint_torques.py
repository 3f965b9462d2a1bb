"""Torques of joints, with the external forces that they are under."""

from __future__ import annotations

from dataclasses import field
from typing import Any, Self

from myomorph.core.model.arrays import read_only
from myomorph.core.model.series import Series, Wrenches


@read_only
class JointTorques(Series):
    """Generalized forces of a motion, as inverse dynamics finds them: values (frames, coordinates).

    They carry the external forces, so that whatever shares them among muscles knows what else acts
    on the body. A table of torques from elsewhere is a `Series` and does not.

    Attributes
    ----------
    wrenches : all external forces at the same times; None where none act
    """

    wrenches: Wrenches | None = field(default=None, kw_only=True)

    def _of_arrays(self, which: Any, **changes: Any) -> Self:
        """Take parts of the arrays, and the frames of the external forces that belong to them.

        Parameters
        ----------
        which : of their frames or, as a tuple, of frames and columns
        changes : of other fields
        """
        if self.wrenches is not None:
            frames = which[0] if isinstance(which, tuple) else which
            changes.setdefault("wrenches", self.wrenches.frames(frames))
        return super()._of_arrays(which, **changes)
