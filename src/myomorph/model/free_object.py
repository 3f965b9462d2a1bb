"""Objects of known inertia as models of their own: a box that is carried, a wheel on its axle."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.functions import linear
from myomorph.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Mesh, Model
from myomorph.model.spatial import Transform

EARTH = (0.0, -9.80665, 0.0)
SLIDES, TURNS = ("tx", "ty", "tz"), ("rx", "ry", "rz")


def free_object(
    name: str,
    mass: float,
    size: ArrayLike | None = None,
    *,
    inertia: ArrayLike | None = None,
    mass_center: ArrayLike = (0.0, 0.0, 0.0),
    markers: Mapping[str, ArrayLike] | None = None,
    mesh: str = "",
    gravity: ArrayLike = EARTH,
) -> Model:
    """One rigid body that moves freely: coordinates `tx`, `ty`, `tz` of its origin, then `rx`, `ry`, `rz`.

    Parameters
    ----------
    name : of the body
    mass : [kg]
    size : (3,) of a solid box about the mass center, which gives the inertia where none is given [m]
    inertia : (3, 3), or (3,) its diagonal, about the mass center in the body's axes [kg m^2]
    mass_center : (3,) in the body's frame [m]
    markers : places (3,) in the body's frame by name [m]
    mesh : file that draws it instead of a box of `size`
    gravity : (3,) in ground [m/s^2]

    Raises
    ------
    BadData
        where mass or size is not positive, or the inertia is none of a body
    """
    body = _body(name, mass, size, inertia, mass_center, mesh)
    axes = [Axis("translation", np.eye(3)[i], linear(1.0), (one,)) for i, one in enumerate(SLIDES)]
    axes += [Axis("rotation", np.eye(3)[i], linear(1.0), (one,)) for i, one in enumerate(TURNS)]
    names = (*SLIDES, *TURNS)
    still = Transform.identity()
    joint = Joint(f"ground_{name}", "CustomJoint", GROUND, name, still, still, tuple(axes), names)
    coordinates = tuple(Coordinate(one, "translational" if one in SLIDES else "rotational") for one in names)
    return Model(name, (body,), (joint,), coordinates, np.asarray(gravity), markers=_markers(name, markers))


def hinged_object(
    name: str,
    mass: float,
    axis: ArrayLike,
    *,
    inertia: ArrayLike,
    center: ArrayLike = (0.0, 0.0, 0.0),
    mass_center: ArrayLike = (0.0, 0.0, 0.0),
    markers: Mapping[str, ArrayLike] | None = None,
    mesh: str = "",
    gravity: ArrayLike = EARTH,
) -> Model:
    """One rigid body that turns about an axle of the ground, by the coordinate `angle`.

    Parameters
    ----------
    axis : (3,) of the axle in ground, which is also the body's z axis
    center : (3,) of the axle in ground, where the body has its origin [m]
    inertia, mass_center, markers : as for `free_object`, in axes that are the ground's turned as little as brings z
        onto `axis`

    Raises
    ------
    BadData
        as `free_object`, or where the axis has no length
    """
    along = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(along))
    if along.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise BadData(f"axle {along.tolist()} of '{name}': expected a vector with a length")
    body = _body(name, mass, None, inertia, mass_center, mesh)
    frame = Transform(_onto(along / length), np.asarray(center, dtype=np.float64))
    turn = Axis("rotation", np.array([0.0, 0.0, 1.0]), linear(1.0), ("angle",))
    joint = Joint(f"ground_{name}", "PinJoint", GROUND, name, frame, Transform.identity(), (turn,), ("angle",))
    return Model(name, (body,), (joint,), (Coordinate("angle"),), np.asarray(gravity), markers=_markers(name, markers))


def _body(
    name: str, mass: float, size: ArrayLike | None, inertia: ArrayLike | None, mass_center: ArrayLike, mesh: str
) -> Body:
    if not (np.isfinite(mass) and mass > 0.0):
        raise BadData(f"mass of '{name}' is {mass:g} kg: expected above 0")
    if size is None and inertia is None:
        raise BadData(f"object '{name}' has neither a size nor an inertia")
    box = np.ones(3) if size is None else np.asarray(size, dtype=np.float64)
    if box.shape != (3,) or not (np.isfinite(box).all() and (box > 0.0).all()):
        raise BadData(f"size {box.tolist()} of '{name}': expected three lengths above 0")
    about = np.asarray((mass / 12.0) * (box @ box - box**2) if inertia is None else inertia, dtype=np.float64)
    moments = np.diag(about) if about.shape == (3,) else about
    _check_inertia(name, moments)
    meshes = []
    if mesh:
        meshes.append(Mesh(mesh, Transform.identity(), np.ones(3)))
    elif size is not None:
        meshes.append(Mesh("", Transform(np.eye(3), np.asarray(mass_center, dtype=np.float64)), 0.5 * box, "box"))
    return Body(name, mass, np.asarray(mass_center), moments, tuple(meshes))


def _check_inertia(name: str, moments: Array) -> None:
    if moments.shape != (3, 3) or not np.isfinite(moments).all() or not np.allclose(moments, moments.T):
        raise BadData(f"inertia of '{name}': expected a symmetric (3, 3) or its diagonal (3,), got {moments.tolist()}")
    low, middle, high = np.linalg.eigvalsh(moments)
    if low <= 0.0 or high > (low + middle) * (1.0 + 1e-9):
        raise BadData(f"inertia of '{name}' with moments {low:.3g}, {middle:.3g}, {high:.3g} kg m^2 is none of a body")


def _onto(axis: Array) -> Array:
    """The least rotation that brings z onto a unit axis."""
    z = np.array([0.0, 0.0, 1.0])
    c = float(z @ axis)
    if c < -1.0 + 1e-12:
        return np.diag([1.0, -1.0, -1.0])
    v = np.cross(z, axis)
    cross = np.array([[0.0, -v[2], v[1]], [v[2], 0.0, -v[0]], [-v[1], v[0], 0.0]])
    rotation: Array = np.eye(3) + cross + cross @ cross / (1.0 + c)
    return rotation


def _markers(body: str, places: Mapping[str, ArrayLike] | None) -> tuple[Marker, ...]:
    return tuple(Marker(name, body, np.asarray(place)) for name, place in (places or {}).items())
