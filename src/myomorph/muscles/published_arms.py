"""Moment arms about the knee that were measured, and the muscles of a model that leave them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.model import Joint, Model
from myomorph.model.series import Motion
from myomorph.muscles.patella import extensors, tendon_arms
from myomorph.muscles.path import compile_paths
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.knees import flexion_coordinate, knee_joints
from myomorph.rigid.tree import compile_tree

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
