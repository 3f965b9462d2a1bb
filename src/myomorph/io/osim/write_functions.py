"""`Function`s as OpenSim's function objects."""

from __future__ import annotations

import re

import numpy as np
from lxml import etree
from numpy.typing import ArrayLike

from myomorph.io.osim.functions import natural_spline, smooth_step
from myomorph.model.arrays import Array
from myomorph.model.functions import Function, PiecewisePolynomial, SineProduct, piecewise_linear, simm_spline

SAMPLES = 401


def number(value: float) -> str:
    """Shortest text that reads back as the same number."""
    if np.isinf(value):
        return "Inf" if value > 0 else "-Inf"
    return repr(float(value))


def numbers(values: ArrayLike) -> str:
    """Numbers with blanks between."""
    return " ".join(number(one) for one in np.ravel(np.asarray(values, dtype=np.float64)))


def legal(name: str) -> str:
    """A name without the characters that OpenSim 4 refuses in one."""
    return re.sub(r"[\\*+\s/]", "_", name)


def child(parent: etree._Element, tag: str, text: str = "", name: str = "") -> etree._Element:
    """A new element inside `parent`."""
    element = etree.SubElement(parent, tag, {"name": legal(name)} if name else {})
    if text:
        element.text = text
    return element


def write_function(parent: etree._Element, function: Function, user: str, warnings: list[str]) -> None:
    """Put the OpenSim object that equals `function` into `parent`; say in `warnings` where none does.

    Parameters
    ----------
    user : what has the function, for the warning
    """
    if isinstance(function, SineProduct):
        if function.arity != 1:
            warnings.append(f"{user}: a product of sines of two coordinates cannot be written: its offset is")
            _polynomial(parent, np.array([function.offset]))
            return
        sine = child(parent, "Sine")
        child(sine, "amplitude", number(function.factor))
        child(sine, "omega", number(function.frequencies[0]))
        child(sine, "phase", number(function.phases[0]))
        child(sine, "offset", number(function.offset))
    elif len(function.breaks) == 1:
        _polynomial(parent, _moved(function.coefficients[0], -float(function.breaks[0])))
    else:
        _pieces(parent, function, user, warnings)


def _moved(coefficients: Array, by: float) -> Array:
    """Coefficients in x of a polynomial in (x + by), the constant term first."""
    if by == 0.0:
        return coefficients
    return np.asarray(np.polynomial.Polynomial(coefficients)(np.polynomial.Polynomial([by, 1.0])).coef, np.float64)


def _polynomial(parent: etree._Element, coefficients: Array) -> None:
    if len(coefficients) == 1:
        child(child(parent, "Constant"), "value", number(coefficients[0]))
    elif len(coefficients) == 2:
        child(child(parent, "LinearFunction"), "coefficients", numbers(coefficients[::-1]))
    else:
        child(child(parent, "PolynomialFunction"), "coefficients", numbers(coefficients[::-1]))


def _pieces(parent: etree._Element, function: PiecewisePolynomial, user: str, warnings: list[str]) -> None:
    x = np.unique(function.breaks)
    y = function(x)
    degree = function.coefficients.shape[1] - 1
    half = (degree + 1) // 2
    if degree == 5 and len(x) == 2 and same(function, smooth_step(x[0], x[1], y[0], y[1])):
        step = child(parent, "StepFunction")
        for tag, value in zip(("transition_start_time", "transition_end_time"), x, strict=True):
            child(step, tag, number(value))
        for tag, value in zip(("start_value", "end_value"), y, strict=True):
            child(step, tag, number(value))
    elif degree == 3 and same(function, simm_spline(x, y)):
        _points(parent, "SimmSpline", x, y)
    elif degree == 1 and same(function, piecewise_linear(*_with_end(function, x, y))):
        _points(parent, "PiecewiseLinearFunction", *_with_end(function, x, y))
    elif degree % 2 and len(x) > degree and same(function, natural_spline(x, y, half)):
        spline = _points(parent, "GCVSpline", x, y)
        child(spline, "half_order", str(half))
        child(spline, "error_variance", "0")
        child(spline, "weights", numbers(np.ones(len(x))))
    else:
        _sampled(parent, function, user, warnings)


def _with_end(function: PiecewisePolynomial, x: Array, y: Array) -> tuple[Array, Array]:
    """The points of a broken line with one more on its last piece, which has no end of its own."""
    end = x[-1] + max(1.0, float(np.ptp(x)))
    return np.append(x, end), np.append(y, float(function(end)))


def same(first: PiecewisePolynomial, second: PiecewisePolynomial) -> bool:
    """Whether two functions agree to rounding, beyond their ends too."""
    low, high = float(first.breaks[0]), float(first.breaks[-1])
    beyond = 0.1 * (high - low)
    x = np.linspace(low - beyond, high + beyond, 1001)
    a, b = first(x), second(x)
    return bool(np.max(np.abs(a - b)) <= 1e-10 * max(1e-3, float(np.max(np.abs(a)))))


def _points(parent: etree._Element, kind: str, x: Array, y: Array) -> etree._Element:
    element = child(parent, kind)
    child(element, "x", numbers(x))
    child(element, "y", numbers(y))
    return element


def _sampled(parent: etree._Element, function: PiecewisePolynomial, user: str, warnings: list[str]) -> None:
    """No class of OpenSim's has these pieces: a spline through many points comes close."""
    x = np.linspace(function.breaks[0], function.breaks[-1], SAMPLES)
    y = function(x)
    between = 0.5 * (x[1:] + x[:-1])
    error = float(np.max(np.abs(simm_spline(x, y)(between) - function(between))))
    warnings.append(f"{user}: written as a spline through {SAMPLES} points, at most {error:.1e} off")
    _points(parent, "SimmSpline", x, y)
