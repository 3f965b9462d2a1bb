"""Whether the body of a draw could have done what was recorded: one whose muscles fall short was not the subject's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.errors import MyomorphError
from myomorph.tension.tension import Tension
from myomorph.tension.terms.actuators import RESERVE

LARGE = 0.3
"""Share of the largest torque from which a coordinate's muscles are judged: those of toes are weak in every model."""
BEYOND = 0.2
"""Reserve beyond that of the result, as a share of the coordinate's own largest torque."""


class TooWeak(MyomorphError):
    """A drawn body whose muscles cannot do what was recorded."""


@dataclass(frozen=True)
class Strength:
    """What reserves may give in a draw, by their names [N m or N]."""

    most: dict[str, float]

    @classmethod
    def of(cls, tension: Tension) -> Strength:
        """What the result without errors needs, and a tolerance."""
        peaks = dict(zip(tension.coordinates, _peaks(tension.torques), strict=True))
        largest = max(peaks.values(), default=0.0)
        most = {}
        for name, peak in zip(tension.reserve_names, _peaks(tension.reserves), strict=True):
            own = peaks.get(name.removeprefix(RESERVE), 0.0) if name.startswith(RESERVE) else 0.0
            if own > LARGE * largest:
                most[name] = peak + BEYOND * own
        return cls(most)

    def check(self, tension: Tension) -> None:
        """Raise `TooWeak` where a reserve of a draw gives more."""
        for name, peak in zip(tension.reserve_names, _peaks(tension.reserves), strict=True):
            if peak > self.most.get(name, np.inf):
                raise TooWeak(f"{name} gives {peak:.3g}, at most {self.most[name]:.3g} can be")


def _peaks(values: np.ndarray) -> list[float]:
    return np.abs(np.nan_to_num(values)).max(axis=0, initial=0.0).tolist()
