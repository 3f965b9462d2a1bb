"""Mass of the subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.study.inputs.input import Input, Opened, Recorded
from myomorph.lab.study.inputs.keys import KeyKind


@dataclass(frozen=True)
class BodyMass(Recorded):
    """Mass of the subject [kg]."""

    mass: Annotated[float | None, KeyKind(per="subject")] = None

    @property
    def facts(self) -> Mapping[str, str]:
        """The number."""
        return FrozenMap({"mass": "" if self.mass is None else repr(self.mass)})


INPUT = Input(name="mass", settings=BodyMass, open=lambda settings, opening: Opened((settings,)))
