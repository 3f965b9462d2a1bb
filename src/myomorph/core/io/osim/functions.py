"""OpenSim's functions of coordinates as `Function`s, read and written."""

from __future__ import annotations

from collections.abc import Callable

import numpy as np
import scipy
from lxml import etree

from myomorph.core.io.osim.document import Node, child, put
from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadModel
from myomorph.core.model.functions import (
    Function,
    PiecewisePolynomial,
    SineProduct,
    constant,
    linear,
    piecewise_linear,
    polynomial,
    simm_spline,
    substituted,
)
from myomorph.core.model.messages import Message

KNOWN = (
    "Constant",
    "LinearFunction",
    "PolynomialFunction",
    "SimmSpline",
    "PiecewiseLinearFunction",
    "MultiplierFunction",
    "Sine",
    "GCVSpline",
    "StepFunction",
)

SAMPLES = 401


def read_function(node: Node, user: Node) -> Function:
    """Read the function that an object of the file describes.

    Parameters
    ----------
    node : the function
    user : object that uses it, for messages

    Returns
    -------
    the function, in the file's units (angles in radians)

    Raises
    ------
    BadFile : its numbers do not make a function
    BadModel : its class is not supported
    """
    if node.kind in READERS:
        return READERS[node.kind](node)
    if node.kind == "MultiplierFunction":
        inner = node.inner("function")
        if inner is None:
            raise node.bad("has no function inside")
        return read_function(inner, user).scaled(node.number("scale", 1.0))
    owner = f"{user.kind} '{user.name}'" if user.name else user.kind
    raise BadModel(
        f"{node.document.path}: {owner} uses a {node.kind}, which is not supported:"
        f" {', '.join(KNOWN)} are"
    )


def _constant(node: Node) -> Function:
    return constant(node.number("value", 0.0))


def _linear(node: Node) -> Function:
    slope, intercept = node.vector("coefficients", (1.0, 0.0))
    return linear(slope, intercept)


def _polynomial_function(node: Node) -> Function:
    """Read a polynomial, whose file has the constant last; without coefficients it is 1."""
    coefficients = node.numbers("coefficients", np.ones(1))
    if coefficients is None or not len(coefficients):
        return polynomial([1.0])
    return polynomial(coefficients[::-1])


def _sine(node: Node) -> Function:
    return SineProduct(
        frequencies=np.array([node.number("omega", 1.0)]),
        phases=np.array([node.number("phase", 0.0)]),
        factor=node.number("amplitude", 1.0),
        offset=node.number("offset", 0.0),
    )


def _step(node: Node) -> Function:
    """Read a smooth step; `BadFile` where it ends before it starts."""
    start = node.number("transition_start_time", 0.99)
    end = node.number("transition_end_time", 1.01)
    if end <= start:
        raise node.bad(f"transition_end_time {end:g} is not after transition_start_time {start:g}")
    low = node.number("start_value", 0.0)
    high = node.number("end_value", 1.0)
    return smooth_step(start, end, low, high)


def _sampled(node: Node) -> Function:
    """Read a function through points; through a single one it is constant."""
    x, y = _points(node)
    if len(x) == 1:
        return constant(float(y[0]))
    if node.kind == "SimmSpline":
        return simm_spline(x, y)
    if node.kind == "PiecewiseLinearFunction":
        return piecewise_linear(x, y)
    return _gcv_spline(node, x, y)


READERS: dict[str, Callable[[Node], Function]] = {
    "Constant": _constant,
    "LinearFunction": _linear,
    "PolynomialFunction": _polynomial_function,
    "SimmSpline": _sampled,
    "PiecewiseLinearFunction": _sampled,
    "Sine": _sine,
    "GCVSpline": _sampled,
    "StepFunction": _step,
}
"""How functions are read that hold no other, by their class."""


def _points(node: Node) -> tuple[Array, Array]:
    """Read the points of a sampled function.

    Returns
    -------
    x (points,), which increases, and y (points,)

    Raises
    ------
    BadFile : there are none, not as many of each, or x does not increase
    """
    x = node.numbers("x")
    y = node.numbers("y")
    if x is None or y is None or not len(x) or len(x) != len(y):
        counts = [0 if values is None else len(values) for values in (x, y)]
        raise node.bad(
            f"has {counts[0]} x and {counts[1]} y values", "expected as many of each, at least one"
        )
    if np.any(np.diff(x) <= 0):
        raise node.bad("its x values do not increase")
    return x, y


def smooth_step(start: float, end: float, low: float, high: float) -> PiecewisePolynomial:
    """Make OpenSim's `StepFunction`, a quintic between two levels.

        f = low + (high - low) (10 s^3 - 15 s^4 + 6 s^5),   s = (x - start) / (end - start)

    Parameters
    ----------
    start, end : x between which it rises, start below end
    low, high : levels before and after

    Returns
    -------
    the function, constant beyond its ends
    """
    width = end - start
    pieces = np.zeros((3, 6))
    pieces[:, 0] = low, low, high
    pieces[1, 3:] = (high - low) * np.array([10.0 / width**3, -15.0 / width**4, 6.0 / width**5])
    return PiecewisePolynomial(np.array([start, start, end]), pieces)


def _gcv_spline(node: Node, x: Array, y: Array) -> PiecewisePolynomial:
    """Read a `GCVSpline` through its points.

    Parameters
    ----------
    node : the spline
    x, y : (points,) that it goes through

    Raises
    ------
    BadFile : it smooths, or has too few points for its degree
    """
    half = int(node.number("half_order", 3.0))
    if node.number("error_variance", 0.0) != 0.0:
        raise node.bad(
            "smooths with an error variance",
            "only interpolating splines (error_variance 0) are supported",
        )
    if half < 1 or len(x) < 2 * half:
        raise node.bad(
            f"has {len(x)} points", f"a spline of degree {2 * half - 1} needs {2 * half}"
        )
    return natural_spline(x, y, half)


