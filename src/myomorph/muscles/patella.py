"""The patella as a lever: the tension of its tendon is that of quadriceps times a ratio that changes with flexion.

A path through the patella has one tension in a model, but the tendons of quadriceps and patella do not: the measured
ratio falls from above 1 near extension to about 0.6 in deep flexion. A patella that moves with the knee does no work of
its own, so what the patellar tendon does to the shank equals what quadriceps does along its path:

    F_tendon = ratio F_quadriceps,   ratio = r_path / r_tendon

with the path's moment arm r_path = -dl/dq and the arm r_tendon of its part on the shank about the knee's axis.

Arms about the knee that were measured tell which muscles of a model leave them.

Source: Buff et al. 1988 and Sheehan 2015, measured ratios; Krevolin et al. 2004, arms of the patellar tendon.
"""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Joint, Model
from myomorph.model.series import Motion
from myomorph.muscles.path import Paths, compile_paths
from myomorph.rigid.coordinates import Ints, couple_rates_frames
from myomorph.rigid.kinematics import body_motion, forward_kinematics
from myomorph.rigid.knees import flexion_coordinate, knee_joints
from myomorph.rigid.tree import compile_tree

PATELLA = "patella"
RATIOS = (0.3, 1.5)  # A model whose ratio leaves these has no lever there: the ratio stays at the nearer end
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
    """Moment arms of extensors about their knee (frames, muscles) [m], below 0 as they all bend it less."""

    path: Array  # -dl/dq of the whole path, of quadriceps as it acts
    tendon: Array  # of the part between patella and shank about the knee's axis

    @property
    def ratio(self) -> Array:
        """Tension of the patellar tendon over that of quadriceps."""
        usable = np.abs(self.tendon) > MIN_ARM
        return np.where(usable, np.clip(self.path / np.where(usable, self.tendon, 1.0), *RATIOS), 1.0)


def extensors(paths: Paths) -> Iterator[Extensors]:
    """Those of every knee whose patella moves on the thigh; none where the model has no such patella."""
    model, tree = paths.tree.model, paths.tree
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
            yield Extensors(knee, model.coordinate_names.index(coordinate), muscles, shank, upper)


def patella_of(model: Model, knee: Joint) -> str | None:
    """Body called patella that hangs on the thigh of a knee, None where there is none."""
    return next(
        (joint.child for joint in model.joints if joint.parent == knee.parent and PATELLA in joint.child.lower()), None
    )


def tendon_arms(paths: Paths, group: Extensors, coordinates: Array, pulls: Array, work: Array) -> TendonArms:
    """Moment arms of quadriceps and of its tendon below the patella, by virtual work.
    `coordinates` (frames, coordinates) in the model's order [rad or m]; `pulls`, `work`: of `Paths.pulls`.
    """
    tree = paths.tree
    c, rates = np.array(coordinates, dtype=np.float64), np.zeros_like(coordinates)
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
        arms[0][:, column] = power[:, paths.pull_muscle == muscle].sum(axis=1) + work[:, moving].sum(axis=1)
        own = group.shank[paths.pull_muscle[group.shank] == muscle]
        arms[1][:, column] = (power[:, own] - against[:, own]).sum(axis=1)
    return TendonArms(*arms)


