"""Recordings condensed to equations, with what was chosen on them."""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.parts import Parts, held_out
from myomorph.body.identify.unseen import ChosenPrior, Strength
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.soft_tissue import SoftTissue


@read_only
class Fitted:
    """Parts of recordings, with the noise and strength of the prior that were chosen on them.

    Attributes
    ----------
    recordings : whose motion is that of the body's mass
    parts : of these recordings
    tissue : that was taken from the motion of the markers; None for none
    choice : on those parts
    """

    recordings: tuple[Recording, ...]
    parts: Parts
    tissue: SoftTissue | None
    choice: ChosenPrior

    def misfits(self, strength: Strength) -> Array:
        """Compute the misfit on each held-out part.

        Parameters
        ----------
        strength : problem of choosing how far data may move masses

        Returns
        -------
        (folds, 2) root mean square of moment [N m] and force [N]
        """
        noise, _, sd = self.choice
        parts = self.parts
        return np.sqrt(
            held_out(parts, lambda fold: strength.fit(parts, noise, sd, parts.without(fold)), noise)
        )
