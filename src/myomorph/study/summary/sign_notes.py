"""Angles of one name that count up in one model and down in another, so that their mean means nothing."""

from __future__ import annotations

from collections.abc import Sequence

from myomorph.study.trial.tidy import Value

SMALL, LARGE = 10.0, 25.0
"""An angle that stays within the first on one side of zero and passes the second on the other bends one way [deg]."""

MOST_NAMED = 4


class SignSearch:
    """Which angles bend to which side, by subject; of each trial nothing else is kept."""

    def __init__(self) -> None:
        self._above: dict[str, dict[str, None]] = {}
        self._below: dict[str, dict[str, None]] = {}

    def add(self, subject: str, values: Sequence[Value]) -> None:
        """Values of one more trial."""
        told = {one.quantity: one.value for one in values if one.unit == "deg"}
        for quantity, most in told.items():
            name, ending, _ = quantity.partition(", maximum")
            least = told.get(f"{name}, minimum")
            if not ending or quantity != f"{name}, maximum" or least is None:
                continue
            if least > -SMALL and most > LARGE:
                self._above.setdefault(name, {})[subject] = None
            elif most < SMALL and least < -LARGE:
                self._below.setdefault(name, {})[subject] = None

    def notes(self) -> list[str]:
        """One line for all angles that bend one way in some subjects and the other way in others."""
        sides: dict[tuple[tuple[str, ...], tuple[str, ...]], list[str]] = {}
        for name, above in self._above.items():
            if name in self._below:
                sides.setdefault((tuple(above), tuple(self._below[name])), []).append(name)
        return [
            f"{_few(names)}: above zero in {_few(above)}, below it in {_few(below)}: where their models count it "
            "the other way round, means over these subjects mean nothing"
            for (above, below), names in sides.items()
        ]


def _few(names: Sequence[str]) -> str:
    more = f" and {len(names) - MOST_NAMED} more" if len(names) > MOST_NAMED else ""
    return ", ".join(names[:MOST_NAMED]) + more
