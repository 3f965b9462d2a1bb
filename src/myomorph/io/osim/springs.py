"""OpenSim's springs and limits of single coordinates as passive torques, and its bushings."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np
from numpy.polynomial import polynomial as poly

from myomorph.io.osim.constraints import tied_frame
from myomorph.io.osim.document import Node
from myomorph.io.osim.frames import Frames
from myomorph.io.osim.joints import plain_name
from myomorph.model.errors import UnknownName
from myomorph.model.functions import PiecewisePolynomial, constant, linear
from myomorph.model.model import Coordinate
from myomorph.model.passive_parts import Bushing, PassiveTorque

BUSHING = "BushingForce"
KINDS = ("CoordinateLimitForce", "SpringGeneralizedForce")


def read_passive_torques(model: Node, coordinates: Sequence[Coordinate]) -> tuple[PassiveTorque, ...]:
    """The passive torques of a model's forces, those switched off left out.

    Raises
    ------
    UnknownName
        One names a coordinate that the model does not have.
    """
    by_name = {one.name: one for one in coordinates}
    found: list[PassiveTorque] = []
    for node in model.items("ForceSet"):
        if node.kind not in KINDS or not node.flag("appliesForce", not node.flag("isDisabled", False)):
            continue
        name = plain_name(node.text("", "coordinate"))
        if name not in by_name:
            raise UnknownName("coordinate", name, tuple(by_name), f"{node.document.path}: {node.kind} '{node.name}'")
        if node.kind == "SpringGeneralizedForce":
            stiffness, rest = node.number("stiffness", 0.0), node.number("rest_length", 0.0)
            spring = linear(-stiffness, stiffness * rest)
            found.append(PassiveTorque(node.name, name, spring, constant(node.number("viscosity", 0.0))))
        else:
            found += _limits(node, by_name[name])
    return tuple(found)


def read_bushings(model: Node, frames: Frames) -> tuple[Bushing, ...]:
    """The bushings of a model's forces, those switched off left out.

    Raises
    ------
    UnknownName
        One names a frame that the model does not have.
    """
    found = []
    for node in model.items("ForceSet"):
        if node.kind != BUSHING or not node.flag("appliesForce", not node.flag("isDisabled", False)):
            continue
        (body_1, pose_1), (body_2, pose_2) = (tied_frame(node, frames, i) for i in "12")
        parts = {
            f"{what}_{part}": node.vector(f"{what}_{part}", (0.0, 0.0, 0.0))
            for what in ("rotational", "translational")
            for part in ("stiffness", "damping")
        }
        found.append(Bushing(node.name, body_1, body_2, pose_1, pose_2, **parts))
    return tuple(found)


def _limits(node: Node, coordinate: Coordinate) -> list[PassiveTorque]:
    """The torques of both limits: nothing inside, then a stiffness that rises over the transition.

    Rotational limits are in degrees, their stiffness and damping per degree.
    """
    unit = np.pi / 180.0 if coordinate.motion == "rotational" else 1.0
    width = node.number("transition", 0.1) * unit
    damping = node.number("damping", 0.001) / unit
    found = []
    for side, sign in (("upper", 1.0), ("lower", -1.0)):
        limit = sign * node.number(f"{side}_limit", 0.0) * unit
        stiffness = node.number(f"{side}_stiffness", 1.0) / unit
        # The smooth step 10 t^3 - 15 t^4 + 6 t^5 of t = h / width, h the way past the limit.
        step = np.array([0.0, 0.0, 0.0, 10.0, -15.0, 6.0]) / width ** np.arange(6)
        resisting = -stiffness * poly.polymul(step, [0.0, 1.0])
        torque = _pieces(limit, width, resisting, [-stiffness * width, -stiffness])
        damped = _pieces(limit, width, damping * step, [damping])
        if sign < 0.0:
            torque, damped = _mirrored(torque).scaled(-1.0), _mirrored(damped)
        found.append(PassiveTorque(f"{node.name}_{side}", coordinate.name, torque, damped))
    return found


def _pieces(limit: float, width: float, within: np.ndarray, beyond: list[float]) -> PiecewisePolynomial:
    """0 up to the limit, `within` over the transition, `beyond` after it."""
    rows = np.zeros((3, 7))
    rows[1, : len(within)] = within
    rows[2, : len(beyond)] = beyond
    return PiecewisePolynomial(np.array([limit, limit, limit + width]), rows)


def _mirrored(function: PiecewisePolynomial) -> PiecewisePolynomial:
    """g(x) = f(-x) of a function of three pieces whose first break is given twice."""
    _, low, high = function.breaks
    width = high - low
    left, middle, right = function.coefficients
    signs = (-1.0) ** np.arange(len(left))
    # On a piece of f, f(-x) with x = -high + k reads f at low + (width - k).
    turned = np.zeros_like(middle)
    power = np.array([1.0])
    for coefficient in middle:
        turned[: len(power)] += coefficient * power
        power = poly.polymul(power, [width, -1.0])
    return PiecewisePolynomial(np.array([-high, -high, -low]), np.stack([right * signs, turned, left * signs]))
