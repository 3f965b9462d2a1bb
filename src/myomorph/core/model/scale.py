"""A model of another size: bodies stretched along their axes, as OpenSim's ScaleTool does."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from typing import Literal, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import Function, PiecewisePolynomial, SineProduct
from myomorph.core.model.model import (
    GROUND,
    Actuator,
    Axis,
    Body,
    Coordinate,
    Coupler,
    Joint,
    Loop,
    Mesh,
    Model,
)
from myomorph.core.model.paths import (
    Bushing,
    Ligament,
    MovingPathPoint,
    Muscle,
    Path,
    PathPoint,
    TendonWrap,
    WrapObject,
)
from myomorph.core.model.spatial import Transform

Tie = TypeVar("Tie", Loop, Bushing)

MIN_MASS = 2.220446049250313e-16  # OpenSim's, of a body that has an inertia [kg]
FIBER_LENGTHS = ("L0", "LT", "lengthrange0", "lengthrange1")


def scale(  # page: what OpenSim's tool has as settings
    model: Model,
    factors: Mapping[str, ArrayLike],
    mass: float | None = None,
    *,
    preserve_mass_distribution: bool = False,
    inertia: Literal["cylinder", "affine"] = "cylinder",
    path_lengths: Callable[[Model], ArrayLike] | None = None,
) -> Model:
    """Stretch the bodies of a model by factors along their axes.

    What is fixed to a body moves with it: mass center, joint frames, markers, frames, path points,
    wrap objects (radii by the mean stretch across, lengths along their axis) and meshes.
    Translations of joints that follow an angle, by a function or a coupler, grow with the parent's
    factors weighted by the axis; a translation that is a degree of freedom of its own does not.

    Parameters
    ----------
    model : to stretch
    factors : (3,) for each body, along its x, y and z; bodies without one keep their size
    mass : of the whole model afterwards; by default what the scaling gives [kg]
    preserve_mass_distribution : masses keep their ratios; otherwise they grow with the volume
    inertia : "cylinder" takes a body whose factors differ for a cylinder, as OpenSim does; "affine"
        stretches its second moments of mass exactly
    path_lengths : gives the lengths (muscles,) of a model's muscle paths in its default pose [m];
        with it optimal fiber and slack lengths keep their ratio to the path, without it they stay

    Raises
    ------
    BadData : factors or a mass that are not positive
    UnknownName : a body that the model does not have
    """
    sizes = _checked(model, factors, mass)
    travel = _dependent_travel(model, sizes)
    homes = {name: joint.child for joint in model.joints for name in joint.coordinates}
    bodies = tuple(
        _body(body, sizes[body.name], preserve_mass_distribution, inertia) for body in model.bodies
    )
    result = replace(
        model,
        bodies=_of_mass(bodies, mass),
        joints=tuple(_joint(joint, sizes, travel) for joint in model.joints),
        coordinates=scaled_coordinates(model.coordinates, travel),
        couplers=scaled_couplers(model.couplers, travel),
        markers=tuple(
            replace(marker, location=marker.location * sizes[marker.body])
            for marker in model.markers
        ),
        frames=tuple(
            replace(frame, pose=_shifted(frame.pose, sizes[frame.body])) for frame in model.frames
        ),
        wrap_objects=tuple(_wrap(item, sizes[item.body]) for item in model.wrap_objects),
        muscles=tuple(
            replace(muscle, path=_path(muscle.path, sizes, homes)) for muscle in model.muscles
        ),
        actuators=tuple(_actuator(actuator, sizes) for actuator in model.actuators),
        loops=tuple(_tied(loop, sizes) for loop in model.loops),
        bushings=tuple(_tied(bushing, sizes) for bushing in model.bushings),
        ligaments=tuple(
            replace(ligament, path=_path(ligament.path, sizes, homes))
            for ligament in model.ligaments
        ),
    )
    if path_lengths is None:
        return result
    ratios = _ratios(model, result, path_lengths)
    muscles = tuple(map(_muscle, result.muscles, ratios))
    return replace(result, muscles=muscles, ligaments=taut_ligaments(model, result, path_lengths))


def taut_ligaments(
    before: Model, after: Model, path_lengths: Callable[[Model], ArrayLike]
) -> tuple[Ligament, ...]:
    """Let slack lengths of ligaments keep their ratio to the path.

    Parameters
    ----------
    before, after : the model, and what it has become
    path_lengths : lengths (muscles,) of a model's muscle paths in its default pose [m]

    Returns
    -------
    ligaments of the model after
    """
    if not after.ligaments:
        return ()
    strings = [
        replace(model, muscles=tuple(each.as_muscle() for each in model.ligaments))
        for model in (before, after)
    ]
    ratios = _ratios(strings[0], strings[1], path_lengths)
    return tuple(
        replace(ligament, slack_length=ligament.slack_length * ratio)
        for ligament, ratio in zip(after.ligaments, ratios, strict=True)
    )


def _ratios(before: Model, after: Model, path_lengths: Callable[[Model], ArrayLike]) -> list[float]:
    """Path lengths (muscles,) after over those before, 1 where there was none."""
    old = np.asarray(path_lengths(before))
    new = np.asarray(path_lengths(after))
    return np.divide(new, old, out=np.ones_like(old), where=old > 0.0).tolist()


def _checked(
    model: Model, factors: Mapping[str, ArrayLike], mass: float | None
) -> dict[str, Array]:
    """Check scale factors; returns (3,) for every body, and for the ground."""
    sizes = {name: np.ones(3) for name in (GROUND, *model.body_names)}
    for name, axis_factors in factors.items():
        check_name("body", name, model.body_names)
        factor = np.asarray(axis_factors, dtype=np.float64)
        if factor.shape != (3,) or not np.all(np.isfinite(factor)) or np.any(factor <= 0.0):
            raise BadData(
                f"expected three positive scale factors for body '{name}', but got {axis_factors!r}"
            )
        sizes[name] = factor
    if mass is not None and not (np.isfinite(mass) and mass > 0.0):
        raise BadData(f"expected a positive mass, but got {mass}")
    return sizes


def _dependent_travel(model: Model, sizes: Mapping[str, Array]) -> dict[str, float]:
    """Factors by which dependent coordinates grow, 1 for those that do not slide."""
    moved: dict[str, float] = {}
    for joint in model.joints:
        moved |= _travel(joint, sizes)
    return {name: moved.get(name, 1.0) for name in model.dependent_coordinates}


def _travel(joint: Joint, sizes: Mapping[str, Array]) -> dict[str, float]:
    """Factors by which dependent coordinates of a joint's sliding axes would grow, by name."""
    return {
        axis.coordinates[0]: float(np.linalg.norm(axis.vector * sizes[joint.parent]))
        for axis in joint.axes
        if axis.kind == "translation" and axis.coordinates and slides_freely(axis.function)
    }


