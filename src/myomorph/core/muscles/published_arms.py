"""Moment arms about knee and ankle that were measured, and muscles of a model that leave them."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import MUSCLES
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Joint, Model
from myomorph.core.model.series import Motion
from myomorph.core.muscles.model_paths import Paths, compile_paths
from myomorph.core.muscles.patella import PATELLA, extensors, tendon_arms
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.knees import flexion_coordinate, flexion_sign, joint_above, knee_joints
from myomorph.core.rigid.tree import compile_tree

THIGH_LENGTH = 0.41  # From hip to knee of the persons that were measured [m]
HUMAN_THIGH_LENGTHS = (0.22, 0.6)  # [m]
MAX_FLEXION = 120.0  # To which bands were measured [deg]
FLEXION_STEP = 5.0  # Between flexions at which a model is compared [deg]
TOLERANCE = 0.003  # Distance from a band that triggers no warning [m]


@dataclass(frozen=True)
class Band:
    """Measured moment arms over knee flexion.

    Two standard deviations about the means, or all persons.

    Attributes
    ----------
    name : of the muscle or tendon
    muscles : beginnings of muscles' names, lower case without underscores; () for a tendon
    bends : 1 for flexors, -1 for extensors
    flexion : (angles,) [deg]
    low, high : (angles,) least and greatest moment arm there [cm]
    source : of the numbers
    """

    name: str
    muscles: tuple[str, ...]
    bends: float
    flexion: tuple[float, ...]
    low: tuple[float, ...]
    high: tuple[float, ...]
    source: str

    def holds(self, muscle: str) -> bool:
        """Whether a muscle of this name is one of the band's."""
        return muscle.lower().replace("_", "").startswith(self.muscles)

    def ends(self, flexion: Array, size: float) -> tuple[Array, Array]:
        """Lower and upper end of the band, interpolated in flexion.

        Parameters
        ----------
        flexion : (angles,) [deg]
        size : of the body, over that of the persons who were measured

        Returns
        -------
        low, high : (angles,) [m]
        """
        low = size * (0.01 * np.interp(flexion, self.flexion, self.low))
        high = size * (0.01 * np.interp(flexion, self.flexion, self.high))
        return low, high


QUADRICEPS = Band(
    name="quadriceps",
    muscles=("vas", "rectfem", "recfem"),
    bends=-1.0,
    flexion=(10.0, 50.0, 90.0, 120.0),
    low=(3.2, 2.2, 1.5, 1.2),
    high=(6.0, 4.8, 3.5, 3.2),
    source="Fiorentino and Sheehan 2015 "
    "(and beyond 50° Krevolin et al. 2004 with Buff et al. 1988)",
)
PATELLAR_TENDON = Band(
    name="patellar tendon",
    muscles=(),
    bends=-1.0,
    flexion=(0.0, 45.0, 90.0, 120.0),
    low=(3.0, 3.2, 2.7, 2.5),
    high=(6.0, 6.0, 5.5, 5.0),
    source="Krevolin et al. 2004, Sheehan 2007 and Dandridge et al. 2022",
)
BICEPS_FEMORIS = Band(
    name="biceps femoris, long head",
    muscles=("bflh", "bifemlh"),
    bends=1.0,
    flexion=(0.0, 30.0, 90.0, 120.0),
    low=(1.2, 1.5, 1.0, 0.0),
    high=(4.0, 4.5, 4.8, 4.8),
    source="Spoor and van Leeuwen 1992 and Buford et al. 1997",
)
SEMIMEMBRANOSUS = Band(
    name="semimembranosus",
    muscles=("semimem",),
    bends=1.0,
    flexion=(0.0, 30.0, 90.0, 120.0),
    low=(1.5, 2.0, 1.5, 0.0),
    high=(5.0, 5.5, 6.0, 5.5),
    source="Spoor and van Leeuwen 1992 and Buford et al. 1997",
)
SEMITENDINOSUS = Band(
    name="semitendinosus",
    muscles=("semiten",),
    bends=1.0,
    flexion=(0.0, 30.0, 90.0, 120.0),
    low=(2.5, 3.0, 2.5, 0.5),
    high=(5.5, 6.3, 7.0, 6.5),
    source="Spoor and van Leeuwen 1992 and Buford et al. 1997",
)
ACHILLES = Band(
    name="Achilles tendon",
    muscles=(),
    bends=-1.0,
    flexion=(0.0,),
    low=(3.2,),
    high=(6.5,),
    source="17 studies that Manal et al. 2013 list, and Wolfram et al. 2018",
)
TIBIALIS_ANTERIOR = Band(
    name="tibialis anterior",
    muscles=(),
    bends=1.0,
    flexion=(-30.0, 15.0),
    low=(2.5, 4.0),
    high=(4.5, 6.0),
    source="Maganaris 2000, at rest and contracted",
)
BANDS = (QUADRICEPS, PATELLAR_TENDON, BICEPS_FEMORIS, SEMIMEMBRANOSUS, SEMITENDINOSUS)


