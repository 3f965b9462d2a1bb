import numpy as np
import pytest
import scs
from scipy import sparse

from made_bodies import MASS, made_body, measured
from myomorph.body.identify.pseudo_inertia import (
    PseudoInertiaOptions,
    possible_reference,
    solve_pseudo_inertia,
    solve_ridge,
)
from myomorph.core.model.errors import BadData
from myomorph.core.model.inertia import pseudo_inertias


@pytest.fixture(scope="module")
def body():
    return made_body(0.05, 6)


@pytest.fixture(scope="module")
def reference(body):
    return body.parameters(body.reference)


def other_mass_points(body, seed=0):
    return body.parameters(
        body.reference * np.random.default_rng(seed).uniform(0.0, 2.0, len(body.points))
    )


def test_nothing_measured_gives_the_reference(reference):
    for solve in (solve_pseudo_inertia, solve_ridge):
        fit = solve(np.zeros((0, 60)), np.zeros(0), reference)
        assert fit.converged
        assert np.allclose(fit.parameters, reference, atol=1e-10)


def test_reference_that_meets_the_measurement_stays(body, reference):
    A, b = measured(body, 40, reference, noise=0.0)
    fit = solve_pseudo_inertia(A, b, reference, mass=MASS)
    assert np.allclose(fit.parameters, reference, atol=1e-8)


@pytest.mark.parametrize("mass", [None, MASS])
def test_same_as_least_squares_where_no_inequality_is_active(body, reference, mass):
    A, b = measured(body, 40, other_mass_points(body))
    fit = solve_pseudo_inertia(A, b, reference, mass=mass)
    free = solve_ridge(A, b, reference, mass=mass)
    assert np.nanmin(fit.smallest) > 0.1
    assert np.allclose(fit.parameters, free.parameters, rtol=1e-6, atol=1e-6)


def by_scs(A, b, reference, mass, options):
    """Solve the same problem in a new formulation, with another solver.

    Pseudo-inertias are as they are, the prior is written as rows.
    """
    links = len(reference)
    units = pseudo_inertias(np.eye(10))
    lower = np.linalg.inv(np.linalg.cholesky(pseudo_inertias(reference)))
    whitened = [_entries(lower[i] @ units @ lower[i].T).T for i in range(links)]
    prior = sparse.block_diag(whitened).toarray() / options.mass_sd
    D = np.tile(np.abs(reference).max(axis=0), links)
    rows = np.vstack([A, prior]) * D
    target = np.concatenate([b, prior @ reference.ravel()])
    total = np.zeros((1, 10 * links))
    total[0, ::10] = 1.0
    cones = np.vstack([total * D, -sparse.block_diag(whitened).toarray() * D])
    margin = np.tile(_entries(options.margin * np.eye(4)), links)
    data = {
        "P": sparse.csc_matrix(np.triu(rows.T @ rows)),
        "c": -rows.T @ target,
        "A": sparse.csc_matrix(cones),
        "b": np.concatenate([[mass], -margin]),
    }
    solver = scs.SCS(
        data,
        {"z": 1, "s": [4] * links},
        verbose=False,
        eps_abs=1e-10,
        eps_rel=1e-10,
        max_iters=100000,
    )
    found = solver.solve()
    assert found["info"]["status"] == "solved"
    return (D * found["x"]).reshape(links, 10)


def _entries(matrices):
    """Return the lower triangles (..., 10) of symmetric matrices (..., 4, 4), norms kept."""
    triangle = [(i, k) for k in range(4) for i in range(k, 4)]
    scale = np.array([1.0 if i == k else np.sqrt(2.0) for i, k in triangle])
    return scale * np.stack([matrices[..., i, k] for i, k in triangle], axis=-1)


def test_same_solution_as_another_solver_and_form(body, reference):
    A, b = measured(body, 30, -0.2 * reference, noise=20.0)
    options = PseudoInertiaOptions(tolerance=1e-10)
    fit = solve_pseudo_inertia(A, b, reference, mass=MASS, options=options)
    assert np.nanmin(fit.smallest) < 2.0 * options.margin
    assert np.allclose(fit.parameters, by_scs(A, b, reference, MASS, options), atol=2e-5)


def test_every_link_is_a_body_whatever_was_measured(body, reference):
    A, b = measured(body, 50, -reference, noise=50.0)
    options = PseudoInertiaOptions(margin=1e-3)
    fit = solve_pseudo_inertia(A, b, reference, mass=MASS, options=options)
    free = solve_ridge(A, b, reference, mass=MASS, options=options)
    assert fit.converged
    assert np.nanmin(fit.smallest) > 0.99e-3
    assert (np.linalg.eigvalsh(pseudo_inertias(fit.parameters)) > 0.0).all()
    assert np.isclose(fit.parameters[:, 0].sum(), MASS, rtol=1e-8)
    assert np.nanmin(free.smallest) < 0.0


