"""The identified damping of a joint in a model's own forms: a bushing, dampers of coordinates,
viscosity of muscles.

A swing tells the passive torque along axes of the limb's first body, tau = -D omega, with omega the
angular velocity of the limb against its base ([S] eq. 1). A BushingForce damps the rates of three
body-fixed angles x, y, z of one frame in another: along the axes of the first frame the torque
-E^-T C E^-1 omega, with omega = E(x, y) (xdot, ydot, zdot). For equal damping in all directions
this is -d omega but for what sin y couples, so frames are sought in which y stays small over a
motion.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
from numpy.typing import ArrayLike
from scipy.optimize import least_squares
from scipy.spatial.transform import Rotation

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.model import Model
from myomorph.core.model.passive_dynamics import line_viscosity, with_passive_dynamics
from myomorph.core.model.paths import Bushing
from myomorph.core.model.series import Motion
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.filters import differentiate
from myomorph.core.rigid.bushings import angular_velocities, bushing_forces, deflection
from myomorph.core.rigid.coordinates import gather_dependents
from myomorph.core.rigid.dynamics import values_and_rates
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.swings.viscosity.identification.identify import SpecimenViscosity
from myomorph.swings.viscosity.specimen.muscles import fig1_muscles
from myomorph.swings.viscosity.tracking.tracked import TrackedSpecimen

STARTS = 6  # Frames the search begins from; several, because it ends in the nearest minimum.
POSES = 150  # Frames of the motion that the search looks at.
RATE = 25.0  # Frames a second that the bushing is fitted to [Hz].
EXCURSION = 0.6  # How far a joint is turned about its default pose where no motion is known [rad].
LOSSY = 0.05  # Share of the joint's torque that a bushing may miss without being named.


def along_axes(what: str, values: ArrayLike) -> Array:
    """Three values along a body's axes of one or three; `BadData` where they cannot be damping or
    stiffness.
    """
    numbers = np.asarray(values, dtype=np.float64)
    if (
        numbers.shape not in ((), (1,), (3,))
        or not (numbers >= 0.0).all()
        or not np.isfinite(numbers).all()
    ):
        raise BadData(
            f"{what} of a joint is {numbers.tolist()}: expected one number or three, 0 or more"
        )
    return np.array(np.broadcast_to(numbers, (3,)))


def joint_jacobian(
    tree: Tree, base: str, first: str, coordinates: Array
) -> tuple[Array, Array, np.ndarray]:
    """E (frames, 3, moving), rotations (frames, 3, 3) of `first` in `base`, and the coordinates
    that turn it there.
    """
    model = tree.model
    for body in (base, first):
        model.body(body)
    poses = forward_kinematics(tree, coordinates)
    a = tree.body_index[base]
    b = tree.body_index[first]
    nowhere = np.zeros((len(coordinates), 3))
    moved = poses.jacobian(b, nowhere) - poses.jacobian(a, nowhere)
    turned = np.swapaxes(poses.rotations[:, b], 1, 2) @ moved[:, :3]
    for frame, c in enumerate(np.array(coordinates)):
        gather_dependents(tree.arrays, c, turned[frame])
    stays = set(model.dependent_coordinates)
    moves = np.abs(turned).max(axis=(0, 1), initial=0.0) > 1e-9
    able = [j for j, name in enumerate(model.coordinate_names) if name not in stays and moves[j]]
    if not able:
        raise BadModel(f"model '{model.name}': no coordinate turns '{first}' against '{base}'")
    R = np.swapaxes(poses.rotations[:, a], 1, 2) @ poses.rotations[:, b]
    return turned[:, :, able], R, np.array(able, np.int64)


def share(lost: Array, whole: Array) -> float:
    """Root mean square of what is lost, relative to that of the whole."""
    total = float(np.sqrt((whole**2).sum()))
    return float(np.sqrt((lost**2).sum())) / total if total > 0.0 else 0.0


@dataclass(frozen=True, eq=False)
class JointBushing:
    """A ball joint's damping as a bushing for `model.passive_dynamics.with_passive_dynamics`.
    `residual`: root mean square of the generalized torque that it does not express, as a share of
    the whole, comparable with that of `CoordinateDamping`; `middle`: greatest middle angle over the
    motion [rad], at a quarter turn a bushing is singular.
    """

    bushing: Bushing
    residual: float
    middle: float


def joint_bushing(
    model: Model, base: str, first: str, viscosity: ArrayLike, motion: Motion, name: str = ""
) -> JointBushing:
    """The rotational bushing between two bodies nearest to the damping of the joint between them,
    over a motion such as the model will be used for. The viscosity is one value, or three along the
    axes of `first` [N m s/rad].
    """
    D = along_axes("viscosity", viscosity)
    tree = compile_tree(model)
    coordinates, rates = values_and_rates(tree, motion)
    E, R, moving = joint_jacobian(tree, base, first, coordinates)
    omega = np.einsum("fak,fk->fa", E, rates[:, moving])
    some = np.unique(np.linspace(0, len(R) - 1, POSES).astype(int))
    lost = _lost(R[some], omega[some], D)
    begun = np.log(np.maximum(D, 1e-3 * max(D.max(), 1e-12)))
    fits = [
        least_squares(
            lost,
            np.concatenate([*Rotation.random(2, random_state=index).as_rotvec(), begun]),
            max_nfev=60,
        )
        for index in range(STARTS)
    ]
    best = min(fits, key=lambda fit: float(fit.cost)).x
    turns = Rotation.from_rotvec(best[:6].reshape(2, 3)).as_matrix()
    turn_1, turn_2 = turns
    pose_1 = Transform(turn_1, np.zeros(3))
    pose_2 = Transform(turn_2, np.zeros(3))
    damping = np.exp(best[6:]) * (D.max() > 0.0)
    bushing = Bushing(
        name=name or f"passive_{base}_{first}",
        body_1=base,
        body_2=first,
        pose_1=pose_1,
        pose_2=pose_2,
        rotational_damping=damping,
    )
    torque = np.zeros_like(coordinates)
    torque[:, moving] = -np.einsum("fak,fa->fk", E, D * omega)
    produced = bushing_forces(tree, [bushing], coordinates, rates)
    q, _ = deflection(tree, forward_kinematics(tree, coordinates), bushing)
    return JointBushing(
        bushing,
        share((produced - torque)[:, moving], torque[:, moving]),
        float(np.abs(q[:, 1]).max()),
    )


def _lost(R: Array, omega: Array, D: Array) -> Callable[[Array], Array]:
    """What a bushing's torque lacks, of frames' rotation vectors and logarithms of its damping
    (9,); R (frames, 3, 3) of the limb in its base, omega (frames, 3) along the limb's axes [rad/s].
    """
    turned = np.einsum("fab,fb->fa", R, omega)
    torque = np.einsum("fab,fb->fa", R, D * omega)
    scale = float(np.sqrt((torque**2).sum())) or 1.0

    def lost(x: Array) -> Array:
        first, second = Rotation.from_rotvec(x[:6].reshape(2, 3)).as_matrix()
        Q = first.T @ R @ second
        E = angular_velocities(
            np.arctan2(-Q[:, 1, 2], Q[:, 2, 2]), np.arcsin(np.clip(Q[:, 0, 2], -0.999, 0.999))
        )
        rates = np.linalg.solve(E, (turned @ first)[:, :, None])[:, :, 0]
        damped = np.linalg.solve(np.swapaxes(E, 1, 2), (np.exp(x[6:]) * rates)[:, :, None])[:, :, 0]
        return ((damped - torque @ first) / scale).ravel()

    return lost


def identified_model(
    tracked: TrackedSpecimen, specimen_viscosity: SpecimenViscosity, cutoff: float
) -> tuple[Model, tuple[str, ...]] | None:
    """The specimen as it stood, its joint damped as found and every muscle with the common
    viscosity, and what that does not express; None where the joint's viscosity is not known. A
    hinge gets a damper of its coordinate, a ball the bushing nearest to its damping over the first
    trial. Masses stay those of the model.
    """
    if specimen_viscosity.without is None:
        return None
    specimen = tracked.specimen
    condition = specimen_viscosity.without
    values = specimen_viscosity.muscles
    muscles = {} if values is None else dict.fromkeys(values.muscles, values.common.value)
    viscosity = line_viscosity(muscles, specimen.muscles)
    if len(specimen.joint_coordinates) == 1:
        damping = {specimen.joint_coordinates[0]: condition.viscosity.value}
        return with_passive_dynamics(specimen.model, damping, viscosity=viscosity), ()
    by_axis = [
        axis_viscosity.value if excited else condition.viscosity.value
        for axis_viscosity, excited in zip(condition.axis_viscosity, condition.excited, strict=True)
    ]
    joint = joint_bushing(
        specimen.model, specimen.base, specimen.first, by_axis, _motion(tracked, cutoff)
    )
    note = (
        f"identified.osim: its bushing misses {100 * joint.residual:.0f} % of the torque of the"
        " joint's damping"
    )
    model = with_passive_dynamics(specimen.model, viscosity=viscosity, bushings=(joint.bushing,))
    return model, (note,) if joint.residual > LOSSY else ()


@dataclass(frozen=True, eq=False)
class Dampers:
    """A joint's damping in the parts of a model: a bushing, or dampers of coordinates [N m s/rad],
    beside viscosity of muscles' lines [N s/m]. `residual`: share of the joint's torque that they do
    not express.
    """

    bushing: Bushing | None
    coordinates: Mapping[str, float]
    muscles: Mapping[str, float]
    residual: float


def dampers_of(
    model: Model,
    base: str,
    first: str,
    viscosity: float,
    muscles: Mapping[str, float],
    by_coordinate: bool = False,
) -> Dampers:
    """What damps the joint between two bodies of any model by the same viscosity about all axes [N
    m s/rad], and its muscles, by their names or those of [S] figure 1 [N s/m]. A hinge gets a
    damper of its coordinate, several coordinates a bushing or, `by_coordinate`, the dampers nearest
    over poses about the default one.
    """
    tree = compile_tree(model)
    motion = _excursions(model, tree, base, first)
    coordinates, rates = values_and_rates(tree, motion)
    E, _, moving = joint_jacobian(tree, base, first, coordinates)
    known = set(model.muscle_names)
    lines = (
        {name: (name,) for name in muscles} if known.issuperset(muscles) else fig1_muscles(model)
    )
    by_line = line_viscosity(muscles, lines)
    if len(moving) > 1 and not by_coordinate:
        joint = joint_bushing(model, base, first, viscosity, motion)
        return Dampers(
            bushing=joint.bushing, coordinates={}, muscles=by_line, residual=joint.residual
        )
    speeds = rates[:, moving]
    torque = viscosity * np.einsum("fak,faj,fj->fk", E, E, speeds)
    damping = np.maximum((torque * speeds).sum(axis=0) / np.square(speeds).sum(axis=0), 0.0)
    names = (model.coordinate_names[j] for j in moving)
    by_name = dict(zip(names, damping.tolist(), strict=True))
    return Dampers(
        bushing=None,
        coordinates=by_name,
        muscles=by_line,
        residual=share(torque - damping * speeds, torque),
    )


def _excursions(model: Model, tree: Tree, base: str, first: str) -> Motion:
    """Poses within `EXCURSION` of the default one, at random rates, of the coordinates that turn a
    joint.
    """
    _, _, moving = joint_jacobian(
        tree, base, first, tree.coordinates_of(Motion(np.zeros(1), (), np.zeros((1, 0))))
    )
    random = np.random.default_rng(0)
    names = tuple(model.coordinate_names[j] for j in moving)
    default = np.array([model.coordinate(name).default for name in names])
    limits = np.array([model.coordinate(name).range for name in names])
    values = default + random.uniform(-EXCURSION, EXCURSION, (POSES, len(names)))
    bounded = np.isfinite(limits).all(axis=1) & (limits[:, 0] < limits[:, 1])
    values[:, bounded] = np.clip(values[:, bounded], *limits[bounded].T)
    return Motion(
        time=np.arange(POSES) / RATE,
        names=names,
        values=values,
        velocities=random.standard_normal(values.shape),
    )


def _motion(tracked: TrackedSpecimen, cutoff: float) -> Motion:
    motion = differentiate(tracked.trials[0].motion, cutoff)
    rates = motion.velocities
    assert rates is not None
    keep = np.flatnonzero(np.isfinite(motion.values).all(axis=1) & np.isfinite(rates).all(axis=1))
    keep = keep[:: max(1, round(motion.rate / RATE))]
    return Motion(
        time=motion.time[keep],
        names=motion.names,
        values=motion.values[keep],
        velocities=rates[keep],
    )
