"""Masses that change no more than what was measured shows.

Of a link whose mass is x +- p after the measurement and was m before, a mass m + d in the direction
of x is farther from the truth than m with the probability

    Phi((d / 2 - (x - m)) / p)

for the truth must then lie on the other side of m + d / 2. The largest change for which that is at
most `MAX_RISK` is taken, and no more than x: d = 0 where the 95 % interval of x holds m, and
d = x - m from twice its half width on. Single masses hardly change any wrench, as mass moves
between neighbors unseen: mass centers and moments of inertia take over.
"""

from __future__ import annotations

from typing import Literal

import numpy as np

from myomorph.body.identify.pseudo_inertia import SMALLEST_SHARE
from myomorph.body.identify.stated_rows import StatedRows
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array, read_only

MAX_RISK = 0.025
"""Probability with which a link's mass may end farther from the truth than it was before."""
HELD = 1e-6  # Relative error of a mass that is held
Evidence = Literal["shown", "partly shown", "not shown"]
"""Whether a mass takes all of its expected change, some of it or none."""


def shown_masses(before: Array, expected: Array, sd: Array) -> Array:
    """Change masses as far as a measurement shows.

    Parameters
    ----------
    before : (bodies,) masses before anything is measured [kg]
    expected : (bodies,) after it [kg]
    sd : (bodies,) standard deviations of the expected ones [kg]

    Returns
    -------
    (bodies,) between both [kg]
    """
    change = expected - before
    shown = np.abs(change) - half_width(sd, 1.0 - 2.0 * MAX_RISK)
    return before + np.sign(change) * np.clip(2.0 * shown, 0.0, np.abs(change))


def mass_evidence(before: Array, expected: Array, sd: Array) -> tuple[Evidence, ...]:
    """Say of each mass whether a measurement shows that it is another one than before.

    Parameters
    ----------
    before, expected, sd : as of `shown_masses`

    Returns
    -------
    one for each link
    """
    taken = np.abs(shown_masses(before, expected, sd) - before)
    whole = np.abs(expected - before)
    return tuple(
        _evidence(part, change) for part, change in zip(taken.tolist(), whole.tolist(), strict=True)
    )


def _evidence(taken: float, change: float) -> Evidence:
    """Compare the change of a mass that is taken with the expected one [kg]."""
    if not taken > 0.0:
        return "not shown"
    return "shown" if taken >= change else "partly shown"


@read_only
class HeldMasses(StatedRows):
    """Rows of unit noise that hold masses of all links but the heaviest, which has the rest.

    Attributes
    ----------
    rows : (held, 10 bodies) A
    right : (held,) b of A x = b
    """

    @classmethod
    def of(cls, masses: Array) -> HeldMasses:
        """Hold masses.

        Parameters
        ----------
        masses : (bodies,) [kg]

        Returns
        -------
        a row for each of the held ones
        """
        held = masses > SMALLEST_SHARE * masses.sum()
        held[np.argmax(masses)] = False
        chosen = np.flatnonzero(held)
        rows = np.zeros((len(chosen), 10 * len(masses)))
        rows[np.arange(len(chosen)), 10 * chosen] = 1.0 / (HELD * masses[chosen])
        return cls(rows=rows, right=np.full(len(chosen), 1.0 / HELD))
