"""What was assumed of a recording, for the first lines of the report."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from myomorph.study.inputs.input import Input, Opened, Opening
from myomorph.study.inputs.keys import Sentences


@dataclass(frozen=True)
class Assumed:
    """Sentences on a recording.

    Attributes
    ----------
    assumed : what was assumed, for the first lines of the report
    """

    assumed: Annotated[tuple[str, ...], Sentences()] = ()


def _open(settings: Assumed, opening: Opening) -> Opened:
    return Opened(assumed=settings.assumed)


INPUT = Input(name="assumed", settings=Assumed, open=_open)
