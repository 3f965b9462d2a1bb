"""Random numbers of the sources of error."""

from __future__ import annotations

import numpy as np
from scipy.special import ndtr

from myomorph.lab.uncertainty.normals import Course, Normals


def test_each_of_equal_parts_holds_one_draw():
    normals = Normals(40, seed=3)
    values = np.array([normals.of(k, "placement", "RASI", 3) for k in range(40)])
    for column in ndtr(values).T:
        np.testing.assert_array_equal(np.sort((40 * column).astype(int)), np.arange(40))


def test_numbers_depend_on_their_own_source_and_item_alone():
    first = Normals(20, seed=1)
    second = Normals(20, seed=1)
    second.of(0, "strength", "soleus_r")
    np.testing.assert_array_equal(
        first.of(5, "placement", "RASI", 3), second.of(5, "placement", "RASI", 3)
    )
    assert not np.allclose(first.of(5, "placement", "RASI", 3), first.of(5, "placement", "LASI", 3))
    assert not np.allclose(
        first.of(5, "placement", "RASI", 3), Normals(20, seed=2).of(5, "placement", "RASI", 3)
    )


def test_a_process_has_variance_one_and_is_correlated_as_a_gaussian():
    """White noise smoothed by a Gaussian of width w.

    The correlation over a lag d is exp(-d^2 / 4 w^2).
    """
    width = 10.0
    lag = 12
    values = np.stack(
        [Normals(300).process(k, "skin", "thigh", Course(200, width, 1))[:, 0] for k in range(300)]
    )
    np.testing.assert_allclose(values.std(axis=0).mean(), 1.0, atol=0.03)
    assert values[:, 0].std() > 0.85
    together = (values[:, :-lag] * values[:, lag:]).mean()
    np.testing.assert_allclose(together, np.exp(-(lag**2) / (4 * width**2)), atol=0.04)
