"""Names of markers that model and recording do not share, and which of them probably mean the same."""

from __future__ import annotations

import difflib
import re
from collections.abc import Sequence

from myomorph.model.errors import quoted
from myomorph.model.findings import Finding

FEW = 0.5
"""Share of the model's markers, and of those recorded, below which too few match."""

NEAR = 0.8
"""Likeness of two names, letters alone, from which one may be meant for the other."""


def spelling(name: str) -> str:
    """A name without what laboratories spell differently: case, dots, blanks, underscores, a subject's prefix."""
    return re.sub(r"[^a-z0-9]", "", name.rsplit(":", 1)[-1].lower())


def near_names(wanted: Sequence[str], offered: Sequence[str]) -> dict[str, str]:
    """For each wanted name the offered one that probably means it, where there is one; sides are never exchanged."""
    result: dict[str, str] = {}
    by_spelling = {spelling(name): name for name in reversed(offered)}
    for name in wanted:
        spelled = spelling(name)
        if spelled in by_spelling:
            result[name] = by_spelling[spelled]
    left = {spelling(name): name for name in offered if name not in result.values()}
    for name in wanted:
        if name in result or len(spelling(name)) < 4:
            continue
        spelled = spelling(name)
        for other in difflib.get_close_matches(spelled, list(left), n=3, cutoff=NEAR):
            # Another letter may be the side, another digit the number in a cluster: letters may only be missing.
            if _only_adds(spelled, other) or _only_adds(other, spelled):
                result[name] = left.pop(other)
                break
    return result


def _only_adds(short: str, long: str) -> bool:
    """Whether a name is another one with more letters put in, and the same first letter and digits."""
    if short[:1] != long[:1] or re.findall(r"\d", short) != re.findall(r"\d", long):
        return False
    rest = iter(long)
    return all(letter in rest for letter in short)


def name_findings(missing: Sequence[str], unused: Sequence[str], matched: int) -> tuple[Finding, ...]:
    """Too few markers that match, and names that are nearly those of the model.

    Parameters
    ----------
    missing : markers of the model that were not recorded
    unused : recorded markers that the model does not have
    matched : how many both have
    """
    model, recorded = matched + len(missing), matched + len(unused)
    near = near_names(missing, unused)
    hints = [f"'{other}' for '{name}'" for name, other in list(near.items())[:4]]
    hint = f"is {', '.join(hints)}{', ...' if len(near) > 4 else ''} meant?" if near else ""
    if matched < FEW * model and matched < FEW * recorded:
        text = (
            f"only {matched} of the model's {model} markers are among the {recorded} recorded: not in the model are "
            f"{quoted(unused)}; {hint + ' ' if hint else ''}map the names with --labels (labels in a study)"
        )
        return (Finding("unmatched markers", "markers", text),)
    if near:
        text = (
            f"{len(missing)} of the model's {model} markers were not recorded, and {len(unused)} recorded ones are not "
            f"in the model: {hint} Map the names with --labels (labels in a study)"
        )
        return (Finding("near names", ", ".join(near), text),)
    return ()
