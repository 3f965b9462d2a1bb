"""Whether the body of a draw could have done what was recorded: one whose muscles fall short was not the subject's."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.errors import MyomorphError
from myomorph.tension.tension import RESERVE, Tension

LARGE = 0.3
"""Share of the largest torque from which a coordinate's muscles are judged: those of toes are weak in every model."""
BEYOND = 0.2
"""Share of a coordinate's largest torque that its reserve may give beyond its share in the result."""


class TooWeak(MyomorphError):
    """A drawn body whose muscles cannot do what was recorded."""


@dataclass(frozen=True)
class Strength:
    """What share of the largest torque of coordinates reserves may give in a draw, by the coordinates' names."""

    most: dict[str, float]

    @classmethod
    def of(cls, tension: Tension) -> Strength:
        """What the result without errors needs, and a tolerance."""
        peaks, reserves = _torques(tension), _reserves(tension)
        largest = max(peaks.values(), default=0.0)
        judged = [name for name in reserves if peaks.get(name, 0.0) > LARGE * largest]
        return cls({name: reserves[name] / peaks[name] + BEYOND for name in judged})

    def check(self, tension: Tension) -> None:
        """Raise `TooWeak` where reserves of a draw give more."""
        peaks, reserves = _torques(tension), _reserves(tension)
        for name, most in self.most.items():
            if reserves[name] > most * peaks[name]:
                share = 100.0 * reserves[name] / max(peaks[name], 1e-300)
                raise TooWeak(
                    f"the reserve of {name} gives {share:.0f} % of its torque, {100.0 * most:.0f} % at most can be"
                )


def _torques(tension: Tension) -> dict[str, float]:
    return dict(zip(tension.coordinates, _peaks(tension.torques), strict=True))


def _reserves(tension: Tension) -> dict[str, float]:
    peaks = zip(tension.reserve_names, _peaks(tension.reserves), strict=True)
    return {name.removeprefix(RESERVE): peak for name, peak in peaks if name.startswith(RESERVE)}


def _peaks(values: np.ndarray) -> list[float]:
    return np.abs(np.nan_to_num(values)).max(axis=0, initial=0.0).tolist()
