"""The ten inertial parameters of every body as numbers, and back."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import MODEL
from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.functions import linear
from myomorph.core.model.messages import Message
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Marker, Mesh, Model
from myomorph.core.model.spatial import Transform, least_rotation

PARAMETERS = ("m", "m c_x", "m c_y", "m c_z", "I_xx", "I_yy", "I_zz", "I_yz", "I_zx", "I_xy")
"""Order of a body's parameters, [D] eq. 3.4; the inertia is about the body's origin."""
# Positions of the last six in the inertia, a symmetric matrix
_ROWS = [0, 1, 2, 1, 2, 0]
_COLUMNS = [0, 1, 2, 2, 0, 1]
EARTH = (0.0, -9.80665, 0.0)  # Gravity [m/s^2]
SLIDES = ("tx", "ty", "tz")
TURNS = ("rx", "ry", "rz")
MAX_RADIUS = 1.0  # Of gyration, of a part of a body [m]
MIN_MOMENT = 0.1  # Of inertia that changes torques of limbs [kg m^2]


def inertial_parameters(model: Model) -> Array:
    """Inertial parameters of every body, in the order of `PARAMETERS`.

    The inertia about the origin is I_c + m (c^T c 1 - c c^T) (Steiner).

    Source: [D] eq. 3.4.

    Parameters
    ----------
    model : with bodies

    Returns
    -------
    (bodies, 10) mass [kg], first moments [kg m] and inertia about the body's origin [kg m^2]
    """
    table = np.empty((len(model.bodies), 10))
    for row, body in zip(table, model.bodies, strict=True):
        c = body.mass_center
        inertia = body.inertia + body.mass * (c @ c * np.eye(3) - np.outer(c, c))
        row[0] = body.mass
        row[1:4] = body.mass * c
        row[4:] = inertia[_ROWS, _COLUMNS]
    return table


def inertia_matrices(parameters: ArrayLike) -> Array:
    """Inertia matrices of inertial parameters.

    Parameters
    ----------
    parameters : (..., 10) as of `inertial_parameters`

    Returns
    -------
    (..., 3, 3) about the bodies' origins [kg m^2]
    """
    values = np.asarray(parameters, dtype=np.float64)
    matrices = np.zeros((*values.shape[:-1], 3, 3))
    matrices[..., _ROWS, _COLUMNS] = matrices[..., _COLUMNS, _ROWS] = values[..., 4:]
    return matrices


def pseudo_inertias(parameters: ArrayLike) -> Array:
    """Pseudo-inertias of inertial parameters.

        J = [[S, h], [h^T, m]],   S = tr(I) / 2 - I

    with the second moments of mass S, the first moments h and the mass m. A body of some
    distribution of positive mass has a positive definite one.

    Source: Wensing, Kim, Slotine 2018, IEEE Robotics and Automation Letters 3(1):60.

    Parameters
    ----------
    parameters : (..., 10) as of `inertial_parameters`

    Returns
    -------
    (..., 4, 4)
    """
    values = np.asarray(parameters, dtype=np.float64)
    inertia = inertia_matrices(values)
    half_trace = 0.5 * np.trace(inertia, axis1=-2, axis2=-1)
    result = np.empty((*values.shape[:-1], 4, 4))
    result[..., :3, :3] = half_trace[..., None, None] * np.eye(3) - inertia
    result[..., :3, 3] = result[..., 3, :3] = values[..., 1:4]
    result[..., 3, 3] = values[..., 0]
    return result


def made_up_inertias(bodies: Sequence[Body]) -> tuple[Message, ...]:
    """Warn of bodies whose inertia is that of mass farther away than a body is wide.

    Inertia that is too small to change torques does not count.
    """
    moments = {body: float(np.diag(body.inertia).max()) for body in bodies if body.mass > 0.0}
    wide = [
        body
        for body, moment in moments.items()
        if moment >= max(MAX_RADIUS**2 * body.mass, MIN_MOMENT)
    ]
    if not wide:
        return ()
    worst = max(wide, key=lambda body: moments[body] / body.mass)
    names = quoted([body.name for body in wide], 4)
    away = np.sqrt(moments[worst] / worst.mass)
    return (
        (
            MODEL.message(
                f"inertia of {names}: up to {moments[worst]:.3g} kg m^2 at {worst.mass:.3g} kg"
                f" ('{worst.name}'), as of mass {away:.3g} m away: torques there depend on it;"
                " correct it in the file",
                severity="may change results",
            )
        ),
    )


def with_inertial_parameters(model: Model, parameters: ArrayLike) -> Model:
    """Change the masses, mass centers and inertias of a model.

    Parameters
    ----------
    model : with bodies
    parameters : (bodies, 10) as of `inertial_parameters`

    Returns
    -------
    the changed model

    Raises
    ------
    BadData : parameters of another shape or not finite, or a mass below 0
    """
    values = np.asarray(parameters, dtype=np.float64)
    if values.shape != (len(model.bodies), 10) or not np.isfinite(values).all():
        raise BadData(
            f"expected finite parameters ({len(model.bodies)}, 10), but got shape {values.shape}"
        )
    if (values[:, 0] < 0.0).any():
        worst = int(np.argmin(values[:, 0]))
        raise BadData(f"body '{model.body_names[worst]}' would weigh {values[worst, 0]:.4g} kg")
    bodies = []
    for body, row, about_origin in zip(model.bodies, values, inertia_matrices(values), strict=True):
        mass = float(row[0])
        center = row[1:4] / mass if mass > 0.0 else np.zeros(3)
        inertia = about_origin - mass * (center @ center * np.eye(3) - np.outer(center, center))
        bodies.append(replace(body, mass=mass, mass_center=center, inertia=inertia))
    return replace(model, bodies=tuple(bodies))


def free_object(  # page: what a user may state of a body, most of it optional
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
    """Make a model of one rigid body that moves freely.

    Its coordinates are `tx`, `ty`, `tz` of its origin, then `rx`, `ry`, `rz`.

    Parameters
    ----------
    name : of the body
    mass : [kg]
    size : (3,) of a solid box about the mass center, from which the inertia follows where there is
        no other [m]
    inertia : (3, 3), or (3,) its diagonal, about the mass center in the body's axes [kg m^2]
    mass_center : (3,) in the body's frame [m]
    markers : positions (3,) in the body's frame by name [m]
    mesh : file that draws it instead of a box of `size`
    gravity : (3,) in ground [m/s^2]

    Raises
    ------
    BadData : a mass, size or inertia that no body has
    """
    body = _body(name, mass, size, inertia, mass_center, mesh)
    axes = [
        Axis(
            kind="translation", vector=np.eye(3)[i], function=linear(1.0), coordinates=(coordinate,)
        )
        for i, coordinate in enumerate(SLIDES)
    ]
    axes += [
        Axis(kind="rotation", vector=np.eye(3)[i], function=linear(1.0), coordinates=(coordinate,))
        for i, coordinate in enumerate(TURNS)
    ]
    names = (*SLIDES, *TURNS)
    still = Transform.identity()
    joint = Joint(
        name=f"ground_{name}",
        kind="CustomJoint",
        parent=GROUND,
        child=name,
        parent_frame=still,
        child_frame=still,
        axes=tuple(axes),
        coordinates=names,
    )
    coordinates = tuple(
        Coordinate(name, "translational" if name in SLIDES else "rotational") for name in names
    )
    return Model(
        name=name,
        bodies=(body,),
        joints=(joint,),
        coordinates=coordinates,
        gravity=np.asarray(gravity),
        markers=_markers(name, markers),
    )


def hinged_object(  # page: as `free_object`, and the axle
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
    """Make a model of one rigid body that turns about an axle of the ground.

    Its coordinate is `angle`. Its axes are the ground's, turned as little as brings z onto `axis`.

    Parameters
    ----------
    name, mass : of the body [kg]
    axis : (3,) of the axle in ground, which is also the body's z axis
    inertia, mass_center, markers, mesh, gravity : as for `free_object`
    center : (3,) of the axle in ground, where the body has its origin [m]

    Raises
    ------
    BadData : an axis without length, or a mass or inertia that no body has
    """
    along = np.asarray(axis, dtype=np.float64)
    length = float(np.linalg.norm(along))
    if along.shape != (3,) or not (np.isfinite(length) and length > 0.0):
        raise BadData(f"axle {along.tolist()} of '{name}': expected a vector with a length")
    body = _body(name, mass, None, inertia, mass_center, mesh)
    frame = Transform(
        least_rotation(np.array([0.0, 0.0, 1.0]), along / length),
        np.asarray(center, dtype=np.float64),
    )
    turn = Axis(
        kind="rotation",
        vector=np.array([0.0, 0.0, 1.0]),
        function=linear(1.0),
        coordinates=("angle",),
    )
    joint = Joint(
        name=f"ground_{name}",
        kind="PinJoint",
        parent=GROUND,
        child=name,
        parent_frame=frame,
        child_frame=Transform.identity(),
        axes=(turn,),
        coordinates=("angle",),
    )
    return Model(
        name=name,
        bodies=(body,),
        joints=(joint,),
        coordinates=(Coordinate("angle"),),
        gravity=np.asarray(gravity),
        markers=_markers(name, markers),
    )


def _body(
    name: str,
    mass: float,
    size: ArrayLike | None,
    inertia: ArrayLike | None,
    mass_center: ArrayLike,
    mesh: str,
) -> Body:
    """Make a body; parameters as of `free_object`."""
    if not (np.isfinite(mass) and mass > 0.0):
        raise BadData(f"mass of '{name}' is {mass:g} kg: expected above 0")
    if size is None and inertia is None:
        raise BadData(f"object '{name}' has neither a size nor an inertia")
    box = np.ones(3) if size is None else np.asarray(size, dtype=np.float64)
    if box.shape != (3,) or not (np.isfinite(box).all() and (box > 0.0).all()):
        raise BadData(f"size {box.tolist()} of '{name}': expected three lengths above 0")
    if inertia is None:
        # Of a solid box: I_xx = m (y^2 + z^2) / 12, ...
        inertia = (mass / 12.0) * (box @ box - box**2)
    meshes = []
    if mesh:
        meshes.append(Mesh(mesh, Transform.identity(), np.ones(3)))
    elif size is not None:
        pose = Transform(np.eye(3), np.asarray(mass_center, dtype=np.float64))
        meshes.append(Mesh(file="", pose=pose, scale=0.5 * box, shape="box"))
    return Body(
        name=name,
        mass=mass,
        mass_center=np.asarray(mass_center),
        inertia=_checked_inertia(name, inertia),
        meshes=tuple(meshes),
    )


def _checked_inertia(name: str, inertia: ArrayLike) -> Array:
    """Check that an inertia is one of a body.

    Its principal moments are above 0, and none is larger than the sum of the others.

    Parameters
    ----------
    name : of the body, for the message
    inertia : (3, 3), or (3,) its diagonal [kg m^2]

    Returns
    -------
    (3, 3) [kg m^2]

    Raises
    ------
    BadData : no body has such an inertia
    """
    values = np.asarray(inertia, dtype=np.float64)
    matrix = np.diag(values) if values.shape == (3,) else values
    is_matrix = matrix.shape == (3, 3) and np.isfinite(matrix).all()
    if not is_matrix or not np.allclose(matrix, matrix.T):
        raise BadData(
            f"inertia of '{name}': expected a symmetric (3, 3) or its diagonal (3,), got"
            f" {matrix.tolist()}"
        )
    low, middle, high = np.linalg.eigvalsh(matrix)
    if low <= 0.0 or high > (low + middle) * (1.0 + 1e-9):
        raise BadData(
            f"inertia of '{name}' with moments {low:.3g}, {middle:.3g}, {high:.3g} kg m^2 is not"
            " that of a body"
        )
    return matrix


def _markers(body: str, places: Mapping[str, ArrayLike] | None) -> tuple[Marker, ...]:
    """Markers at positions (3,) of a body by name [m]."""
    return tuple(Marker(name, body, np.asarray(place)) for name, place in (places or {}).items())


def parameters_of(pseudo: Array) -> Array:
    """Inertial parameters of pseudo-inertias, the inverse of `pseudo_inertias`.

    Parameters
    ----------
    pseudo : (..., 4, 4)

    Returns
    -------
    (..., 10) as of `inertial_parameters`
    """
    second = pseudo[..., :3, :3]
    inertia = np.trace(second, axis1=-2, axis2=-1)[..., None, None] * np.eye(3) - second
    result = np.empty((*pseudo.shape[:-2], 10))
    result[..., 0] = pseudo[..., 3, 3]
    result[..., 1:4] = pseudo[..., :3, 3]
    result[..., 4:] = inertia[..., _ROWS, _COLUMNS]
    return result
