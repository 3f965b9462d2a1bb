import numpy as np
import piqp
import pytest
from scipy.optimize import nnls

from made_bodies import MASS, filled, made_body, measured, random_links
from myomorph.body.identify.mass_points import (
    MassPointOptions,
    _Problem,
    prior_variances,
    solve_mass_points,
)
from myomorph.body.shape.points import MassPoints
from myomorph.body.shape.weights import bone_weights, cog_weights, nearest_weights
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import pseudo_inertias


def full_matrix(body, A):
    """Return A W, which the solver never forms.

    Its columns are what one kilogram at each point adds.
    """
    return np.stack([A @ body.parameters(one).ravel() for one in np.eye(len(body.points))], axis=1)


def general_solution(body, A, b, mass, options):
    """Solve the same problem by general solvers, in masses over their prior standard deviation.

    Non-negative least squares by Lawson and Hanson is exact; it has no equality, for which PIQP
    stands in.
    """
    sd = np.sqrt(prior_variances(body, options))
    B = np.sqrt(options.W_phi) * full_matrix(body, A)
    target = np.sqrt(options.W_phi) * b - B @ body.reference
    B = B * sd
    least = (options.floor * body.reference.mean() - body.reference) / sd
    if mass is None:
        rows = np.vstack([B, np.eye(len(sd))])
        return body.reference + sd * (
            least + nnls(rows, np.append(target, np.zeros(len(sd))) - rows @ least)[0]
        )
    solver = piqp.DenseSolver()
    solver.settings.eps_abs = 1e-12
    solver.settings.eps_rel = 1e-13
    solver.settings.max_iter = 500
    total = sd[None], np.array([mass - body.reference.sum()])
    H = np.asfortranarray(B.T @ B + np.eye(len(sd)))
    solver.setup(H, -B.T @ target, *total, None, None, None, least, np.full(len(sd), 1e30))
    assert solver.solve() == piqp.PIQP_SOLVED
    return body.reference + sd * solver.result.x


CASES = {
    "relative prior": (None, MassPointOptions()),
    "the paper's weights": (None, MassPointOptions(prior="paper")),
    "other weights": (None, MassPointOptions(prior="paper", W_phi=0.01, W_rho=30.0)),
    "total mass": (MASS, MassPointOptions(mass_sd=0.3)),
    "total mass far off": (0.5 * MASS, MassPointOptions()),
}


@pytest.mark.parametrize("case", CASES)
@pytest.mark.parametrize("weights", [cog_weights, nearest_weights])
def test_same_solution_as_a_general_solver(case, weights):
    mass, options = CASES[case]
    body = made_body(0.05, weights=weights)
    random = np.random.default_rng(0)
    truth = body.parameters(body.reference * random.uniform(0.0, 2.0, len(body.points)))
    A, b = measured(body, 20, truth, noise=30.0)
    fit = solve_mass_points(body, A, b, mass=mass, options=options)
    expected = general_solution(body, A, b, mass, options)
    assert fit.converged
    assert len(body.points) > 700
    assert np.abs(fit.masses - expected).max() < 1e-8
    assert np.allclose(fit.parameters, body.parameters(expected), atol=1e-8)


def _optimality(body, A, b, fit, mass, options):
    """Return the Karush-Kuhn-Tucker residuals from matrices the solver never forms, in kg."""
    v = prior_variances(body, options)
    B = full_matrix(body, A)
    pull = fit.masses - body.reference - v * (B.T @ (b - B @ fit.masses)) * options.W_phi
    free = fit.masses > options.floor * body.reference.mean()
    multiplier = 0.0 if mass is None else float(np.sum(pull[free] * v[free]) / np.sum(v[free] ** 2))
    pull = pull - multiplier * v
    return np.abs(pull[free]).max(initial=0.0), -pull[~free].min(initial=0.0)


@pytest.mark.parametrize("mass", [None, MASS])
@pytest.mark.parametrize("noise", [0.0, 100.0, 3000.0])
def test_conditions_of_the_optimum_hold(mass, noise):
    body = made_body(0.06)
    options = MassPointOptions(mass_sd=0.3)
    A, b = measured(body, 30, body.parameters(body.reference), noise=noise)
    fit = solve_mass_points(body, A, b, mass=mass, options=options)
    assert fit.converged
    assert (fit.masses >= options.floor * body.reference.mean()).all()
    assert max(_optimality(body, A, b, fit, mass, options)) < 1e-5 * body.reference.mean()
    assert fit.optimality.worst < 1e-7
    assert fit.optimality.stationarity < 1e-12
    if noise == 3000.0:
        assert fit.on_bound > 0.5 * len(body.points)
    if mass is not None:
        assert np.isclose(fit.masses.sum(), mass, rtol=1e-12)