def _body(body: Body, size: Array, keep_mass: bool, rule: str) -> Body:
    """Stretch a body by (3,) factors."""
    mass = body.mass if keep_mass else body.mass * float(np.prod(size))
    moments = _cylinder_inertia if rule == "cylinder" else _affine_inertia
    return replace(
        body,
        mass=mass,
        mass_center=body.mass_center * size,
        inertia=moments(body, size, mass),
        meshes=tuple(_mesh(mesh, size) for mesh in body.meshes),
    )


def _affine_inertia(body: Body, size: Array, mass: float) -> Array:
    """Stretch second moments of mass: P = tr(I) / 2 - I becomes S P S, S = diag(size)."""
    if body.mass == 0.0:
        return np.array(body.inertia)
    second = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
    second = second * np.outer(size, size) * (mass / body.mass)
    return np.trace(second) * np.eye(3) - second


def _cylinder_inertia(body: Body, size: Array, mass: float) -> Array:
    """Stretch a body as a cylinder along its axis of least inertia, as OpenSim does.

    With the mass m, radius r and length l: I_axis = m r^2 / 2, I_across = m (l^2 / 12 + r^2 / 4)
    (`Body::scaleInertialProperties`).
    """
    if mass <= MIN_MASS:
        return np.zeros((3, 3))
    grown = mass / body.mass
    if np.allclose(size, size[0], rtol=1e-14, atol=0.0):
        return np.array(body.inertia * grown * size[0] ** 2)
    inertia = body.inertia * np.outer(size, size) * grown
    axis = int(np.argmin(np.diag(body.inertia)))
    other = 1 if axis == 0 else 0
    across = [i for i in range(3) if i != axis]
    radius2 = max(0.0, 2.0 * body.inertia[axis, axis] / body.mass)
    length2 = max(0.0, 12.0 * (body.inertia[other, other] / body.mass - 0.25 * radius2))
    radius2 *= size[across[0]] * size[across[1]]
    length2 *= size[axis] ** 2
    inertia[axis, axis] = 0.5 * mass * radius2
    for i in across:
        inertia[i, i] = mass * (length2 / 12.0 + 0.25 * radius2)
    return np.array(inertia)


