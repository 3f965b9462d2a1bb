"""Measured excitations in the tension problem: what is known of each muscle's activation, and how it is used."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData


@dataclass(frozen=True, eq=False)
class EmgTarget:
    """Activations that EMG tells, at the motion's times.

    Attributes
    ----------
    muscles : names of the muscles that are told of
    activations : (frames, muscles) in 0..1, NaN where unknown
    mode : "soft": the cost gains weight (a - activation)^2; "equality": a may differ by `slack` only, beyond
        which a stiff cost of the same form gives way, so that the problem always has a solution
    weight : of the soft target, in units of the effort a^2 of one muscle
    slack : [activation]
    """

    muscles: tuple[str, ...]
    activations: Array
    mode: Literal["soft", "equality"] = "soft"
    weight: float = 10.0
    slack: float = 0.02

    def __post_init__(self) -> None:
        object.__setattr__(self, "muscles", tuple(self.muscles))
        object.__setattr__(self, "activations", frozen_array(self.activations, (-1, len(self.muscles))))
        if self.mode not in ("soft", "equality"):
            raise BadData(f"unknown use of EMG '{self.mode}': there are 'soft', 'equality'")
        if not (self.weight > 0.0 and self.slack >= 0.0):
            raise BadData(f"EMG weight {self.weight:g}, slack {self.slack:g}: expected above 0, and 0 or more")
