"""Age, sex and height of the subject, as far as they are known."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import dataclass, replace
from typing import Annotated, Literal

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.lab.study.inputs.input import Input, Opened, Opening, Recorded
from myomorph.lab.study.inputs.keys import KeyKind
from myomorph.lab.study.inputs.markers import Recording

METERS = re.compile(r"([\d.]+) m")


@dataclass(frozen=True)
class RecordedPerson(Recorded):
    """Who was recorded, beside the mass.

    Attributes
    ----------
    age : age of the subject [years], which selects the norms of gait
    sex : sex of the subject: female or male
    height : height of the subject [m]; by default as stated in the recording
    """

    age: Annotated[float | None, KeyKind(per="subject")] = None
    sex: Annotated[Literal["female", "male"] | None, KeyKind(per="subject")] = None
    height: Annotated[float | None, KeyKind(per="subject")] = None

    @property
    def facts(self) -> Mapping[str, str]:
        """The numbers and the word, "" where they are not known."""
        return FrozenMap(
            {
                "age": "" if self.age is None else repr(self.age),
                "sex": self.sex or "",
                "height": "" if self.height is None else repr(self.height),
            }
        )


def _open(settings: RecordedPerson, opening: Opening) -> Opened:
    """Return what is stated; a height that nobody states is that of the recording's file."""
    if settings.height is None:
        facts = opening.values.or_default(Recording).trial.facts
        found = METERS.fullmatch(facts.get("height", ""))
        if found is not None:
            settings = replace(settings, height=float(found[1]))
    return Opened((settings,))


INPUT = Input(name="person", settings=RecordedPerson, open=_open)
