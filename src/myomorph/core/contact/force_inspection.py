"""External forces with the motion that they belong to: sampled at its times, by the feet."""

from __future__ import annotations

from collections.abc import Callable, Iterable
from dataclasses import dataclass, replace
from functools import cached_property, partial
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import NDArray

from myomorph.core.contact.consistency.plate_signals import BROKEN
from myomorph.core.contact.site_motion import center_of
from myomorph.core.contact.sites import Foot, feet_of
from myomorph.core.model.arrays import Array, read_only, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import Finding, Repair
from myomorph.core.model.model import Model
from myomorph.core.model.segments import segments_of
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.rigid.kinematics import Poses, forward_kinematics, standing_poses
from myomorph.core.rigid.tree import Tree, compile_tree

FOOT = 0.19
"""Length of a human foot from heel to toes' joint, which lengths are relative to [m]."""
TIP = 1.35
"""End of the sole, over that length."""


LOADED = 0.05
"""Share of the weight from which a force counts as load."""
SHORTEST = 0.05
"""A load that is shorter is not judged [s]."""
LOAD = "load in the hands"
"""Kind of a finding: a force that no foot carries."""
MIRRORED_PLATE = "mirrored plate"
UNSURE = "wrong foot or mirrored plate"
"""Kinds of findings about plates that may be mirrored about their own middle."""
TURNED_PLATE = "turned plate"
"""Kind of a finding: one plate whose axes are not those of the others."""
GAIN = "gain"
"""Kind of a finding: a plate of another sensitivity, so that plates do not show the mass."""
MOVES = 0.8
"""Speed of heel and tip of a human foot above which it does not stand [m/s]."""
BELT = 0.3
"""Speed from which on the ground under loaded feet is a belt [m/s]."""
PAUSE = 0.06
"""A foot that moves for a shorter time goes on standing [s]."""
CARRIED = 0.6
"""Share of a stance during which a plate has to carry its foot."""
EDGE = 0.05
"""Uncertainty of the time at which a foot is put down or lifted, by its motion [s]."""


@read_only
class FootPoses:
    """Feet and center of mass of a model at the times of a motion.

    Attributes
    ----------
    model, tree, poses : the model and where its bodies are
    time : (frames,) [s]
    feet : of the model, right before left
    owners : body to the number of the foot that it belongs to: talus, heel bone and toes
    """

    model: Model
    tree: Tree
    poses: Poses
    time: Array
    feet: tuple[Foot, ...]
    owners: dict[str, int]

    @property
    def unit(self) -> float:
        """Size of the feet over that of a human foot: what tolerances grow with."""
        return float(np.mean([item.length for item in self.feet])) / FOOT

    @property
    def up(self) -> Array:
        """(3,) against gravity."""
        return np.asarray(self.model.up)

    @cached_property
    def soles(self) -> tuple[Array, Array]:
        """Heels and tips of the soles (frames, feet, 3) [m]."""
        heels = []
        tips = []
        for foot in self.feet:
            pose = standing_poses(self.model)[foot.heel]
            ahead = pose.rotation.T @ foot.axes[:, 0]
            rotations, origins = self.pose_of(foot.heel)
            heel = origins + rotations @ pose.inverse().apply(foot.origin)
            heels.append(heel)
            tips.append(heel + TIP * foot.length * rotations @ ahead)
        return np.stack(heels, axis=1), np.stack(tips, axis=1)

    @cached_property
    def center(self) -> Array:
        """Center of mass (frames, 3) [m]."""
        return center_of(self.tree, self.poses, np.asarray(self.tree.arrays.mass) > 0.0)

    @cached_property
    def needed(self) -> Array:
        """External force (frames, 3) that the center of mass needs [N]."""
        if len(self.time) < 5:
            return np.tile(-self.model.mass * np.asarray(self.model.gravity), (len(self.time), 1))
        velocity = np.gradient(self.center, self.time, axis=0)
        return np.asarray(
            self.model.mass
            * (np.gradient(velocity, self.time, axis=0) - np.asarray(self.model.gravity))
        )

    def pose_of(self, body: str) -> tuple[Array, Array]:
        """Pose of a body in all frames.

        Parameters
        ----------
        body : its name

        Returns
        -------
        (frames, 3, 3) rotations and (frames, 3) origins [m]
        """
        b = self.tree.body_index[body]
        return self.poses.rotations[:, b], self.poses.origins[:, b]

    def distances(self, points: Array) -> Array:
        """Distances of points to the soles' middle lines; see `sole_distances`.

        Parameters
        ----------
        points : (frames, points, 3) [m]

        Returns
        -------
        (frames, points, feet) [m]
        """
        return sole_distances(points, *self.soles, self.up)


