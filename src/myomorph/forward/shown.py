"""A simulated body as pages draw it."""

from __future__ import annotations

from dataclasses import dataclass

from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches


@dataclass(frozen=True, eq=False, kw_only=True)
class ShownRun:
    """What a page draws of a run.

    Attributes
    ----------
    name : of the run
    model : that moved
    motion : its coordinates
    activations : of its muscles, over the same times
    wrenches : of contacts, None for none
    """

    name: str
    model: Model
    motion: Motion
    activations: Series
    wrenches: Wrenches | None = None
