"""How one joint of a MuJoCo model follows another where a polynomial of degree four does not do."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.functions import PiecewisePolynomial
from myomorph.model.model import Coupler, Model


@read_only
class Branch:
    """A distance between two sites in a cam.

    Attributes
    ----------
    weight : of the distance in the sum
    body_1, body_2 : that the sites are on
    place_1, place_2 : (3,) in those bodies [m]
    """

    weight: float
    body_1: str
    place_1: Array
    body_2: str
    place_2: Array


@read_only
class Cam:
    """A sum of weighted distances that stays what it is; the positive ones are one tendon, the negative ones another.

    Attributes
    ----------
    follower : coordinate that the cam holds
    offset : of the sum, over its value in the default pose [m]
    branches : at least one of each sign
    """

    follower: str
    offset: float
    branches: tuple[Branch, ...]


def curve_text(follower: str, model: Model, joints: set[str]) -> str:
    """The curve that a cam holds its follower to, in MuJoCo's custom text; "" where it has no name for its leader.

    Leader, breaks and coefficients of each piece, with semicolons between.
    """
    coupler = model.dependent_coordinates[follower]
    leader = coupler.independents[0]
    while leader not in joints:
        between = model.dependent_coordinates.get(leader)
        if between is None or not np.array_equal(between.function(LINE), LINE):
            return ""
        leader = between.independents[0]
    function = coupler.function
    if not isinstance(function, PiecewisePolynomial):
        return ""
    rows = [" ".join(map(repr, row)) for row in (function.breaks.tolist(), *function.coefficients.tolist())]
    return ";".join([leader, *rows])


LINE = np.array([-1.0, 0.0, 0.3, 1.0])
"""Values by which a coupler that changes nothing is known."""


def coupler_of_text(name: str, follower: str, text: str) -> Coupler:
    """The coupler that `curve_text` wrote.

    Raises
    ------
    ValueError : it wrote no such text
    """
    leader, breaks, *rows = text.split(";")
    coefficients = np.array([[float(number) for number in row.split()] for row in rows])
    function = PiecewisePolynomial(np.array([float(number) for number in breaks.split()]), coefficients)
    return Coupler(name, follower, function, (leader,))
