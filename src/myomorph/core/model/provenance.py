"""Provenance of results: inputs by their hashes, options, version and date."""

from __future__ import annotations

import hashlib
import json
from collections.abc import Mapping
from dataclasses import asdict, dataclass, field

from myomorph.core.model.frozen_map import FrozenMap

FORMER_OPTIONS = {"ik.mend": "ik.repair"}
"""Names that options had in results of versions before 0.2."""
FORMER_CHOICES = {"mend": "repair"}
"""The same of their choices."""


@dataclass(frozen=True)
class Source:
    """One input of a step.

    Attributes
    ----------
    role : what it was used as: "model", "markers", "loads", ...
    name : path of the file, or a name for a value that was made in memory
    sha256 : of the file's bytes, or of the value
    """

    role: str
    name: str
    sha256: str


@dataclass(frozen=True)
class Provenance:
    """Inputs and options that one step's result was derived from.

    Attributes
    ----------
    step : "ik", "id", "muscles", "tension"
    sources : the inputs
    options : of the step, by option name; values are numbers, texts, None or lists of them
    version : of Myomorph
    date : when it was made, ISO 8601 with time zone
    """

    step: str
    sources: tuple[Source, ...]
    options: Mapping[str, object] = field(default_factory=lambda: FrozenMap({}))
    version: str = ""
    date: str = ""

    @property
    def key(self) -> str:
        """Hash of all that determines the result.

        Equal keys mean an equal result, whatever its name or date.
        """
        parts = [self.step, self.version, sorted(self.options.items())]
        parts.append(sorted((source.role, source.sha256) for source in self.sources))
        return hashlib.sha256(json.dumps(parts, default=str).encode()).hexdigest()

    def to_json(self) -> str:
        """Write the provenance as a line of JSON."""
        values = asdict(self) | {"options": dict(self.options), "key": self.key}
        return json.dumps(values, default=str)

    @staticmethod
    def from_json(text: str) -> Provenance:
        """Read a provenance that `to_json` wrote.

        Raises
        ------
        ValueError : the text is something else
        """
        try:
            stored = json.loads(text)
            sources = tuple(
                Source(source["role"], source["name"], source["sha256"])
                for source in stored["sources"]
            )
            return Provenance(
                step=stored["step"],
                sources=sources,
                options=_present_options(stored["options"]),
                version=stored["version"],
                date=stored["date"],
            )
        except (KeyError, TypeError) as error:
            raise ValueError(f"not a provenance: {error}") from None


def _present_options(stored: Mapping[str, object]) -> dict[str, object]:
    """Give options their present names, and choices theirs."""
    return {
        FORMER_OPTIONS.get(name, name): (
            FORMER_CHOICES.get(value, value) if isinstance(value, str) else value
        )
        for name, value in stored.items()
    }
