"""The identified damping of a joint in a model's own forms.

These are a bushing, dampers of coordinates and viscosity of muscles. Swings show the passive torque
along axes of the limb's first body, tau = -D omega, with omega the angular velocity of the limb
against its base ([S] eq. 1). A BushingForce damps the rates of three body-fixed angles x, y, z of
one frame in another: along the axes of the first frame the torque -E^-T C E^-1 omega, with
omega = E(x, y) (xdot, ydot, zdot). For equal damping in all directions this is -d omega but for
what sin y couples, so frames are sought in which y stays small over a motion. Where a joint turns
widely no frames keep it small: one bushing misses 13 % of a shoulder's torque over 0.6 rad either
way. What is left turns its sign with the frames, so two or three bushings that share the damping
make up for each other.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, field
from typing import NamedTuple

import numpy as np
from numpy.typing import ArrayLike, NDArray
from scipy.spatial.transform import Rotation

from myomorph.core.fit.problem import Problem
from myomorph.core.fit.residuals import Measured
from myomorph.core.fit.solver import Method, minimize
from myomorph.core.fit.unknowns import Block, Unknown, Unknowns, Values, turned
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData, BadModel
from myomorph.core.model.frozen_map import FrozenMap
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

STARTS = 8  # Frames the search begins from; several, because it ends in the nearest minimum.
MORE_STARTS = 3  # Frames from which the search for one bushing more begins.
MAX_BUSHINGS = 3
POSES = 150  # Frames of the motion that the search looks at.
RATE = 25.0  # Frames a second that the bushing is fitted to [Hz].
EXCURSION = 0.6  # How far a joint is turned about its default pose where no motion is known [rad].
LOSSY = 0.05  # Share of the joint's torque that a bushing may miss without being named.
MIN_TURN = 1e-9  # Of a joint by a unit of a coordinate that turns it [rad/rad]
MAX_SINE = 0.999  # Of the middle angle, short of where a bushing is singular
MIN_DAMPING = 1e-3  # At which the search begins, over the largest of the three
LOG_RANGE = 15.0  # Of the logarithm of damping about that
FRAMES = "frames"
DAMPING = "damping"
"""Blocks of unknowns of a bushing."""
METHOD = Method(iterations=40, tolerance=1e-8, min_gain=1e-8)


class JointMotion(NamedTuple):
    """A joint between two bodies in some poses.

    Attributes
    ----------
    rates : (frames, 3, moving) E, the angular velocity along the limb's axes by rates of the
        coordinates that turn the joint
    rotations : (frames, 3, 3) of the limb in its base
    moving : (moving,) places of these coordinates
    """

    rates: Array
    rotations: Array
    moving: NDArray[np.int64]


@dataclass(frozen=True, eq=False)
class JointBushing:
    """A ball joint's damping as bushings for `model.passive_dynamics.with_passive_dynamics`.

    Attributes
    ----------
    bushings : with the frames that were found; more than one where one misses more than `LOSSY`
    residual : root mean square of the generalized torque that it does not express, as a share of
        the whole, comparable with that of `CoordinateDamping`
    middle : greatest middle angle of any over the motion [rad]; at a quarter turn a bushing is
        singular
    """

    bushings: tuple[Bushing, ...]
    residual: float
    middle: float


@dataclass(frozen=True, kw_only=True)
class ViscosityValues:
    """What a joint and its muscles resist with.

    Attributes
    ----------
    joint : viscosity about all axes [N m s/rad]
    muscles : by the model's names or those of [S] figure 1 [N s/m]
    """

    joint: float
    muscles: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))


@dataclass(frozen=True, eq=False)
class Dampers:
    """A joint's damping in the parts of a model, and that of its muscles.

    Attributes
    ----------
    bushings : of the joint; none where coordinates are damped
    coordinates : damping of coordinates [N m s/rad]
    muscles : viscosity of muscles' lines [N s/m]
    residual : share of the joint's torque that they do not express
    """

    bushings: tuple[Bushing, ...]
    coordinates: Mapping[str, float]
    muscles: Mapping[str, float]
    residual: float


def along_axes(what: str, values: ArrayLike) -> Array:
    """Spread one number, or three, over a body's axes.

    Parameters
    ----------
    what : of a joint, for the message
    values : () or (1,) or (3,) damping or stiffness

    Returns
    -------
    (3,)

    Raises
    ------
    BadData : they cannot be damping or stiffness
    """
    numbers = np.asarray(values, dtype=np.float64)
    possible = (numbers >= 0.0).all() and np.isfinite(numbers).all()
    if numbers.shape not in ((), (1,), (3,)) or not possible:
        raise BadData(
            f"{what} of a joint is {numbers.tolist()}: expected one number or three, 0 or more"
        )
    return np.array(np.broadcast_to(numbers, (3,)))


def joint_jacobian(tree: Tree, base: str, first: str, coordinates: Array) -> JointMotion:
    """Find how coordinates turn one body against another.

    Parameters
    ----------
    tree : of the model
    base, first : the bodies
    coordinates : (frames, coordinates)

    Returns
    -------
    the joint in these poses

    Raises
    ------
    BadModel : no coordinate turns the one against the other
    """
    model = tree.model
    for body in (base, first):
        model.body(body)
    poses = forward_kinematics(tree, coordinates)
    a = tree.body_index[base]
    b = tree.body_index[first]
    nowhere = np.zeros((len(coordinates), 3))
    moved = poses.jacobian(b, nowhere) - poses.jacobian(a, nowhere)
    turning = np.swapaxes(poses.rotations[:, b], 1, 2) @ moved[:, :3]
    for frame, c in enumerate(np.array(coordinates)):
        gather_dependents(tree.arrays, c, turning[frame])
    dependent = set(model.dependent_coordinates)
    moves = np.abs(turning).max(axis=(0, 1), initial=0.0) > MIN_TURN
    able = [
        place
        for place, name in enumerate(model.coordinate_names)
        if name not in dependent and moves[place]
    ]
    if not able:
        raise BadModel(f"model '{model.name}': no coordinate turns '{first}' against '{base}'")
    rotations = np.swapaxes(poses.rotations[:, a], 1, 2) @ poses.rotations[:, b]
    return JointMotion(
        rates=turning[:, :, able], rotations=rotations, moving=np.array(able, np.int64)
    )


def share(lost: Array, whole: Array) -> float:
    """Compare what is lost with the whole, by root mean squares.

    Parameters
    ----------
    lost, whole : of any shape

    Returns
    -------
    0 where there is nothing to lose
    """
    total = float(np.sqrt((whole**2).sum()))
    return float(np.sqrt((lost**2).sum())) / total if total > 0.0 else 0.0


def joint_bushing(
    model: Model, base: str, first: str, viscosity: ArrayLike, motion: Motion
) -> JointBushing:
    """Find the rotational bushings nearest to the damping of the joint between two bodies.

    Parameters
    ----------
    model : with the joint
    base, first : the bodies
    viscosity : one value, or three along the axes of `first` [N m s/rad]
    motion : such as the model will be used for

    Returns
    -------
    the bushings, as few as miss no more than `LOSSY`, and what they do not express
    """
    D = along_axes("viscosity", viscosity)
    tree = compile_tree(model)
    coordinates, rates = values_and_rates(tree, motion)
    joint = joint_jacobian(tree, base, first, coordinates)
    omega = np.einsum("fak,fk->fa", joint.rates, rates[:, joint.moving])
    some = np.unique(np.linspace(0, len(omega) - 1, POSES).astype(int))
    damped = DampedJoint(rotations=joint.rotations[some], omega=omega[some], viscosity=D)
    bushings = _nearest(damped, base, first)
    torque = np.zeros_like(coordinates)
    torque[:, joint.moving] = -np.einsum("fak,fa->fk", joint.rates, D * omega)
    produced = bushing_forces(tree, bushings, coordinates, rates)
    poses = forward_kinematics(tree, coordinates)
    middles = [deflection(tree, poses, bushing)[0][:, 1] for bushing in bushings]
    lost = (produced - torque)[:, joint.moving]
    return JointBushing(
        bushings=bushings,
        residual=share(lost, torque[:, joint.moving]),
        middle=float(np.abs(middles).max()),
    )


@read_only
class DampedJoint:
    """A joint's damping over a motion, as residuals of bushings.

    Attributes
    ----------
    rotations : (frames, 3, 3) R of the limb in its base
    omega : (frames, 3) along the limb's axes [rad/s]
    viscosity : (3,) D along the limb's axes [N m s/rad]
    """

    rotations: Array
    omega: Array
    viscosity: Array

    def lost(self, values: Values) -> Array:
        """Compare the torque of bushings with that of the joint, both in the base's axes.

        With frames F_1 in the base and F_2 in the limb, Q = F_1^T R F_2 has the angles x, y, z, and

            sum of F_1 E^-T C E^-1 F_1^T R omega - R D omega

        Parameters
        ----------
        values : rotation vectors of the frames of each bushing, logarithms of C

        Returns
        -------
        (3 frames,) over the root of the sum of squares of the joint's torque
        """
        turns = Rotation.from_rotvec(np.array(values[FRAMES]).reshape(-1, 3)).as_matrix()
        damping = np.exp(values[DAMPING]).reshape(-1, 3)
        in_base = np.einsum("fab,fb->fa", self.rotations, self.omega)
        torque = np.einsum("fab,fb->fa", self.rotations, self.viscosity * self.omega)
        scale = float(np.sqrt((torque**2).sum())) or 1.0
        made = [
            self._of_bushing(frames, C, in_base)
            for frames, C in zip(turns.reshape(-1, 2, 3, 3), damping, strict=True)
        ]
        return np.asarray((np.sum(made, axis=0) - torque) / scale).ravel()

    def _of_bushing(self, frames: Array, damping: Array, in_base: Array) -> Array:
        """Find the torque of one bushing in the base's axes.

        Parameters
        ----------
        frames : (2, 3, 3) in the base and in the limb
        damping : (3,) of its angles [N m s/rad]
        in_base : (frames, 3) angular velocity in the base's axes [rad/s]

        Returns
        -------
        (frames, 3) [N m]
        """
        first = frames[0]
        Q = first.T @ self.rotations @ frames[1]
        x = np.arctan2(-Q[:, 1, 2], Q[:, 2, 2])
        y = np.arcsin(np.clip(Q[:, 0, 2], -MAX_SINE, MAX_SINE))
        E = angular_velocities(x, y)
        rates = np.linalg.solve(E, (in_base @ first)[:, :, None])[:, :, 0]
        resisted = (damping * rates)[:, :, None]
        damped = np.linalg.solve(np.swapaxes(E, 1, 2), resisted)[:, :, 0]
        return np.asarray(damped @ first.T)


def _nearest(joint: DampedJoint, base: str, first: str) -> tuple[Bushing, ...]:
    """Find bushings between two bodies nearest to the damping of the joint between them.

    One is sought from several frames. As long as bushings miss more than `LOSSY`, one more is
    sought beside them.
    """
    largest = joint.viscosity.max()
    begin = np.maximum(joint.viscosity, MIN_DAMPING * max(largest, 1e-12))
    frames = np.zeros((0, 3))
    damping = np.zeros((0, 3))
    for count in range(1, MAX_BUSHINGS + 1):
        solutions = []
        for start in range(STARTS if count == 1 else MORE_STARTS):
            more = Rotation.random(2, random_state=start).as_rotvec()
            shared = np.vstack([damping * (count - 1) / count, begin[None] / count])
            unknowns = Unknowns((_frames_block(np.vstack([frames, more])), _damping_block(shared)))
            torque = Measured(
                name="torque of the joint", blocks=(FRAMES, DAMPING), function=joint.lost
            )
            solutions.append(minimize(Problem(unknowns, (torque,)), method=METHOD))
        best = min(solutions, key=lambda solution: solution.search.cost)
        values = Values(best.problem.unknowns, best.x)
        frames = np.array(values[FRAMES]).reshape(-1, 3)
        damping = np.exp(values[DAMPING]).reshape(-1, 3)
        if float(np.linalg.norm(joint.lost(values))) < LOSSY:
            break
    turns = Rotation.from_rotvec(frames).as_matrix().reshape(-1, 2, 3, 3)
    name = f"passive_{base}_{first}"
    return tuple(
        Bushing(
            name=name if not number else f"{name}_{number + 1}",
            body_1=base,
            body_2=first,
            pose_1=Transform(in_base, np.zeros(3)),
            pose_2=Transform(in_limb, np.zeros(3)),
            rotational_damping=own * (largest > 0.0),
        )
        for number, ((in_base, in_limb), own) in enumerate(zip(turns, damping, strict=True))
    )


def _frames_block(vectors: Array) -> Block:
    """Rotation vectors (2 bushings, 3) of the frames of bushings in base and limb [rad]."""
    unknowns = tuple(
        Unknown(
            name=f"frame {number // 2 + 1} in {('base', 'limb')[number % 2]} {axis}",
            unit="rad",
            start=value,
        )
        for number, vector in enumerate(vectors.tolist())
        for axis, value in zip("xyz", vector, strict=True)
    )
    return Block(name=FRAMES, unknowns=unknowns, chart=turned)


def _damping_block(damping: Array) -> Block:
    """Logarithms of the damping (bushings, 3) of bushings [N m s/rad]."""
    unknowns = tuple(
        Unknown(
            name=f"log damping {number} {axis}",
            start=value,
            low=value - LOG_RANGE,
            high=value + LOG_RANGE,
        )
        for number, row in enumerate(np.log(damping).tolist(), 1)
        for axis, value in zip("xyz", row, strict=True)
    )
    return Block(name=DAMPING, unknowns=unknowns)


def identified_model(
    tracked: TrackedSpecimen, specimen_viscosity: SpecimenViscosity, cutoff: float
) -> tuple[Model, tuple[str, ...]] | None:
    """Put what was identified into the specimen's model, as it stood.

    A hinge gets a damper of its coordinate, a ball the bushing nearest to its damping over the
    first trial, every muscle the common viscosity. Masses stay those of the model.

    Parameters
    ----------
    tracked : the specimen and its motion
    specimen_viscosity : what was found
    cutoff : of the low-pass of the motion [Hz]

    Returns
    -------
    the model and what it does not express; None where the joint's viscosity is not known
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
    motion = _motion(tracked, cutoff)
    joint = joint_bushing(specimen.model, specimen.base, specimen.first, by_axis, motion)
    note = (
        f"identified.osim: its bushings miss {100 * joint.residual:.0f} % of the torque of the"
        " joint's damping"
    )
    model = with_passive_dynamics(specimen.model, viscosity=viscosity, bushings=joint.bushings)
    return model, (note,) if joint.residual > LOSSY else ()


