"""Six virtual specimens with the values of [S] tables I and II, swung in MuJoCo.

The values are masses, centers of mass and viscosities. Bones and muscles are those of the arm that
is bundled with `myo-sim`. The tables' viscosities cannot all hold with muscles of that size:
(d_{M+J} - d_J) / d_M is the mean square of the moment arms, about 3.3 mm, where the model's are
some 20 mm. So the muscles are scaled about the joint's center (`VirtualSpecimen.factor`) until the
total viscosity over the true swing is that of table II; or they keep their size and d_M is made to
fit.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from functools import lru_cache

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.core.io.mjcf.composed import composed_model
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import Model
from myomorph.core.model.spatial import Transform, least_rotation
from myomorph.swings.simulate.laboratory import (
    Instruments,
    Noise,
    Sampled,
    VirtualTrial,
    measured_markers,
    measured_wrench,
    simulate,
)
from myomorph.swings.simulate.limb import (
    BaseLoad,
    HeldLimb,
    SwungLimb,
    with_clusters,
    with_scaled_muscles,
)
from myomorph.swings.viscosity.cohort import SPECIMENS, PublishedSpecimen
from myomorph.swings.viscosity.specimen.model import (
    Specimen,
    SpecimenNames,
    SwingTrial,
    build_specimen,
)
from myomorph.swings.viscosity.specimen.muscles import fig1_muscles

BASE = "scapula_r"
FIRST = "humerus_r"
FURTHER = ("ulna_r", "radius_r", "thirdmc_r")
HELD = {"elbow_flexion_r": np.deg2rad(20.0), "pro_sup_r": np.deg2rad(15.0)}
"""The wires of [S] hold the elbow and the forearm so; the wrist is straight [rad]."""
STEP = 2.5e-3
COARSE = 5e-3  # Of the integrator, and where the muscles' scale is sought [s].
USUAL_ARM = 0.02  # A moment arm of a shoulder muscle, where the search begins [m].
PLATE = np.array([0.2, 0.0, -0.8])  # Origin of the plate, from the joint's center, in ground [m].
TIGHT = 1e-5  # Relative change of the muscles' scale at which its search ends.


@read_only
class VirtualCondition:
    """What truly is of a specimen with its muscles or without, and what was recorded."""

    parameters: Array  # (10,) of the limb about the joint's center, in the axes of its first bone
    # d_J, or with muscles d_{M+J}: the one value nearest to the passive torque of all trials [N m
    # s/rad]
    viscosity: float
    trials: tuple[VirtualTrial, ...]

    @property
    def mass(self) -> float:
        """[kg]."""
        return float(self.parameters[0])

    @property
    def com(self) -> float:
        """Distance of the mass center from the joint's center [m]."""
        return float(np.linalg.norm(self.parameters[1:4]) / self.parameters[0])

    def swing_trials(self) -> tuple[SwingTrial, ...]:
        """As the identification takes them."""
        return tuple(SwingTrial(trial.name, trial.markers, trial.wrenches) for trial in self.trials)


@dataclass(frozen=True, eq=False)
class VirtualSpecimen:
    """A virtual specimen and its recordings."""

    published: PublishedSpecimen  # the row of [S] tables I and II that it is made after
    specimen: Specimen  # its model, with exact markers and muscles
    without: VirtualCondition
    intact: VirtualCondition
    joint_viscosity: float
    muscle_viscosity: float  # d_M of every muscle [N s/m]
    factor: float  # of the muscles' size about the joint's center, 1 for the model's own
    # root mean square over the muscles and the intact swings, of the arm that the motion uses:
    # lengthening speed over angular speed [m]
    moment_arm: float
    noise: Noise


@lru_cache(maxsize=1)
def arm_model() -> Model:
    """Return the arm that is bundled with `myo-sim`."""
    return composed_model("myoarm")


@lru_cache(maxsize=1)
def arm_specimen() -> Specimen:
    """Return the specimen of [S] from that arm.

    It has five bones with three markers each, and the muscles of figure 1.
    """
    model = arm_model()
    names = SpecimenNames(base=BASE, first=FIRST, bones=FURTHER, muscles=fig1_muscles(model))
    return with_clusters(build_specimen(model, names))