@read_only
class KneeArms:
    """Moment arms of a muscle or tendon about one knee, with their band.

    Attributes
    ----------
    name : of the muscle, or of the tendon with its knee
    flexion : (angles,) [deg]
    arms : (angles,) above 0 for the direction that the band expects [m]
    low, high : (angles,) ends of the band at the model's size [m]
    """

    band: Band
    name: str
    flexion: Array
    arms: Array
    low: Array
    high: Array

    @property
    def beyond(self) -> Array:
        """(angles,) distance outside the band, below 0 under it, 0 in it [m]."""
        below = np.minimum(self.arms - self.low, 0.0)
        return np.where(self.arms > self.high, self.arms - self.high, below)

    @property
    def text(self) -> str:
        """The farthest arm in words, "" where all lie within `TOLERANCE` of the band."""
        worst = int(np.argmax(np.abs(self.beyond)))
        if abs(self.beyond[worst]) <= TOLERANCE:
            return ""
        arm = 100.0 * self.arms[worst]
        low = 100.0 * self.low[worst]
        high = 100.0 * self.high[worst]
        flexion = self.flexion[worst]
        return f"{self.name} {arm:.1f} cm at {flexion:.0f}° ({low:.1f} to {high:.1f})"


@read_only
class FlexedKnee:
    """A knee at several flexions, all else at its default.

    Attributes
    ----------
    knee : the joint
    coordinate : name of its flexion
    sign : -1 where the model counts flexion below 0, else 1
    flexion : (angles,) [deg]
    coordinates : (angles, coordinates) of the model [rad or m]
    """

    knee: Joint
    coordinate: str
    sign: float
    flexion: Array
    coordinates: Array


def knee_arms(model: Model) -> tuple[KneeArms, ...]:
    """Moment arms about the knees of a human model that have a published band.

    Returns
    -------
    arms over the flexion that the model allows; none for a model without muscles or knees, with
    closed loops, or not as large as a person
    """
    if model.loops:
        return ()
    model = _with_compared_muscles(model)
    if not model.muscles:
        return ()
    result: list[KneeArms] = []
    for knee in knee_joints(model):
        coordinate = flexion_coordinate(model, knee)
        size = size_of_person(model, knee)
        if coordinate and size is not None:
            result += _of_knee(model, knee, coordinate, size)
    return tuple(result)


def size_of_person(model: Model, knee: Joint) -> float | None:
    """Size of a body over that of the persons who were measured, by the thigh above a knee.

    None for a thigh without a hip, or one that is no person's.
    """
    length = _thigh(model, knee)
    shortest, longest = HUMAN_THIGH_LENGTHS
    if length is None or not shortest < length < longest:
        return None
    return length / THIGH_LENGTH


def _with_compared_muscles(model: Model) -> Model:
    """Keep only the muscles that a band is about, by name or as part of the patellar tendon."""
    surfaces = {surface.name: surface.body for surface in model.wrap_objects}
    muscles = []
    for muscle in model.muscles:
        bodies = {point.body for point in muscle.path.points}
        bodies |= {surfaces.get(wrap.wrap_object, "") for wrap in muscle.path.wraps}
        on_patella = any(PATELLA in body.lower() for body in bodies)
        if on_patella or any(band.holds(muscle.name) for band in BANDS):
            muscles.append(muscle)
    return replace(model, muscles=tuple(muscles))


