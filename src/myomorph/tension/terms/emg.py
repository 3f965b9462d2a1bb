"""EMG as a term: what is known of each muscle's activation draws it into an interval."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import index_of
from myomorph.tension.terms.term import Penalties, Term, Unknowns

STIFFNESS = 1e4
"""Cost of passing the slack of an equality, of the excess squared, in units of the effort a^2 of one muscle."""


@read_only
@dataclass(frozen=True, eq=False)
class EmgTarget(Term):
    """Activations known from EMG, at the motion's times: k dist(a, [l, h])^2.

    Attributes
    ----------
    muscles : names of the muscles that are known of
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

    def penalties(self, unknowns: Unknowns) -> Penalties:
        """L = h = EMG with a soft target, EMG -+ slack with an equality.

        Raises
        ------
        BadData
            where EMG has another number of frames than the motion, or knows of a muscle twice
        UnknownName
            where it knows of a muscle that the model does not have
        """
        frames = len(unknowns.time)
        if len(self.activations) != frames:
            raise BadData(f"EMG has {len(self.activations)} frames, the motion {frames}: both must have the same times")
        columns = [index_of("muscle", name, unknowns.muscles, "the model, for EMG,") for name in self.muscles]
        if len(set(columns)) != len(columns):
            twice = next(name for name in self.muscles if self.muscles.count(name) > 1)
            raise BadData(f"EMG is given for muscle '{twice}' twice: combine its channels first")
        slack, stiffness = (0.0, self.weight) if self.mode == "soft" else (self.slack, STIFFNESS)
        weight = np.where(np.isfinite(self.activations), stiffness, 0.0)
        return Penalties(columns, self.activations - slack, self.activations + slack, weight)
