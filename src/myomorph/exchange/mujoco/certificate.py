"""Differences of MuJoCo's copy of a model from the model.

They are taken over the ranges of its coordinates and along recorded motion. The copy moves from
pose to pose, so that a dependent coordinate is where MuJoCo has it, and not where the model does.
Lengths by the rules of the version of MuJoCo that is not installed follow from kernels of our own,
which are tested against both.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass

import mujoco
import numpy as np

from myomorph.core.io.mjcf.muscles import VERSION
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import quoted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.rigid.dynamics import inverse_dynamics, motion_arrays
from myomorph.core.rigid.tree import compile_tree
from myomorph.exchange.mujoco.copy import MujocoCopy
from myomorph.exchange.mujoco.muscle_forces import force_differences
from myomorph.exchange.mujoco.tendon_paths import lengths_of_version

TOLERANCE = 1e-4  # By which lengths [m] and moment arms [m/rad] may differ.
SLOPE_STEP = 1e-4
FRAMES = 20
STEPS = 20
OTHER_VERSION = 7 - VERSION  # Of MuJoCo, of those with rules of their own, the one not installed


@read_only
class ComparedPoses:
    """Poses in which a model and its copy are compared.

    Attributes
    ----------
    model : (poses, coordinates) in the model's coordinates [rad or m]
    copy : (poses, coordinates) in those of the copy
    swept : (poses,) number of the coordinate that moves alone, -1 where all do
    route : (poses,) number of the pose from which each is reached, -1 for the default one
    """

    model: Array
    copy: Array
    swept: np.ndarray
    route: np.ndarray


@dataclass(frozen=True, eq=False)
class Difference:
    """Where one muscle of MuJoCo differs most from ours.

    Attributes
    ----------
    muscle : its name
    length, arm : largest differences, each coordinate moved alone [m], [m/rad or m/m]
    length_at, arm_at : coordinate and its value where that is [rad or m]
    arm_about : coordinate of that moment arm
    own : difference there of our moment arm from the slope of our length, which OpenSim's rules do
        not keep equal [m/rad or m/m]
    length_together, arm_together : largest differences, all coordinates moved together
    share : of those poses, the share in which length and moment arms are within the tolerance
    other : largest difference of lengths by the rules of the other version of MuJoCo, in all poses
    along : largest difference of lengths along the recorded motion, nan without one
    along_at : its time [s]
    force, moving_force : largest differences of MuJoCo's isometric force and of that in motion,
        over the muscle's strength (`force_differences`)
    """

    muscle: str
    length: float
    length_at: tuple[str, float]
    arm: float
    arm_at: tuple[str, float]
    arm_about: str
    own: float
    length_together: float
    arm_together: float
    share: float
    other: float
    along: float
    along_at: float
    force: float
    moving_force: float

    @property
    def within(self) -> bool:
        """Whether the muscle is within the tolerance wherever one coordinate moves alone."""
        return max(self.length, self.arm) <= TOLERANCE


@dataclass(frozen=True, eq=False)
class Certificate:
    """How far MuJoCo's copy of a model is the model.

    Attributes
    ----------
    version : of MuJoCo
    poses : compared
    differences : one a muscle
    mass : difference of the whole mass [kg]
    torque, largest_torque : largest difference of inverse dynamics in made motions, and its largest
        value [N m or N]
    steps : whether MuJoCo's copy steps from its default pose without a warning and with finite
        values
    notes : what is otherwise than in the model, one line each
    """

    version: str
    poses: int
    differences: tuple[Difference, ...]
    mass: float
    torque: float
    largest_torque: float
    steps: bool
    notes: tuple[Message, ...] = ()

    @property
    def rows(self) -> list[dict[str, str | float]]:
        """A row a muscle, as the table beside the file has it [mm]."""
        return [
            {
                "muscle": one.muscle,
                "length [mm]": 1e3 * one.length,
                "length at": f"{one.length_at[0]} {one.length_at[1]:.3f}",
                "moment arm [mm]": 1e3 * one.arm,
                "moment arm about": one.arm_about,
                "moment arm at": f"{one.arm_at[0]} {one.arm_at[1]:.3f}",
                "own moment arm off slope [mm]": 1e3 * one.own,
                "length together [mm]": 1e3 * one.length_together,
                "moment arm together [mm]": 1e3 * one.arm_together,
                "share of poses within": one.share,
                f"length by MuJoCo {OTHER_VERSION} [mm]": 1e3 * one.other,
                "length along the motion [mm]": 1e3 * one.along,
                "isometric force": one.force,
                "force in motion": one.moving_force,
            }
            for one in self.differences
        ]

    @property
    def lines(self) -> tuple[str, ...]:
        """Write the certificate in words.

        Its first line states where lengths or moment arms are not the model's.
        """
        beyond = sorted(
            (each for each in self.differences if not each.within),
            key=lambda each: -max(each.length, each.arm),
        )
        steps = "steps" if self.steps else "does not step"
        return (
            *self._of_paths(beyond),
            *self._of_slopes(beyond),
            *self._of_poses_together(),
            *self._of_motion(),
            *self._of_other_version(),
            f"MuJoCo {self.version}: mass differs by {self.mass:.1e} kg, inverse dynamics by"
            f" {self.torque:.1e} of {self.largest_torque:.0f} N m; it"
            f" {steps} from its default pose",
            *self._of_forces(),
            *self.notes,
        )

    def _of_paths(self, beyond: Sequence[Difference]) -> list[str]:
        """Report lengths and moment arms over the ranges, of muscles `beyond` tolerance."""
        if not self.differences:
            return []
        if not beyond:
            return [
                f"lengths and moment arms of all {len(self.differences)} muscles are within"
                f" {1e3 * TOLERANCE:g} mm"
            ]
        worst = beyond[0]
        lines = [
            f"{len(beyond)} of {len(self.differences)} muscles differ by more than"
            f" {1e3 * TOLERANCE:g} mm: most '{worst.muscle}', length by {1e3 * worst.length:.2f} mm"
            f" at {worst.length_at[0]} {worst.length_at[1]:.2f}, moment arm about"
            f" {worst.arm_about} by {1e3 * worst.arm:.2f} mm at {worst.arm_at[0]}"
            f" {worst.arm_at[1]:.2f}"
        ]
        if len(beyond) > 1:
            others = [
                f"{each.muscle} {1e3 * each.length:.2f} and {1e3 * each.arm:.2f}"
                for each in beyond[1:]
            ]
            lines.append(f"the others, length and moment arm [mm]: {quoted(others, 8)}")
        return lines

    @staticmethod
    def _of_slopes(beyond: Sequence[Difference]) -> list[str]:
        """Report muscles whose moment arms differ only because the model's are no slopes."""
        own = [
            each for each in beyond if each.length <= TOLERANCE and each.arm <= each.own + TOLERANCE
        ]
        if not own:
            return []
        muscles = [each.muscle for each in own]
        return [
            f"in {len(own)} of them lengths agree, but OpenSim's moment arms are not the slopes"
            f" of its lengths, as MuJoCo's are: {quoted(muscles, 4)}"
        ]

    def _of_poses_together(self) -> list[str]:
        """Report muscles that differ somewhere when all coordinates move together."""
        together = [each for each in self.differences if each.share < 1.0]
        if not together:
            return []
        worst = min(together, key=lambda each: each.share)
        return [
            f"all coordinates moved together: {len(together)} muscles leave {1e3 * TOLERANCE:g}"
            f" mm somewhere, '{worst.muscle}' in {100.0 * (1.0 - worst.share):.0f} % of poses"
        ]

    def _of_forces(self) -> list[str]:
        """Report how far forces of MuJoCo's muscles differ."""
        strengths = [each for each in self.differences if each.force > 0.0]
        if not strengths:
            return []
        worst = max(strengths, key=lambda each: each.force)
        moving = max(each.moving_force for each in strengths)
        return [
            f"MuJoCo's muscles differ by up to {100.0 * worst.force:.0f} % of their strength"
            f" where they rest ('{worst.muscle}'), by"
            f" {100.0 * moving:.0f} % where they move: the"
            " table of curves has ours"
        ]

    def _of_motion(self) -> list[str]:
        """Say how far lengths differ along the recorded motion."""
        recorded = [one for one in self.differences if np.isfinite(one.along)]
        if not recorded:
            return []
        worst = max(recorded, key=lambda one: one.along)
        beyond = sum(one.along > TOLERANCE for one in recorded)
        if not beyond:
            return [f"along the motion all lengths are within {1e3 * TOLERANCE:g} mm"]
        return [
            f"along the motion {beyond} muscles leave {1e3 * TOLERANCE:g} mm: most"
            f" '{worst.muscle}', by {1e3 * worst.along:.2f} mm at {worst.along_at:.2f} s"
        ]

    def _of_other_version(self) -> list[str]:
        """Say how far lengths differ by the rules of the version that is not installed."""
        if not self.differences:
            return []
        worst = max(self.differences, key=lambda one: one.other)
        beyond = sum(one.other > TOLERANCE for one in self.differences)
        if not beyond:
            return [
                f"by the rules of MuJoCo {OTHER_VERSION} all lengths are within"
                f" {1e3 * TOLERANCE:g} mm"
            ]
        return [
            f"by the rules of MuJoCo {OTHER_VERSION} {beyond} muscles leave {1e3 * TOLERANCE:g} mm:"
            f" most '{worst.muscle}', by {1e3 * worst.other:.2f} mm"
        ]