def _of_mass(bodies: tuple[Body, ...], mass: float | None) -> tuple[Body, ...]:
    """Scale masses and inertias so that bodies have a mass together [kg]."""
    total = sum(body.mass for body in bodies)
    if mass is None or total <= 0.0:
        return bodies
    share = mass / total
    return tuple(
        replace(body, mass=body.mass * share, inertia=body.inertia * share) for body in bodies
    )


def _shifted(pose: Transform, size: Array) -> Transform:
    """Move a frame with its stretched body."""
    return Transform(pose.rotation, pose.translation * size)


def _stretch(pose: Transform, size: Array) -> Array:
    """Factors (3,) of lengths along the axes of a frame that is turned in its body."""
    return np.linalg.norm(pose.rotation * size[:, None], axis=0)


def _mesh(mesh: Mesh, size: Array) -> Mesh:
    """Stretch a mesh with its body."""
    return replace(
        mesh,
        pose=_shifted(mesh.pose, size),
        scale=np.asarray(mesh.scale) * _stretch(mesh.pose, size),
    )


def _joint(joint: Joint, sizes: Mapping[str, Array], travel: Mapping[str, float]) -> Joint:
    """Move a joint with its stretched bodies; `travel`: factors of dependent coordinates."""
    parent = sizes[joint.parent]
    child = sizes[joint.child]
    return replace(
        joint,
        parent_frame=_shifted(joint.parent_frame, parent),
        child_frame=_shifted(joint.child_frame, child),
        axes=tuple(_axis(axis, parent, child, travel) for axis in joint.axes),
    )


def _axis(axis: Axis, parent: Array, child: Array, travel: Mapping[str, float]) -> Axis:
    """Move an axis with its stretched bodies, whose factors are (3,)."""
    moved = replace(axis, origin=axis.origin * child)
    if axis.kind == "rotation":
        return moved
    if not slides_freely(axis.function):
        # OpenSim's rule; right for axes of the frame, too large for oblique ones.
        return replace(moved, function=axis.function.scaled(float(np.abs(axis.vector) @ parent)))
    factor = travel.get(axis.coordinates[0], 1.0)
    return replace(moved, function=stretched(axis.function, factor, factor))


def stretched(function: Function, factor: float, source: float) -> Function:
    """Stretch a function: f(x) becomes factor f(x / source)."""
    if factor == source == 1.0:
        return function
    grown = function.scaled(factor)
    if isinstance(grown, SineProduct):
        return replace(grown, frequencies=grown.frequencies / source)
    powers = source ** -np.arange(grown.coefficients.shape[1], dtype=np.float64)
    return PiecewisePolynomial(grown.breaks * source, grown.coefficients * powers)


def slides_freely(function: Function) -> bool:
    """Whether an axis's motion is its coordinate, up to a constant: its own degree of freedom."""
    if isinstance(function, SineProduct) or len(function.breaks) != 1:
        return False
    return function.coefficients.shape[1] == 2 and function.coefficients[0, 1] == 1.0


