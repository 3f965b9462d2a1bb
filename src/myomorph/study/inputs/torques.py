"""Joint torques of a file, in the place of external forces and inverse dynamics."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import Annotated

from myomorph.model.series import Series
from myomorph.study.inputs.input import Input, later
from myomorph.study.inputs.keys import File


@dataclass(frozen=True)
class TorquesFile:
    """Generalized forces from elsewhere.

    Attributes
    ----------
    torques : joint torques from elsewhere (.sto, .mot), in the place of loads and inverse dynamics: columns named as
        coordinates, or with _moment and _force as OpenSim's inverse dynamics names them [N m, N]
    """

    torques: Annotated[Path | None, File(per="trial")] = None


@dataclass(frozen=True, eq=False)
class RecordedTorques:
    """Generalized forces of a file (frames, coordinates) [N m or N]."""

    torques: Series


INPUT = Input(
    name="torques", settings=TorquesFile, open=later("myomorph.study.inputs.torque_file:opened"), main="torques"
)
