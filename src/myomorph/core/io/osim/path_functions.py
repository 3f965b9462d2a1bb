"""OpenSim's paths by functions of coordinates (FunctionBasedPath), read and written."""

from __future__ import annotations

from collections.abc import Sequence
from math import comb

import numpy as np
from lxml import etree

from myomorph.core.io.osim.document import Node, child, legal, put
from myomorph.core.io.osim.functions import read_function, write_function
from myomorph.core.io.osim.joints import plain_name
from myomorph.core.model.errors import BadModel, check_name
from myomorph.core.model.functions import Function
from myomorph.core.model.messages import Message
from myomorph.core.model.paths import PathFunction
from myomorph.core.model.polynomial import Polynomial

KIND = "FunctionBasedPath"
MAX_DIMENSION = 100  # Coordinates of one path and their rates.


def read_path_function(node: Node, owner: Node, coordinates: Sequence[str]) -> PathFunction:
    """Read a path whose length is a function of coordinates.

    Source: OpenSim 4.6, FunctionBasedPath.

    Parameters
    ----------
    node : the path
    owner : object that has it, for messages
    coordinates : names of the model's coordinates

    Returns
    -------
    functions of coordinates in radians and meters

    Raises
    ------
    BadFile : it has no coordinate, no function, or one of another number of coordinates
    BadModel : a function is of a class that is not supported
    UnknownName : it names a coordinate that does not exist
    """
    names = tuple(map(plain_name, node.words("coordinate_paths", "coordinates")))
    where = f"{node.document.path}: the path of '{owner.name}': the model"
    for name in names:
        check_name("coordinate", name, coordinates, where)
    if not names or len(set(names)) < len(names):
        raise owner.bad("its path has no coordinate, or one twice", "expected <coordinate_paths>")
    length = node.inner("length_function")
    if length is None:
        raise owner.bad("its path has no length_function")
    arms = node.items("moment_arm_functions")
    if arms and len(arms) != len(names):
        raise owner.bad(
            f"its path has {len(arms)} moment_arm_functions", f"expected {len(names)} or none"
        )
    velocity = node.inner("lengthening_speed_function")
    return PathFunction(
        coordinates=names,
        length=_function(length, owner, len(names)),
        moment_arms=tuple(_function(arm, owner, len(names)) for arm in arms),
        velocity=None if velocity is None else _function(velocity, owner, 2 * len(names)),
    )


def _function(node: Node, owner: Node, count: int) -> Polynomial | Function:
    """Read a function of several coordinates.

    Parameters
    ----------
    node : the function
    owner : object that uses it, for messages
    count : of the coordinates that it takes

    Raises
    ------
    BadFile : its numbers do not make a function of so many coordinates
    BadModel : its class is not supported
    """
    if node.kind == "MultivariatePolynomialFunction":
        return _polynomial(node, owner, count)
    if node.kind == "LinearFunction":
        values = node.numbers("coefficients", np.array([1.0, 0.0]))
        if values is None or len(values) != count + 1:
            raise owner.bad(f"a LinearFunction of its path is not of {count} coordinates")
        # The constant is last in the file, and first in a polynomial; slopes the other way round.
        return Polynomial(dimension=count, order=1, coefficients=values[::-1])
    if node.kind == "MultiplierFunction":
        inner = node.inner("function")
        if inner is None:
            raise node.bad("has no function inside")
        return _function(inner, owner, count).scaled(node.number("scale", 1.0))
    if node.kind == "Constant":
        value = np.array([node.number("value", 0.0)])
        return Polynomial(dimension=count, order=0, coefficients=value)
    if count != 1:
        raise BadModel(
            f"{node.document.path}: the path of '{owner.name}' uses a {node.kind} of {count}"
            " coordinates, which is not supported: MultivariatePolynomialFunction, LinearFunction"
            " and"
            " Constant are"
        )
    function = read_function(node, owner)
    if function.arity == 1:
        return function
    return Polynomial(dimension=1, order=0, coefficients=np.atleast_1d(function(0.0)))


def _polynomial(node: Node, owner: Node, count: int) -> Polynomial:
    """Read a polynomial of several coordinates; `BadFile` where its numbers do not fit."""
    values = node.numbers("coefficients", np.zeros(0))
    dimension = int(node.number("dimension", 0.0))
    order = int(node.number("order", 0.0))
    if dimension != count or not 0 < dimension <= MAX_DIMENSION:
        raise owner.bad(f"a polynomial of its path is of {dimension} coordinates, not {count}")
    # Counted before any term is made: a file may state any order.
    sizes = 0 if values is None else len(values)
    if values is None or not 0 <= order < sizes + 1 or comb(dimension + order, order) != sizes:
        raise owner.bad(
            f"a polynomial of its path has {sizes} coefficients",
            f"one of {dimension} coordinates and order {order} has another number",
        )
    return Polynomial(dimension=dimension, order=order, coefficients=values)


def write_path_function(
    element: etree._Element,
    owner: str,
    function: PathFunction,
    joints: dict[str, str],
    warnings: list[Message],
) -> etree._Element:
    """Write a path whose length is a function of coordinates.

    Parameters
    ----------
    element : gets the path
    owner : name of the muscle, for warnings
    function : of the path
    joints : component name of the joint of each coordinate
    warnings : gets a line where a function is written only nearly

    Returns
    -------
    the path's element
    """
    path = child(element, KIND, name="path")
    names = [f"/jointset/{joints[name]}/{legal(name)}" for name in function.coordinates]
    put(path, coordinate_paths=" ".join(names))
    _write_function(child(path, "length_function"), function.length, owner, warnings)
    if function.moment_arms:
        holder = child(path, "moment_arm_functions")
        for arm in function.moment_arms:
            _write_function(holder, arm, owner, warnings)
    if function.velocity is not None:
        _write_function(
            child(path, "lengthening_speed_function"), function.velocity, owner, warnings
        )
    return path


def _write_function(
    parent: etree._Element, function: Polynomial | Function, owner: str, warnings: list[Message]
) -> None:
    """Write a function of several coordinates."""
    if not isinstance(function, Polynomial):
        write_function(parent, function, f"path of '{owner}'", warnings)
        return
    put(
        child(parent, "MultivariatePolynomialFunction"),
        coefficients=function.coefficients,
        dimension=str(function.dimension),
        order=str(function.order),
    )
