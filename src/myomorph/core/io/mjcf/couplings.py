"""Couplings of joints in MuJoCo models for which a polynomial of degree four does not do."""

from __future__ import annotations

import os
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import mujoco
import numpy as np

from myomorph.core.io.mjcf.compile import silent_mujoco
from myomorph.core.io.parsing.text import written
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadFile
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import PiecewisePolynomial
from myomorph.core.model.model import Coupler, Model


@read_only
class Branch:
    """A distance between two sites in a cam.

    Attributes
    ----------
    weight : of the distance in the sum
    body_1, body_2 : that the sites are on
    place_1, place_2 : (3,) positions of the sites in those bodies [m]
    """

    weight: float
    body_1: str
    place_1: Array
    body_2: str
    place_2: Array


@read_only
class Cam:
    """A sum of weighted distances that stays constant.

    Positive distances are one tendon, negative ones another.

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
    """Write the function that a cam holds its follower to, as MuJoCo's custom text.

    Parameters
    ----------
    follower : dependent coordinate
    model : its couplers are read
    joints : names of the coordinates that are joints in MuJoCo

    Returns
    -------
    leader, breaks and coefficients of each piece, with semicolons between; "" where the leader is
    no such joint or the function has no pieces
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
    rows = [
        " ".join(map(repr, row))
        for row in (function.breaks.tolist(), *function.coefficients.tolist())
    ]
    return ";".join([leader, *rows])


LINE = np.array([-1.0, 0.0, 0.3, 1.0])  # Values by which a coupler that changes nothing is known.


def coupler_of_text(name: str, follower: str, text: str) -> Coupler:
    """Read the coupler that `curve_text` wrote.

    Parameters
    ----------
    name : of the coupler
    follower : dependent coordinate
    text : as `curve_text` writes it

    Returns
    -------
    the coupler, its function in pieces

    Raises
    ------
    ValueError : it is no such text
    """
    leader, breaks, *rows = text.split(";")
    coefficients = np.array([[float(number) for number in row.split()] for row in rows])
    function = PiecewisePolynomial(
        np.array([float(number) for number in breaks.split()]), coefficients
    )
    return Coupler(name=name, dependent=follower, function=function, independents=(leader,))


def write_dampers(
    path: Path,
    out: Path,
    joints: Mapping[str, float],
    muscles: Mapping[str, float] = FrozenMap({}),
    springs: Mapping[str, tuple[float, float]] = FrozenMap({}),
) -> None:
    """Write an MJCF file with damping of its joints and tendons, and springs of joints.

    Parameters
    ----------
    path : of the file to read
    out : path of the file to write, replaced where it exists
    joints : damping by joint [N m s/rad]
    muscles : damping of the tendon by muscle [N s/m]
    springs : stiffness [N m/rad] and neutral position [rad] by joint

    Raises
    ------
    BadFile : MuJoCo cannot read the file, or a part is not in it
    """
    with silent_mujoco():
        try:
            spec = mujoco.MjSpec.from_file(str(path))
            for name, value in joints.items():
                _resist(spec.joint(name), "damping", value)
            for name, (stiffness, rest) in springs.items():
                _resist(spec.joint(name), "stiffness", stiffness)
                spec.joint(name).springref = np.rad2deg(rest) if spec.compiler.degree else rest
            for name, value in muscles.items():
                _resist(spec.tendon(spec.actuator(name).target), "damping", value)
            spec.compile()
            spec.meshdir = os.path.relpath(
                path.resolve().parent / spec.meshdir, out.resolve().parent
            )
            spec.texturedir = os.path.relpath(
                path.resolve().parent / spec.texturedir, out.resolve().parent
            )
            text = spec.to_xml()
        except (ValueError, AttributeError, KeyError) as error:
            raise BadFile(
                path, f"takes no dampers ({error})", "a joint or muscle needs the model's name"
            ) from None
    with written(out) as stream:
        stream.write(text)


def _resist(part: Any, name: str, value: float) -> None:
    # MuJoCo since 3.5 has powers of the speed, and of the angle, beside it.
    """Set the damping or stiffness of a part, the first of its powers where MuJoCo has several."""
    powers = getattr(part, name)
    setattr(part, name, np.array([value, *np.zeros(len(powers) - 1)]) if np.ndim(powers) else value)
