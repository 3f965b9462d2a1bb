"""How the axes of a laboratory stand to those of the model.

They are the axis that points up, and the way that people face.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated, Literal

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Trial, Wrenches
from myomorph.core.model.spatial import axis_rotation
from myomorph.lab.store.results import value_source
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import KeyKind

Up = Literal["", "x", "-x", "y", "-y", "z", "-z"]
UPRIGHT: dict[str, tuple[tuple[float, float, float], ...]] = {
    "x": ((0, -1, 0), (1, 0, 0), (0, 0, 1)),
    "-x": ((0, 1, 0), (-1, 0, 0), (0, 0, 1)),
    "y": ((1, 0, 0), (0, 1, 0), (0, 0, 1)),
    "-y": ((1, 0, 0), (0, -1, 0), (0, 0, -1)),
    "z": ((1, 0, 0), (0, 0, 1), (0, -1, 0)),
    "-z": ((1, 0, 0), (0, 0, -1), (0, 1, 0)),
}
"""Rotations, rows the new axes in the laboratory, by which the named axis becomes y."""


@dataclass(frozen=True)
class Laboratory:
    """Axes of a recording's laboratory.

    Attributes
    ----------
    up : vertical axis of the recording; by default it is detected
    turn : rotation of the recording about the model's vertical, counterclockwise seen from above
        [degrees]
    """

    up: Annotated[Up, KeyKind()] = ""
    turn: Annotated[float, KeyKind()] = 0.0

    def __bool__(self) -> bool:
        return bool(self.up) or self.turn != 0.0

    @property
    def rotation(self) -> Array:
        """(3, 3) from the laboratory to the model's ground, y up."""
        turned: Array = axis_rotation((0.0, 1.0, 0.0), np.deg2rad(self.turn))
        return turned @ np.array(UPRIGHT[self.up or "y"], dtype=np.float64)

    def trial(self, trial: Trial) -> Trial:
        """Turn a recording to the model's ground."""
        return trial.rotated(self.rotation) if self else trial

    def wrenches(self, wrenches: Wrenches) -> Wrenches:
        """External forces in the model's ground."""
        return wrenches.rotated(self.rotation) if self else wrenches


AS_RECORDED: Laboratory = Laboratory()


def _open(settings: Laboratory, opening: Opening) -> Opened:
    """Markers and forces are turned where they are read."""
    return (
        Opened(sources=(value_source("laboratory", "axes of the laboratory", settings),))
        if settings
        else Opened()
    )


INPUT = Input(name="laboratory", settings=Laboratory, open=_open)
