"""From a recording to the numbers of its movement: forces by side, stances, angles, heights."""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.movement import Movement
from myomorph.core.model.quantity import Quantity
from myomorph.core.model.segments import named_segment
from myomorph.core.model.series import Motion, Series
from myomorph.core.model.sides import split_side
from myomorph.core.motion.ik import KinematicsFit
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.lab.analysis.gait_curves import SIDES, joint_coordinate
from myomorph.lab.analysis.sagittal_joints import extension_moment, joint_angle, low_back_moment
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.analysis.walking import chains, walking_limbs
from myomorph.lab.movements import quantities as of
from myomorph.lab.movements.body_curves import BodyCurves
from myomorph.lab.movements.jumping import jumps
from myomorph.lab.movements.part import UNKNOWN, MovementNumbers
from myomorph.lab.movements.rising import rising
from myomorph.lab.movements.running import Runner, Stance, running_steps
from myomorph.lab.movements.squatting import squats
from myomorph.lab.movements.support_force import UNLOADED, Contact, SupportForce

NEAR = 0.15
"""A contact that plates show is a stance that begins so near to it [s]."""
HALVES = 1e-3
"""Forces of two feet differ by more than this share of the weight, unless one force was halved."""
FLYING: tuple[Movement, ...] = ("running", "jumping")
LEG = ("hip_flexion", "knee_flexion", "ankle_dorsiflexion")
"""Joints of a leg from the hip to the ankle."""


@read_only
class RecordedMovement:
    """A recording of a movement.

    Attributes
    ----------
    movement : of which it is
    model : of the body
    motion : coordinates [rad or m]
    fit : of the markers, None where the motion was given
    torques : (frames, coordinates) [N m], None where there are none
    measured : (samples, bodies) vertical force on each body as measured [N], None without plates
    shared : whether feet share a plate, so that no force is of one foot alone
    strides : None where no foot was seen to step
    center : (frames, 3) center of mass [m], None where it is not known
    up : (3,) unit vector against gravity
    floor : height of the ground [m]
    weight : of the body [N]
    """

    movement: Movement
    model: Model
    motion: Motion
    fit: KinematicsFit | None
    torques: Series | None
    measured: Series | None
    shared: bool
    strides: Strides | None
    center: Series | None
    up: Array
    floor: float
    weight: float

    def numbers(self) -> MovementNumbers | None:
        """Return the numbers of the movement; None where it has none, or shows no part."""
        maker = MAKERS.get(self.movement)
        found = None if maker is None else maker(self)
        return found if found is not None and found.parts else None

    def poses(self, tree: Tree) -> Poses:
        """Poses of all bodies, NaN in frames that were not seen."""
        return forward_kinematics(tree, tree.coordinates_of(self.motion))


def support_force(recorded: RecordedMovement) -> SupportForce | None:
    """Collect the forces under the feet.

    Of a run, forces of single feet count where the other foot is never on a plate. Who runs or
    jumps leaves the plates, which shows their offsets.

    Parameters
    ----------
    recorded : the movement

    Returns
    -------
    the forces, None where no foot was on a plate
    """
    measured = recorded.measured
    if measured is None or len(measured) < 3 or recorded.weight <= 0.0:
        return None
    parts = _forces_by_foot(recorded, measured)
    both_loaded = _loaded(parts.right, recorded) and _loaded(parts.left, recorded)
    alone = recorded.movement == "running"
    if recorded.shared or not (alone or both_loaded) or parts.halved(recorded.weight):
        parts = _FootForces(right=None, left=None, both=parts.whole)
    if parts.whole is None:
        return None
    force = SupportForce.of(measured.time, recorded.weight, parts.right, parts.left, parts.both)
    return force.zeroed() if recorded.movement in FLYING else force


@read_only
class _FootForces:
    """Vertical forces (samples,) under one foot each and under both together [N], None for none."""

    right: Array | None
    left: Array | None
    both: Array | None

    def halved(self, weight: float) -> bool:
        """Whether one force was given to both feet by halves, which says nothing of either.

        Parameters
        ----------
        weight : of the body [N]
        """
        if self.right is None or self.left is None:
            return False
        return bool(np.abs(self.right - self.left).max(initial=0.0) < HALVES * weight)

    @property
    def whole(self) -> Array | None:
        """Sum of all (samples,) [N]."""
        known = [force for force in (self.right, self.left, self.both) if force is not None]
        return np.asarray(np.sum(known, axis=0)) if known else None


def _forces_by_foot(recorded: RecordedMovement, measured: Series) -> _FootForces:
    """Sort forces on bodies by the foot that these belong to.

    Parameters
    ----------
    recorded : the movement
    measured : (samples, bodies) [N]

    Returns
    -------
    forces under each foot; what is on no body of the model is a plate under both
    """
    limbs = walking_limbs(recorded.model)
    chained = chains(recorded.model, limbs) if limbs else {}
    sided = {split_side(limb)[1]: own for limb, own in chained.items()}

    def summed(owners: Collection[str]) -> Array | None:
        columns = [place for place, name in enumerate(measured.names) if name in owners]
        return np.asarray(measured.values[:, columns].sum(axis=1)) if columns else None

    plates = set(measured.names) - set(recorded.model.body_names)
    return _FootForces(
        right=summed(sided.get("right", ())),
        left=summed(sided.get("left", ())),
        both=summed(plates),
    )


