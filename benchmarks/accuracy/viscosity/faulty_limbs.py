"""Limbs as a laboratory delivers them whose instruments and models are in error.

Every limb is simulated by MuJoCo with a part of its mass loose on it, and seen by a plate and
markers whose errors are drawn; the model that comes with it has the joint's center and muscle
attachments off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import mujoco
import numpy as np
from scipy.spatial.transform import Rotation

import myomorph as mm
from benchmarks.accuracy.viscosity.handling import (
    Clamp,
    Gimbal,
    base_load,
    resting_wrench,
    slipped,
    still,
)
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Wrenches
from myomorph.swings.simulate.laboratory import (
    Instruments,
    Noise,
    Sampled,
    measured_markers,
    measured_wrench,
    simulate,
)
from myomorph.swings.simulate.limb import BaseLoad, HeldLimb, SwungLimb, fixed_points
from myomorph.swings.simulate.shoulder import (
    BASE,
    FIRST,
    FURTHER,
    HELD,
    PLATE,
    STEP,
    arm_specimen,
    hanging,
    mounted,
    released,
)
from myomorph.swings.viscosity.cohort import SPECIMENS
from myomorph.swings.viscosity.identification.budget import ErrorOptions
from myomorph.swings.viscosity.specimen.model import Specimen, SwingTrial
from myomorph.swings.viscosity.trust.law import HINGES
from myomorph.swings.viscosity.trust.moment_arms import MomentArmOptions
from truths.soft_limbs import SoftTissue

SECONDS = 8.0
TRIALS = 3
EVERY = 4
"""Of the markers' frames and the plate's samples, which are used: 50 and 500 Hz."""
BONES = (BASE, FIRST, *FURTHER)
ARM = 0.02
"""A moment arm of a shoulder muscle [m]."""


@dataclass(frozen=True)
class Faults:
    """What is wrong with instruments and model of one limb; all zero where nothing is.

    Attributes
    ----------
    plate, turn : error of the plate's place [m] and of its axes [rad], (3,) each
    force, moment : relative errors of the gains (3,) each
    clock, drift : of the plate [s], [s/s]
    center : of the joint in the model, along ground's axes while the limb hangs (3,) [m]
    clusters : (2, 3) of base and limb against their bones [m]
    tissue : share of the limb's mass that is loose, muscles removed and intact; 0 for none
    frequency, damping : of the loose mass
    attachments : standard deviation of the places of the model's muscle points, of each muscle on
        each bone [m]
    loads : at rest on the base, muscles removed and intact [kg]
    tared : whether the plate was recorded with the first of these and without the limb, and the
        second is stated
    friction : dry, of the joint [N m]
    sway : by which the base turns to and fro [rad]; it then has a load
    slip : of one bone's cluster, in one trial of one condition and all later ones [m]
    axes, hinges : viscosity of the ball about each axis, of three hinges one after another in its
        place [N m s/rad]
    noise : of markers and plate, over `Noise`
    """

    plate: Sequence[float] = (0.0, 0.0, 0.0)
    turn: Sequence[float] = (0.0, 0.0, 0.0)
    force: Sequence[float] = (0.0, 0.0, 0.0)
    moment: Sequence[float] = (0.0, 0.0, 0.0)
    clock: float = 0.0
    drift: float = 0.0
    center: Sequence[float] = (0.0, 0.0, 0.0)
    clusters: Sequence[Sequence[float]] = ((0.0, 0.0, 0.0), (0.0, 0.0, 0.0))
    tissue: tuple[float, float] = (0.0, 0.0)
    frequency: float = 8.0
    damping: float = 0.2
    attachments: float = 0.0
    loads: tuple[float, float] = (0.0, 0.0)
    tared: bool = False
    friction: float = 0.0
    sway: float = 0.0
    slip: float = 0.0
    axes: tuple[float, ...] = ()
    hinges: tuple[float, ...] = ()
    noise: float = 1.0

    @property
    def instruments(self) -> Noise:
        """White noise of markers and plate, and the plate's clock."""
        plain = Noise()
        return Noise(
            marker=self.noise * plain.marker,
            force=self.noise * plain.force,
            lever=plain.lever,
            offset=self.clock,
            drift=self.drift,
        )


def random_faults(random: np.random.Generator, scale: float = 1.0) -> Faults:
    """Draw faults with the standard deviations that `ErrorOptions` assumes by default.

    They are multiplied by `scale`.
    """
    sds = ErrorOptions()

    def three(sd: float) -> Array:
        return scale * sd * random.standard_normal(3)

    return Faults(
        plate=three(sds.plate_position),
        turn=three(sds.plate_rotation),
        force=three(sds.force_gain),
        moment=three(sds.moment_gain),
        clock=random.uniform(-0.03, 0.03),
        drift=random.uniform(-5e-5, 5e-5),
        center=three(sds.joint_center),
        clusters=scale * 5e-4 * random.standard_normal((2, 3)),
        tissue=(random.uniform(0.0, 0.05), random.uniform(0.05, 0.15)),
        frequency=random.uniform(6.0, 12.0),
        damping=random.uniform(0.1, 0.4),
        attachments=scale * MomentArmOptions().offset,
    )


