"""A run of frames between gaps, solved in a window that begins later.

Whose frames it smooths, fills and marks.
"""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

from myomorph.core.tension.dual import MISSING, OPTIMAL, STALLED
from myomorph.core.tension.elastic import problem


@pytest.mark.parametrize(("solved", "status"), [(True, OPTIMAL), (False, STALLED)])
def test_a_run_takes_the_links_of_its_own_frames_and_fills_them_only(monkeypatch, solved, status):
    """Frames 3 to 7 of a window that begins at frame 10, one of them bridged.

    Links and marks are of 13 to 17.
    """
    frames = SimpleNamespace(
        time=np.arange(5.0), penalties="own", x=np.ones((5, 2)), forces=2.0 * np.ones((5, 1))
    )
    links = []
    marks = []
    penalties = []

    def solve(given):
        penalties.append(given.penalties)
        return [SimpleNamespace(solved=solved, steps=9)]

    monkeypatch.setattr(
        problem.windows, "drawn", lambda own, links, x, separable: f"{own} and linked"
    )
    problem_of_run = SimpleNamespace(
        _frames=lambda given, begin, part, good: (frames, np.ones(5, bool)),
        smooth=SimpleNamespace(links=lambda start, stop: links.append((start, stop))),
        separable=None,
        _every=1,
        _pass=solve,
        _passes=lambda frames, place: problem.ElasticProblem._passes(problem_of_run, frames, place),
        _missed=lambda frames, x: (np.zeros(5), np.ones(5)),
        _outcomes=[],
        _mark=lambda start, stop: marks.append((start, stop)),
    )
    results = problem.WindowResults(
        x=np.zeros((9, 2)),
        forces=np.zeros((9, 1)),
        residual=np.full(9, np.nan),
        iterations=np.zeros(9, int),
        status=np.full(9, MISSING),
    )
    good = np.array([True, True, False, True, True])
    problem.ElasticProblem._solve_run(problem_of_run, None, 10, slice(3, 8), good, results)
    assert set(links) == {(13, 18)}
    assert marks == [(13, 18)]
    assert penalties == ["own and linked"] * problem.PASSES
    inside = np.isin(np.arange(9), np.arange(3, 8))
    np.testing.assert_array_equal(results.x, np.where(inside[:, None], 1.0, [[0.0, 0.0]]))
    np.testing.assert_array_equal(results.forces[:, 0], np.where(inside, 2.0, 0.0))
    np.testing.assert_array_equal(np.isfinite(results.residual), inside)
    np.testing.assert_array_equal(results.iterations, np.where(inside, 9, 0))
    expected = np.where(inside, status, MISSING)
    expected[5] = MISSING
    np.testing.assert_array_equal(results.status, expected)