def test_known_truth_is_found_better_than_by_least_squares(body, reference):
    """Twenty noisy rows of sixty parameters, and the truth near the reference.

    The comparison is least squares of minimum norm.
    """
    truth = other_mass_points(body, 3)
    A, b = measured(body, 20, truth, noise=5.0)
    fit = solve_pseudo_inertia(A, b, reference, options=PseudoInertiaOptions(mass_sd=0.2))
    plain = np.linalg.lstsq(A, b)[0].reshape(reference.shape)
    errors = [
        np.abs((one - truth) / np.abs(truth).mean(axis=0)).mean()
        for one in (fit.parameters, plain, reference)
    ]
    assert errors[0] < 0.8 * errors[2] < errors[1]
    assert (np.linalg.eigvalsh(pseudo_inertias(plain))[:, 0] < 0.0).any()


def test_prior_is_the_asked_standard_deviation():
    """With the total of one link alone measured to sd, half of what is missing is made up."""
    reference = made_body(0.05, 3).parameters(made_body(0.05, 3).reference)
    sd = 0.2
    A = np.zeros((1, 30))
    A[0, 10] = 1.0 / (sd * reference[1, 0])
    wish = A @ reference.ravel() + 0.3
    fit = solve_pseudo_inertia(A, wish, reference, options=PseudoInertiaOptions(mass_sd=sd))
    assert np.isclose(fit.parameters[1, 0] / reference[1, 0] - 1.0, 0.15 * sd, rtol=1e-6)


def test_pullback_does_not_depend_on_the_links_frames(body, reference):
    """Moving the frames of the links moves the answer along."""
    from dataclasses import replace

    A, b = measured(body, 40, other_mass_points(body), noise=10.0)
    links = body.links
    R = links.rotations[::-1]
    p = links.origins + np.linspace(-0.2, 0.3, 18).reshape(6, 3)
    moved = replace(body, links=replace(links, rotations=R, origins=p))
    # Parameters in the two frames are linear in each other: change = places_moved @ places^-1.
    change = np.stack(
        [np.linalg.solve(P.T, Q.T).T for P, Q in zip(body.places, moved.places, strict=True)]
    )
    back = np.linalg.inv(change)
    A_moved = np.einsum("rli,lij->rlj", A.reshape(40, 6, 10), back).reshape(40, 60)
    here = solve_pseudo_inertia(A, b, reference, mass=MASS).parameters
    there = solve_pseudo_inertia(
        A_moved, b, np.einsum("lij,lj->li", change, reference), mass=MASS
    ).parameters
    assert np.allclose(np.einsum("lij,lj->li", change, here), there, atol=1e-6)


def test_massless_links_stay(reference):
    phantom = reference.copy()
    phantom[2] = 0.0
    A = np.random.default_rng(0).normal(size=(30, 60))
    fit = solve_pseudo_inertia(A, np.ones(30), phantom, mass=MASS)
    assert fit.kept.tolist() == [False, False, True, False, False, False]
    assert not fit.parameters[2].any()
    assert np.isnan(fit.smallest[2])


def test_a_reference_of_no_body_is_named_and_can_be_repaired(reference):
    flat = reference.copy()
    c = flat[4, 1:4] / flat[4, 0]
    flat[4, 4:] = [
        c[1] ** 2 + c[2] ** 2,
        c[2] ** 2 + c[0] ** 2,
        c[0] ** 2 + c[1] ** 2,
        -c[1] * c[2],
        -c[2] * c[0],
        -c[0] * c[1],
    ]
    flat[4, 4:] *= flat[4, 0]
    with pytest.raises(BadData, match="reference of link 4 is not physically possible"):
        solve_pseudo_inertia(np.zeros((0, 60)), np.zeros(0), flat)
    repaired = possible_reference(flat, 0.02)
    second = pseudo_inertias(repaired[4])[:3, :3] - repaired[4, 0] * np.outer(c, c)
    assert np.allclose(second, repaired[4, 0] * 0.02**2 * np.eye(3), atol=1e-9)
    assert np.array_equal(np.delete(repaired, 4, axis=0), np.delete(flat, 4, axis=0))
    assert solve_pseudo_inertia(np.zeros((0, 60)), np.zeros(0), repaired).converged


def test_bad_input_is_named(reference):
    with pytest.raises(BadData, match="but got"):
        solve_pseudo_inertia(np.zeros((3, 50)), np.zeros(3), reference)
    with pytest.raises(BadData, match="not finite"):
        solve_pseudo_inertia(np.full((3, 60), np.nan), np.zeros(3), reference)
    with pytest.raises(BadData, match="mass is -1 kg"):
        solve_ridge(np.zeros((3, 60)), np.zeros(3), reference, mass=-1.0)
    with pytest.raises(BadData, match="margin of the pseudo-inertia is 1"):
        PseudoInertiaOptions(margin=1.0)