@dataclass(frozen=True, eq=False)
class FaultyLimb:
    """A limb as a laboratory hands it over, and its truth.

    Attributes
    ----------
    known : the specimen out of the laboratory's model
    trials : by condition
    truth : by the names of `QUANTITIES`
    slip : condition, trial and bone of a cluster that slips; None where none does
    """

    known: Specimen
    trials: dict[str, list[SwingTrial]]
    truth: dict[str, float]
    slip: tuple[str, str, str] | None = None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Setup:
    """A limb on its plate.

    Attributes
    ----------
    limb : with its specimen
    faults : of instruments and model
    damping : of the joint [N m s/rad]
    starts : (3,) rotation vector and (3,) rates of each swing at its start, in ground
    gimbal : hinges in place of a ball joint, None for a ball joint
    """

    limb: HeldLimb
    faults: Faults
    damping: float
    starts: Sequence[tuple[Array, Array]]
    gimbal: Gimbal | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Condition:
    """The limb with or without its muscles.

    Attributes
    ----------
    name : "without" or "with"
    parameters : (10,) of the limb
    muscle : viscosity of each muscle [N s/m]
    tissue : mass that is loose on the limb, None for none
    load : of the base, None for none
    """

    name: str
    parameters: Array
    muscle: float
    tissue: SoftTissue | None
    load: BaseLoad | None


@dataclass(frozen=True, kw_only=True, eq=False)
class _Swing:
    """A simulated swing.

    Attributes
    ----------
    exact : samples without noise
    clamp : that gives way under the base, None where the base is fixed
    turns : (frames, 3, 3) rotations of the base, empty where it is fixed
    """

    exact: Sampled
    clamp: Clamp | None
    turns: Array


class _Slip(NamedTuple):
    """A cluster that slips: in which condition, from which of its trials, and on which bone."""

    condition: str
    first: int
    bone: str

    @property
    def named(self) -> tuple[str, str, str]:
        """Condition, name of the first trial, and bone."""
        return self.condition, f"{self.condition} {self.first + 1}", self.bone


def faulty_limb(seed: int, faults: Faults, damping: float | None) -> FaultyLimb:
    """Simulate a limb of one of the six published sizes.

    Viscosities are drawn unless the joint's is set.
    """
    random = np.random.default_rng(seed)
    row = SPECIMENS[seed % len(SPECIMENS)]
    specimen = arm_specimen()
    specimen = specimen.standing(mounted(specimen.stand, random))
    limb = HeldLimb(specimen, HELD)
    bare = limb.parameters(row.mass_muscles_removed, row.com_muscles_removed)
    whole = limb.with_muscle_mass(bare, row.mass_intact, row.com_intact)
    drawn_damping = damping or float(np.exp(random.uniform(np.log(0.03), np.log(0.1))))
    muscle = random.uniform(0.02, 0.06) / (len(specimen.model.muscles) * ARM**2)
    setup = _Setup(
        limb=limb,
        faults=faults,
        damping=drawn_damping,
        starts=[released(random) for _ in range(TRIALS)],
        gimbal=Gimbal(limb, hanging(limb, bare), faults.hinges) if faults.hinges else None,
    )
    loads = [base_load(limb, mass, random) if mass > 0.0 else None for mass in faults.loads]
    tare = _tare(setup, loads[0], random)
    slip = _drawn_slip(faults, random)
    without = _Condition(
        name="without",
        parameters=bare,
        muscle=0.0,
        tissue=_tissue(faults, faults.tissue[0], bare, 0.8 * _center(limb, -1)),
        load=loads[0],
    )
    intact = _Condition(
        name="with",
        parameters=whole,
        muscle=muscle,
        tissue=_tissue(faults, faults.tissue[1], whole, 0.5 * _center(limb, 1)),
        load=loads[1],
    )
    trials = {
        condition.name: _trials(setup, condition, tare, slip, random)
        for condition in (without, intact)
    }
    return FaultyLimb(
        known=_known_specimen(setup, whole, random),
        trials=trials,
        truth=_truth(setup, without, intact),
        slip=None if slip is None else slip.named,
    )


def _center(limb: HeldLimb, number: int) -> Array:
    """Return the center (3,) of one of the limb's bones, from the joint's center [m]."""
    center: Array = limb.poses[limb.specimen.limb[number]].translation
    return center


