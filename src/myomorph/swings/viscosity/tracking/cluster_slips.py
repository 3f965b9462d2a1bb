"""Clusters that slip on their bones.

The bone's joints then stand apart, which a loose wire or base never does.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Joint
from myomorph.core.model.series import Markers
from myomorph.swings.viscosity.specimen.model import Specimen
from myomorph.swings.viscosity.tracking.held import Slip, bone_poses, mean_rotation

SHORTEST = 0.5  # Time on either side of a slip that tells where the cluster was [s].

Poses = tuple[Array, Array]
"""Rotations (frames, 3, 3) and origins (frames, 3) of a bone in ground, all trials of a condition
in a row.
"""


def without_slips(
    specimen: Specimen, markers: Sequence[Markers], names: Sequence[str], threshold: float
) -> tuple[list[Markers], list[list[Slip]]]:
    """Put markers of clusters that slipped back to where they were before.

    Returns the markers of all trials, and the slips of each trial.

    A cluster that moves by more than `threshold` [m] on its bone moves all joints of the bone away
    from those of the bones beside it, at one time, and they stay there. A wire that slips turns
    about its joint, and a base that moves takes its joint along: both leave joints together. Trials
    follow each other in time.
    """
    model = specimen.model
    markers = list(markers)
    slips = [list[Slip]() for _ in markers]
    for _ in model.body_names:
        poses = {bone: bone_poses(model, bone, markers) for bone in model.body_names}
        steps = _joint_steps(specimen, markers, poses)
        bone = _slipped(specimen, steps, poses, threshold)
        if bone is None:
            break
        joints = [joint.child for joint in model.joints if bone in (joint.parent, joint.child)]
        known = [steps[joint] for joint in joints if joint in steps]
        at, amount = max(known, key=lambda step: step[1])
        starts = np.cumsum([0, *(len(trial) for trial in markers)])
        trial = int(np.searchsorted(starts, at, side="right")) - 1
        slips[trial].append(
            Slip(
                trial=names[trial],
                what=bone,
                time=float(markers[trial].time[at - starts[trial]]),
                amount=amount,
                lasting=True,
                unit="m",
                cluster=True,
            )
        )
        reference = _reference(specimen, bone, steps)
        if reference is None:
            break
        still = poses[reference] if reference else None
        markers = _put_back(specimen, bone, poses[bone], still, at, markers, starts)
    return markers, slips


def _joint_steps(
    specimen: Specimen, markers: Sequence[Markers], poses: dict[str, Poses]
) -> dict[str, tuple[int, float]]:
    """Find the step of the gap of each joint whose bones are seen, by its child.

    A step has the frame at which it is, of all trials in a row, and its size [m].
    """
    least = max(1, round(SHORTEST * markers[0].rate)) if len(markers[0]) > 1 else 1
    placed = {bone for bone, pose in poses.items() if np.isfinite(pose[1]).any()}
    joints = [joint for joint in specimen.model.joints if {joint.parent, joint.child} <= placed]
    return {joint.child: _step(_gap(joint, poses), least) for joint in joints}


def _gap(joint: Joint, poses: dict[str, Poses]) -> Array:
    """Return the vector from the parent's joint to the child's, (frames, 3) [m].

    It is in the parent's axes.
    """
    above, origin = poses[joint.parent]
    below, place = poses[joint.child]
    apart = np.einsum("fij,j->fi", below, joint.child_frame.translation) + place - origin
    return np.einsum("fji,fj->fi", above, apart) - joint.parent_frame.translation


def _step(values: Array, least: int) -> tuple[int, float]:
    """Frame at which the mean of values (frames, 3) changes most surely, and the change [m]."""
    seen = np.asarray(np.isfinite(values).all(axis=1))
    filled = np.where(seen[:, None], values, 0.0)
    before = np.cumsum(filled, axis=0)[:-1]
    count = np.cumsum(seen)[:-1].astype(np.float64)
    after = filled.sum(axis=0) - before
    rest = seen.sum() - count
    use = (count >= least) & (rest >= least)
    if not use.any():
        return 0, 0.0
    change = np.linalg.norm(
        after / np.maximum(rest, 1.0)[:, None] - before / np.maximum(count, 1.0)[:, None], axis=1
    )
    at = int(np.argmax(np.where(use, change * np.sqrt(count * rest), 0.0)))
    return at + 1, float(change[at])


def _slipped(
    specimen: Specimen,
    steps: dict[str, tuple[int, float]],
    poses: dict[str, Poses],
    threshold: float,
) -> str | None:
    """Return the bone all of whose joints come apart, of several the one with most joints."""
    known = _steps_of_bones(specimen, steps)
    apart = [bone for bone, amounts in known.items() if amounts and min(amounts) > threshold]
    if not apart:
        return None
    most = max(len(known[bone]) for bone in apart)
    likely = [bone for bone in apart if len(known[bone]) == most]
    if specimen.base in likely and len(likely) > 1:
        # Base and limb share the one joint that is known: a cluster of the base that slipped does
        # not stand still.
        moved = _step(poses[specimen.base][1], 1)[1] > threshold
        likely = [bone for bone in likely if (bone == specimen.base) == moved]
    return max(likely, key=lambda bone: min(known[bone]))


def _steps_of_bones(
    specimen: Specimen, steps: dict[str, tuple[int, float]]
) -> dict[str, list[float]]:
    """Return by how much the known joints of each bone come apart [m]."""
    known: dict[str, list[float]] = {bone: [] for bone in specimen.model.body_names}
    for joint in specimen.model.joints:
        if joint.child in steps:
            for bone in {joint.parent, joint.child} & known.keys():
                known[bone].append(steps[joint.child][1])
    return known


def _reference(specimen: Specimen, bone: str, steps: dict[str, tuple[int, float]]) -> str | None:
    """Return the bone that shows where another was.

    It is one that wires hold on it, "" for the ground that holds the base.
    """
    if bone == specimen.base:
        return ""
    for joint in specimen.model.joints:
        if (
            joint.child in steps
            and joint.parent != specimen.base
            and bone in (joint.parent, joint.child)
        ):
            return joint.parent if joint.child == bone else joint.child
    return None


def _put_back(
    specimen: Specimen,
    bone: str,
    pose: Poses,
    still: Poses | None,
    at: int,
    markers: list[Markers],
    starts: np.ndarray,
) -> list[Markers]:
    """Put markers of a bone, from the frame `at` on, where they would be without the slip.

    Its cluster is then as it was before in a frame that is `still`, ground where None.
    """
    back, shift = _way_back(pose, still, at)
    columns = [marker.name for marker in specimen.model.markers if marker.body == bone]
    rotations, origins = pose
    result = []
    for trial, start in zip(markers, starts, strict=False):
        use = slice(max(0, at - int(start)), None)
        turn = rotations[start : start + len(trial)][use]
        origin = origins[start : start + len(trial)][use]
        values = np.array(trial.values)
        carried = [trial.names.index(name) for name in columns if name in trial.names]
        own = np.einsum("fji,fmj->fmi", turn, values[use, carried] - origin[:, None])
        values[use, carried] = (
            np.einsum("fij,fmj->fmi", turn, own @ back.T + shift) + origin[:, None]
        )
        result.append(replace(trial, values=values))
    return result


def _way_back(pose: Poses, still: Poses | None, at: int) -> tuple[Array, Array]:
    """Return the way from where a cluster is, from the frame `at` on, to where it was before.

    It is a rotation (3, 3) and a shift (3,) in the cluster's own frame [m]. Before and after are
    means in a frame that is `still`, ground where None.
    """
    rotations, origins = pose
    if still is not None:
        turn = still[0].transpose(0, 2, 1)
        rotations = turn @ rotations
        origins = np.einsum("fij,fj->fi", turn, origins - still[1])
    seen = np.asarray(np.isfinite(origins).all(axis=1))
    earlier = seen & (np.arange(len(seen)) < at)
    before = mean_rotation(rotations[earlier])
    there = origins[earlier].mean(axis=0)
    later = seen & (np.arange(len(seen)) >= at)
    after = mean_rotation(rotations[later])
    here = origins[later].mean(axis=0)
    return after.T @ before, after.T @ (there - here)