@read_only
class RecordedPoses:
    """Poses of a recorded motion, in the order of time.

    Attributes
    ----------
    time : (frames,) [s]
    poses : to be compared
    """

    time: Array
    poses: ComparedPoses


def certify(
    model: Model,
    copy: MujocoCopy,
    poses: ComparedPoses,
    recorded: RecordedPoses | None = None,
    notes: tuple[Message, ...] = (),
) -> Certificate:
    """Compare MuJoCo's copy with the model.

    Parameters
    ----------
    model : the model
    copy : of it
    poses : over the coordinates' ranges
    recorded : motion along which lengths are compared as well
    notes : what is otherwise than in the model
    """
    differences: tuple[Difference, ...] = ()
    if model.muscles:
        differences = _differences(model, copy, poses, recorded)
    torque, largest = _torques(copy, poses.copy)
    mass = float(copy.m.body_mass.sum()) - model.mass
    return Certificate(
        version=mujoco.__version__,
        poses=len(poses.model),
        differences=differences,
        mass=mass,
        torque=torque,
        largest_torque=largest,
        steps=copy.steps(STEPS),
        notes=notes,
    )


@read_only
class _Along:
    """Largest differences of lengths (muscles,) along a motion [m], nan without one, and when."""

    length: Array
    time: Array


