"""Unknowns of single frames, eliminated of all frames at once and of one after the other."""

from __future__ import annotations

import numpy as np

from myomorph.core.fit.elimination import eliminated, eliminated_frames


def test_all_frames_at_once_are_one_after_the_other():
    rng = np.random.default_rng(4)
    own = rng.normal(size=(5, 9, 4))
    shared = rng.normal(size=(5, 9, 3))
    residuals = rng.normal(size=(5, 9))
    own[1, :, 2] = 0.0  # Nothing shows this unknown.
    own[2, :, 3] = 2.0 * own[2, :, 0]  # Two that cannot be parted.
    for rows in (own, shared, residuals):
        rows[3, 4:] = 0.0  # Rows that say nothing.
    together = eliminated_frames(own, shared, residuals)
    for frame in range(len(own)):
        alone = eliminated(own[frame], shared[frame], residuals[frame])
        np.testing.assert_allclose(together.H[frame], alone.equations.H, atol=1e-12)
        np.testing.assert_allclose(together.g[frame], alone.equations.g, atol=1e-12)
        np.testing.assert_allclose(together.moved[frame], alone.moved, atol=1e-12)
        np.testing.assert_allclose(together.follows[frame], alone.follows, atol=1e-12)


def test_rows_of_zeros_say_nothing():
    nothing = eliminated_frames(np.zeros((1, 2, 2)), np.zeros((1, 2, 1)), np.zeros((1, 2)))
    assert not nothing.H.any()
    assert not nothing.moved.any()