def sole_distances(points: Array, heels: Array, tips: Array, up: Array) -> Array:
    """Horizontal distances of points to lines from heels to tips.

    Parameters
    ----------
    points : (frames, points, 3) [m]
    heels, tips : (frames, feet, 3) [m]
    up : (3,)

    Returns
    -------
    (frames, points, feet) [m]
    """
    level = np.eye(3) - np.outer(up, up)
    along = ((tips - heels) @ level)[:, None]
    offset = (points[:, :, None] - heels[:, None]) @ level
    projection = (offset * along).sum(axis=3)
    share = np.clip(projection / np.maximum((along**2).sum(axis=3), 1e-12), 0.0, 1.0)
    return np.linalg.norm(offset - share[..., None] * along, axis=3)


def foot_poses(model: Model, motion: Motion) -> FootPoses | None:
    """Find the feet over a motion.

    Parameters
    ----------
    model : of the body
    motion : coordinates (frames, coordinates) [rad or m], without gaps

    Returns
    -------
    heels, tips and what belongs to each foot; None for a model without feet
    """
    try:
        feet = feet_of(model)
        segments = segments_of(model)
    except BadData:
        return None
    owners: dict[str, int] = {}
    for number, foot in enumerate(feet):
        of_foot = segments[foot.heel]
        part = foot.name.removesuffix("foot_r").removesuffix("foot_l")
        owners |= {
            name: number
            for name, segment in segments.items()
            if segment == of_foot and name.startswith(part) and name not in owners
        }
    tree = compile_tree(model)
    return FootPoses(
        model=model,
        tree=tree,
        poses=forward_kinematics(tree, tree.coordinates_of(motion)),
        time=np.asarray(motion.time),
        feet=feet,
        owners=owners,
    )


Change: TypeAlias = Callable[[Array, Array, Array], tuple[Array, Array, Array]]
"""What makes other forces, points and torques (..., 3) of those of one wrench."""


@read_only
class ForceSamples:
    """External forces at the times of a motion.

    Attributes
    ----------
    forces, points, torques : (frames, wrenches, 3) [N], [m], [N m]; zero where unknown
    loaded : (frames, wrenches) forces large enough for their center of pressure to be believed
    """

    forces: Array
    points: Array
    torques: Array
    loaded: NDArray[np.bool_]

    def centers(self, up: Array) -> Array:
        """Points at the height of each wrench's own, at which it has no horizontal moment.

        Parameters
        ----------
        up : (3,)

        Returns
        -------
        (frames, wrenches, 3) [m]
        """
        lift = self.forces @ up
        firm = np.abs(lift) > 0.2 * np.linalg.norm(self.forces, axis=2)
        shift = np.cross(up, self.torques) / np.where(firm, lift, np.inf)[..., None]
        return np.asarray(self.points + shift)


def sampled(wrenches: Wrenches, time: Array, least: float) -> ForceSamples:
    """Take the nearest samples of wrenches, 0 at times not covered.

    Parameters
    ----------
    wrenches : at their own times
    time : (frames,) [s]
    least : force from which one counts as loaded [N]

    Returns
    -------
    forces at the times
    """
    after = np.clip(np.searchsorted(wrenches.time, time), 1, max(len(wrenches) - 1, 1))
    before = after - 1
    after = np.minimum(after, len(wrenches) - 1)
    nearest = np.where(time - wrenches.time[before] < wrenches.time[after] - time, before, after)
    step = float(np.median(np.diff(wrenches.time))) if len(wrenches) > 1 else 1e-3
    inside = (np.abs(wrenches.time[nearest] - time) <= max(step, 1e-6))[:, None, None]
    forces = np.where(inside, np.nan_to_num(wrenches.forces[nearest]), 0.0)
    points = np.where(inside, np.nan_to_num(wrenches.points[nearest]), 0.0)
    torques = np.where(inside, np.nan_to_num(wrenches.torques[nearest]), 0.0)
    return ForceSamples(
        forces=forces, points=points, torques=torques, loaded=np.linalg.norm(forces, axis=2) > least
    )