def with_lever(paths: Paths, coordinates: Array, pulls: Array, work: Array) -> Array:
    """Pulls of unit tensions of quadriceps, with the patellar tendon's own tension below the patella.
    What the tendon pulls less at the shank it pulls less at the patella; all other muscles stay as they are.
    `coordinates`, `pulls`, `work`: as of `tendon_arms`. Returns (frames, pairs, 6) as `Paths.pulls` has them.
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


THIGH_LENGTH = 0.41  # From hip to knee of the persons that were measured [m]; bands grow with a model's
HUMAN = (0.22, 0.6)  # Thighs of people have such lengths [m]
MARGIN = 0.003  # So far beside a band an arm may lie that nobody warns of [m]
STEP = 5.0  # Between flexions at which a model is looked at [deg]


@dataclass(frozen=True)
class Band:
    """Measured moment arms over knee flexion: two standard deviations about the means, or all persons."""

    name: str
    muscles: tuple[str, ...]  # how their names begin, lower case without underscores; () for the patellar tendon
    bends: float  # 1 for flexors, -1 for extensors
    flexion: tuple[float, ...]  # [deg]
    # low, high: there [cm]
    low: tuple[float, ...]
    high: tuple[float, ...]
    source: str  # of the numbers

    def at(self, flexion: Array) -> tuple[Array, Array]:
        """Ends of the band between its flexions [m]."""
        return tuple(0.01 * np.interp(flexion, self.flexion, end) for end in (self.low, self.high))  # type: ignore[return-value]


BANDS = (
    Band(
        "quadriceps", ("vas", "rectfem", "recfem"), -1.0, (10.0, 50.0, 90.0, 120.0), (3.2, 2.2, 1.5, 1.2),
        (6.0, 4.8, 3.5, 3.2), "Fiorentino and Sheehan 2015 (and beyond 50° Krevolin et al. 2004 with Buff et al. 1988)",
    ),
    Band(
        "patellar tendon", (), -1.0, (0.0, 45.0, 90.0, 120.0), (3.0, 3.2, 2.7, 2.5), (6.0, 6.0, 5.5, 5.0),
        "Krevolin et al. 2004, Sheehan 2007 and Dandridge et al. 2022",
    ),
    Band(
        "biceps femoris, long head", ("bflh", "bifemlh"), 1.0, (0.0, 30.0, 90.0, 120.0), (1.2, 1.5, 1.0, 0.0),
        (4.0, 4.5, 4.8, 4.8), "Spoor and van Leeuwen 1992 and Buford et al. 1997",
    ),
    Band(
        "semimembranosus", ("semimem",), 1.0, (0.0, 30.0, 90.0, 120.0), (1.5, 2.0, 1.5, 0.0), (5.0, 5.5, 6.0, 5.5),
        "Spoor and van Leeuwen 1992 and Buford et al. 1997",
    ),
    Band(
        "semitendinosus", ("semiten",), 1.0, (0.0, 30.0, 90.0, 120.0), (2.5, 3.0, 2.5, 0.5), (5.5, 6.3, 7.0, 6.5),
        "Spoor and van Leeuwen 1992 and Buford et al. 1997",
    ),
)  # fmt: skip


@read_only
class KneeArms:
    """Moment arms of what a band is of, on one knee."""

    band: Band
    name: str  # of the muscle, or of the tendon with its knee
    flexion: Array  # (angles,) [deg]
    arms: Array  # (angles,) above 0 for what the band expects [m]
    # low, high: (angles,) of the band, grown with the thigh [m]
    low: Array
    high: Array

    @property
    def beyond(self) -> Array:
        """(angles,) how far an arm lies outside the band, below 0 under it [m]."""
        return np.where(self.arms > self.high, self.arms - self.high, np.minimum(self.arms - self.low, 0.0))

    @property
    def text(self) -> str:
        """The worst of it in words, "" where all lies in the band or at most `MARGIN` beside it."""
        worst = int(np.argmax(np.abs(self.beyond)))
        if abs(self.beyond[worst]) <= MARGIN:
            return ""
        low, high = 100.0 * self.low[worst], 100.0 * self.high[worst]
        return f"{self.name} {100.0 * self.arms[worst]:.1f} cm at {self.flexion[worst]:.0f}° ({low:.1f} to {high:.1f})"


def knee_arms(model: Model) -> tuple[KneeArms, ...]:
    """Moment arms about the knees of a human model that have a published band, over the flexion that it allows.
    Without any for a model without muscles or knees, with closed loops, or not as large as a person.
    """
    if not model.muscles or model.loops:
        return ()
    result: list[KneeArms] = []
    for knee in knee_joints(model):
        coordinate, length = flexion_coordinate(model, knee), _thigh(model, knee)
        if coordinate and length is not None and HUMAN[0] < length < HUMAN[1]:
            result += _of_knee(model, knee, coordinate, length / THIGH_LENGTH)
    return tuple(result)


def _thigh(model: Model, knee: Joint) -> float | None:
    """Distance from hip to knee in the default pose [m], None without a hip."""
    hip = next((joint for joint in model.joints if joint.child == knee.parent), None)
    if hip is None:
        return None
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    bodies = np.array([tree.body_index[hip.child], tree.body_index[knee.child]])
    ends = poses.points(bodies, np.array([hip.child_frame.translation, knee.child_frame.translation]))[0]
    return float(np.linalg.norm(ends[0] - ends[1]))


def _of_knee(model: Model, knee: Joint, coordinate: str, size: float) -> list[KneeArms]:
    low, high = np.degrees(model.coordinate(coordinate).range)
    sign = -1.0 if abs(low) > abs(high) else 1.0
    flexion = np.arange(0.0, min(120.0, max(sign * low, sign * high)) + 1e-6, STEP)
    if not len(flexion):
        return []
    angles = np.asarray(sign * np.radians(flexion)[:, None], dtype=np.float64)
    motion = Motion(0.01 * np.arange(len(flexion), dtype=np.float64), (coordinate,), angles)
    paths = compile_paths(model)
    values = paths.tree.coordinates_of(motion)
    _, _, arms = paths.evaluate(values)
    number = model.coordinate_names.index(coordinate)
    result = []
    for band in BANDS:
        ends = [size * end for end in band.at(flexion)]
        for pair in np.flatnonzero(paths.arm_coordinate == number):
            name = model.muscle_names[paths.arm_muscle[pair]]
            if name.lower().replace("_", "").startswith(band.muscles or ("\0",)):
                result.append(KneeArms(band, name, flexion, sign * band.bends * arms[:, pair], ends[0], ends[1]))
    for group in extensors(paths):
        if group.knee.name == knee.name:
            band = next(each for each in BANDS if not each.muscles)
            tendon = tendon_arms(paths, group, values, *paths.pulls(values)).tendon.mean(axis=1)
            ends = [size * end for end in band.at(flexion)]
            result.append(KneeArms(band, f"{band.name} of {knee.name}", flexion, -sign * tendon, ends[0], ends[1]))
    return result


def arm_warnings(model: Model) -> tuple[str, ...]:
    """One line for every band that muscles of a model leave: which, how far, at what angle, and who measured it."""
    found = knee_arms(model)
    lines = []
    for band in BANDS:
        texts = [arms.text for arms in found if arms.band is band and arms.text]
        if texts:
            lines.append(
                f"moment arms at the knee, {band.name}: {', '.join(texts)}; in brackets what {band.source} measured"
            )
    return tuple(lines)