def _loaded(force: Array | None, recorded: RecordedMovement) -> bool:
    """Whether a foot ever is on its plate."""
    return force is not None and float(force.max()) > UNLOADED * recorded.weight


def stances(recorded: RecordedMovement, force: SupportForce | None) -> tuple[Stance, ...]:
    """Find when each foot is on the ground: by plates, else as the strides show.

    Parameters
    ----------
    recorded : the movement
    force : under the feet, None without plates
    """
    found: list[Stance] = []
    for side in SIDES:
        seen = _seen_stances(recorded.strides, side)
        own = None if force is None else force.of_side(side)
        contacts = () if force is None or own is None else force.contacts(own)
        measured = [
            _measured_stance(contact, side, seen)
            for contact in contacts
            if contact.begins and contact.ends
        ]
        starts = [stance.start for stance in measured]
        found += measured
        found += [
            stance for stance in seen if all(abs(stance.start - start) > NEAR for start in starts)
        ]
    return tuple(sorted(found, key=lambda stance: stance.start))


def _seen_stances(strides: Strides | None, side: str) -> list[Stance]:
    """Stances of one side by the strikes and lifts of its foot."""
    if strides is None:
        return []
    limb = next((name for name in strides.strikes if split_side(name)[1] == side), None)
    if limb is None:
        return []
    strikes = sorted(float(time) for time in strides.strikes[limb])
    lifts = sorted(float(time) for time in strides.lifts.get(limb, ()))
    ends = [*strikes[1:], np.inf]
    # The step that ends with a strike of the other foot began with this one's strike before.
    lengths = {
        stride.stop: stride.step for stride in strides.strides if split_side(stride.limb)[1] != side
    }
    found = []
    for start, following in zip(strikes, ends, strict=True):
        lift = next((time for time in lifts if start < time < following), UNKNOWN)
        step = next(
            (length for stop, length in lengths.items() if start < stop < following), UNKNOWN
        )
        found.append(Stance(side=side, start=start, stop=lift, length=step))
    return found


def _measured_stance(contact: Contact, side: str, seen: list[Stance]) -> Stance:
    """Return a stance by its plate, with the step length of the one that was seen."""
    near = [stance for stance in seen if abs(stance.start - contact.start) <= NEAR]
    return Stance(
        side=side,
        start=contact.start,
        stop=contact.stop,
        measured=True,
        length=near[0].length if near else UNKNOWN,
    )


def leg_length(recorded: RecordedMovement) -> float:
    """Return the length of the straight leg, from the hip's center to the ground.

    Thigh and shank of the model, and the least height of the ankle's center over the ground; the
    mean of both sides.

    Returns
    -------
    [m], NaN for a model without these joints
    """
    tree = compile_tree(recorded.model)
    moving = recorded.poses(tree)
    lengths = []
    for side in SIDES:
        joints = [_joint(recorded.model, key, side) for key in LEG]
        if any(joint is None for joint in joints):
            return UNKNOWN
        places = [_center(moving, tree, joint) for joint in joints if joint is not None]
        hip, knee, ankle = places
        thigh = np.linalg.norm(hip - knee, axis=1)
        shank = np.linalg.norm(knee - ankle, axis=1)
        height = ankle @ recorded.up - recorded.floor
        lengths.append(np.nanmedian(thigh) + np.nanmedian(shank) + np.nanmin(height))
    return float(np.mean(lengths))


def _joint(model: Model, key: str, side: str) -> Joint | None:
    """Return the joint that a coordinate of `SPELLINGS` moves."""
    name = joint_coordinate(model, key, side)
    return next((joint for joint in model.joints if name and name in joint.coordinates), None)


def _center(poses: Poses, tree: Tree, joint: Joint) -> Array:
    """Position of a joint's center in ground.

    Returns
    -------
    (frames, 3) [m]
    """
    parent = tree.body_index[joint.parent]
    place = joint.parent_frame.translation
    return np.asarray(poses.origins[:, parent] + poses.rotations[:, parent] @ place)


def body_curves(recorded: RecordedMovement) -> BodyCurves | None:
    """Collect angles, heights and moments; None for a model without hips or knees."""
    model = recorded.model
    motion = recorded.motion
    knees = [joint_angle(model, motion, "knee_flexion", side) for side in SIDES]
    seen = [angle for angle in knees if angle is not None]
    hips = [joint for side in SIDES if (joint := _joint(model, "hip_flexion", side)) is not None]
    if not seen or not hips:
        return None
    tree = compile_tree(model)
    poses = recorded.poses(tree)
    heights = [_center(poses, tree, joint) @ recorded.up for joint in hips]
    center = np.full(len(motion), np.nan)
    if recorded.center is not None and len(recorded.center):
        height = recorded.center.values @ recorded.up
        center = np.interp(motion.time, recorded.center.time, height)
    return BodyCurves(
        time=motion.time,
        bend=np.asarray(np.mean(seen, axis=0)),
        center=center,
        hips=np.asarray(np.mean(heights, axis=0)),
        lean=trunk_lean(recorded, poses, tree),
        clock=motion.time if recorded.torques is None else recorded.torques.time,
        moments=_moments(recorded),
    )


