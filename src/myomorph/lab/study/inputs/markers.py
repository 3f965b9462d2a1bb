"""Markers of a trial, and what else their recording holds: events and force plates."""

from __future__ import annotations

from dataclasses import dataclass, field
from pathlib import Path
from typing import Annotated

from myomorph.core.model.messages import located
from myomorph.core.model.series import Trial
from myomorph.lab.store import stored as store
from myomorph.lab.store.results import ResultWriter, file_source
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.input import Input, Opened, Opening, Recorded
from myomorph.lab.study.inputs.keys import File
from myomorph.lab.study.inputs.labels import Labels
from myomorph.lab.study.inputs.laboratory import Laboratory


@dataclass(frozen=True)
class MarkersFile:
    """Recording of markers (.trc, .c3d, .mat or .h5)."""

    markers: Annotated[Path | None, File(per="trial")] = None


@dataclass(frozen=True, eq=False)
class Recording(Recorded):
    """A recording in the model's ground, its markers under the model's names."""

    trial: Trial = field(default_factory=Trial)

    def put(self, writer: ResultWriter) -> None:
        """Write events and outlines of plates."""
        store.put_events(writer, self.trial.events)
        store.put_plates(writer, self.trial.plates)


def _open(settings: MarkersFile, opening: Opening) -> Opened:
    """Read the recording, turned, with the model's labels, and check its size by the model's."""
    path = settings.markers
    model = opening.model
    if path is None:
        return Opened()
    labels = opening.settings.or_default(Labels).labels
    reading.check_labels(labels, model)
    upright = opening.settings.or_default(Laboratory).trial(reading.read_recording(path))
    recording = reading.fitted_to(model, reading.with_labels(upright, labels))
    return Opened(
        values=(Recording(recording),),
        sources=(file_source("markers", path),),
        warnings=located(path.name, recording.warnings),
        real=f"markers from {path.name}",
    )


INPUT = Input(
    name="markers",
    settings=MarkersFile,
    open=_open,
    main="markers",
    holds=("loads", "error sizes", "person", "session"),
)