def dampers_of(
    model: Model,
    base: str,
    first: str,
    viscosity: ViscosityValues,
    by_coordinate: bool = False,
) -> Dampers:
    """Find what damps the joint between two bodies of any model, and its muscles.

    A hinge gets a damper of its coordinate. Several coordinates get a bushing, or the dampers
    nearest over poses about the default one.

    Parameters
    ----------
    model : with the joint
    base, first : the bodies
    viscosity : the same about all axes, and that of the muscles
    by_coordinate : whether several coordinates are damped one by one
    """
    tree = compile_tree(model)
    motion = _excursions(model, tree, base, first)
    coordinates, rates = values_and_rates(tree, motion)
    joint = joint_jacobian(tree, base, first, coordinates)
    muscles = viscosity.muscles
    known = set(model.muscle_names)
    lines = (
        {name: (name,) for name in muscles} if known.issuperset(muscles) else fig1_muscles(model)
    )
    by_line = line_viscosity(muscles, lines)
    if len(joint.moving) > 1 and not by_coordinate:
        found = joint_bushing(model, base, first, viscosity.joint, motion)
        return Dampers(
            bushings=found.bushings, coordinates={}, muscles=by_line, residual=found.residual
        )
    speeds = rates[:, joint.moving]
    torque = viscosity.joint * np.einsum("fak,faj,fj->fk", joint.rates, joint.rates, speeds)
    damping = np.maximum((torque * speeds).sum(axis=0) / np.square(speeds).sum(axis=0), 0.0)
    names = [model.coordinate_names[place] for place in joint.moving]
    return Dampers(
        bushings=(),
        coordinates=dict(zip(names, damping.tolist(), strict=True)),
        muscles=by_line,
        residual=share(torque - damping * speeds, torque),
    )


def _excursions(model: Model, tree: Tree, base: str, first: str) -> Motion:
    """Draw poses about the default one, at random rates, of the coordinates that turn a joint.

    They are within `EXCURSION` of it, and within the coordinates' ranges.
    """
    default_pose = tree.coordinates_of(Motion(np.zeros(1), (), np.zeros((1, 0))))
    joint = joint_jacobian(tree, base, first, default_pose)
    random = np.random.default_rng(0)
    names = tuple(model.coordinate_names[place] for place in joint.moving)
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
    """Thin out the first trial's motion to `RATE`, frames that are known."""
    motion = differentiate(tracked.trials[0].motion, cutoff)
    rates = motion.velocities
    assert rates is not None
    known = np.isfinite(motion.values).all(axis=1) & np.isfinite(rates).all(axis=1)
    frames = np.flatnonzero(known)[:: max(1, round(motion.rate / RATE))]
    return Motion(
        time=motion.time[frames],
        names=motion.names,
        values=motion.values[frames],
        velocities=rates[frames],
    )