def natural_spline(x: Array, y: Array, half: int) -> PiecewisePolynomial:
    """Interpolate by a natural spline, as `GCVSpline` does where its error variance is zero.

    Beyond its ends it goes on as a polynomial of degree half - 1.

    Parameters
    ----------
    x : (points,), increasing; 2 half or more
    y : (points,)
    half : half the order; the degree is 2 half - 1

    Returns
    -------
    a piece between each pair of points and one beyond each end
    """
    # SciPy takes a while to import, and hardly any model has such a spline.
    zero = [(order, 0.0) for order in range(half, 2 * half - 1)]
    spline = scipy.interpolate.make_interp_spline(
        x, y, k=2 * half - 1, bc_type=(zero, zero) if zero else None
    )
    faculties = np.cumprod([1.0, *range(1, 2 * half)])
    pieces = np.column_stack([spline(x, nu=order) / faculties[order] for order in range(2 * half)])
    before = pieces[0].copy()
    before[half:] = pieces[-1, half:] = 0.0
    return PiecewisePolynomial(np.concatenate([x[:1], x]), np.vstack([before, pieces]))


def write_function(
    parent: etree._Element, function: Function, user: str, warnings: list[Message]
) -> None:
    """Write the OpenSim object that equals a function.

    Parameters
    ----------
    parent : element that gets it
    function : to write
    user : what has the function, for the warning
    warnings : gets a line where no class of OpenSim's equals it
    """
    if isinstance(function, SineProduct):
        if function.arity != 1:
            warnings.append(
                MODEL.message(
                    f"{user}: a product of sines of two coordinates cannot be written: its offset"
                    " is"
                )
            )
            _polynomial(parent, np.array([function.offset]))
            return
        sine = child(parent, "Sine")
        put(
            sine, amplitude=function.factor, omega=function.frequencies[0], phase=function.phases[0]
        )
        put(sine, offset=function.offset)
    elif len(function.breaks) == 1:
        _polynomial(parent, substituted(function.coefficients[0], -float(function.breaks[0])))
    else:
        _pieces(parent, function, user, warnings)


def _polynomial(parent: etree._Element, coefficients: Array) -> None:
    """Write a polynomial of these coefficients (degree + 1,), the constant first."""
    if len(coefficients) == 1:
        put(child(parent, "Constant"), value=coefficients[0])
    else:
        kind = "LinearFunction" if len(coefficients) == 2 else "PolynomialFunction"
        put(child(parent, kind), coefficients=coefficients[::-1])


def _pieces(
    parent: etree._Element, function: PiecewisePolynomial, user: str, warnings: list[Message]
) -> None:
    """Write a function of pieces as the class that equals it, or as a spline close to it.

    A warning states how far the spline is off.
    """
    x = np.unique(function.breaks)
    y = function(x)
    degree = function.coefficients.shape[1] - 1
    half = (degree + 1) // 2
    if degree == 5 and len(x) == 2 and same(function, smooth_step(x[0], x[1], y[0], y[1])):
        step = child(parent, "StepFunction")
        put(
            step,
            transition_start_time=x[0],
            transition_end_time=x[1],
            start_value=y[0],
            end_value=y[1],
        )
    elif degree == 3 and same(function, simm_spline(x, y)):
        _sampled_points(parent, "SimmSpline", x, y)
    elif degree == 1 and same(function, piecewise_linear(*_with_end(function, x, y))):
        _sampled_points(parent, "PiecewiseLinearFunction", *_with_end(function, x, y))
    elif degree % 2 and len(x) > degree and same(function, natural_spline(x, y, half)):
        spline = _sampled_points(parent, "GCVSpline", x, y)
        put(spline, half_order=str(half), error_variance="0", weights=np.ones(len(x)))
    else:
        # No class of OpenSim's has these pieces: a spline through many points comes close.
        x = np.linspace(function.breaks[0], function.breaks[-1], SAMPLES)
        y = function(x)
        between = 0.5 * (x[1:] + x[:-1])
        error = float(np.max(np.abs(simm_spline(x, y)(between) - function(between))))
        warnings.append(
            MODEL.message(
                f"{user}: written as a spline through {SAMPLES} points, at most {error:.1e} off"
            )
        )
        _sampled_points(parent, "SimmSpline", x, y)


def _with_end(function: PiecewisePolynomial, x: Array, y: Array) -> tuple[Array, Array]:
    """Add a point on the last piece of a broken line, which has no end of its own.

    Parameters
    ----------
    function : the broken line
    x, y : (points,) at its breaks

    Returns
    -------
    x and y (points + 1,)
    """
    end = x[-1] + max(1.0, float(np.ptp(x)))
    return np.append(x, end), np.append(y, float(function(end)))


def same(first: PiecewisePolynomial, second: PiecewisePolynomial) -> bool:
    """Return whether two functions agree to rounding, beyond their ends too.

    Parameters
    ----------
    first, second : compared at 1001 values around the breaks of the first
    """
    low = float(first.breaks[0])
    high = float(first.breaks[-1])
    beyond = 0.1 * (high - low)
    x = np.linspace(low - beyond, high + beyond, 1001)
    a = first(x)
    b = second(x)
    return bool(np.max(np.abs(a - b)) <= 1e-10 * max(1e-3, float(np.max(np.abs(a)))))


def _sampled_points(parent: etree._Element, kind: str, x: Array, y: Array) -> etree._Element:
    """Write a function that is given by points x, y (points,) and return its element."""
    element = child(parent, kind)
    put(element, x=x, y=y)
    return element