Forces = TypeVar("Forces", ForceSamples, Wrenches)


def changed_wrenches(wrenches: Forces, number: int, change: Change) -> Forces:
    """Change one of some wrenches in all samples.

    Parameters
    ----------
    wrenches : forces, points and torques, each (samples, wrenches, 3)
    number : of the wrench
    change : from force [N], point [m] and torque [N m], each (samples, 3), to the changed ones

    Returns
    -------
    the wrenches with the changed one
    """
    forces = np.array(wrenches.forces)
    points = np.array(wrenches.points)
    torques = np.array(wrenches.torques)
    force, point, torque = change(forces[:, number], points[:, number], torques[:, number])
    forces[:, number] = force
    points[:, number] = point
    torques[:, number] = torque
    return replace(wrenches, forces=forces, points=points, torques=torques)


@dataclass(frozen=True, eq=False)
class Inspection:
    """Forces with the motion that they belong to.

    Attributes
    ----------
    wrenches : with what earlier checks found put right
    feet : where the feet are
    findings : of earlier checks
    """

    wrenches: Wrenches
    feet: FootPoses
    findings: tuple[Finding, ...] = ()

    @cached_property
    def numbers(self) -> list[int]:
        """Numbers of the wrenches that act on a foot, or on a body that is not known yet.

        Those whose signal is broken show nothing.
        """
        broken = {finding.place for finding in self.findings if finding.kind in BROKEN}
        return [
            number
            for number, body in enumerate(self.wrenches.bodies)
            if (not body or body in self.feet.owners) and self.name(number) not in broken
        ]

    @cached_property
    def samples(self) -> ForceSamples:
        """The wrenches at the times of the motion."""
        samples = sampled(self.wrenches, self.feet.time, LOADED * self.feet.model.weight)
        known = np.asarray(np.isfinite(self.feet.center).all(axis=1))
        return replace(samples, loaded=samples.loaded & known[:, None])

    @property
    def assigned(self) -> list[int]:
        """Numbers of the forces whose foot is looked for.

        Forces of which no foot's place is known to be right are not.
        """
        others = {
            finding.place
            for finding in self.findings
            if finding.kind in (LOAD, MIRRORED_PLATE, UNSURE) and not finding.times
        }
        return [number for number in self.numbers if self.name(number) not in others]

    def weights(self, number: int) -> Array:
        """Size of a force where it is loaded, else 0.

        Parameters
        ----------
        number : of the force

        Returns
        -------
        (frames,) [N]
        """
        size = np.linalg.norm(self.samples.forces[:, number], axis=1)
        return np.asarray(np.where(self.samples.loaded[:, number], size, 0.0))

    def misfit(self, number: int, samples: ForceSamples | None = None) -> float:
        """Compute the mean distance of a center of pressure to the nearest foot, weighted by force.

        Parameters
        ----------
        number : of the force
        samples : in place of the recorded ones

        Returns
        -------
        [m], 0 for a force that is never loaded
        """
        weights = self.weights(number)
        centers = (samples or self.samples).centers(self.feet.up)[:, [number]]
        distances = np.nan_to_num(self.feet.distances(centers)[:, 0].min(axis=1), nan=0.0)
        return float(np.average(distances, weights=weights)) if weights.any() else 0.0

    def episodes(self, number: int) -> list[slice]:
        """Find each stretch of time in which a force is loaded and nearest to one foot.

        Parameters
        ----------
        number : of the force

        Returns
        -------
        slices of frames, in the order of time
        """
        results = []
        time = self.feet.time
        distances = self.feet.distances(self.samples.centers(self.feet.up)[:, [number]])[:, 0]
        nearest = np.argmin(np.nan_to_num(distances, nan=9.0), axis=1)
        for foot in range(len(self.feet.feet)):
            for start, stop in runs(self.samples.loaded[:, number] & (nearest == foot)):
                if time[stop - 1] - time[start] >= SHORTEST:
                    results.append(slice(start, stop))
        return sorted(results, key=lambda result: result.start)

    def name(self, number: int) -> str:
        """Name of a force."""
        return self.wrenches.names[number]

    def times(self, parts: Iterable[slice]) -> tuple[tuple[float, float], ...]:
        """First and last time of parts of the frames [s]."""
        time = self.feet.time
        return tuple((float(time[part.start]), float(time[part.stop - 1])) for part in parts)


