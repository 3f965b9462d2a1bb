"""The title of the gait page: of how many strides it is, so that one never looks like a mean."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

from myomorph.lab.analysis.gait_curves import SIDES
from myomorph.lab.analysis.stride_spread import MIN_STRIDES


def gait_title(strides: Mapping[str, Sequence[object]]) -> str:
    """Say of how many strides the curves are, and whether they are means.

    Parameters
    ----------
    strides : by side
    """
    counts = {side: len(strides.get(side, ())) for side in SIDES if strides.get(side, ())}
    if not counts:
        return "No whole stride"
    if max(counts.values()) == 1:
        return f"Single strides, no mean: {_listed(counts)}"
    if min(counts.values()) >= MIN_STRIDES:
        return f"Mean of {sum(counts.values())} strides: {_listed(counts)}"
    sides = {side if count > 1 else f"{side} (no mean)": count for side, count in counts.items()}
    return f"Mean of few strides, each drawn: {_listed(sides)}"


def _listed(counts: Mapping[str, int]) -> str:
    return ", ".join(f"{count} {side}" for side, count in counts.items())
