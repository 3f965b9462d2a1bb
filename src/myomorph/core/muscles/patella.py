"""The patella as a lever between quadriceps and patellar tendon.

The tension of the tendon is that of quadriceps times a ratio that changes with flexion.

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
from myomorph.core.model.latest import Latest
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.shapes import ArmPairs, Coordinates, MuscleValues, Pulls
from myomorph.core.model.spatial import cross_products
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.rigid.coordinates import Ints, couple_rates_frames
from myomorph.core.rigid.kinematics import body_motion
from myomorph.core.rigid.knees import flexion_coordinate, knee_joints

PATELLA = "patella"
# Limits of the ratio; a model that leaves them has no lever there and keeps the nearer one
MIN_RATIO = 0.3
MAX_RATIO = 1.5
MIN_ARM = 0.01  # Of a tendon about the knee's axis that a ratio is computed from [m]


@read_only
class Extensors:
    """Muscles of a model that reach the shank over the patella of one knee.

    Attributes
    ----------
    knee : the joint
    coordinate : number of the coordinate that bends it
    thigh : number of the body above it
    muscles : (muscles,) their numbers
    pairs : (pairs,) rows of `Paths.pull_muscle` that are theirs
    owners : (muscles, pairs) 1 where a row of `pairs` is of a muscle, else 0
    moving : (muscles, arms) 1 where a moment arm of the pattern is of a muscle about the knee, else
        0
    shank : (pairs on the shank,) rows of `Paths.pull_muscle` on the shank and what hangs on it
    shank_owners : (muscles, pairs on the shank) as `owners`
    patella : (muscles,) a row of each muscle on the patella
    """

    knee: Joint
    coordinate: int
    thigh: int
    muscles: Ints
    pairs: Ints
    owners: Array
    moving: Array
    shank: Ints
    shank_owners: Array
    patella: Ints


class TendonArms(NamedTuple):
    """Moment arms of extensors about their knee, below 0 as they all extend it.

    Attributes
    ----------
    path : (frames, muscles) -dl/dq of the whole path, of quadriceps as it acts [m]
    tendon : (frames, muscles) of the part between patella and shank about the knee's axis [m]
    """

    path: MuscleValues
    tendon: MuscleValues

    @property
    def ratio(self) -> MuscleValues:
        """(frames, muscles) tension of the patellar tendon over that of quadriceps.

        1 where the tendon's arm is too small to tell.
        """
        usable = np.abs(self.tendon) > MIN_ARM
        ratio = self.path / np.where(usable, self.tendon, 1.0)
        return np.where(usable, np.clip(ratio, MIN_RATIO, MAX_RATIO), 1.0)


def extensors(paths: Paths) -> tuple[Extensors, ...]:
    """Find the extensors of every knee whose patella moves on the thigh.

    Parameters
    ----------
    paths : of the model's muscles

    Returns
    -------
    a group for each knee; none where the model has no such patella
    """
    return _extensors_of(paths.tree.model)


def _extensors(model: Model) -> Iterator[Extensors]:
    """Find the groups of `extensors`."""
    paths = compile_paths(model)
    for knee in knee_joints(model):
        coordinate = flexion_coordinate(model, knee)
        patella = patella_of(model, knee)
        if not coordinate or patella is None:
            continue
        pairs = _pairs_over_patella(paths, knee, patella)
        if not pairs:
            continue
        on_shank, on_patella = np.array(pairs).T
        muscles, first = np.unique(paths.pull_muscle[on_shank], return_index=True)
        theirs = np.flatnonzero(np.isin(paths.pull_muscle, muscles))
        number = model.coordinate_names.index(coordinate)
        moving = _owners(muscles, paths.arm_muscle) * (paths.arm_coordinate == number)
        yield Extensors(
            knee=knee,
            coordinate=number,
            thigh=paths.tree.body_index[knee.parent],
            muscles=muscles,
            pairs=theirs,
            owners=_owners(muscles, paths.pull_muscle[theirs]),
            moving=moving,
            shank=on_shank,
            shank_owners=_owners(muscles, paths.pull_muscle[on_shank]),
            patella=on_patella[first],
        )


_extensors_of: Latest[tuple[Extensors, ...]] = Latest(lambda model: tuple(_extensors(model)))


def _owners(muscles: Ints, of_rows: Ints) -> Array:
    """(muscles, rows) 1 where a row is of a muscle, else 0."""
    return (muscles[:, None] == of_rows).astype(np.float64)


def _pairs_over_patella(paths: Paths, knee: Joint, patella: str) -> list[tuple[int, int]]:
    """Match the pulls on the shank with those of the same muscle on the patella.

    Returns
    -------
    rows of `Paths.pull_muscle`: on the shank, or what hangs on it, and on the patella
    """
    tree = paths.tree
    hanging = tree.hanging(knee.child)
    on_patella = np.flatnonzero(paths.pull_body == tree.body_index[patella])
    first_of_muscle: dict[int, int] = {}
    for row in on_patella:
        first_of_muscle.setdefault(int(paths.pull_muscle[row]), int(row))
    return [
        (int(row), first_of_muscle[int(paths.pull_muscle[row])])
        for row in np.flatnonzero(hanging[paths.pull_body])
        if int(paths.pull_muscle[row]) in first_of_muscle
    ]


def patella_of(model: Model, knee: Joint) -> str | None:
    """Find the body called patella that hangs on the thigh of a knee, None where there is none."""
    on_thigh = (joint.child for joint in model.joints if joint.parent == knee.parent)
    return next((body for body in on_thigh if PATELLA in body.lower()), None)


def tendon_arms(
    paths: Paths, group: Extensors, coordinates: Coordinates, pulls: Pulls, work: ArmPairs
) -> TendonArms:
    """Moment arms of quadriceps and of its tendon below the patella, by virtual work.

    Where the knee bends at unit speed, a pull (f, m) about the ground's origin has the power

        f . v_0 + m . w

    with the body's velocity v_0 at that origin and its angular velocity w. Summed over a muscle's
    path, with the work of its moving points, that is the path's arm; over the shank, as seen from
    the thigh, the tendon's.

    Parameters
    ----------
    paths : of the model's muscles
    group : extensors of a knee
    coordinates : (frames, coordinates) in the model's order [rad or m]
    pulls, work : of `Paths.pulls`

    Returns
    -------
    arms of the group's muscles
    """
    tree = paths.tree
    c = np.array(coordinates, dtype=np.float64)
    rates = np.zeros_like(c)
    rates[:, group.coordinate] = 1.0
    none = np.zeros_like(c)
    couple_rates_frames(tree.arrays, c, rates, none)
    motion = body_motion(tree, c, rates, none)

    spin = motion.angular_velocities
    # (frames, bodies, 6) velocity at the ground's origin and angular velocity, as pulls are given.
    at_ground = motion.velocities - cross_products(spin, motion.origins)
    twists = np.concatenate([at_ground, spin], axis=2)
    seen_from_thigh = twists - twists[:, group.thigh, None]
    power = _power(pulls[:, group.pairs], twists[:, paths.pull_body[group.pairs]])
    of_tendon = _power(pulls[:, group.shank], seen_from_thigh[:, paths.pull_body[group.shank]])
    return TendonArms(
        path=power @ group.owners.T + work @ group.moving.T,
        tendon=of_tendon @ group.shank_owners.T,
    )


def _power(pulls: Pulls, twists: Array) -> Array:
    """(frames, pairs) power of (frames, pairs, 6) pulls on what moves so [m/s for unit tension]."""
    return np.einsum("fpi,fpi->fp", pulls, twists)


def with_lever(paths: Paths, coordinates: Coordinates, pulls: Pulls, work: ArmPairs) -> Pulls:
    """Compute pulls of unit tensions, where the patellar tendon has a tension of its own.

    What the tendon pulls less at the shank it pulls less at the patella. All other muscles stay as
    they are.

    Parameters
    ----------
    paths, coordinates, pulls, work : as of `tendon_arms`

    Returns
    -------
    (frames, pairs, 6) as of `Paths.pulls`
    """
    result = pulls
    for group in extensors(paths):
        if result is pulls:
            result = pulls.copy()
        ratio = tendon_arms(paths, group, coordinates, pulls, work).ratio
        less_of_pairs = (1.0 - ratio) @ group.shank_owners
        less = less_of_pairs[..., None] * pulls[:, group.shank]
        result[:, group.shank] -= less
        result[:, group.patella] += group.shank_owners @ less
    return result