def _tare(setup: _Setup, load: BaseLoad | None, random: np.random.Generator) -> Wrenches | None:
    """Return what the plate measures of a resting load, None where it is not tared."""
    if not setup.faults.tared or load is None:
        return None
    resting = still(resting_wrench(setup.limb, load), 3.0, STEP)
    return _on_plate(setup, resting, random)


def _drawn_slip(faults: Faults, random: np.random.Generator) -> _Slip | None:
    if faults.slip <= 0.0:
        return None
    return _Slip(
        condition=str(random.choice(["without", "with"])),
        first=int(random.integers(TRIALS)),
        bone=str(random.choice(BONES)),
    )


def _tissue(faults: Faults, share: float, parameters: Array, place: Array) -> SoftTissue | None:
    """Return a share of the limb's mass that is loose at a place (3,) [m], None for none."""
    if share <= 0.0:
        return None
    return SoftTissue(
        place=tuple(place),
        mass=share * float(parameters[0]),
        frequency=faults.frequency,
        damping=faults.damping,
    )


def _trials(
    setup: _Setup,
    condition: _Condition,
    tare: Wrenches | None,
    slip: _Slip | None,
    random: np.random.Generator,
) -> list[SwingTrial]:
    """Return the swings of a condition as instruments with faults measure them."""
    swings = _swings(setup, condition)
    trials = [
        replace(_measured(setup, swing, f"{condition.name} {number}", random), tare=tare)
        for number, swing in enumerate(swings, 1)
    ]
    if slip is None or slip.condition != condition.name:
        return trials
    return _slipping(setup, trials, swings, slip, random)


def _known_specimen(setup: _Setup, whole: Array, random: np.random.Generator) -> Specimen:
    """Return the specimen as the laboratory knows it, its center and attachments off."""
    faults = setup.faults
    specimen = setup.limb.specimen
    known = specimen.centered(
        specimen.center
        + specimen.stand.rotation.T @ np.array(faults.center)
        + np.array(faults.clusters[0]),
        specimen.center_in_limb
        + hanging(setup.limb, whole).T @ np.array(faults.center)
        + np.array(faults.clusters[1]),
    )
    if setup.gimbal is not None:
        axes = np.stack([setup.gimbal.in_base, setup.gimbal.axes[2]])
        known = replace(known, turning_axes=axes)
    return replace(known, model=with_moved_attachments(known.model, faults.attachments, random))


def _truth(setup: _Setup, without: _Condition, intact: _Condition) -> dict[str, float]:
    """Return what is true of a limb, by the names of `QUANTITIES`."""
    faults = setup.faults
    truth = {"muscle_viscosity": intact.muscle}
    if not faults.axes and not faults.hinges:
        truth["joint_viscosity"] = setup.damping
    if faults.axes:
        truth |= {
            f"viscosity {name}": value for name, value in zip("xyz", faults.axes, strict=True)
        }
    if setup.gimbal is not None:
        truth |= {f"hinge {name}": value for name, value in zip(HINGES, faults.hinges, strict=True)}
    for name, condition in (("muscles_removed", without), ("intact", intact)):
        mass = condition.parameters[0]
        truth[f"mass_{name}"] = float(mass)
        truth[f"com_{name}"] = float(np.linalg.norm(condition.parameters[1:4]) / mass)
    return truth


def with_moved_attachments(model: mm.Model, sd: float, random: np.random.Generator) -> mm.Model:
    """Displace the muscles' points of a model, all points of a muscle on one bone alike.

    Paths keep their surfaces.
    """
    if sd <= 0.0:
        return model
    muscles = []
    for muscle in model.muscles:
        points = fixed_points(muscle)
        off = {
            body: sd * random.standard_normal(3)
            for body in dict.fromkeys(point.body for point in points)
        }
        moved = tuple(
            replace(point, location=np.add(point.location, off[point.body])) for point in points
        )
        muscles.append(replace(muscle, path=replace(muscle.path, points=moved)))
    return replace(model, muscles=tuple(muscles))


