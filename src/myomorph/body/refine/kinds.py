"""The kinds of unknowns that `refine` estimates beside motions: the names in `fit`."""

from __future__ import annotations

from collections.abc import Callable

from myomorph.body.refine.clock import Clock
from myomorph.body.refine.kind import Kind, Setup
from myomorph.body.refine.lengths import Lengths
from myomorph.body.refine.marker_positions import MarkerPositions
from myomorph.body.refine.masses import Masses
from myomorph.body.refine.options import (
    CLOCK,
    LENGTHS,
    MARKERS,
    MASSES,
    MOTIONS,
    RefineOptions,
)
from myomorph.core.model.errors import check_name

KINDS: dict[str, Callable[[Setup], Kind]] = {
    LENGTHS: Lengths.of,
    MARKERS: MarkerPositions.of,
    MASSES: Masses.of,
    CLOCK: Clock.of,
}
"""What makes each kind; one acts on what those before it have made."""
BODY = (LENGTHS, MARKERS, MASSES)
"""Kinds that a body has whether they are estimated or held; others are there where they are
estimated.
"""


def kinds_of(setup: Setup) -> tuple[Kind, ...]:
    """Make the kinds of a problem.

    Parameters
    ----------
    setup : what they are made of
    """
    names = [name for name in KINDS if name in BODY or name in setup.options.fit]
    return tuple(KINDS[name](setup) for name in names)


def check_fit(options: RefineOptions) -> None:
    """Refuse names in `fit` that are no kind.

    Parameters
    ----------
    options : with the names

    Raises
    ------
    UnknownName : a name is neither a kind nor "motions"
    """
    for name in options.fit:
        check_name("unknowns", name, (*KINDS, MOTIONS), "what can be refined")
