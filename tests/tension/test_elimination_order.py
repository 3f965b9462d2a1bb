"""The order of elimination is that of scipy, whose import it spares."""

from __future__ import annotations

import numpy as np
import pytest
import scipy.sparse
import scipy.sparse.csgraph

from myomorph.core.tension.elimination_order import coupled_rows, elimination_order


@pytest.mark.parametrize("seed", range(20))
def test_the_order_is_that_of_scipy(seed):
    rng = np.random.default_rng(seed)
    shape = (int(rng.integers(1, 50)), int(rng.integers(1, 120)))
    rows, columns = np.nonzero(rng.random(shape) < rng.uniform(0.01, 0.3))
    matrix = scipy.sparse.csr_array((np.ones(len(rows)), (rows, columns)), shape=shape)
    expected = scipy.sparse.csgraph.reverse_cuthill_mckee(
        scipy.sparse.csr_array(matrix @ matrix.T), symmetric_mode=True
    )
    neighbors = coupled_rows(rows, columns, shape[0])
    np.testing.assert_array_equal(elimination_order(neighbors), expected)


def test_coupled_rows_share_a_column():
    rows = np.array([0, 1, 1, 2])
    columns = np.array([0, 0, 1, 2])
    assert coupled_rows(rows, columns, 4) == [[1, 0], [1, 0], [2], []]
