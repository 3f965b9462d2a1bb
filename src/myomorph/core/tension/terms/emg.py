"""EMG as a term: what is known of each muscle's activation draws it into an interval."""

from __future__ import annotations

from typing import Literal

import numpy as np

from myomorph.core.model.arrays import Array, freeze, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import index_of
from myomorph.core.model.series import Series
from myomorph.core.tension.terms.term import Penalties, Term, Unknowns

STIFFNESS = 1e4
"""Cost of passing the slack of driven muscles, of the excess squared, in units of the effort a^2 of
one muscle.
"""


@read_only
class EmgTarget(Term):
    """Activations known from EMG, at the motion's times: k dist(a, [l, h])^2.

    Attributes
    ----------
    muscles : names of the muscles that are known of
    activations : (frames, muscles) in 0..1, NaN where unknown
    mode : "soft": in place of the effort, the cost has weight (a - activation)^2; "driven": a may
        differ by `slack` only, beyond which a stiff cost of the same form gives way, so that the
        problem always has a solution
    weight : of the soft target, in units of the effort a^2 of one muscle; 0 for none
    slack : [activation]
    others : (frames, muscles) what synergies say of further muscles, drawn softly; None for nothing
    others_weight : of that, in units of the effort a^2 of one muscle
    """

    muscles: tuple[str, ...]
    activations: Array
    mode: Literal["soft", "driven"] = "soft"
    weight: float = 10.0
    slack: float = 0.02
    others: Series | None = None
    others_weight: float = 1.0

    def __post_init__(self) -> None:
        object.__setattr__(self, "muscles", tuple(self.muscles))
        freeze(self, activations=(-1, len(self.muscles)))
        if self.mode not in ("soft", "driven"):
            raise BadData(f"unknown use of EMG '{self.mode}': there are 'soft', 'driven'")
        if not (self.weight >= 0.0 and self.slack >= 0.0):
            raise BadData(f"EMG weight {self.weight:g}, slack {self.slack:g}: expected 0 or more")

    def penalties(self, unknowns: Unknowns) -> Penalties:
        """L = h near EMG with a soft target, EMG -+ slack with driven muscles.

        Beside a firm target the effort says nothing more of a muscle: w a^p + s (a - t)^2 is least
        at the EMG where

            t = EMG + w p EMG^(p-1) / (2 s),

        so that co-contraction costs nothing. The share s / (1 + s) of that is added: all of it to a
        firm target, nothing to one that is hardly there.

        Raises
        ------
        BadData : EMG has another number of frames than the motion, or knows of a muscle twice
        UnknownName : it knows of a muscle that the model does not have
        """
        names, values = self._all_targets()
        if len(values) != len(unknowns.time):
            raise BadData(
                f"EMG has {len(values)} frames, the motion {len(unknowns.time)}: both must have the"
                " same times"
            )
        columns = [
            index_of("muscle", name, unknowns.muscles, "the model, for EMG,") for name in names
        ]
        if len(set(columns)) != len(columns):
            twice = next(name for name in names if names.count(name) > 1)
            raise BadData(f"EMG is given for muscle '{twice}' twice: combine its channels first")
        measured = np.arange(len(names)) < len(self.muscles)
        soft = ~measured | (self.mode == "soft")
        weight = np.where(
            measured, self.weight if self.mode == "soft" else STIFFNESS, self.others_weight
        )

        effort = unknowns.muscle_term.variables()
        w = effort.weight[columns]
        p = effort.exponent[columns]
        held = np.clip(values, 0.0, 1.0)
        firm = values + w * p * held ** (p - 1.0) / (2.0 * (1.0 + weight))
        goals = np.where(soft, firm, values)
        slack = np.where(soft, 0.0, self.slack)
        return Penalties(
            columns=columns,
            low=goals - slack,
            high=goals + slack,
            weight=np.where(np.isfinite(values), weight, 0.0),
        )

    def _all_targets(self) -> tuple[tuple[str, ...], Array]:
        """Names and (frames, muscles) activations of EMG, and of what synergies tell."""
        if self.others is None:
            return self.muscles, self.activations
        values = np.hstack([self.activations, self.others.values])
        return (*self.muscles, *self.others.names), values