def _along(paths: Paths, copy: MujocoCopy, recorded: RecordedPoses | None, muscles: int) -> _Along:
    """Compare lengths along a recorded motion, in which the copy moves from frame to frame."""
    if recorded is None:
        return _Along(length=np.full(muscles, np.nan), time=np.full(muscles, np.nan))
    lengths = paths.evaluate(recorded.poses.model)[0]
    theirs, _ = copy.lengths_and_arms(recorded.poses.copy, recorded.poses.route)
    off = np.abs(theirs - lengths)
    return _Along(length=off.max(axis=0), time=recorded.time[off.argmax(axis=0)])


@read_only
class _ComparedPaths:
    """Paths of a model and of its copy, over poses.

    Attributes
    ----------
    lengths : (poses, muscles) of the model [m]
    length_errors : (poses, muscles) absolute differences [m]
    arms : (poses, muscles, coordinates) moment arms of the model [m/rad or m/m]
    arm_errors : (poses, muscles, coordinates) absolute differences [m/rad or m/m]
    columns : (coordinates,) their indices in the model, those that both have
    """

    lengths: Array
    length_errors: Array
    arms: Array
    arm_errors: Array
    columns: np.ndarray


def _compared_paths(
    model: Model, paths: Paths, copy: MujocoCopy, poses: ComparedPoses
) -> _ComparedPaths:
    """Compare lengths and moment arms in poses over the coordinates' ranges."""
    lengths, _, pairs = paths.evaluate(poses.model)
    copied_lengths, copied_arms = copy.lengths_and_arms(poses.copy, poses.route)
    dense = np.zeros((*lengths.shape, len(model.coordinates)))
    dense[:, paths.arm_muscle, paths.arm_coordinate] = pairs
    free = [i for i, name in enumerate(copy.free) if name in model.coordinate_names]
    columns = [model.coordinate_names.index(copy.free[i]) for i in free]
    arms = dense[:, :, columns]
    return _ComparedPaths(
        lengths=lengths,
        length_errors=np.abs(copied_lengths - lengths),
        arms=arms,
        arm_errors=np.abs(copied_arms[:, :, free] - arms),
        columns=np.array(columns, np.intp),
    )


@read_only
class _WorstArms:
    """The largest difference of each muscle's moment arms, of poses in which one coordinate moves.

    Attributes
    ----------
    pose : (muscles,) index of the pose
    coordinate : (muscles,) index of the coordinate, among those that are compared
    own : (muscles,) difference of the model's moment arm from the slope of its length there
        [m/rad or m/m]
    """

    pose: np.ndarray
    coordinate: np.ndarray
    own: Array