@pytest.mark.parametrize("size", [0.01, 30.0])
def test_balance_is_the_greatest_imbalance_over_the_greatest_miss(size):
    """Multipliers far from the optimum, by a matrix that the solver never forms.

    Misses below 1 count as 1.
    """
    body = made_body(0.1)
    options = MassPointOptions(W_phi=0.25)
    A, b = measured(body, 10, body.parameters(body.reference), noise=100.0)
    problem = _Problem.of(body, A, b, None, options)
    y = size * np.random.default_rng(0).normal(size=10)
    fit = problem.result(y, 0)
    left = 0.5 * (b - full_matrix(body, A) @ fit.masses) - y
    expected = np.abs(left).max() / max(np.abs(y).max(), 1.0)
    assert fit.optimality.balance == pytest.approx(expected, rel=1e-9)
    assert expected > 0.1


def test_targets_that_positive_masses_can_meet_are_met():
    body = made_body(0.05, 6)
    truth = body.parameters(body.reference * np.where(body.points[:, 1] > 1.0, 1.4, 0.6))
    A, b = measured(body, 60, truth, noise=0.0)
    fit = solve_mass_points(body, 1e4 * A, 1e4 * b)
    assert np.allclose(fit.parameters, truth, atol=1e-5)
    before = 1e4 * (b - A @ body.parameters(body.reference).ravel())
    assert fit.misfit < 1e-6 * before @ before


def test_nothing_measured_gives_the_reference():
    body = made_body(0.05)
    fit = solve_mass_points(body, np.zeros((0, 50)), np.zeros(0))
    assert np.array_equal(fit.masses, body.reference)
    fit = solve_mass_points(body, np.zeros((0, 50)), np.zeros(0), mass=1.1 * MASS)
    assert np.isclose(fit.masses.sum(), 1.1 * MASS, rtol=1e-12)


def test_impossible_targets_still_give_bodies():
    body = made_body(0.04, 6)
    A, b = measured(body, 60, -body.parameters(body.reference), noise=10.0)
    fit = solve_mass_points(body, A, b)
    assert (fit.masses > 0.0).all()
    assert (np.linalg.eigvalsh(pseudo_inertias(fit.parameters)) > 0.0).all()
    assert fit.on_bound > 0


def test_a_wish_that_the_plain_iteration_does_not_settle():
    """Rows of very different scale and a wrench that no body has.

    The solution is exact, by rows that soften and harden again.
    """
    random = np.random.default_rng(72)
    body = made_body(0.1, 6, seed=72)
    A = (
        random.normal(size=(33, 60))
        * 10.0 ** random.uniform(-2.0, 4.0, (33, 1))
        * 10.0 ** random.uniform(-1.0, 1.0, 60)
    )
    b = A @ body.parameters(body.reference).ravel() + 1e3 * random.normal(size=33)
    options = MassPointOptions(prior="paper", W_rho=0.2, iterations=20)
    fit = solve_mass_points(body, A, b, options=options)
    exact = general_solution(body, A, b, None, options)
    assert fit.iterations > options.iterations
    assert np.abs(fit.masses - exact).max() < 1e-8


@pytest.mark.parametrize("mass", [None, 1.0])
def test_everything_on_its_bound(mass):
    """A body that weighs less than nothing: every point is on its bound, but for a given total."""
    body = made_body(0.06)
    A = np.zeros((1, 50))
    A[0, ::10] = 100.0
    options = MassPointOptions()
    fit = solve_mass_points(body, A, np.array([-1e4]), mass=mass, options=options)
    assert fit.converged
    if mass is None:
        assert fit.on_bound == len(body.points)
        assert np.allclose(fit.masses, options.floor * body.reference.mean(), rtol=1e-12)
    else:
        assert np.isclose(fit.masses.sum(), mass, rtol=1e-12)


@pytest.mark.parametrize("weights", [nearest_weights, bone_weights, cog_weights])
def test_prior_is_the_asked_standard_deviation_of_every_links_mass(weights):
    body = made_body(0.03, 8, weights)
    fit = solve_mass_points(
        body, np.zeros((0, 80)), np.zeros(0), options=MassPointOptions(mass_sd=0.2)
    )
    assert np.allclose(
        fit.link_sd,
        0.2 * body.parameters(body.reference)[:, 0],
        rtol=1e-6 if weights is nearest_weights else 0.02,
    )


