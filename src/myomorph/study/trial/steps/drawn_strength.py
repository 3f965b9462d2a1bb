"""Whether the body of a draw could have done what was recorded: one whose muscles fall short was not the subject's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.errors import MyomorphError
from myomorph.tension.tension import Tension
from myomorph.tension.terms.actuators import RESERVE, RESIDUAL

OF_TORQUE, OF_LARGEST = 0.1, 0.02
"""Reserve beyond that of the result: shares of the coordinate's own largest torque, and of the largest of all."""
OF_WEIGHT = 0.05
"""Residual force beyond that of the result, as a share of the weight (Hicks et al. 2015)."""


class TooWeak(MyomorphError):
    """A drawn body whose muscles cannot do what was recorded."""


@dataclass(frozen=True)
class Strength:
    """What reserves and residual forces may give in a draw, by their names [N m or N]."""

    most: dict[str, float]

    @classmethod
    def of(cls, tension: Tension, weight: float) -> Strength:
        """What the result without errors needs, and a tolerance.

        Parameters
        ----------
        weight : of the body [N]
        """
        peaks = dict(zip(tension.coordinates, _peaks(tension.torques), strict=True))
        largest = max(peaks.values(), default=0.0)
        most = {}
        for name, peak in zip(tension.reserve_names, _peaks(tension.reserves), strict=True):
            if name.startswith(f"{RESIDUAL}F"):
                most[name] = peak + OF_WEIGHT * weight
            elif name.startswith(RESERVE):
                own = peaks.get(name.removeprefix(RESERVE), 0.0)
                most[name] = peak + max(OF_TORQUE * own, OF_LARGEST * largest)
        return cls(most)

    def check(self, tension: Tension) -> None:
        """Raise `TooWeak` where a reserve of a draw gives more."""
        for name, peak in zip(tension.reserve_names, _peaks(tension.reserves), strict=True):
            if peak > self.most.get(name, np.inf):
                raise TooWeak(f"{name} gives {peak:.3g}, at most {self.most[name]:.3g} can be")


def _peaks(values: np.ndarray) -> list[float]:
    return np.abs(np.nan_to_num(values)).max(axis=0, initial=0.0).tolist()