def _worst_arms(paths: Paths, compared: _ComparedPaths, poses: ComparedPoses) -> _WorstArms:
    """Find where each muscle's moment arms differ most."""
    alone = np.flatnonzero(poses.swept >= 0)
    muscles = np.arange(compared.arms.shape[1])
    shape = (len(alone), len(compared.columns))
    places = [np.unravel_index(np.argmax(compared.arm_errors[alone, m]), shape) for m in muscles]
    pose = alone[[int(index) for index, _ in places]]
    coordinate = [int(index) for _, index in places]
    columns = [int(compared.columns[index]) for index in coordinate]
    arms = compared.arms[pose, muscles, coordinate]
    own = _off_slopes(paths, poses.model[pose], columns, arms)
    return _WorstArms(pose=pose, coordinate=np.array(coordinate, np.intp), own=own)


def _differences(
    model: Model, copy: MujocoCopy, poses: ComparedPoses, recorded: RecordedPoses | None
) -> tuple[Difference, ...]:
    """Compare lengths, moment arms and forces of each muscle."""
    paths = compile_paths(model)
    compared = _compared_paths(model, paths, copy, poses)
    other_lengths = lengths_of_version(copy.model, OTHER_VERSION, poses.copy)
    along = _along(paths, copy, recorded, len(model.muscles))
    worst = _worst_arms(paths, compared, poses)
    still, moving = force_differences(model, copy)
    alone = np.flatnonzero(poses.swept >= 0)
    together = poses.swept < 0
    result = []
    for m, muscle in enumerate(model.muscles):
        lengths_off = compared.length_errors[:, m]
        arms_off = compared.arm_errors[:, m]
        at = int(alone[np.argmax(lengths_off[alone])])
        arm_at = int(worst.pose[m])
        about = int(worst.coordinate[m])
        result.append(
            Difference(
                muscle=muscle.name,
                length=float(lengths_off[at]),
                length_at=_place(model, poses.model, poses.swept, at),
                arm=float(arms_off[arm_at, about]),
                arm_at=_place(model, poses.model, poses.swept, arm_at),
                arm_about=model.coordinate_names[compared.columns[about]],
                own=float(worst.own[m]),
                length_together=float(lengths_off[together].max(initial=0.0)),
                arm_together=float(arms_off[together].max(initial=0.0)),
                share=_share_within(lengths_off[together], arms_off[together]),
                other=float(np.abs(other_lengths[:, m] - compared.lengths[:, m]).max()),
                along=float(along.length[m]),
                along_at=float(along.time[m]),
                force=float(still[m]),
                moving_force=float(moving[m]),
            )
        )
    return tuple(result)


def _share_within(lengths_off: Array, arms_off: Array) -> float:
    """Return the share of poses in which a muscle is within tolerance.

    `lengths_off`: (poses,) [m]; `arms_off`: (poses, coordinates) [m/rad or m/m].
    """
    within = (lengths_off <= TOLERANCE) & (arms_off.max(axis=1) <= TOLERANCE)
    return float(within.mean())


def _off_slopes(paths: Paths, poses: Array, columns: list[int], arms: Array) -> Array:
    """Compare each muscle's moment arm in its own pose with the slope of its length.

    Returns their differences (muscles,). `poses`: (muscles, coordinates); `columns`: the coordinate
    of each of the moment arms (muscles,).
    """
    step = np.zeros_like(poses)
    every = np.arange(len(poses))
    step[every, columns] = SLOPE_STEP
    slopes = []
    for sign in (1.0, -1.0):
        change = paths.evaluate(poses + sign * step)[0] - paths.evaluate(poses)[0]
        slopes.append(np.abs(arms + sign * change[every, every] / SLOPE_STEP))
    # At an end of a range, or where a path changes, one side counts.
    return np.asarray(np.minimum(*slopes))


def _place(model: Model, coordinates: Array, swept: Array, pose: int) -> tuple[str, float]:
    return model.coordinate_names[swept[pose]], float(coordinates[pose, swept[pose]])


def _torques(copy: MujocoCopy, copied: Array) -> tuple[float, float]:
    """Return the largest difference of inverse dynamics in made motions.

    The second value is the largest generalized force; both in N m or N.
    """
    poses = copied[-FRAMES:]
    random = np.random.default_rng(0)
    speeds, accelerations = random.standard_normal((2, *poses.shape))
    for _, _, at, _ in copy.turning:
        columns = slice(at, at + 3)
        speeds[:, columns] = 0.0
        accelerations[:, columns] = 0.0
    motion = Motion(
        time=np.arange(len(poses), dtype=np.float64),
        names=copy.model.coordinate_names,
        values=poses,
        velocities=speeds,
        accelerations=accelerations,
    )
    ours = inverse_dynamics(copy.model, motion).values[:, copy.columns]
    theirs = copy.generalized_forces(*motion_arrays(compile_tree(copy.model), motion))
    return float(np.abs(theirs - ours).max(initial=0.0)), float(np.abs(ours).max(initial=0.0))
