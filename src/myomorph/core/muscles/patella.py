"""The patella as a lever: the tension of its tendon is that of quadriceps times a ratio that
changes with flexion.

A path through the patella has one tension in a model, but the tendons of quadriceps and patella do
not: the measured ratio falls from above 1 near extension to about 0.6 in deep flexion. A patella
that moves with the knee does no work of its own, so what the patellar tendon does to the shank
equals what quadriceps does along its path:

    F_tendon = ratio F_quadriceps,   ratio = r_path / r_tendon

with the path's moment arm r_path = -dl/dq and the arm r_tendon of its part on the shank about the
knee's axis.

Source: Buff et al. 1988 and Sheehan 2015, measured ratios; Krevolin et al. 2004, arms of the
patellar tendon.
"""

from __future__ import annotations

from collections.abc import Iterator
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import Joint, Model
from myomorph.core.muscles.path import Paths
from myomorph.core.rigid.coordinates import Ints, couple_rates_frames
from myomorph.core.rigid.kinematics import body_motion
from myomorph.core.rigid.knees import flexion_coordinate, knee_joints

PATELLA = "patella"
# A model whose ratio leaves these has no lever there: the ratio stays at the nearer end
RATIOS = (0.3, 1.5)
MIN_ARM = 0.01  # A tendon nearer to the knee's axis says nothing of a ratio [m]


@read_only
class Extensors:
    """Muscles of a model that reach the shank over the patella of one knee."""

    knee: Joint  # the joint
    coordinate: int  # number of the coordinate that bends it
    muscles: Ints  # (muscles,) their numbers
    shank: Ints
    """(pairs,) of `Paths.pull_muscle` on the shank and what hangs on it"""
    patella: Ints
    """(pairs,) of the same muscles on the patella, in the order of `shank`"""


class TendonArms(NamedTuple):
    """Moment arms of extensors about their knee (frames, muscles) [m], below 0 as they all bend it
    less.
    """

    path: Array  # -dl/dq of the whole path, of quadriceps as it acts
    tendon: Array  # of the part between patella and shank about the knee's axis

    @property
    def ratio(self) -> Array:
        """Tension of the patellar tendon over that of quadriceps."""
        usable = np.abs(self.tendon) > MIN_ARM
        return np.where(
            usable, np.clip(self.path / np.where(usable, self.tendon, 1.0), *RATIOS), 1.0
        )


def extensors(paths: Paths) -> Iterator[Extensors]:
    """Those of every knee whose patella moves on the thigh; none where the model has no such
    patella.
    """
    model = paths.tree.model
    tree = paths.tree
    for knee in knee_joints(model):
        coordinate = flexion_coordinate(model, knee)
        patella = patella_of(model, knee)
        if not coordinate or patella is None:
            continue
        hanging = tree.hanging(knee.child)
        on_patella = np.flatnonzero(paths.pull_body == tree.body_index[patella])
        pairs = [
            (pair, own[0])
            for pair in np.flatnonzero(hanging[paths.pull_body])
            if len(own := on_patella[paths.pull_muscle[on_patella] == paths.pull_muscle[pair]])
        ]
        if pairs:
            shank, upper = np.array(pairs).T
            muscles = np.unique(paths.pull_muscle[shank])
            yield Extensors(
                knee=knee,
                coordinate=model.coordinate_names.index(coordinate),
                muscles=muscles,
                shank=shank,
                patella=upper,
            )


def patella_of(model: Model, knee: Joint) -> str | None:
    """Body called patella that hangs on the thigh of a knee, None where there is none."""
    return next(
        (
            joint.child
            for joint in model.joints
            if joint.parent == knee.parent and PATELLA in joint.child.lower()
        ),
        None,
    )


def tendon_arms(
    paths: Paths, group: Extensors, coordinates: Array, pulls: Array, work: Array
) -> TendonArms:
    """Moment arms of quadriceps and of its tendon below the patella, by virtual work.
    `coordinates` (frames, coordinates) in the model's order [rad or m]; `pulls`, `work`: of
    `Paths.pulls`.
    """
    tree = paths.tree
    c = np.array(coordinates, dtype=np.float64)
    rates = np.zeros_like(coordinates)
    rates[:, group.coordinate] = 1.0
    none = np.zeros_like(c)
    couple_rates_frames(tree.arrays, c, rates, none)
    moved = body_motion(tree, c, rates, none)
    # Velocity of each body's point at the ground's origin: what the wrenches there work along.
    spin = moved.angular_velocities
    velocity = moved.velocities - np.cross(spin, moved.origins)
    power = np.einsum("fpi,fpi->fp", pulls[..., :3], velocity[:, paths.pull_body])
    power += np.einsum("fpi,fpi->fp", pulls[..., 3:], spin[:, paths.pull_body])
    thigh = tree.body_index[group.knee.parent]
    against = np.einsum("fpi,fi->fp", pulls[..., :3], velocity[:, thigh])
    against += np.einsum("fpi,fi->fp", pulls[..., 3:], spin[:, thigh])
    arms = [np.zeros((len(c), len(group.muscles))) for _ in range(2)]
    for column, muscle in enumerate(group.muscles):
        moving = (paths.arm_muscle == muscle) & (paths.arm_coordinate == group.coordinate)
        arms[0][:, column] = power[:, paths.pull_muscle == muscle].sum(axis=1) + work[
            :, moving
        ].sum(axis=1)
        own = group.shank[paths.pull_muscle[group.shank] == muscle]
        arms[1][:, column] = (power[:, own] - against[:, own]).sum(axis=1)
    return TendonArms(*arms)


def with_lever(paths: Paths, coordinates: Array, pulls: Array, work: Array) -> Array:
    """Pulls of unit tensions of quadriceps, with the patellar tendon's own tension below the
    patella. What the tendon pulls less at the shank it pulls less at the patella; all other muscles
    stay as they are. `coordinates`, `pulls`, `work`: as of `tendon_arms`. Returns (frames, pairs,
    6) as `Paths.pulls` has them.
    """
    result = pulls
    for group in extensors(paths):
        if result is pulls:
            result = pulls.copy()
        ratio = tendon_arms(paths, group, coordinates, pulls, work).ratio
        columns = np.searchsorted(group.muscles, paths.pull_muscle[group.shank])
        for shank, patella, column in zip(group.shank, group.patella, columns, strict=True):
            less = (1.0 - ratio[:, column, None]) * pulls[:, shank]
            result[:, shank] -= less
            result[:, patella] += less
    return result
