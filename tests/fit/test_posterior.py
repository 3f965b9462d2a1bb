"""Posteriors against closed forms, and intervals against simulated truth."""

import numpy as np
import pytest
import scipy

from myomorph.core.fit import Block, Measured, Method, Posterior, Problem, Unknown, Unknowns
from myomorph.core.fit import estimate as estimated
from myomorph.core.fit.solver import minimize

CLOSE = Method(iterations=100, tolerance=1e-12, min_gain=0.0)


def problem(A, b, sd, prior_sd, mean=0.0):
    unknowns = tuple(
        Unknown(name=f"x{i}", mean=mean, sd=None if np.isinf(each) else each)
        for i, each in enumerate(prior_sd)
    )
    measured = Measured(
        name="rows",
        blocks=("x",),
        function=lambda values: A @ values["x"] - b,
        slopes=lambda values: {"x": A},
        sd=sd,
    )
    return Problem(Unknowns((Block(name="x", unknowns=unknowns),)), (measured,))


@pytest.fixture
def gaussian():
    random = np.random.default_rng(0)
    A = random.normal(size=(7, 4))
    b = random.normal(size=7)
    return A, b, np.array([0.3, 1.0, 2.0, 0.5])


def test_the_posterior_of_a_linear_problem_is_the_analytic_one(gaussian):
    A, b, prior_sd = gaussian
    found = estimated(problem(A, b, 0.4, prior_sd, mean=0.2), method=CLOSE)
    information = A.T @ A / 0.4**2 + np.diag(prior_sd**-2)
    covariance = np.linalg.inv(information)
    mean = covariance @ (A.T @ b / 0.4**2 + 0.2 * prior_sd**-2)
    np.testing.assert_allclose(found.posterior.x, mean, atol=1e-9)
    np.testing.assert_allclose(found.posterior.covariance, covariance, rtol=1e-9, atol=1e-12)
    shares = 1.0 - np.diag(covariance) / prior_sd**2
    np.testing.assert_allclose(found.posterior.share, shares, rtol=1e-9)
    weights = np.array([1.0, -1.0, 0.5, 0.0])
    limits = found.posterior.interval(weights, level=0.9)
    half = scipy.stats.norm.ppf(0.95) * np.sqrt(weights @ covariance @ weights)
    np.testing.assert_allclose([limits.low, limits.high], weights @ mean + [-half, half])


def test_bounds_have_no_part_in_the_posterior(gaussian):
    A, b, prior_sd = gaussian
    free = problem(A, b, 0.4, prior_sd)
    block = free.unknowns.blocks[0]
    bounded = [
        Unknown(name=one.name, mean=0.0, sd=one.sd, low=-1e-3, high=1e-3) for one in block.unknowns
    ]
    held = Problem(Unknowns((Block(name="x", unknowns=tuple(bounded)),)), free.residuals)
    np.testing.assert_allclose(
        estimated(held).posterior.covariance, estimated(free).posterior.covariance, rtol=1e-9
    )


def test_blocks_that_are_held_have_no_spread(gaussian):
    A, b, prior_sd = gaussian
    posterior = estimated(problem(A, b, 0.4, prior_sd), fit=[]).posterior
    np.testing.assert_array_equal(posterior.sd, 0.0)


def test_directions_that_nothing_shows_are_reported():
    A = np.array([[1.0, 1.0, 0.0, 0.0], [0.0, 0.0, 0.0, 1.0]])
    found = estimated(problem(A, np.ones(2), 0.1, np.full(4, np.inf)), method=CLOSE)
    posterior = found.posterior
    assert len(posterior.hidden) == 2
    np.testing.assert_array_equal(np.isinf(posterior.sd), [True, True, True, False])
    np.testing.assert_allclose(posterior.sd[3], 0.1)
    assert posterior.shown.tolist() == [False, False, False, True]
    # The sum of both is shown, each alone is not.
    assert np.isfinite(posterior.interval([1.0, 1.0, 0.0, 0.0]).high)
    assert np.isinf(posterior.interval("x0").high)
    assert np.isinf(posterior.interval(lambda x: x[0] ** 2).high)
    assert np.isfinite(posterior.interval(lambda x: (x[0] + x[1]) ** 2).high)
    assert {line.split(":")[1] for line in posterior.not_shown} == {" not shown"}
    assert any("x0" in line for line in found.certificate)


def test_a_prior_alone_shows_nothing_of_the_data():
    A = np.array([[1.0, 0.0]])
    posterior = estimated(problem(A, np.ones(1), 0.1, np.array([1.0, 1.0]))).posterior
    np.testing.assert_allclose(posterior.share, [1.0 - 1.0 / 101.0, 0.0], atol=1e-12)
    assert posterior.shown.tolist() == [True, False]
    assert not len(posterior.hidden)


def test_draws_have_the_covariance(gaussian):
    A, b, prior_sd = gaussian
    posterior = estimated(problem(A, b, 0.4, prior_sd)).posterior
    draws = posterior.draws(40000)
    np.testing.assert_allclose(draws.mean(axis=0), posterior.x, atol=1e-9)
    np.testing.assert_allclose(np.cov(draws.T), posterior.covariance, atol=0.003)
    np.testing.assert_array_equal(draws[:10], posterior.draws(10))


@pytest.mark.parametrize(
    ("function", "truth"),
    [
        (lambda x: x[0], 1.0),
        (lambda x: np.exp(x[1]), np.exp(-0.5)),
        (lambda x: float(np.linalg.norm(x)), float(np.hypot(1.0, -0.5))),
        (lambda x: x[0] * x[1], -0.5),
    ],
)
def test_intervals_hold_simulated_truth(function, truth):
    """Of 400 seeds nine in ten hold it: four standard errors of a binomial are 0.06."""
    random = np.random.default_rng(3)
    A = random.normal(size=(30, 2))
    held = 0
    for _ in range(400):
        b = A @ [1.0, -0.5] + random.normal(size=30)
        one = problem(A, b, 1.0, np.full(2, np.inf))
        posterior = Posterior.of(minimize(one))
        held += posterior.interval(function, level=0.9).holds(truth)
    assert abs(held / 400 - 0.9) < 0.06


def test_noise_from_few_residuals_widens_intervals():
    """Of noise from 4 residuals more than unknowns Student's t holds what a normal does not."""
    random = np.random.default_rng(5)
    A = random.normal(size=(6, 2))
    held = {4.0: 0, np.inf: 0}
    for _ in range(400):
        b = A @ [1.0, -0.5] + random.normal(size=6)
        left = np.linalg.lstsq(A, b)[1][0]
        one = problem(A, b, np.sqrt(left / 4.0), np.full(2, np.inf))
        solution = minimize(one)
        for freedom in held:
            limits = Posterior.of(solution, freedom=freedom).interval("x0")
            held[freedom] += limits.holds(1.0)
    assert abs(held[4.0] / 400 - 0.9) < 0.06
    assert held[np.inf] / 400 < 0.86


def test_noise_that_repeats_itself_counts_less():
    A = np.ones((100, 1))
    found = [
        estimated(
            Problem(
                Unknowns((Block(name="x", unknowns=(Unknown(name="x0"),)),)),
                (
                    Measured(
                        name="rows",
                        blocks=("x",),
                        function=lambda values: A @ values["x"],
                        correlation_time=time,
                    ),
                ),
            )
        ).posterior.sd[0]
        for time in (1.0, 25.0)
    ]
    np.testing.assert_allclose(found, [0.1, 0.5], rtol=1e-6)
