"""Simulated performers: what they do is physics, and they step, hop and sit."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.show.simulate.performances import (
    FLIGHT,
    HOP,
    STEPS,
    drum_part,
    hop_height,
    taichi_part,
    tap_part,
)
from myomorph.show.simulate.performer import MASS, performed

WEIGHT = MASS * 9.80665
PARTS = {
    "taichi": taichi_part,
    "tap": tap_part,
    "drum": lambda: drum_part([("snare", 0.7, 0.4), ("high tom", 1.6, 0.6)], 2.4),
}


@pytest.fixture(scope="module", params=list(PARTS))
def shown(request):
    """Perform one of them."""
    return request.param, performed(PARTS[request.param]())


def test_contacts_give_all_that_the_motion_needs(shown):
    """Also in the air: half a hundredth of the weight, and of that at a lever of 0.3 m."""
    _, performance = shown
    moments = np.linalg.norm(performance.missing[:, :3], axis=1)
    forces = np.linalg.norm(performance.missing[:, 3:], axis=1)
    assert forces.max() < 0.005 * WEIGHT
    assert moments.max() < 0.005 * WEIGHT * 0.5


def test_they_step_hop_and_sit(shown):
    name, performance = shown
    time = performance.forces.time
    up = performance.forces.values[:, :, 1]
    assert (up >= -1e-6).all()
    if name == "taichi":
        for side, (start, stop, _) in STEPS.items():
            away = (time > start) & (time < stop)
            one = performance.forces.names.index(f"foot_{side}")
            assert np.abs(up[away, one]).max() == 0.0
            assert up[away].sum(axis=1).min() > 0.9 * WEIGHT
    elif name == "tap":
        air = np.abs(time - HOP) < 0.5 * FLIGHT - 0.005
        assert air.sum() > 15
        assert np.abs(up[air]).max() == 0.0
        assert up.sum(axis=1).max() > 1.5 * WEIGHT
    else:
        stool = up[:, performance.forces.names.index("stool")]
        assert stool.min() > 0.5 * WEIGHT
        right = up[:, performance.forces.names.index("foot_r")]
        assert right.min() == 0.0
        assert right.max() > 0.1 * WEIGHT


def test_a_hop_falls_freely_and_ends_at_rest():
    time = np.linspace(HOP - 1.0, HOP + 1.0, 4001)
    height = hop_height(time)
    step = float(time[1] - time[0])
    falls = np.diff(height, 2) / step**2
    air = np.abs(time[1:-1] - HOP) < 0.5 * FLIGHT - 0.01
    # Interpolated heights: the mean is that of free fall.
    assert falls[air].mean() == pytest.approx(-9.81, rel=0.01)
    assert abs(height[0]) < 1e-9
    assert abs(height[-1]) < 1e-9
    # The hop ends as it began, so that impulses add up to those of the weight.
    assert np.trapezoid(np.gradient(height, time), time) == pytest.approx(0.0, abs=1e-9)
