"""A window solved again from another start.

How far apart the solutions are, and which of them is used.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.tension.elastic import windows
from myomorph.core.tension.elastic.interior import Outcome
from myomorph.core.tension.elastic.program import Point

ZERO = Point(np.zeros((3, 2)), np.zeros((2, 2)), np.zeros((3, 1)))
OTHER = Point(
    np.array([[3.0, 0.0], [0.0, -4.0], [0.0, 0.0]]),
    np.array([[0.0, 0.2], [0.0, 0.0]]),
    np.ones((3, 1)),
)


@pytest.mark.parametrize(
    ("solved", "taken"),
    [((True, True), 0), ((False, False), 0), ((True, False), 0), ((False, True), 1)],
)
def test_two_starts_give_their_distance_and_the_one_that_is_solved(monkeypatch, solved, taken):
    """Root mean squares of differences.

    0.2 in one of four activations, 3 and 4 in two of six forces.
    """
    outcomes = [
        (one, Outcome(residual=0.0, equilibrium=0.0, steps=0, solved=yes))
        for one, yes in zip((ZERO, OTHER), solved, strict=True)
    ]
    starts = []

    def solver(program, start, y):
        starts.append((start, y))
        return SimpleNamespace(solve=lambda: outcomes[len(starts) - 1])

    monkeypatch.setattr(windows, "Solver", solver)
    monkeypatch.setattr(windows, "integrated", lambda program, a: np.full((3, 2), a.mean()))
    point, found = windows.solve_part(None, ZERO, np.ones((3, 1)), second_start=True)
    assert point is outcomes[taken][0]
    assert found.solved is outcomes[taken][1].solved
    assert found.far == pytest.approx((0.1, np.sqrt(25.0 / 6.0)))
    (first, y), (second, no_y) = starts
    assert first is ZERO
    assert (y.all(), no_y.any()) == (True, False)
    assert (second.a == windows.SECOND_START).all()
    assert (second.f == windows.SECOND_START).all()
    starts.clear()
    point, alone = windows.solve_part(None, ZERO, np.ones((3, 1)), second_start=False)
    assert point is ZERO
    assert np.isnan(alone.far).all()