def scaled_coordinates(
    coordinates: Sequence[Coordinate], travel: Mapping[str, float]
) -> tuple[Coordinate, ...]:
    """Let coordinates go further, by factors by name."""
    factors = [travel.get(coordinate.name, 1.0) for coordinate in coordinates]
    return tuple(
        replace(
            old, default=old.default * factor, range=(old.range[0] * factor, old.range[1] * factor)
        )
        for old, factor in zip(coordinates, factors, strict=True)
    )


def scaled_couplers(
    couplers: Sequence[Coupler], travel: Mapping[str, float]
) -> tuple[Coupler, ...]:
    """Adapt couplers to coordinates that go further, by factors by name."""
    factors = [
        (travel.get(each.dependent, 1.0), travel.get(each.independents[0], 1.0))
        for each in couplers
    ]
    return tuple(
        replace(coupler, function=stretched(coupler.function, *both))
        for coupler, both in zip(couplers, factors, strict=True)
    )


def _wrap(wrap: WrapObject, size: Array) -> WrapObject:
    """Stretch a surface: radii by the mean of the stretch across, lengths along the axis."""
    growth = _stretch(wrap.pose, size)
    across = 0.5 * (growth[0] + growth[1])
    factors = {
        "sphere": (float(np.mean(size)),),
        "cylinder": (across, growth[2]),
        "torus": (across, across),
        "ellipsoid": tuple(growth),
    }[wrap.kind]
    grown = tuple(float(a * b) for a, b in zip(wrap.size, factors, strict=True))
    return replace(wrap, pose=_shifted(wrap.pose, size), size=grown)


def _path(path: Path, sizes: Mapping[str, Array], homes: Mapping[str, str]) -> Path:
    """Move a path with its stretched bodies.

    A function that gives the length names no body: it grows with the mean of the factors of the
    bodies that its coordinates move, which is exact where all have one.

    Parameters
    ----------
    path : to move
    sizes : (3,) factors by body
    homes : by coordinate, the body that its joint leads to
    """
    if path.function is not None:
        moved = [sizes[homes[name]] for name in path.function.coordinates]
        return replace(path, function=path.function.scaled(float(np.mean(moved))))
    wraps = list(path.wraps)
    for i, wrap in enumerate(wraps):
        if isinstance(wrap, TendonWrap) and wrap.side is not None:
            wraps[i] = replace(wrap, side=wrap.side * sizes[wrap.side_body])
    points = tuple(_point(point, sizes[point.body]) for point in path.points)
    return replace(path, points=points, wraps=tuple(wraps))


def _point(point: PathPoint | MovingPathPoint, size: Array) -> PathPoint | MovingPathPoint:
    """Move a path point with its stretched body."""
    if isinstance(point, PathPoint):
        return replace(point, location=point.location * size)
    x, y, z = point.functions
    scaled = (x.scaled(float(size[0])), y.scaled(float(size[1])), z.scaled(float(size[2])))
    return replace(point, functions=scaled)


def _muscle(muscle: Muscle, ratio: float) -> Muscle:
    """Scale fiber and tendon lengths by the ratio of path lengths."""
    parameters = dict(muscle.parameters)
    for name in FIBER_LENGTHS:
        if name in parameters:
            parameters[name] *= ratio
    return replace(
        muscle,
        optimal_fiber_length=muscle.optimal_fiber_length * ratio,
        tendon_slack_length=muscle.tendon_slack_length * ratio,
        parameters=FrozenMap(parameters),
    )


def _actuator(actuator: Actuator, sizes: Mapping[str, Array]) -> Actuator:
    """Move the points of an actuator with its stretched bodies."""
    if actuator.point_is_global:
        return actuator
    return replace(
        actuator,
        point=actuator.point * sizes.get(actuator.body, np.ones(3)),
        other_point=actuator.other_point * sizes.get(actuator.other_body, np.ones(3)),
    )


def _tied(tie: Tie, sizes: Mapping[str, Array]) -> Tie:
    """Move the frames of a loop or bushing with its stretched bodies."""
    return replace(
        tie,
        pose_1=_shifted(tie.pose_1, sizes[tie.body_1]),
        pose_2=_shifted(tie.pose_2, sizes[tie.body_2]),
    )
