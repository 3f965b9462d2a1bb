"""Feet of a model over a motion: where their soles lie, how far a force's center of pressure is from them."""

from __future__ import annotations

from functools import cached_property

import numpy as np

from myomorph.contact.site_motion import center_of
from myomorph.contact.sites import Foot, feet_of
from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.segments import segments_of
from myomorph.model.series import Motion
from myomorph.rigid.kinematics import Poses, forward_kinematics, standing_poses
from myomorph.rigid.tree import Tree, compile_tree

FOOT = 0.19  # Length of a human foot from the heel to the toes' joint, which lengths are relative to [m]
TIP = 1.35  # Where the sole ends, over that length


@read_only
class FootPoses:
    """Feet and center of mass of a model at the times of a motion."""

    # model, tree, poses: the model and where its bodies are
    model: Model
    tree: Tree
    poses: Poses
    time: Array  # (frames,) [s]
    feet: tuple[Foot, ...]  # of the model, right before left
    owners: dict[str, int]  # body to the number of the foot that it belongs to: talus, heel bone and toes

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
        heels, tips = [], []
        for foot in self.feet:
            pose = standing_poses(self.model)[foot.heel]
            ahead = pose.rotation.T @ foot.axes[:, 0]
            rotations, origins = self.pose_of(foot.heel)
            heels.append(origins)
            tips.append(origins + TIP * foot.length * rotations @ ahead)
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
        return np.asarray(self.model.mass * (np.gradient(velocity, self.time, axis=0) - np.asarray(self.model.gravity)))

    def pose_of(self, body: str) -> tuple[Array, Array]:
        """Rotations (frames, 3, 3) and origins (frames, 3) of a body."""
        b = self.tree.body_index[body]
        return self.poses.rotations[:, b], self.poses.origins[:, b]

    def distances(self, points: Array) -> Array:
        """Of points (frames, points, 3) to the soles' middle lines (frames, points, feet); see `sole_distances` [m]."""
        return sole_distances(points, *self.soles, self.up)


def sole_distances(points: Array, heels: Array, tips: Array, up: Array) -> Array:
    """Horizontal distances (frames, points, feet) of points to lines from heels to tips (frames, feet, 3) [m]."""
    level = np.eye(3) - np.outer(up, up)
    along, reach = ((tips - heels) @ level)[:, None], (points[:, :, None] - heels[:, None]) @ level
    share = np.clip((reach * along).sum(axis=3) / np.maximum((along**2).sum(axis=3), 1e-12), 0.0, 1.0)
    return np.linalg.norm(reach - share[..., None] * along, axis=3)


def foot_poses(model: Model, motion: Motion) -> FootPoses | None:
    """Feet over a motion without its frames that have gaps; None for a model without feet."""
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
        model, tree, forward_kinematics(tree, tree.coordinates_of(motion)), np.asarray(motion.time), feet, owners
    )
