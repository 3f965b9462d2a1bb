"""Curves: Millard's against OpenSim's, inverses, and corners.

Derivatives of all classes' curves are against finite differences.
"""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.model.paths import Muscle, Path
from myomorph.core.muscles.curves import (
    ASINH,
    BELL,
    EXPONENTIAL,
    LOGARITHM,
    LOGISTIC,
    RATIO,
    Curve,
    Piece,
    Shape,
    spline_curve,
)
from myomorph.core.muscles.hill import MODELS, muscle_model
from myomorph.core.muscles.models.millard import (
    active_force_length,
    force_velocity,
    passive_force_length,
)

X = np.linspace(-1.6, 2.6, 4201)

ACTIVE = [(), (0.25, 0.77, 1.9, 0.75, 0.0), (0.4327, 0.728, 1.595, 0.4613, 0.0)]
VELOCITY = [
    (),
    (0.1, 0.25, 5.0, 0.1, 0.15, 1.4, 0.6, 0.9),
    (0.0, 0.3, 7.0, 0.0, 0.2, 1.8, 0.2, 0.4),
]
PASSIVE = [
    (),
    (-0.19, 0.5, 0.2, 3.1, 0.75),
    (0.1, 0.85, 0.2, 3.9, 0.75),
    (0.0, 0.6405, 0.0751, 6.3163, 0.6658),
]


def _values(function) -> np.ndarray:
    return np.array([function.calcValue(float(x)) for x in X])


@pytest.mark.parametrize("parameters", ACTIVE)
def test_active_force_length_is_opensims(parameters):
    opensim = pytest.importorskip("opensim")
    theirs = opensim.ActiveForceLengthCurve(*parameters)
    np.testing.assert_allclose(
        active_force_length(*parameters)(X), _values(theirs), rtol=0, atol=1e-10
    )


@pytest.mark.parametrize("parameters", VELOCITY)
def test_force_velocity_is_opensims(parameters):
    opensim = pytest.importorskip("opensim")
    theirs = opensim.ForceVelocityCurve(*parameters)
    np.testing.assert_allclose(force_velocity(*parameters)(X), _values(theirs), rtol=0, atol=1e-10)


@pytest.mark.parametrize("parameters", PASSIVE)
def test_passive_force_length_is_opensims(parameters):
    opensim = pytest.importorskip("opensim")
    theirs = opensim.FiberForceLengthCurve(*parameters)
    np.testing.assert_allclose(
        passive_force_length(*parameters)(X), _values(theirs), rtol=1e-10, atol=1e-10
    )


def test_a_spline_curve_is_the_spline():
    opensim = pytest.importorskip("opensim")
    x = (-1.0, 0.2, 0.5, 1.3, 2.0)
    y = (0.0, 0.3, 1.0, 0.7, 0.9)
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


def _slopes_agree(curve: Curve, x: np.ndarray, h: float = 1e-5) -> None:
    """Compare values, slopes and curvatures with central differences.

    Only where no piece or line begins nearby.
    """
    breaks = [piece.start for piece in curve.pieces] + [curve.end]
    x = x[np.all([np.abs(x - at) > 2.0 * h for at in breaks], axis=0)]
    jets = curve.jets(x)
    before = curve.jets(x - h)
    after = curve.jets(x + h)
    np.testing.assert_allclose(jets[:, 0], curve(x), rtol=1e-13, atol=1e-15)
    np.testing.assert_allclose(
        jets[:, 1:], (after[:, :2] - before[:, :2]) / (2.0 * h), rtol=1e-5, atol=1e-5
    )


@pytest.mark.parametrize("kind", MODELS)
def test_derivatives_of_every_class_are_those_of_finite_differences(kind):
    muscle = Muscle(
        name="m",
        kind=kind,
        path=Path(()),
        max_isometric_force=500.0,
        optimal_fiber_length=0.05,
        tendon_slack_length=0.1,
    )
    model = muscle_model(muscle)
    assert muscle_model(muscle) is model
    x = np.linspace(0.3, 1.9, 331)
    v = np.linspace(-1.3, 1.3, 331)
    for curves in (model.curves(muscle), model.smooth_curves(muscle)):
        _slopes_agree(curves.active, x)
        _slopes_agree(curves.passive, x)
        _slopes_agree(curves.velocity, v)
    if model.elastic:
        force = np.linspace(0.01, 1.5, 200)
        _slopes_agree(model.tendon(muscle), np.linspace(0.99, 1.07, 200), 1e-7)
        _slopes_agree(model.stretch(muscle), force)
        np.testing.assert_allclose(
            model.tendon(muscle)(model.stretch(muscle)(force)), force, atol=1e-9
        )


@pytest.mark.parametrize("form", [RATIO, EXPONENTIAL, BELL, LOGARITHM, ASINH, LOGISTIC])
def test_every_elementary_function_has_its_derivatives(form):
    functions = {
        RATIO: lambda z: z,
        EXPONENTIAL: np.exp,
        BELL: lambda z: np.exp(-z * z),
        LOGARITHM: np.log,
        ASINH: np.arcsinh,
        LOGISTIC: lambda z: 1.0 / (1.0 + np.exp(z)),
    }
    x = np.linspace(0.2, 2.0, 50)
    curve = Curve(
        (
            Piece(
                -np.inf,
                (0.3, -0.2),
                shapes=(Shape(form=form, size=1.7, a=0.4, b=0.6, c=1.1, d=0.25),),
            ),
        )
    )
    expected = 0.3 - 0.2 * x + 1.7 * functions[form]((0.4 + 0.6 * x) / (1.1 + 0.25 * x))
    np.testing.assert_allclose(curve(x), expected, rtol=1e-14)
    _slopes_agree(curve, x)


def test_lines_and_bounds_hold_a_curve_outside():
    curve = Curve(
        pieces=(Piece(0.0, (1.0, 0.0, 1.0)),), end=2.0, slopes=(-1.0, None), bounds=(0.5, 6.0)
    )
    np.testing.assert_allclose(curve([-0.2, 1.0, 2.0, 2.1]), [1.2, 2.0, 5.0, 5.4])
    np.testing.assert_allclose(
        curve.jets([-9.0, 2.1, 3.0]), [[6.0, 0.0, 0.0], [5.4, 4.0, 0.0], [6.0, 0.0, 0.0]]
    )
    assert np.isnan(curve(np.nan))


def test_a_corner_is_rounded_without_a_step_in_value_or_slope():
    corner = Curve((Piece(-1.0, (0.0, 1.0)), Piece(0.0, (1.0, 3.0))), 1.0, (None, None))
    smooth = corner.rounded(0.0, 0.1)
    for at in (-0.1, 0.1):
        before, after = smooth.jets([at - 1e-9, at + 1e-9])
        np.testing.assert_allclose(before[:2], after[:2], atol=1e-6)
    far = np.array([-2.0, -0.5, -0.1, 0.1, 0.7, 3.0])
    np.testing.assert_allclose(smooth(far), corner(far), atol=1e-14)


def test_the_inverse_of_polynomials_is_exact_and_shapes_are_refused():
    curve = force_velocity(0.1, 0.25, 5.0, 0.1)
    x = np.linspace(-1.5, 1.5, 301)
    np.testing.assert_allclose(curve.inverse()(curve(x)), x, atol=1e-8)
    with pytest.raises(ValueError, match="polynomials"):
        Curve((Piece(0.0, shapes=(Shape(EXPONENTIAL, 1.0),)),)).inverse()