def trunk_lean(recorded: RecordedMovement, poses: Poses, tree: Tree) -> Array | None:
    """Return the angle of the trunk with the vertical.

    Its own upright direction is the vertical in the pose in which all joints are straight.

    Parameters
    ----------
    recorded : the movement
    poses : of its bodies
    tree : of the model

    Returns
    -------
    (frames,) [degrees], None for a body without a trunk, or where no marker shows it
    """
    model = recorded.model
    trunks = [body for body in model.bodies if _is_trunk(body.name)]
    if not trunks:
        return None
    trunk = max(trunks, key=lambda body: body.mass)
    fit = recorded.fit
    if fit is not None and fit.marker_names:
        shown = {model.marker(name).body for name in fit.marker_names}
        if not shown & {body.name for body in trunks}:
            return None
    turning = np.array([coordinate.motion == "rotational" for coordinate in model.coordinates])
    straight = forward_kinematics(tree, np.where(turning, 0.0, tree.defaults)[None])
    index = tree.body_index[trunk.name]
    upright = straight.rotations[0, index].T @ recorded.up
    cosine = (poses.rotations[:, index] @ upright) @ recorded.up
    return np.asarray(np.degrees(np.arccos(np.clip(cosine, -1.0, 1.0))))


def _is_trunk(body: str) -> bool:
    """Whether a body is named as the upper trunk."""
    segment = named_segment(body)
    return segment is not None and segment.name == "upper_trunk" and not segment.side


def _moments(recorded: RecordedMovement) -> Mapping[Quantity, Array]:
    """Extension moments per body mass, by the quantities of their peaks, (samples,) [N m/kg]."""
    torques = recorded.torques
    mass = recorded.model.mass
    if torques is None or not mass > 0.0:
        return FrozenMap({})
    joints = (
        (of.KNEE_MOMENT_RIGHT, extension_moment(recorded.model, torques, "knee_flexion", "right")),
        (of.KNEE_MOMENT_LEFT, extension_moment(recorded.model, torques, "knee_flexion", "left")),
        (of.HIP_MOMENT_RIGHT, extension_moment(recorded.model, torques, "hip_flexion", "right")),
        (of.HIP_MOMENT_LEFT, extension_moment(recorded.model, torques, "hip_flexion", "left")),
        (of.LOW_BACK_MOMENT, low_back_moment(torques)),
    )
    known = {quantity: moment / mass for quantity, moment in joints if moment is not None}
    return FrozenMap(known)


def _running(recorded: RecordedMovement) -> MovementNumbers:
    """Return the steps of a run."""
    force = support_force(recorded)
    speeds = [] if recorded.strides is None else recorded.strides.strides
    speed = float(np.mean([stride.speed for stride in speeds])) if speeds else UNKNOWN
    length = leg_length(recorded) if force is not None else UNKNOWN
    runner = Runner(leg_length=length, speed=speed)
    return MovementNumbers(
        one="step",
        many="steps",
        parts=running_steps(stances(recorded, force), force, runner),
        quantities=of.RUNNING,
    )


def _jumping(recorded: RecordedMovement) -> MovementNumbers | None:
    """Return the jumps that plates show, with what their kind has."""
    force = support_force(recorded)
    if force is None:
        return None
    parts = jumps(force)
    rebounds = [np.isfinite(part.number(of.CONTACT_TIME)) for part in parts]
    absent: tuple[Quantity, ...] = ()
    if not any(rebounds):
        absent = of.OF_DROP_JUMPS
    elif all(rebounds):
        absent = of.FROM_STANDING
    quantities = tuple(quantity for quantity in of.JUMPING if quantity not in absent)
    return MovementNumbers(one="jump", many="jumps", parts=parts, quantities=quantities)


def _squatting(recorded: RecordedMovement) -> MovementNumbers | None:
    """Repetitions of a squat."""
    curves = body_curves(recorded)
    if curves is None:
        return None
    parts = squats(curves, support_force(recorded))
    return MovementNumbers(
        one="repetition", many="repetitions", parts=parts, quantities=of.SQUATTING
    )


def _rising(recorded: RecordedMovement) -> MovementNumbers | None:
    """Rises from a seat."""
    curves = body_curves(recorded)
    if curves is None:
        return None
    parts = rising(curves, support_force(recorded))
    return MovementNumbers(one="rise", many="rises", parts=parts, quantities=of.RISING)


MAKERS: Mapping[Movement, Callable[[RecordedMovement], MovementNumbers | None]] = FrozenMap(
    {
        "running": _running,
        "jumping": _jumping,
        "squatting": _squatting,
        "rising": _rising,
    }
)
"""Movements that have numbers of their own."""
