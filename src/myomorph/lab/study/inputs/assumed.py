"""What was assumed of a recording, for the first lines of the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from myomorph.lab.study.inputs.input import Input, Opened
from myomorph.lab.study.inputs.keys import Sentences


@dataclass(frozen=True)
class Assumed:
    """What was assumed of a recording, for the first lines of the report."""

    assumed: Annotated[tuple[str, ...], Sentences()] = ()


INPUT = Input(
    name="assumed",
    settings=Assumed,
    open=lambda settings, opening: Opened(assumed=settings.assumed),
)
