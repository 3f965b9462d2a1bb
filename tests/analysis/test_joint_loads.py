"""Loads of joints over time, against integrals that are known."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.series import Series
from myomorph.lab.analysis.joint_loads import stride_loads


def test_peak_and_impulse_of_a_half_sine():
    """Of F sin(pi t / T) the impulse is 2 F T / pi."""
    time = np.linspace(0.0, 0.6, 2001)
    force = 900.0 * np.sin(np.pi * time / 0.6)
    (found,) = stride_loads(Series(time, ("total_knee_l",), force[:, None]), None)
    assert found.peak == pytest.approx(900.0)
    assert found.impulse == pytest.approx(2.0 * 900.0 * 0.6 / np.pi, rel=1e-5)
