"""Limbs as a laboratory hands them over whose instruments and models are in error.

Every limb is simulated by MuJoCo with a part of its mass loose on it, and seen by a plate and
markers whose errors are drawn; the model that comes with it has the joint's center and muscle
attachments off.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

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
    Noise,
    Sampled,
    measured_markers,
    measured_wrench,
    simulate,
)
from myomorph.swings.simulate.limb import BaseLoad, HeldLimb, fixed_points, swing_mjcf
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
    damping = damping or float(np.exp(random.uniform(np.log(0.03), np.log(0.1))))
    muscle = random.uniform(0.02, 0.06) / (len(specimen.model.muscles) * ARM**2)
    hand = limb.poses[specimen.limb[(-1)]].translation
    elbow = limb.poses[specimen.limb[1]].translation
    starts = [released(random) for _ in range(TRIALS)]
    trials: dict[str, list[SwingTrial]] = {}
    gimbal = Gimbal(limb, hanging(limb, bare), faults.hinges) if faults.hinges else None
    loads = [base_load(limb, mass, random) if mass > 0.0 else None for mass in faults.loads]
    tare = None
    if faults.tared and loads[0] is not None:
        tare = _on_plate(limb, still(resting_wrench(limb, loads[0]), 3.0, STEP), faults, random)
    slip = None
    if faults.slip > 0.0:
        slip = (
            str(random.choice(["without", "with"])),
            int(random.integers(TRIALS)),
            str(random.choice(BONES)),
        )
    for name, parameters, own, share, place, load in (
        ("without", bare, 0.0, faults.tissue[0], 0.8 * hand, loads[0]),
        ("with", whole, muscle, faults.tissue[1], 0.5 * elbow, loads[1]),
    ):
        tissue = None
        if share > 0.0:
            tissue = SoftTissue(
                place=tuple(place),
                mass=share * float(parameters[0]),
                frequency=faults.frequency,
                damping=faults.damping,
            )
        swings = _swings(limb, parameters, damping, own, tissue, starts, load, gimbal, faults)
        trials[name] = [
            replace(_measured(limb, *swing, f"{name} {number}", faults, random), tare=tare)
            for number, swing in enumerate(swings, 1)
        ]
        if slip is not None and slip[0] == name:
            exact = [swing[0] for swing in swings]
            trials[name] = _slipping(
                limb, trials[name], exact, slip[1], slip[2], faults.slip, random
            )
    known = specimen.centered(
        specimen.center
        + specimen.stand.rotation.T @ np.array(faults.center)
        + np.array(faults.clusters[0]),
        specimen.center_in_limb
        + hanging(limb, whole).T @ np.array(faults.center)
        + np.array(faults.clusters[1]),
    )
    truth = {"muscle_viscosity": muscle} | (
        {} if faults.axes or faults.hinges else {"joint_viscosity": damping}
    )
    truth |= {
        f"viscosity {name}": value
        for name, value in zip("xyz", faults.axes, strict=bool(faults.axes))
    }
    if gimbal is not None:
        known = replace(known, turning_axes=np.stack([gimbal.in_base, gimbal.axes[2]]))
        truth |= {f"hinge {name}": value for name, value in zip(HINGES, faults.hinges, strict=True)}
    known = replace(known, model=with_moved_attachments(known.model, faults.attachments, random))
    for name, one in (("muscles_removed", bare), ("intact", whole)):
        truth |= {
            f"mass_{name}": float(one[0]),
            f"com_{name}": float(np.linalg.norm(one[1:4]) / one[0]),
        }
    named = None if slip is None else (slip[0], f"{slip[0]} {slip[1] + 1}", slip[2])
    return FaultyLimb(known=known, trials=trials, truth=truth, slip=named)


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


def _swings(
    limb: HeldLimb,
    parameters: Array,
    damping: float,
    muscle: float,
    tissue: SoftTissue | None,
    starts: Sequence[tuple[Array, Array]],
    load: BaseLoad | None,
    gimbal: Gimbal | None,
    faults: Faults,
) -> list[tuple[Sampled, Clamp | None, Array]]:
    """Every swing, and how the base turns in it (frames, 3, 3)."""
    rest = hanging(limb, parameters) if gimbal is None else gimbal.rest
    loose = np.zeros(0 if tissue is None else 3)
    states = [(rest.T @ axis, rest.T @ rates) for axis, rates in starts]
    if gimbal is None:
        states = [
            (Rotation.from_rotvec(turn).as_quat(scalar_first=True), rates) for turn, rates in states
        ]
    else:
        states = [gimbal.state(*state) for state in states]
    states = [(np.append(position, loose), np.append(rates, loose)) for position, rates in states]
    text = {
        "limb": limb,
        "parameters": parameters if tissue is None else parameters - tissue.parameters,
        "stand": limb.specimen.stand,
        "rest": rest,
        "damping": damping,
        "muscle": muscle,
        "loose": (
            "" if tissue is None else tissue.mjcf(rest.T @ np.asarray(limb.specimen.model.gravity))
        ),
        "load": load,
        "joint": "" if gimbal is None else gimbal.mjcf,
    }
    if faults.sway > 0.0 and load is not None:
        clamp = Clamp(limb, parameters, load)
        return [
            (exact, clamp, turns)
            for exact, turns in clamp.swings(text, states, faults.sway, SECONDS, STEP)
        ]
    compiled = mujoco.MjModel.from_xml_string(swing_mjcf(**text))
    compiled.dof_frictionloss[:3] = faults.friction
    if faults.axes:
        compiled.dof_damping[:3] = faults.axes
    return [(simulate(compiled, *state, SECONDS, STEP), None, np.zeros(0)) for state in states]


def _measured(
    limb: HeldLimb,
    exact: Sampled,
    clamp: Clamp | None,
    turns: Array,
    name: str,
    faults: Faults,
    random: np.random.Generator,
) -> SwingTrial:
    """Return a swing as markers and a plate with faults measure it, every `EVERY`-th sample."""
    specimen = limb.specimen
    noise = faults.instruments
    center = specimen.center_in_ground
    on_base, on_limb = limb.markers()
    at_base = {
        marker: center + specimen.stand.rotation @ place for marker, place in on_base.items()
    }
    markers = measured_markers(exact, center, at_base, on_limb, noise, random)
    if clamp is not None:
        frames = np.searchsorted(exact.time, markers.time - 1e-9)
        markers = clamp.moved(markers, turns[frames], center, len(on_base))
    wrenches = _on_plate(limb, exact, faults, random)
    return SwingTrial(
        name, replace(markers, time=markers.time[::EVERY], values=markers.values[::EVERY]), wrenches
    )


def _on_plate(
    limb: HeldLimb, exact: Sampled, faults: Faults, random: np.random.Generator
) -> Wrenches:
    """Return the wrench of a swing as a plate with faults measures it."""
    center = limb.specimen.center_in_ground
    noise = faults.instruments
    wrenches = measured_wrench(exact, center, center + PLATE, limb.specimen.base, noise, random)
    turn = Rotation.from_rotvec(faults.turn).as_matrix()
    return replace(
        wrenches,
        time=wrenches.time[::EVERY],
        forces=(wrenches.forces * (1.0 + np.array(faults.force)) @ turn.T)[::EVERY],
        torques=(wrenches.torques * (1.0 + np.array(faults.moment)) @ turn.T)[::EVERY],
        points=(wrenches.points + np.array(faults.plate))[::EVERY],
    )


def _slipping(
    limb: HeldLimb,
    trials: list[SwingTrial],
    exact: list[Sampled],
    first: int,
    bone: str,
    size: float,
    random: np.random.Generator,
) -> list[SwingTrial]:
    """Return the trials, in which a bone's cluster slips.

    It moves on the bone in the middle of the trial `first`, and stays there.
    """
    by = random.standard_normal(3)
    by *= size / np.linalg.norm(by)
    names = {marker.name for marker in limb.specimen.model.markers if marker.body == bone}
    at = random.uniform(0.25, 0.75) * SECONDS
    result = trials[:first]
    for trial, swing in zip(trials[first:], exact[first:], strict=True):
        columns = [column for column, name in enumerate(trial.markers.names) if name in names]
        rotations = swing.rotations[np.searchsorted(swing.time, trial.markers.time - 1e-9)]
        if bone == limb.specimen.base:
            rotations = np.broadcast_to(limb.specimen.stand.rotation, rotations.shape)
        result.append(replace(trial, markers=slipped(trial.markers, columns, rotations, by, at)))
        at = -np.inf
    return result
