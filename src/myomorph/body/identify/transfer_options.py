"""Options of `transfer`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.segments import Segment


@dataclass(frozen=True)
class TransferOptions:
    """Options of a transfer.

    Attributes
    ----------
    rounds : maximum number of rounds of scaling and posing
    tolerance : convergence tolerance: largest movement of a joint center relative to the lower
        model's in a round [m]
    keep_markers : keep the markers of the higher model that the lower model does not have
    lower_segments, higher_segments : segments of bodies whose names do not show them
    """

    rounds: int = 8
    tolerance: float = 1e-4
    keep_markers: bool = False
    lower_segments: Mapping[str, Segment] = field(default_factory=lambda: FrozenMap({}))
    higher_segments: Mapping[str, Segment] = field(default_factory=lambda: FrozenMap({}))
