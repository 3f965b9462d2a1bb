"""Parts of the motion that the report tells apart."""

from __future__ import annotations

import json
from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import Annotated

from myomorph.core.model.causes import SETTINGS
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.study.inputs.input import Input, Opened, Opening, Recorded
from myomorph.lab.study.inputs.keys import Spans
from myomorph.lab.study.inputs.markers import Recording


@dataclass(frozen=True)
class Phases(Recorded):
    """NAME=START,END [s]: parts of the motion that the report shows apart."""

    phases: Annotated[Mapping[str, tuple[float, float]], Spans(per="trial")] = field(
        default_factory=lambda: FrozenMap({})
    )

    @property
    def facts(self) -> Mapping[str, str]:
        """Start and end of each."""
        return FrozenMap(
            {"phases": json.dumps({name: list(span) for name, span in self.phases.items()})}
        )


def _open(settings: Phases, opening: Opening) -> Opened:
    """Themselves, with a warning of those outside the recording."""
    markers = opening.values.or_default(Recording).trial.markers
    if markers is None:
        return Opened((settings,))
    start = float(markers.time[0])
    stop = float(markers.time[-1])
    warnings = tuple(
        SETTINGS.message(
            f"phase '{name}' is specified from {first:g} to {last:g} s, the recording lasts from"
            f" {start:g} to {stop:g} s",
            severity="may change results",
        )
        for name, (first, last) in settings.phases.items()
        if last <= start or first >= stop
    )
    return Opened((settings,), warnings=warnings)


INPUT = Input(name="phases", settings=Phases, open=_open)