@dataclass(frozen=True, eq=False, kw_only=True)
class Setup:
    """Setup of a virtual experiment.

    Attributes
    ----------
    noise : of the instruments; by default 0.3 mm, 0.3 N, and clocks apart by tens of milliseconds
        and of millionths
    full_size : muscles of the model's size, and d_M such that the total viscosity is the table's
    loads : on the base, muscles removed and intact
    """

    noise: Noise | None = None
    full_size: bool = False
    loads: tuple[BaseLoad | None, BaseLoad | None] = (None, None)


def virtual_specimen(
    number: int, *, seconds: float = 10.0, trials: int = 3, setup: Setup | None = None
) -> VirtualSpecimen:
    """Simulate one of the six specimens (the row of the tables) without muscles and with them."""
    if not 1 <= number <= len(SPECIMENS):
        raise BadData(f"there is no specimen {number}: [S] has 1 to {len(SPECIMENS)}")
    setup = setup or Setup()
    row = SPECIMENS[number - 1]
    random = np.random.default_rng(number)
    instruments = Instruments(
        setup.noise or Noise(offset=random.uniform(-0.04, 0.04), drift=random.uniform(-5e-5, 5e-5)),
        random,
    )
    specimen = arm_specimen()
    specimen = specimen.standing(mounted(specimen.stand, random))
    limb = HeldLimb(specimen, HELD)
    bare = limb.parameters(row.mass_muscles_removed, row.com_muscles_removed)
    whole = limb.with_muscle_mass(bare, row.mass_intact, row.com_intact)
    starts = [released(random) for _ in range(trials)]
    limb, factor, muscle = _sized(limb, row, whole, starts, seconds, setup.full_size)
    viscosity = row.joint_viscosity
    swings = _swings(limb, whole, viscosity, muscle, starts, seconds, load=setup.loads[1])
    bare_swings = _swings(limb, bare, viscosity, 0.0, starts, seconds, load=setup.loads[0])
    arm = _mean_square_arm(swings)
    return VirtualSpecimen(
        published=row,
        specimen=limb.specimen,
        without=VirtualCondition(
            bare, viscosity, _recorded(limb, bare_swings, "without", instruments)
        ),
        intact=VirtualCondition(
            whole, viscosity + muscle * arm, _recorded(limb, swings, "with", instruments)
        ),
        joint_viscosity=viscosity,
        muscle_viscosity=muscle,
        factor=factor,
        moment_arm=float(np.sqrt(arm / len(limb.specimen.model.muscles))),
        noise=instruments.noise,
    )


def bare_swing(number: int, seconds: float) -> tuple[Specimen, VirtualCondition]:
    """Release one of the six specimens once, without its muscles.

    Parameters
    ----------
    number : row of the tables
    seconds : that are recorded [s]

    Returns
    -------
    specimen with exact markers, and what is recorded
    """
    row = SPECIMENS[number - 1]
    random = np.random.default_rng(number)
    specimen = arm_specimen()
    specimen = specimen.standing(mounted(specimen.stand, random))
    limb = HeldLimb(specimen, HELD)
    bare = limb.parameters(row.mass_muscles_removed, row.com_muscles_removed)
    swings = _swings(limb, bare, row.joint_viscosity, 0.0, [released(random)], seconds)
    trials = _recorded(limb, swings, "without", Instruments(Noise(), random))
    return specimen, VirtualCondition(bare, row.joint_viscosity, trials)


def _sized(
    limb: HeldLimb,
    row: PublishedSpecimen,
    parameters: Array,
    starts: Sequence[tuple[Array, Array]],
    seconds: float,
    full_size: bool,
) -> tuple[HeldLimb, float, float]:
    """Return the limb, and its muscles' scale and viscosity that give the total viscosity.

    One of the two is sought, by fixed point: the swing that weighs the moment arms depends on them
    too.
    """
    excess = row.total_viscosity - row.joint_viscosity
    factor, muscle = (1.0, excess / USUAL_ARM**2) if full_size else (0.1, row.muscle_viscosity)
    for _ in range(12):
        made = HeldLimb(with_scaled_muscles(limb, factor), limb.held)
        swings = _swings(made, parameters, row.joint_viscosity, muscle, starts, seconds, COARSE)
        change = excess / (muscle * _mean_square_arm(swings))
        if abs(change - 1.0) < TIGHT:
            break
        factor, muscle = (
            (1.0, muscle * change) if full_size else (factor * float(np.sqrt(change)), muscle)
        )
    return made, factor, muscle