def change_repair(number: int, change: Change, done: str, advice: str) -> Repair:
    """Make the repair that changes one wrench in all samples.

    Parameters
    ----------
    number : of the wrench
    change : see `changed_wrenches`
    done : text where it was repaired
    advice : text where it was not
    """
    return Repair(partial(changed_wrenches, number=number, change=change), done, advice)


def standing(inspection: Inspection) -> NDArray[np.bool_]:
    """Flag whether the heel or the tip of each sole moves as the ground does.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    (frames, feet)
    """
    feet = inspection.feet
    loaded = inspection.samples.loaded[:, inspection.numbers].any(axis=1)
    moving = []
    for points in feet.soles:
        velocity = np.gradient(points, feet.time, axis=0)
        moving.append(np.linalg.norm(velocity - ground_velocity(velocity, loaded), axis=2))
    return np.asarray(np.minimum(*moving) <= MOVES * np.sqrt(feet.unit))


def belt_velocity(inspection: Inspection) -> Array:
    """Velocity of the ground under loaded feet, zero but on a treadmill.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    (3,) [m/s]
    """
    feet = inspection.feet
    velocities = np.concatenate(
        [np.gradient(points, feet.time, axis=0) for points in feet.soles], axis=1
    )
    return ground_velocity(velocities, inspection.samples.loaded[:, inspection.numbers].any(axis=1))


def ground_velocity(velocities: Array, loaded: np.ndarray | np.bool_) -> Array:
    """Velocity of the ground by the slowest of some points of feet in frames with a load.

    Parameters
    ----------
    velocities : (frames, points, 3) [m/s]
    loaded : (frames,)

    Returns
    -------
    (3,) [m/s], zero below `BELT`
    """
    if not loaded.any():
        return np.zeros(3)
    speeds = np.linalg.norm(velocities, axis=2)
    slow = velocities[np.arange(len(velocities)), np.argmin(speeds, axis=1)][loaded]
    middle = np.median(slow, axis=0)
    return np.asarray(middle if np.linalg.norm(middle) > BELT else np.zeros(3))


def supported(inspection: Inspection) -> NDArray[np.bool_]:
    """Find frames in which every foot that stands does so on a plate, and one does.

    A stance counts as a whole, so that the frames hardly depend on the clock of the forces; where
    one begins or ends that no plate carries, frames around are left out.

    Parameters
    ----------
    inspection : forces with the motion

    Returns
    -------
    (frames,)
    """
    feet = inspection.feet
    step = float(np.median(np.diff(feet.time)))
    edge = max(1, round(EDGE / step))
    pause = max(1, round(PAUSE / step))
    stands = standing(inspection)
    carries = _carries(inspection)
    on_plate = np.zeros(len(feet.time), bool)
    elsewhere = np.zeros(len(feet.time), bool)
    for foot in range(len(feet.feet)):
        for start, stop in runs(_bridged(stands[:, foot], pause)):
            if carries[start:stop, foot].mean() > CARRIED:
                on_plate[start:stop] = True
            elif stop - start > pause:
                elsewhere[max(0, start - edge) : stop + edge] = True
    return np.asarray(on_plate & ~elsewhere)


def _carries(inspection: Inspection) -> NDArray[np.bool_]:
    """Flag when a plate carries each foot (frames, feet)."""
    feet = inspection.feet
    result = np.zeros((len(feet.time), len(feet.feet)), bool)
    distances = feet.distances(inspection.samples.centers(feet.up)[:, inspection.numbers])
    nearest = np.argmin(np.nan_to_num(distances, nan=9.0), axis=2)
    for column, index in enumerate(inspection.numbers):
        owner = feet.owners.get(inspection.wrenches.bodies[index])
        loaded = inspection.samples.loaded[:, index]
        for foot in range(len(feet.feet)):
            result[:, foot] |= loaded & (
                nearest[:, column] == foot if owner is None else owner == foot
            )
    return result


def _bridged(flags: NDArray[np.bool_], pause: int) -> NDArray[np.bool_]:
    """Close gaps of so many frames or fewer in flags (frames,)."""
    flags = flags.copy()
    for start, stop in runs(~flags):
        if start > 0 and stop < len(flags) and stop - start <= pause:
            flags[start:stop] = True
    return flags
