"""What was found in a file."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Inspection:
    """What a file holds: its kind in words, (label, text) in the order to show them, and what looks wrong."""

    kind: str
    facts: tuple[tuple[str, str], ...]
    warnings: tuple[str, ...] = ()

    def lines(self) -> list[str]:
        """The inspection as text, a fact or a warning a line."""
        width = max((len(label) for label, _ in self.facts), default=0)
        shown = [self.kind, *(f"  {label:<{width}}  {text}" for label, text in self.facts)]
        return shown + [f"  warning: {line}" for line in self.warnings]