def _mean_square_arm(swings: Sequence[Sampled]) -> float:
    """Return the factor from a common muscle viscosity to that of the joint [m^2].

    The joint's viscosity is the nearest one.
    """
    speeds = sum(float(np.sum(swing.lengthening**2)) for swing in swings)
    return speeds / sum(float(np.sum(swing.rates**2)) for swing in swings)


def _swings(
    limb: HeldLimb,
    parameters: Array,
    damping: float,
    muscle: float,
    starts: Sequence[tuple[Array, Array]],
    seconds: float,
    step: float = STEP,
    load: BaseLoad | None = None,
) -> list[Sampled]:
    rest = hanging(limb, parameters)
    compiled = mujoco.MjModel.from_xml_string(
        SwungLimb(
            limb=limb,
            parameters=parameters,
            stand=limb.specimen.stand,
            rest=rest,
            damping=damping,
            muscle=muscle,
            load=load,
        ).mjcf
    )
    result = []
    for axis, rates in starts:
        turn = Rotation.from_rotvec(rest.T @ axis).as_quat(scalar_first=True)
        result.append(simulate(compiled, turn, rest.T @ rates, seconds, step))
    return result


def hanging(limb: HeldLimb, parameters: Array) -> Array:
    """Return the orientation of the limb where it hangs at rest.

    It is rotated the shortest way from the model's default pose.

    Parameters
    ----------
    limb : in its held pose
    parameters : (10,) of the limb, [D] order

    Returns
    -------
    (3, 3) of the limb in ground
    """
    model = limb.specimen.model
    joint = next(joint for joint in model.joints if joint.child == limb.specimen.first)
    pose = limb.specimen.stand.rotation @ joint.parent_frame.rotation
    start = pose @ parameters[1:4]
    down = np.asarray(model.gravity) / np.linalg.norm(model.gravity)
    return least_rotation(start / np.linalg.norm(start), down) @ pose


def released(random: np.random.Generator) -> tuple[Array, Array]:
    """Draw a release by hand.

    Parameters
    ----------
    random : generator

    Returns
    -------
    (3,) rotation vector from hanging [rad] and (3,) angular velocity [rad/s], in ground
    """
    azimuth = random.uniform(0.0, 2.0 * np.pi)
    level = np.array([np.cos(azimuth), np.sin(azimuth), 0.0])
    across = np.array([-level[1], level[0], 0.0])
    tilt = random.uniform(0.6, 0.9) * level + np.array([0.0, 0.0, random.uniform(-0.3, 0.3)])
    return tilt, random.uniform(0.1, 0.5) * across + np.array([0.0, 0.0, random.uniform(-1.0, 1.0)])


def mounted(stand: Transform, random: np.random.Generator) -> Transform:
    """Return the base as it stands on the plate, some degrees and centimeters from the model's."""
    turn = Rotation.from_rotvec(random.uniform(-0.15, 0.15, 3)).as_matrix()
    return Transform(turn @ stand.rotation, stand.translation + random.uniform(-0.1, 0.1, 3))


def _recorded(
    limb: HeldLimb, swings: Sequence[Sampled], word: str, instruments: Instruments
) -> tuple[VirtualTrial, ...]:
    stand = limb.specimen.stand
    center = stand.apply(limb.specimen.center)
    on_base, on_limb = limb.markers()
    at_base = {name: center + stand.rotation @ place for name, place in on_base.items()}
    return tuple(
        VirtualTrial(
            name=f"{word} {number}",
            markers=measured_markers(exact, center, at_base, on_limb, instruments),
            wrenches=measured_wrench(
                exact, center, center + PLATE, limb.specimen.base, instruments
            ),
            exact=exact,
        )
        for number, exact in enumerate(swings, 1)
    )
