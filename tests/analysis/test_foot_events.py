"""The direction of a body in place on a belt.

It is where the feet swing fastest, whatever the unit of length.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.lab.analysis.travel import CLEAR, FootPaths, travel_of

X, Y, Z = np.eye(3)
TIME = np.arange(0.0, 4.0, 0.01)


def _directed(unevenness: float, size: float) -> tuple[np.ndarray, str]:
    """Return the direction of feet whose speed is cos + b cos 2, and its note.

    The speed has a skewness of (3/4) b / ((1 + b^2) / 2)^1.5.
    """
    phases = (2.0 * np.pi * TIME, 2.0 * np.pi * TIME + np.pi)
    feet = [
        size * np.outer(np.sin(phase) + 0.5 * unevenness * np.sin(2.0 * phase), X)
        for phase in phases
    ]
    paths = FootPaths(time=TIME, trunk=np.zeros((len(TIME), 3)), feet=tuple(feet), up=Z)
    travel = travel_of(paths, facing=-X)
    assert not travel.over_ground
    return travel.direction, travel.notes[0]


@pytest.mark.parametrize("size", [0.02, 0.3, 20.0])
def test_even_feet_point_and_uneven_ones_swing_whatever_their_size(size):
    skewness = [0.75 * b / (0.5 * (1.0 + b * b)) ** 1.5 for b in (0.12, 0.3)]
    assert skewness[0] < CLEAR < skewness[1]
    pointed, why = _directed(0.12, size)
    np.testing.assert_allclose(pointed, -X, atol=1e-9)
    assert "feet point" in why
    swung, why = _directed(0.3, size)
    np.testing.assert_allclose(swung, X, atol=1e-9)
    assert "swing fastest" in why
