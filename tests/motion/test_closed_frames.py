"""Frames of a four-bar linkage in inverse kinematics.

Bounds and locks of one coordinate constrain the whole loop.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from looped import four_bar, four_bar_angles, markers_of
from myomorph.core.motion.ik import inverse_kinematics


def test_bounds_hold_while_the_loop_stays_closed():
    """The crank swings; the rocker may only go so far, and then all three stop."""
    model = four_bar()
    true = four_bar_angles(1.5 + 0.8 * np.sin(np.linspace(0.0, 6.0, 120)))
    low, high = np.quantile(true[:, 2], [0.2, 0.8])
    coordinates = list(model.coordinates)
    coordinates[2] = replace(coordinates[2], clamped=True, range=(low, high))
    bounded = replace(model, coordinates=tuple(coordinates))
    fit = inverse_kinematics(bounded, markers_of(model, true))
    assert fit.converged.all()
    assert fit.loop_closure_error.max() < 1e-9
    rocker = fit.motion["rocker"]
    assert rocker.min() >= low - 1e-9
    assert rocker.max() <= high + 1e-9
    assert ((rocker < low + 1e-9) | (rocker > high - 1e-9)).sum() > 20
    inside = (true[:, 2] > low + 1e-6) & (true[:, 2] < high - 1e-6)
    np.testing.assert_allclose(fit.motion.values[inside], true[inside], atol=1e-5)
    at_bound = (np.abs(rocker - high) < 1e-9) | (np.abs(rocker - low) < 1e-9)
    reached = four_bar_angles(fit.motion["crank"][at_bound])
    np.testing.assert_allclose(fit.motion.values[at_bound], reached, atol=1e-6)


def test_a_locked_coordinate_of_a_loop_stops_all_of_it():
    model = four_bar()
    true = four_bar_angles(np.linspace(1.0, 1.4, 5))
    coordinates = list(model.coordinates)
    coordinates[0] = replace(coordinates[0], locked=True, default=1.2)
    fit = inverse_kinematics(
        replace(model, coordinates=tuple(coordinates)), markers_of(model, true)
    )
    np.testing.assert_allclose(
        fit.motion.values, np.tile(four_bar_angles(np.array([1.2])), (5, 1)), atol=1e-9
    )
