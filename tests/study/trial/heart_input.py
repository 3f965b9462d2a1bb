"""An input that the package does not have: how fast the heart beat during a recording."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from pathlib import Path
from typing import Annotated, Any

import numpy as np

from myomorph.core.model.errors import BadFile
from myomorph.lab.store.results import ResultWriter, file_source
from myomorph.lab.study.inputs.beside import companion
from myomorph.lab.study.inputs.input import Beside, Input, Opened, Opening
from myomorph.lab.study.inputs.keys import File


@dataclass(frozen=True)
class HeartFile:
    """Times of heartbeats, one a line [s]."""

    heart: Annotated[Path | None, File(per="trial")] = None


@dataclass(frozen=True)
class HeartRate:
    """Beats a minute."""

    rate: float

    @property
    def facts(self) -> Mapping[str, str]:
        """What result files hold of it."""
        return {"heart_rate": f"{self.rate:.1f}"}

    def put(self, writer: ResultWriter) -> None:
        """Nothing beside the facts."""


def _open(settings: HeartFile, opening: Opening) -> Opened:
    path = settings.heart
    if path is None:
        return Opened()
    times = np.atleast_1d(np.loadtxt(path))
    if len(times) < 2:
        raise BadFile(path, "has fewer than two heartbeats", "expected times [s], one a line")
    rate = HeartRate(60.0 / float(np.mean(np.diff(times))))
    return Opened((rate,), (file_source("heart", path),), real=f"heart rate from {path.name}")


def _beside(recording: Path, values: Mapping[str, Any]) -> Beside:
    return Beside(companion(recording, ("heart",), (".txt",)))


INPUT = Input(name="heart", settings=HeartFile, open=_open, main="heart", beside=_beside)