def _thigh(model: Model, knee: Joint) -> float | None:
    """Distance from hip to knee in the default pose [m], None without a hip."""
    hip = joint_above(model, knee.parent)
    if hip is None:
        return None
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    bodies = np.array([tree.body_index[hip.child], tree.body_index[knee.child]])
    ends = poses.points(
        bodies, np.array([hip.child_frame.translation, knee.child_frame.translation])
    )[0]
    return float(np.linalg.norm(ends[0] - ends[1]))


def _of_knee(model: Model, knee: Joint, coordinate: str, size: float) -> list[KneeArms]:
    """Arms of all muscles and the tendon about one knee.

    Parameters
    ----------
    coordinate : name of the knee's flexion
    size : of the body, over that of the persons who were measured
    """
    sign = flexion_sign(model, coordinate)
    least, greatest = np.degrees(model.coordinate(coordinate).range)
    max_flexion = min(MAX_FLEXION, max(sign * least, sign * greatest))
    flexion = np.arange(0.0, max_flexion + 1e-6, FLEXION_STEP)
    if not len(flexion):
        return []

    angles = np.asarray(sign * np.radians(flexion)[:, None], dtype=np.float64)
    times = 0.01 * np.arange(len(flexion), dtype=np.float64)  # any: only the poses count
    paths = compile_paths(model)
    postures = Motion(times, (coordinate,), angles)
    coordinates = paths.tree.coordinates_of(postures)
    flexed = FlexedKnee(
        knee=knee, coordinate=coordinate, sign=sign, flexion=flexion, coordinates=coordinates
    )
    return [
        *_of_muscles(paths, flexed, size),
        *_of_tendon(paths, flexed, size),
    ]


def _of_muscles(paths: Paths, flexed: FlexedKnee, size: float) -> Iterator[KneeArms]:
    """Arms of the muscles that have a band."""
    model = paths.tree.model
    _, _, arms = paths.evaluate(flexed.coordinates)
    column = model.coordinate_names.index(flexed.coordinate)
    of_flexion = np.flatnonzero(paths.arm_coordinate == column)
    for band in BANDS:
        low, high = band.ends(flexed.flexion, size)
        for pair in of_flexion:
            muscle = model.muscle_names[paths.arm_muscle[pair]]
            if band.holds(muscle):
                yield KneeArms(
                    band=band,
                    name=muscle,
                    flexion=flexed.flexion,
                    arms=flexed.sign * band.bends * arms[:, pair],
                    low=low,
                    high=high,
                )


def _of_tendon(paths: Paths, flexed: FlexedKnee, size: float) -> Iterator[KneeArms]:
    """Arms of the patellar tendon, as the mean of the muscles that reach the shank over it."""
    low, high = PATELLAR_TENDON.ends(flexed.flexion, size)
    for group in extensors(paths):
        if group.knee.name != flexed.knee.name:
            continue
        pulls, work = paths.pulls(flexed.coordinates)
        arms = tendon_arms(paths, group, flexed.coordinates, pulls, work).tendon.mean(axis=1)
        yield KneeArms(
            band=PATELLAR_TENDON,
            name=f"{PATELLAR_TENDON.name} of {flexed.knee.name}",
            flexion=flexed.flexion,
            arms=flexed.sign * PATELLAR_TENDON.bends * arms,
            low=low,
            high=high,
        )


def arm_warnings(model: Model) -> tuple[Message, ...]:
    """Write one line for every band that muscles of a model leave.

    Each names the muscles, how far and at what angle they leave it, and who measured it.
    """
    all_arms = knee_arms(model)
    lines = []
    for band in BANDS:
        texts = [arms.text for arms in all_arms if arms.band is band and arms.text]
        if texts:
            lines.append(
                MUSCLES.message(
                    f"moment arms at the knee, {band.name}: {', '.join(texts)}; "
                    f"in brackets what {band.source} measured"
                )
            )
    return tuple(lines)
