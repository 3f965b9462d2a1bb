"""The files of a calibration, and what it gives."""

from __future__ import annotations

from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from myomorph.model.provenance import Provenance, Source
from myomorph.motion.calibrate import Calibration
from myomorph.store.results import file_source

if TYPE_CHECKING:
    pass


@dataclass(frozen=True)
class CalibrationFiles:
    """The files of a calibration.

    Attributes
    ----------
    markers : TRC or C3D files
    static : recording of standing still, where there is one
    marker_set : OpenSim marker set that replaces the model's markers of the same names
    tasks : OpenSim task set or setup file whose weights of markers count
    time : start and end of every recording but the static one [s]
    """

    model: Path
    markers: tuple[Path, ...]
    static: Path | None = None
    marker_set: Path | None = None
    tasks: Path | None = None
    time: tuple[float, float] | None = None

    def sources(self) -> tuple[Source, ...]:
        """The files by their hashes."""
        named = (("static", self.static), ("marker set", self.marker_set), ("tasks", self.tasks))
        given = [("model", self.model), *(("markers", path) for path in self.markers)]
        given += [(role, path) for role, path in named if path is not None]
        return tuple(file_source(role, path) for role, path in given)


@dataclass(frozen=True, eq=False)
class Calibrated:
    """A calibration and what it was made from.

    Attributes
    ----------
    recordings : names of the recordings, in the calibration's order
    warnings : of the files, one line each
    """

    found: Calibration
    recordings: tuple[str, ...]
    provenance: Provenance
    warnings: tuple[str, ...]
