"""Arrays are checked in one way, with what was expected and what was given in the message."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.arrays import checked_array
from myomorph.core.model.errors import BadData


def test_a_fitting_array_is_not_copied():
    values = np.zeros((4, 3))
    assert checked_array(values, ("frames", 3), "points") is values


@pytest.mark.parametrize("values", [np.zeros((4, 2)), np.zeros(3), 1.0, np.zeros((4, 3, 1))])
def test_another_shape_is_refused(values):
    with pytest.raises(BadData, match=r"expected points of shape \(frames, 3\), but got \("):
        checked_array(values, ("frames", 3), "points")


def test_integers_become_floats():
    assert checked_array([1, 2], (2,), "lengths").dtype == np.float64


def test_values_need_not_be_finite():
    assert np.isnan(checked_array([np.nan], (1,), "masses")).all()