def test_prior_of_a_mass_center_is_its_radius_of_gyration_times_the_standard_deviation():
    """Independent points: the first moment about the link's center has variance sum_j x_j^2 v_j."""
    body = made_body(0.03, 4, nearest_weights)
    v = prior_variances(body, MassPointOptions(mass_sd=0.1))
    for link in range(4):
        own = body.weights[:, [link]].toarray()[:, 0] > 0.0
        x = body.points[own] - body.points[own].mean(axis=0)
        gyration = np.sqrt((x**2).mean(axis=0))
        assert np.allclose(
            np.sqrt(v[own] @ x**2) / body.reference[own].sum(), 0.1 * gyration, rtol=1e-9
        )


def test_result_does_not_depend_on_the_grid():
    """A weak target of a tenth more mass, with cells of 20 and 10 mm.

    The paper's prior decreases with the cells' volume.
    """
    changes = {"relative": [], "paper": []}
    for spacing in (0.02, 0.01):
        body = made_body(spacing)
        before = body.parameters(body.reference)
        A, _ = measured(made_body(0.02), 30, before)
        for prior, weight in (("relative", 0.01), ("paper", 1e-5)):
            wish = weight * A @ (1.1 * before).ravel()
            fit = solve_mass_points(
                body, weight * A, wish, options=MassPointOptions(prior=prior, W_rho=1.0)
            )
            changes[prior].append(fit.masses.sum() - MASS)
            assert fit.on_bound == 0
    assert 1.0 < changes["relative"][1] < 6.9
    assert np.isclose(*changes["relative"], rtol=0.01)
    assert changes["paper"][1] > 3.0 * changes["paper"][0] > 0.0


def test_points_far_from_the_origin_give_the_same_masses():
    near = (0.3, 1.0, -0.2)
    far = (30.3, -19.0, 9.8)
    fits = []
    for place in (near, far):
        points = filled(0.05, place)
        links = random_links(5, place)
        body = MassPoints(
            points=points,
            reference=np.full(len(points), MASS / len(points)),
            weights=bone_weights(points, links),
            links=links,
            spacing=0.05,
        )
        truth = body.parameters(body.reference * np.where(points[:, 0] > place[0], 1.5, 0.5))
        A, b = measured(body, 30, truth)
        fits.append(solve_mass_points(body, A, b, mass=MASS))
    assert np.allclose(fits[0].masses, fits[1].masses, rtol=1e-6, atol=1e-9)


def test_more_rows_than_parameters():
    body = made_body(0.06)
    truth = body.parameters(
        body.reference * np.random.default_rng(0).uniform(0.5, 1.5, len(body.points))
    )
    A, b = measured(body, 300, truth)
    Q, R = np.linalg.qr(A)
    many = solve_mass_points(body, A, b)
    few = solve_mass_points(body, R, Q.T @ b)
    assert np.allclose(many.masses, few.masses, atol=1e-10)
    assert np.isclose(many.misfit, np.sum((b - A @ many.parameters.ravel()) ** 2))


def test_a_point_without_reference_mass_stays_at_the_least_mass():
    body = made_body(0.06)
    reference = np.array(body.reference)
    reference[::7] = 0.0
    hollow = MassPoints(
        points=body.points,
        reference=reference,
        weights=body.weights,
        links=body.links,
        spacing=body.spacing,
    )
    A, b = measured(body, 30, body.parameters(body.reference))
    fit = solve_mass_points(hollow, A, b, mass=MASS)
    assert fit.converged
    assert fit.masses[::7].max() < 1e-2 * reference.max()


def test_bad_input_is_named():
    body = made_body(0.1)
    A = np.zeros((3, 50))
    b = np.zeros(3)
    with pytest.raises(BadData, match=r"expected A \(rows, 50\)"):
        solve_mass_points(body, A[:, 1:], b)
    with pytest.raises(BadData, match="not finite"):
        solve_mass_points(body, A + np.nan, b)
    with pytest.raises(BadData, match=r"mass is 0\.01 kg"):
        solve_mass_points(body, A, b, mass=0.01)
    with pytest.raises(BadData, match="unknown prior 'flat'"):
        MassPointOptions(prior="flat")
    with pytest.raises(BadData, match="mass_sd"):
        MassPointOptions(mass_sd=0.0)
