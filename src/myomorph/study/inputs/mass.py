"""Mass of the subject."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass
from typing import Annotated

from myomorph.model.frozen_map import FrozenMap
from myomorph.store.results import ResultWriter
from myomorph.study.inputs.input import Input, Opened, Opening
from myomorph.study.inputs.keys import KeyKind


@dataclass(frozen=True)
class BodyMass:
    """What the subject weighs.

    Attributes
    ----------
    mass : of the subject [kg]
    """

    mass: Annotated[float | None, KeyKind(per="subject")] = None

    @property
    def facts(self) -> Mapping[str, str]:
        """The number."""
        return FrozenMap({"mass": "" if self.mass is None else repr(self.mass)})

    def put(self, writer: ResultWriter) -> None:
        """Write nothing beside the facts."""


def _open(settings: BodyMass, opening: Opening) -> Opened:
    return Opened((settings,))


INPUT = Input(name="mass", settings=BodyMass, open=_open)