def _swings(setup: _Setup, condition: _Condition) -> list[_Swing]:
    """Simulate every swing of a condition."""
    limb = setup.limb
    gimbal = setup.gimbal
    tissue = condition.tissue
    rest = hanging(limb, condition.parameters) if gimbal is None else gimbal.rest
    states = _start_states(setup, tissue, rest)
    swung = SwungLimb(
        limb=limb,
        parameters=condition.parameters,
        stand=limb.specimen.stand,
        rest=rest,
        damping=setup.damping,
        muscle=condition.muscle,
        load=condition.load,
        joint="" if gimbal is None else gimbal.mjcf,
    )
    if tissue is not None:
        swung = replace(
            swung,
            parameters=condition.parameters - tissue.parameters,
            loose=tissue.mjcf(rest.T @ np.asarray(limb.specimen.model.gravity)),
        )
    if setup.faults.sway > 0.0 and condition.load is not None:
        clamp = Clamp(limb, condition.parameters, condition.load)
        swings = clamp.swings(swung, states, setup.faults.sway, SECONDS, STEP)
        return [_Swing(exact=exact, clamp=clamp, turns=turns) for exact, turns in swings]
    compiled = mujoco.MjModel.from_xml_string(swung.mjcf)
    compiled.dof_frictionloss[:3] = setup.faults.friction
    if setup.faults.axes:
        compiled.dof_damping[:3] = setup.faults.axes
    return [
        _Swing(exact=simulate(compiled, *state, SECONDS, STEP), clamp=None, turns=np.zeros(0))
        for state in states
    ]


def _start_states(
    setup: _Setup, tissue: SoftTissue | None, rest: Array
) -> list[tuple[Array, Array]]:
    """Return MuJoCo's positions and velocities of each swing at its start.

    A ball joint has a quaternion, a gimbal the angles of its hinges; loose tissue has three more.
    """
    loose = np.zeros(0 if tissue is None else 3)
    states = []
    for axis, ground_rates in setup.starts:
        turn = rest.T @ axis
        rates = rest.T @ ground_rates
        if setup.gimbal is None:
            position = Rotation.from_rotvec(turn).as_quat(scalar_first=True)
        else:
            position, rates = setup.gimbal.state(turn, rates)
        states.append((np.append(position, loose), np.append(rates, loose)))
    return states


def _measured(setup: _Setup, swing: _Swing, name: str, random: np.random.Generator) -> SwingTrial:
    """Return a swing as markers and a plate with faults measure it, every `EVERY`-th sample."""
    limb = setup.limb
    specimen = limb.specimen
    exact = swing.exact
    center = specimen.center_in_ground
    on_base, on_limb = limb.markers()
    at_base = {
        marker: center + specimen.stand.rotation @ place for marker, place in on_base.items()
    }
    instruments = Instruments(setup.faults.instruments, random)
    markers = measured_markers(exact, center, at_base, on_limb, instruments)
    if swing.clamp is not None:
        frames = np.searchsorted(exact.time, markers.time - 1e-9)
        markers = swing.clamp.moved(markers, swing.turns[frames], center, len(on_base))
    wrenches = _on_plate(setup, exact, random)
    return SwingTrial(
        name, replace(markers, time=markers.time[::EVERY], values=markers.values[::EVERY]), wrenches
    )


def _on_plate(setup: _Setup, exact: Sampled, random: np.random.Generator) -> Wrenches:
    """Return the wrench of a swing as a plate with faults measures it."""
    faults = setup.faults
    specimen = setup.limb.specimen
    center = specimen.center_in_ground
    instruments = Instruments(faults.instruments, random)
    wrenches = measured_wrench(exact, center, center + PLATE, specimen.base, instruments)
    turn = Rotation.from_rotvec(faults.turn).as_matrix()
    return replace(
        wrenches,
        time=wrenches.time[::EVERY],
        forces=(wrenches.forces * (1.0 + np.array(faults.force)) @ turn.T)[::EVERY],
        torques=(wrenches.torques * (1.0 + np.array(faults.moment)) @ turn.T)[::EVERY],
        points=(wrenches.points + np.array(faults.plate))[::EVERY],
    )


def _slipping(
    setup: _Setup,
    trials: list[SwingTrial],
    swings: Sequence[_Swing],
    slip: _Slip,
    random: np.random.Generator,
) -> list[SwingTrial]:
    """Return the trials, in which a bone's cluster slips.

    It moves on the bone in the middle of the trial `slip.first`, and stays there.
    """
    specimen = setup.limb.specimen
    by = random.standard_normal(3)
    by *= setup.faults.slip / np.linalg.norm(by)
    names = {marker.name for marker in specimen.model.markers if marker.body == slip.bone}
    at = random.uniform(0.25, 0.75) * SECONDS
    result = trials[: slip.first]
    for trial, swing in zip(trials[slip.first :], swings[slip.first :], strict=True):
        exact = swing.exact
        columns = [column for column, name in enumerate(trial.markers.names) if name in names]
        rotations = exact.rotations[np.searchsorted(exact.time, trial.markers.time - 1e-9)]
        if slip.bone == specimen.base:
            rotations = np.broadcast_to(specimen.stand.rotation, rotations.shape)
        result.append(replace(trial, markers=slipped(trial.markers, columns, rotations, by, at)))
        at = -np.inf
    return result
