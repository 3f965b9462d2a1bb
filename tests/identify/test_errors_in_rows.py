"""Condensed rows with errors that are not independent: generalized least squares of them."""

from __future__ import annotations

import numpy as np

from myomorph.body.identify.errors_in_rows import Whitening


def made(errors, count=300, n=5):
    rng = np.random.default_rng(4)
    A = rng.normal(size=(count, n)) * [3.0, 1.0, 1.0, 0.3, 2.0]
    S = rng.normal(size=(count, errors))
    Q, R = np.linalg.qr(A)
    return rng, A, S, Q, R


def test_weighed_rows_are_generalized_least_squares_of_the_condensed_ones():
    rng, A, S, Q, R = made(errors=3)
    b = rng.normal(size=len(A))
    weighed = Whitening.of(R, A.T @ S).rows(Q.T @ b)
    inside = Q.T @ S
    inverse = np.linalg.inv(np.eye(len(R)) + inside @ inside.T)
    information = R.T @ inverse @ R
    np.testing.assert_allclose(weighed.R.T @ weighed.R, information, rtol=1e-9)
    np.testing.assert_allclose(weighed.R.T @ weighed.z, R.T @ inverse @ Q.T @ b, rtol=1e-9)
    scores = rng.normal(size=(2, len(A)))
    np.testing.assert_allclose(
        Whitening.of(R, A.T @ S).scores(scores @ A),
        scores @ Q @ inverse @ R,
        rtol=1e-8,
        atol=1e-10,
    )


def test_intervals_of_weighed_rows_hold_and_plain_ones_do_not():
    rng, A, S, Q, R = made(errors=8)
    truth = np.array([1.0, -1.0, 0.5, 2.0, 0.0])
    weighing = Whitening.of(R, A.T @ S)
    inside = {"plain": [], "weighed": []}
    for _ in range(400):
        b = A @ truth + rng.normal(size=len(A)) + S @ rng.normal(size=S.shape[1])
        for name, (rows, z) in {"plain": (R, Q.T @ b), "weighed": weighing.rows(Q.T @ b)}.items():
            covariance = np.linalg.inv(rows.T @ rows)
            error = covariance @ rows.T @ z - truth
            inside[name].append(np.abs(error) < 1.645 * np.sqrt(np.diag(covariance)))
    assert 0.87 < np.mean(inside["weighed"]) < 0.93
    assert np.mean(inside["plain"]) < 0.7


def test_rows_that_show_nothing_stay_so():
    _, A, S, _, _ = made(errors=2)
    A = A.copy()
    A[:, 3] = A[:, 0]
    Q, R = np.linalg.qr(A)
    weighed = Whitening.of(R, A.T @ S).rows(Q.T @ A @ np.arange(5.0))
    unseen = np.array([1.0, 0.0, 0.0, -1.0, 0.0])
    np.testing.assert_allclose(weighed.R @ unseen, 0.0, atol=1e-9)
    np.testing.assert_allclose(weighed.R @ np.arange(5.0), weighed.z, atol=1e-8)
