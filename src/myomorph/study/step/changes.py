"""What makes a result be computed again: how its inputs, options and version differ from those of an earlier run."""

from __future__ import annotations

import json
from collections.abc import Iterable, Mapping
from pathlib import PurePath

from myomorph.model.provenance import Provenance, Source

LONGEST = 60
"""Longest value that is reported whole [characters]."""


def changes(before: Provenance, after: Provenance) -> tuple[str, ...]:
    """Why a result that was made one way would come out otherwise the other way, () where the keys are equal: "model
    generic.osim has changed", "ik.tolerance 1e-05 -> 0.0001", "version 1.0.0 -> 1.1.0".
    """
    if before.key == after.key:
        return ()
    lines = []
    if before.version != after.version:
        lines.append(f"version {before.version or 'unknown'} -> {after.version or 'unknown'}")
    lines += _sources(before.sources, after.sources)
    names = sorted(before.options.keys() | after.options.keys())
    for name in names:
        old, new = _option(before.options, name), _option(after.options, name)
        if old != new:
            short = max(len(old), len(new)) <= LONGEST
            lines.append(f"{name} {old} -> {new}" if short else f"{name} has changed")
    return tuple(dict.fromkeys(lines)) or ("what it was made from has changed",)


def _sources(before: Iterable[Source], after: Iterable[Source]) -> list[str]:
    """Inputs that came, went or hold something else; a file that only moved is the same input."""
    result = []
    old, new = _by_role(before), _by_role(after)
    for role in dict.fromkeys((*old, *new)):
        gone = [
            source for source in old.get(role, ()) if source.sha256 not in {other.sha256 for other in new.get(role, ())}
        ]
        come = [
            source for source in new.get(role, ()) if source.sha256 not in {other.sha256 for other in old.get(role, ())}
        ]
        for source in come:
            same = next((other for other in gone if other.name == source.name), None)
            if same is None and len(gone) == len(come) == 1:
                same = gone[0]
            if same is None:
                result.append(f"{role} {_name(source)} is new")
                continue
            gone.remove(same)
            moved = "" if _name(same) == _name(source) else f"{_name(same)} -> "
            result.append(
                f"{role} {moved}{_name(source)} has changed" if not moved else f"{role} {moved}{_name(source)}"
            )
        result += [f"{role} {_name(source)} is no longer used" for source in gone]
    return result


def _by_role(sources: Iterable[Source]) -> dict[str, list[Source]]:
    result: dict[str, list[Source]] = {}
    for source in sources:
        result.setdefault(source.role, []).append(source)
    return result


def _name(source: Source) -> str:
    return PurePath(source.name.replace("\\", "/")).name or source.name


def _option(options: Mapping[str, object], name: str) -> str:
    """A value as text; stored ones were read back from JSON, so tuples and lists are the same."""
    return str(json.loads(json.dumps(options.get(name), default=str)))
