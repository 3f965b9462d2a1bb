"""What was assumed of a recording, for the first lines of the report, and warnings among it."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Annotated

from myomorph.lab.causes import SESSION
from myomorph.lab.study.inputs.input import Input, Opened, Opening
from myomorph.lab.study.inputs.keys import Sentences


@dataclass(frozen=True)
class Assumed:
    """What was assumed of a recording, for the first lines of the report."""

    assumed: Annotated[tuple[str, ...], Sentences()] = ()


WARNING = "WARNING: "
"""Begins a sentence on persons or movements that is a warning."""


def opened(settings: Assumed, opening: Opening) -> Opened:
    """Sentences, those that warn of the person or the movement as messages."""
    warnings = [text for text in settings.assumed if text.startswith(WARNING)]
    return Opened(
        assumed=tuple(text for text in settings.assumed if text not in warnings),
        warnings=tuple(
            SESSION.message(text.removeprefix(WARNING), severity="changes results")
            for text in warnings
        ),
    )


INPUT = Input(name="assumed", settings=Assumed, open=opened)
