"""The part of a recording that is used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from myomorph.core.model.messages import located
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import Span
from myomorph.lab.study.inputs.markers import MarkersFile, Recording
from myomorph.lab.study.inputs.motion import MotionFile, RecordedMotion


@dataclass(frozen=True)
class TimeSpan:
    """START END [s]: part of the recording that is used."""

    time: Annotated[tuple[float, float] | None, Span()] = None


def _open(settings: TimeSpan, opening: Opening) -> Opened:
    """Itself, held against the recording."""
    motion = opening.values.get(RecordedMotion)
    recorded = opening.values.or_default(Recording).trial.markers
    series = recorded if motion is None else motion.motion
    if series is None:
        return Opened((settings,))
    files = opening.settings
    path = files[MotionFile].motion if motion is not None else files[MarkersFile].markers
    assert path is not None
    warnings = located(path.name, reading.cut_warning(settings.time, series))
    return Opened((TimeSpan(reading.cut_to(settings.time, series, path)),), warnings=warnings)


INPUT = Input(name="time", settings=TimeSpan, open=_open)
