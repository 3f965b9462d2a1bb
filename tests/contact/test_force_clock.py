"""Lags between forces and motion.

The minimum of values by a parabola, against parabolas whose minimum is known.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.contact.force_balance import _least

LAGS = np.arange(-4, 5) * 0.005


@pytest.mark.parametrize("least", [0.0, 0.0112, -0.0133, 0.0164, -0.0164])
def test_the_least_of_a_parabola_lies_between_the_lags_too(least):
    """Up to the lags next to the ends, which have a neighbor on either side."""
    values = 3.0 + 2e5 * (LAGS - least) ** 2
    lag, left = _least(LAGS, values)
    assert lag == pytest.approx(least, abs=1e-12)
    assert left == pytest.approx(values.min() / (3.0 + 2e5 * least**2), rel=1e-12)


def test_at_the_ends_the_least_is_the_end():
    assert _least(LAGS, -LAGS + 1.0)[0] == LAGS[-1]
    assert _least(LAGS, LAGS + 1.0)[0] == LAGS[0]
