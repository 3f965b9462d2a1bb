"""Gains of EMG as an estimate: slopes, optimum and spread of a regression that is known."""

from __future__ import annotations

import numpy as np
import pytest
from scipy.optimize import minimize as minimize_by_scipy

from myomorph.core.fit.solver import minimize
from myomorph.core.fit.unknowns import Values
from myomorph.core.tension.emg_gains import (
    GAINS,
    METHOD,
    Prior,
    Squares,
    gain_posterior,
    gain_problem,
    gain_unknowns,
    parameters_of,
)

CHANNELS = ("vasti", "hamstrings", "soleus")
PRIOR = Prior(
    mean=np.log([0.5, 0.8, 1.0]),
    precision=np.linalg.inv(np.diag([0.25, 0.25, 0.25]) + 0.49),
    upper=np.log([4.0, 4.0, 0.9]),
)


def regression(seed: int, noise: float):
    """Squares of a regression on three channels with offsets and two weights, and its ridge."""
    rng = np.random.default_rng(seed)
    rows = rng.normal(size=(60, 8)) / noise
    truth = np.array([0.7, 1.4, 0.6, 0.0, 0.1, 0.0, 0.3, 0.0])
    torques = rows @ truth + rng.normal(size=60)
    squares = Squares(
        matrix=rows.T @ rows,
        slope=rows.T @ torques,
        square=float(torques @ torques),
        compared=60,
    )
    ridge = np.diag([0.0, 0.0, 0.0, 400.0, 400.0, 400.0, 30.0, 30.0])
    unknowns = gain_unknowns(CHANNELS, PRIOR, True, ["first weight", "second weight"])
    return gain_problem(unknowns, squares, ridge, PRIOR)


@pytest.mark.parametrize("noise", [0.05, 0.5, 20.0])
def test_the_most_probable_gains_are_those_of_a_general_search(noise):
    problem = regression(1, noise)
    found = minimize(problem, method=METHOD)
    assert found.search.converged
    unknowns = problem.unknowns
    theirs = minimize_by_scipy(
        lambda x: problem.at(x).cost,
        unknowns.start,
        bounds=list(zip(unknowns.low, unknowns.high, strict=True)),
        method="L-BFGS-B",
        options={"ftol": 1e-15, "gtol": 1e-9, "maxiter": 5000},
    )
    assert found.at.cost <= theirs.fun * (1.0 + 1e-9)
    np.testing.assert_allclose(found.x, theirs.x, atol=2e-3)
    assert (found.x <= unknowns.high).all()


def test_slopes_are_those_of_finite_differences():
    problem = regression(2, 0.3)
    x = np.array([0.1, -0.4, -0.3, 0.02, 0.1, 0.0, 0.2, 0.1])
    for residuals in problem.residuals[:2]:
        at = residuals.at(Values(problem.unknowns, x))
        for unknown, slope in enumerate(at.normal().g):
            step = np.zeros(len(x))
            step[unknown] = 1e-5
            after = residuals.at(Values(problem.unknowns, x + step)).cost
            before = residuals.at(Values(problem.unknowns, x - step)).cost
            assert (after - before) / 4e-5 == pytest.approx(slope, rel=1e-5, abs=1e-5)


def test_torques_that_say_nothing_leave_the_prior_and_sharp_ones_an_interval_about_the_truth():
    vague = gain_posterior(minimize(regression(3, 1e4), method=METHOD), PRIOR)
    gains = vague.unknowns.slices[GAINS]
    expected = np.sqrt(np.diag(np.linalg.inv(PRIOR.precision)))
    np.testing.assert_allclose(vague.sd[gains], expected, rtol=1e-3)
    assert not vague.shown[gains].any()

    solution = minimize(regression(3, 0.05), method=METHOD)
    sharp = gain_posterior(solution, PRIOR)
    assert sharp.shown[gains].all()
    found = parameters_of(sharp.unknowns, solution.x)[gains]
    np.testing.assert_allclose(found, [0.7, 1.4, 0.6], rtol=0.05)
