"""Millard's curves against OpenSim's, with default and other parameters."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.muscles.hill_curves import active_force_length, force_velocity, passive_force_length, spline_curve

X = np.linspace(-1.6, 2.6, 4201)

ACTIVE = [(), (0.25, 0.77, 1.9, 0.75, 0.0), (0.4327, 0.728, 1.595, 0.4613, 0.0)]
VELOCITY = [(), (0.1, 0.25, 5.0, 0.1, 0.15, 1.4, 0.6, 0.9), (0.0, 0.3, 7.0, 0.0, 0.2, 1.8, 0.2, 0.4)]
PASSIVE = [(), (-0.19, 0.5, 0.2, 3.1, 0.75), (0.1, 0.85, 0.2, 3.9, 0.75), (0.0, 0.6405, 0.0751, 6.3163, 0.6658)]


def values(function) -> np.ndarray:
    return np.array([function.calcValue(float(x)) for x in X])


@pytest.mark.parametrize("parameters", ACTIVE)
def test_active_force_length_is_opensims(parameters):
    opensim = pytest.importorskip("opensim")
    theirs = opensim.ActiveForceLengthCurve(*parameters)
    np.testing.assert_allclose(active_force_length(*parameters)(X), values(theirs), rtol=0, atol=1e-10)


@pytest.mark.parametrize("parameters", VELOCITY)
def test_force_velocity_is_opensims(parameters):
    opensim = pytest.importorskip("opensim")
    theirs = opensim.ForceVelocityCurve(*parameters)
    np.testing.assert_allclose(force_velocity(*parameters)(X), values(theirs), rtol=0, atol=1e-10)


@pytest.mark.parametrize("parameters", PASSIVE)
def test_passive_force_length_is_opensims(parameters):
    opensim = pytest.importorskip("opensim")
    theirs = opensim.FiberForceLengthCurve(*parameters)
    np.testing.assert_allclose(passive_force_length(*parameters)(X), values(theirs), rtol=1e-10, atol=1e-10)


def test_a_spline_curve_is_the_spline():
    opensim = pytest.importorskip("opensim")
    x, y = [-1.0, 0.2, 0.5, 1.3, 2.0], [0.0, 0.3, 1.0, 0.7, 0.9]
    theirs = opensim.SimmSpline()
    for a, b in zip(x, y, strict=True):
        theirs.addPoint(a, b)
    found = [theirs.calcValue(opensim.Vector(1, float(one))) for one in X]
    np.testing.assert_allclose(spline_curve(x, y)(X), found, rtol=0, atol=1e-11)


def test_curves_are_continuous_with_their_slopes():
    for curve in (active_force_length(), force_velocity(), passive_force_length()):
        x = np.linspace(-1.2, 2.0, 200001)
        slope = np.diff(curve(x)) / np.diff(x)
        assert np.abs(np.diff(slope)).max() < 5e-3
