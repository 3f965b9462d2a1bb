"""Coverage of the intervals of every estimator, on simulated truth, in one table.

The truths are those of the other tables, by code that shares nothing with the estimators but for
drawn limits, whose truth is a draw. Nothing was chosen on their seeds. Noise is not what the
estimators assume: it is alike over time, follows the motion, or moves markers together.

`python -m benchmarks.validation coverage` measures all. `python -m
benchmarks.accuracy.intervals.coverage ESTIMATOR ...` measures some again, and puts their rows in
the place of those in the table.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from scipy.signal import lfilter
from scipy.special import stdtrit
from tests.truths.simulated_sensors import SensorErrors, SimulatedSensors, simulated_sensors
from threadpoolctl import threadpool_limits

import myomorph as mm
from benchmarks.accuracy.identification import identification, refine
from benchmarks.accuracy.identification.identification_runners import HEAVY, drawn_body
from benchmarks.accuracy.intervals.covered import Covered, Row, joined
from benchmarks.accuracy.intervals.drawn_numbers import (
    AWAY,
    CURVES,
    SCORE_ERRORS,
    WALKERS,
    gait_profile_scores,
    numbers_of_curves,
)
from benchmarks.accuracy.intervals.mechanical import JOINTS, KINDS, dampings
from benchmarks.accuracy.intervals.uncertainty import OTHER, TITLES, distances_from_limits
from benchmarks.accuracy.kinematics.calibration_zeros import (
    drawn_walker,
    expert_motion,
    scaled,
    zero_errors,
)
from benchmarks.accuracy.kinematics.inertial import BODIES
from benchmarks.accuracy.tension import personalize
from benchmarks.accuracy.viscosity import calibrations, limbs, relaxed
from benchmarks.accuracy.viscosity.faulty_limbs import Faults, random_faults
from benchmarks.accuracy.viscosity.signatures import CASES, heavy_limb
from benchmarks.recordings import RECORDINGS
from benchmarks.results import load, save
from data_collection import data_folder
from myomorph.body.identify import base
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.motion_noise import coordinate_noise
from myomorph.body.identify.recordings import RecordingOptions, Usable
from myomorph.body.identify.subject import IdentificationOptions
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.refinement import Refinement
from myomorph.body.sensors.first_guess import calibration_pose, from_pose
from myomorph.body.sensors.fit_mounting import Chosen, MountingFit
from myomorph.body.sensors.sensor_kinematics import sensor_kinematics
from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.body.tension.emg_calibration import calibrate_emg
from myomorph.body.tension.emg_held_out import EmgTrial
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.interval import Interval
from myomorph.core.model.spatial import vector_from_rotation
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.lengths import lengths_of
from myomorph.core.motion.sensors.mounting import SensorMounting, SensorOptions
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.regressor import base_regressor, reference_points
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape
from myomorph.lab.uncertainty.sources import Sources
from myomorph.lab.uncertainty.spread import FACTORS
from myomorph.swings.plate_calibration import calibrate_plate
from truths.plate_checks import pose_deviations
from truths.simulated_muscles import (
    Errors,
    Laboratory,
    all_recorded,
    as_degroote,
    smooth_activations,
    some_gains,
    swings,
)

TABLE = "validation/coverage"
FIRST = 20000
"""The first seed: nothing was chosen, and no fault was looked for, on seeds from here on."""
ALIKE = 0.1
"""Time over which errors of coordinates, forces and EMG are alike [s]."""
COORDINATE_SD = 0.002
FORCE_SD = 3.0
MOMENT_SD = 1.0
"""Errors of coordinates [rad, m], and of forces [N] and moments [N m] on the ground."""

POSED = 60
POSE_ERROR = np.radians(4.0)
"""Persons in a calibration pose, and how far each of their joints is from it [rad]."""
WALKS = 6
WALK_FRAMES = 60
SENSOR_SEEDS = 24
SENSOR_SECONDS = 12.0
PLATES = 100
BODIES_DRAWN = 12
BASES_DRAWN = 36
REFINED = 8
REFINED_SECONDS = 5.0
MASSES_OFF = 0.4
LATE = 0.03
GAINED = 6
PERSONAL = 30
LIMBS = 40
RELAXED = 24
DRAWN_PEOPLE = 1
"""Truths of each estimator, frames of a walk, seconds of recordings: few, for the table's time."""
PERSONAL_CASES = {
    "arm, two of 5 s, gains unknown": "slowly varying, of torques and EMG; tendons elastic"
}
"""Recordings of simulated people, and their noise."""
NOISY = 3.0
"""Noise of markers and plate of further limbs, over the usual one."""
DROPPED: Mapping[str, relaxed.Kind] = {
    "masses off as assumed": relaxed.Kind(mass_errors=1.0),
    "masses off by twice as much": relaxed.Kind(mass_errors=2.0),
    f"masses off as assumed, noise of markers times {NOISY:g}": relaxed.Kind(
        mass_errors=1.0, noise=NOISY
    ),
    "masses off as assumed, thigh gives way": relaxed.Kind(
        mass_errors=1.0, changes={"giving": 400.0}
    ),
}
"""What is wrong with relaxed limbs."""
LEGS = tuple(f"{name}_{side}" for name in ("femur", "tibia") for side in "rl")
GAINS = Errors(torque=0.02, emg=0.0, floor=0.0, gain=0.3)


GIVEN = "base parameters that are identifiable"
NOT_GIVEN = "base parameters, noise of coordinates not given"
"""Ways to estimate base parameters: with noise as it is, and as it is assumed if not given."""


@dataclass(frozen=True, kw_only=True, eq=False)
class Case:
    """Intervals of one unknown of an estimator.

    Attributes
    ----------
    unknown : what the intervals are of
    noise : of the truth, in words
    truths : how many were simulated
    covered : intervals beside the truth
    promised : share that the intervals promise to hold [%]
    """

    unknown: str
    noise: str
    truths: int
    covered: Covered
    promised: int = 90


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure(folder: Path, only: Sequence[str] = ()) -> Iterator[Row]:
    """Measure a row for each estimator, unknown and noise."""
    for estimator, measured in ESTIMATORS.items():
        if only and estimator not in only:
            continue
        began = time.perf_counter()
        for case in measured(folder):
            yield {
                "estimator": estimator,
                "unknown": case.unknown,
                "noise of the truth": case.noise,
                "truths": case.truths,
                **case.covered.row(),
                "promised [%]": case.promised,
                "first seed": FIRST,
            }
        print(f"coverage, {estimator}: {time.perf_counter() - began:.0f} s", flush=True)


def alike_noise(time: Array, shape: tuple[int, ...], rng: np.random.Generator) -> Array:
    """Draw noise of variance 1 whose autocorrelation falls as exp(-lag / `ALIKE`).

    Parameters
    ----------
    time : (frames,) [s]
    shape : of the noise, frames first
    rng : its generator

    Returns
    -------
    first-order autoregressive noise in that shape
    """
    share = float(np.exp(-np.median(np.diff(time)) / ALIKE))
    white = rng.normal(size=shape) * np.sqrt(1.0 - share**2)
    white[0] /= np.sqrt(1.0 - share**2)
    return np.asarray(lfilter([1.0], [1.0, -share], white, axis=0))


def calibrated(folder: Path) -> Iterator[Case]:
    """Lengths, markers and zero angles of people who walk as recorded."""
    recordings = {one.name: one for one in scaled(folder)}
    one = recordings["gait2354 walk"]
    motions = expert_motion(one, one.motion, WALK_FRAMES), expert_motion(one, one.static, 1)
    for slides in (False, True):
        people = [
            _calibrated_walker(one.generic, motions, seed, slides)
            for seed in range(FIRST, FIRST + WALKS)
        ]
        noise = "skin in waves" + (", and as one piece" if slides else "")
        for unknown in people[0]:
            covered = joined([person[unknown] for person in people])
            yield Case(unknown=unknown, noise=noise, truths=WALKS, covered=covered)


def _calibrated_walker(
    generic: mm.Model, motions: tuple[mm.Motion, mm.Motion], seed: int, slides: bool
) -> dict[str, Covered]:
    """Calibrate one walker and compare intervals with the truth, by unknown."""
    drawn = drawn_walker(generic, motions, seed, slides)
    found = drawn.calibrated(generic, static=True)
    factors = np.array([each.factor for each in found.lengths])
    factors_sd = np.array([each.sd for each in found.lengths])
    before = np.array([each.prior_sd for each in found.lengths])
    truth = np.array([drawn.person.marker(each.name).location for each in found.markers])
    apart = np.array([each.location for each in found.markers]) - truth
    spread = np.array([each.sd for each in found.markers])
    return {
        "lengths": Covered.of_sd(factors - drawn.factors, factors_sd, before),
        "places of markers": Covered.of_sd(apart.ravel(), spread.ravel()),
        "zero angles": Covered.of_sd(*zero_errors(found, motions[0], drawn.walk)),
    }


def mounted(folder: Path) -> Iterator[Case]:
    """Mounting of sensors on a body that walks as recorded."""
    files = RECORDINGS["treadmill"]
    model = mm.read_model(folder / files.model)
    recorded = mm.read_motion(folder / files.motion, model)
    values = compile_tree(model).coordinates_of(recorded)
    motion = mm.Motion(recorded.time, model.coordinate_names, values)
    motion = cut(motion, motion.time[0], motion.time[0] + SENSOR_SECONDS)
    yield Case(
        unknown="flexion of knees, by pose",
        noise=f"pose off by {np.degrees(POSE_ERROR):.0f} degrees in every joint",
        truths=POSED,
        covered=posed(model, motion),
    )
    for kind in ("pose", "recording"):
        parts = []
        for seed in range(FIRST, FIRST + SENSOR_SEEDS):
            made = simulated_sensors(model, motion, BODIES, SensorErrors(), seed)
            recording = SensorRecording(
                made.sensors, pose=made.pose, sizes=SensorOptions(imu_mounting=kind)
            )
            found = sensor_kinematics(model, recording).mounting
            off = vector_from_rotation(made.rotations @ np.swapaxes(found.rotations, 1, 2))
            sd = np.sqrt(np.sum(found.factor**2, axis=1))[: off.size]
            parts.append(Covered.of_sd(off.ravel(), sd))
        yield Case(
            unknown=f"rotations, by {kind}",
            noise="skin that follows the joints, smooth; axes of joints off",
            truths=SENSOR_SEEDS,
            covered=joined(parts),
        )


def posed(model: mm.Model, motion: mm.Motion) -> Covered:
    """Flexion that thigh's and shank's sensors show in a pose in which knees may be overextended.

    Parameters
    ----------
    model : whose knees end where they are straight
    motion : of whose times the sensors are
    """
    knees = [name for name in model.coordinate_names if name.startswith("knee_angle")]
    opened = replace(
        model,
        coordinates=tuple(
            replace(one, clamped=False) if one.name in knees else one for one in model.coordinates
        ),
    )
    errors = SensorErrors(skin=0.0, noise=0.0, pose=POSE_ERROR)
    sizes = SensorOptions(imu_mounting="pose", imu_pose_error=POSE_ERROR)
    short = cut(motion, motion.time[0], motion.time[0] + 1.0)
    parts = []
    for seed in range(FIRST, FIRST + POSED):
        made = simulated_sensors(opened, short, BODIES, errors, seed)
        mounting = _mounted_by_pose(model, made, sizes)
        off = vector_from_rotation(made.rotations @ np.swapaxes(mounting.rotations, 1, 2))
        for side in "rl":
            shank = BODIES.index(f"tibia_{side}")
            thigh = BODIES.index(f"femur_{side}")
            weights = np.zeros(len(mounting.factor))
            weights[[3 * shank + 2, 3 * thigh + 2]] = 1.0, -1.0
            sd = np.linalg.norm(weights @ mounting.factor)
            flexion = off[shank, 2] - off[thigh, 2]
            parts.append(Covered.of_sd(np.array([flexion]), np.array([sd])))
    return joined(parts)


def _mounted_by_pose(
    model: mm.Model, made: SimulatedSensors, sizes: SensorOptions
) -> SensorMounting:
    """Mount sensors by their pose, with headings as they are."""
    tree = compile_tree(model)
    pose = calibration_pose(model, made.pose, tree.defaults, 0.0)
    time = made.sensors.time[:2]
    fit = MountingFit(
        tree=tree,
        sensors=made.sensors,
        bodies=tuple(BODIES),
        chosen=Chosen(
            time=time,
            markers=mm.Markers(time, (), np.empty((2, 0, 3))),
            marker_names=(),
            marker_weights=np.empty(0),
            share=1.0,
        ),
        options=InverseKinematicsOptions(),
        sizes=sizes,
        pose=pose,
    )
    guess = from_pose(tree, tuple(BODIES), pose, made.headings[0])
    return fit.by_pose(fit.at(guess, 0.0)).mounting


def placed_plates(folder: Path) -> Iterator[Case]:
    """Pose of a force plate by a marked weight or a rod."""
    for name, pushed in (("weight", False), ("rod", True)):
        turns = []
        centers = []
        for seed in range(FIRST, FIRST + PLATES):
            placements = calibrations.placements_of(calibrations.NINE, seed, 20.0, pushed)
            found = calibrate_plate(placements)
            sd = pose_deviations(found)
            turn = vector_from_rotation(found.rotation @ calibrations.AXES.T)
            shift = found.center - calibrations.CENTER
            shown = np.isfinite(sd[3:])
            turns.append(_student(turn, sd[:3], found.posterior.freedom))
            centers.append(_student(shift[shown], sd[3:][shown], found.posterior.freedom))
        for unknown, parts in (("axes", turns), ("center", centers)):
            yield Case(
                unknown=f"{unknown}, {name}",
                noise="white, of each placement's means",
                truths=PLATES,
                covered=joined(parts),
            )


def identified(folder: Path) -> Iterator[Case]:
    """Masses and base parameters of bodies that run as recorded."""
    subject = next(one for one in identification.SUBJECTS if one.name == "Hamner, calibrated")
    model, trials = identification.opened(folder, subject)
    shape = BodyOptions(spacing=identification.SPACING)
    points, _, _ = body_points(model, BodyShape(), model.mass, shape)
    noise = f"alike over {ALIKE:g} s, of coordinates and forces"
    masses = []
    fitted: dict[str, list[Covered]] = {GIVEN: [], NOT_GIVEN: []}
    for seed in range(FIRST, FIRST + BASES_DRAWN):
        truth, seen = _drawn_body(model, trials, seed)
        recordings = [one.recording for one in seen]
        unknown = [replace(one, noise=None) for one in recordings]
        white = [
            replace(one, noise=coordinate_noise(one.motion, COORDINATE_SD, identification.CUTOFF))
            for one in unknown
        ]
        fitted[GIVEN].append(_base_covered(model, truth, recordings))
        fitted[NOT_GIVEN].append(_base_covered(model, truth, unknown))
        if len(masses) < BODIES_DRAWN:
            white_seen = [
                replace(one, recording=recording)
                for one, recording in zip(seen, white, strict=True)
            ]
            masses.append(_masses_covered(model, truth, white_seen, points))
    yield Case(unknown="masses", noise=noise, truths=len(masses), covered=joined(masses))
    for unknown, parts in fitted.items():
        yield Case(unknown=unknown, noise=noise, truths=len(parts), covered=joined(parts))


def _drawn_body(
    model: mm.Model, trials: Mapping[str, Usable], seed: int
) -> tuple[Array, list[Usable]]:
    """Draw a body, (bodies, 10) parameters, and record it as it moves in the trials."""
    heavy = inertial_parameters(model)[:, 0] > HEAVY * model.mass
    rng = np.random.default_rng(seed)
    truth = drawn_body(model, heavy, rng)
    return truth, [_measured(model, truth, one, rng) for one in trials.values()]


def _masses_covered(
    model: mm.Model, truth: Array, seen: Sequence[Usable], points: Mapping[str, mm.MassPoints]
) -> Covered:
    """Identify a body and compare intervals of its masses with the truth.

    Parameters
    ----------
    truth : (bodies, 10) parameters
    seen : recordings of the body
    """
    heavy = inertial_parameters(model)[:, 0] > HEAVY * model.mass
    found = mm.identify(
        model,
        seen,
        points,
        mass=model.mass,
        options=IdentificationOptions(compare=False, motion_sd=COORDINATE_SD),
        recording=RecordingOptions(cutoff=identification.CUTOFF),
    )
    off = (found.expected - truth)[heavy, 0]
    return Covered.of_sd(off, found.sd[heavy, 0], found.known.prior_sd[heavy, 0])


def _base_covered(model: mm.Model, truth: Array, recordings: Sequence[Recording]) -> Covered:
    """Fit the base parameters of a body and compare intervals with the truth.

    Parameters
    ----------
    truth : (bodies, 10) parameters
    recordings : of the body
    """
    fit = base.fit_base(model, recordings)
    shown = fit.identifiable
    return Covered.of_sd((fit.estimate - fit.base.of(truth))[shown], fit.sd[shown])


def _measured(model: mm.Model, truth: Array, one: Usable, rng: np.random.Generator) -> Usable:
    """Measure a body that moves as recorded: coordinates and forces with noise that is alike.

    Both pass one filter, as a user's do. Coordinates that rest, as locked ones, have no errors.

    Parameters
    ----------
    truth : (bodies, 10) parameters
    one : the recorded motion
    """
    motion = one.recording.motion
    wrench = base_regressor(model, motion) @ truth.ravel()
    sizes = np.repeat([MOMENT_SD, FORCE_SD], 3)
    wrench = wrench + sizes * alike_noise(motion.time, wrench.shape, rng)
    wrenches = mm.Wrenches(
        motion.time,
        ("plate",),
        (model.body_names[0],),
        wrench[:, None, 3:],
        reference_points(model, motion)[:, None],
        wrench[:, None, :3],
    )
    moving = np.ptp(motion.values, axis=0) > 0.0
    off = COORDINATE_SD * moving * alike_noise(motion.time, motion.values.shape, rng)
    noisy = mm.Motion(motion.time, motion.names, motion.values + off)
    options = RecordingOptions(cutoff=identification.CUTOFF)
    seen = mm.usable(model, noisy, wrenches, mass=model.mass, name=one.name, options=options)
    # Errors whose correlation falls as exp(-lag / T) are one sample in 2 T.
    noise = replace(
        coordinate_noise(noisy, COORDINATE_SD),
        correlation_time=np.full(len(noisy.names), 2.0 * ALIKE),
        floor=np.zeros(len(noisy.names)),
    )
    return replace(seen, recording=replace(seen.recording, noise=noise), notes=())


def refined(folder: Path) -> Iterator[Case]:
    """Lengths and masses of the legs of simulated people with unequal legs, and clocks."""
    waves = refine.Truth(skin=refine.waving_skin)
    alike = f"skin alike over {ALIKE:g} s"
    default = RefineOptions().fit
    truths = {
        "skin in waves": (waves, default),
        alike: (refine.Truth(skin=_alike_skin), default),
        f"skin in waves, generic masses off by up to {100 * MASSES_OFF:g} %": (
            replace(waves, mass=MASSES_OFF),
            default,
        ),
        f"{alike}, forces late by up to {1e3 * LATE:g} ms": (
            refine.Truth(skin=_alike_skin, late=LATE),
            (*default, "clock"),
        ),
    }
    for noise, (truth, fit) in truths.items():
        people = [_refined_person(seed, truth, fit) for seed in range(FIRST, FIRST + REFINED)]
        for unknown in people[0]:
            yield Case(
                unknown=unknown,
                noise=noise,
                truths=REFINED,
                covered=joined([person[unknown] for person in people]),
            )


def _alike_skin(values: Array, time: Array, seed: int) -> Array:
    """Move markers (frames, markers, 3) by noise that is alike for a while."""
    rng = np.random.default_rng(seed)
    return values + refine.SKIN * alike_noise(time, values.shape, rng)


def _refined_person(seed: int, truth: refine.Truth, fit: tuple[str, ...]) -> dict[str, Covered]:
    """Refine one person and compare intervals with the truth, by unknown."""
    late = truth.late * np.random.default_rng(seed).uniform(-1.0, 1.0)
    # What is held out chooses parts to keep; intervals are of what is estimated.
    options = RefineOptions(fit=fit, check=False)
    person, given, found = refine.simulated(
        seed, REFINED_SECONDS, options, replace(truth, late=late)
    )
    covered = {
        "lengths of legs": _refined_lengths(person, given, found),
        "masses of legs": _refined_masses(person, found),
    }
    for clock in found.clocks:
        low = np.array([clock.offset.low])
        high = np.array([clock.offset.high])
        covered["clock of forces"] = Covered.of_limits(np.array([late]), low, high)
    return covered


def _refined_lengths(person: mm.Model, given: mm.Model, found: Refinement) -> Covered:
    """Compare lengths of the legs with the truth."""
    truth = {one.name: one.extent for one in lengths_of(person)}
    named = [one for one in lengths_of(given) if one.along and one.segment in LEGS]
    places = [found.lengths.index(one.name) for one in named]
    extent = np.array([one.extent for one in named])
    errors = extent * found.factors[places] - [truth[one.name] for one in named]
    own = found.estimate.unknowns.slices["lengths"]
    prior_sd = np.sqrt(found.estimate.posterior.before[own])[places]
    return Covered.of_sd(errors, extent * found.factors_sd[places], extent * prior_sd)


def _refined_masses(person: mm.Model, found: Refinement) -> Covered:
    """Compare masses of the legs with the truth."""
    rows = [found.model.body_names.index(name) for name in LEGS]
    errors = found.parameters[rows, 0] - [person.body(name).mass for name in LEGS]
    own = found.estimate.unknowns.slices["masses"]
    prior_sd = np.sqrt(found.estimate.posterior.before[own]).reshape(-1, 10)[rows, 0]
    return Covered.of_sd(errors, found.mass_sd[rows], prior_sd)


def gained(folder: Path) -> Iterator[Case]:
    """Gains of EMG: forces are integrated with elastic tendons, envelopes err alike over time."""
    model = as_degroote(mm.read_model(folder / "opensim-reference-small/arm26_bounds.osim"))
    yield Case(
        unknown="gains that torques determine",
        noise=f"10 % of EMG, alike over {ALIKE:g} s; tendons elastic",
        truths=GAINED,
        covered=joined([_gains(model, seed) for seed in range(FIRST, FIRST + GAINED)]),
        promised=95,
    )


def _gains(model: mm.Model, seed: int) -> Covered:
    """Calibrate the EMG of one swing of the arm and compare intervals of the gains."""
    rng = np.random.default_rng(seed)
    clock = np.arange(0.0, 6.0, 0.01)
    motions = [swings(model, personalize.ARM, clock, rng)]
    activations = smooth_activations(clock, len(model.muscles), rng, 0.7)
    gains = some_gains(model, GAINS, rng)
    laboratory = Laboratory(errors=GAINS, gains=gains, rng=rng)
    (trial,) = all_recorded(model, model, motions, [activations], laboratory)
    envelopes = activations / np.array([gains[name] for name in model.muscle_names])
    envelopes = envelopes * (1.0 + 0.1 * alike_noise(clock, envelopes.shape, rng))
    emg = mm.Emg(clock, model.muscle_names, np.maximum(envelopes, 0.0))
    channels = {name: (name,) for name in model.muscle_names}
    options = EmgOptions(delay=0.0, weight=1.0)
    found = calibrate_emg(model, [EmgTrial(trial.motion, trial.torques, emg)], channels, options)
    truth = np.array([gains[name] for name in found.channels])
    low, high = found.intervals[found.by_torque].T
    return Covered.of_limits(truth[found.by_torque], low, high)


def personalized(folder: Path) -> Iterator[Case]:
    """Lengths, strengths and gains of people whose arm or legs swing.

    Fibers are integrated by SciPy's LSODA in equations of their own.
    """
    cases = personalize.cases()
    for name, noise in PERSONAL_CASES.items():
        people = [
            personalize.simulated_intervals(folder, cases[name], seed)
            for seed in range(FIRST, FIRST + PERSONAL)
        ]
        for parameter in people[0]:
            yield Case(
                unknown=f"{parameter.replace('_', ' ')}, {name}",
                noise=noise,
                truths=PERSONAL,
                covered=joined([person[parameter] for person in people]),
            )


def swung(folder: Path) -> Iterator[Case]:
    """Viscosity of joint and muscles of limbs, swung by hand, with faults of all instruments."""
    for noise, faults_of in SWUNG.items():
        seeds = range(FIRST, FIRST + LIMBS)
        runs = [limbs.limb_run((seed, faults_of(seed), None)) for seed in seeds]
        for quantity, label in limbs.QUANTITIES.items():
            own = [run for run in runs if quantity in run.found]
            if own:
                truth = [run.truth[quantity] for run in own]
                covered = _limits(truth, [run.found[quantity] for run in own])
                yield Case(
                    unknown=label,
                    noise=f"{noise}; simulated by MuJoCo",
                    truths=LIMBS,
                    covered=covered,
                )


def _any_limb(seed: int) -> Faults:
    return random_faults(np.random.default_rng(seed))


def _noisy_limb(seed: int) -> Faults:
    return replace(_any_limb(seed), noise=NOISY)


def _loaded_limb(seed: int) -> Faults:
    return heavy_limb(seed, CASES["nothing"])


def _swaying_limb(seed: int) -> Faults:
    return heavy_limb(seed, CASES["moving base"])


SWUNG: Mapping[str, Callable[[int], Faults]] = {
    "all instruments off, loose tissue": _any_limb,
    f"the same, noise of markers and plate times {NOISY:g}": _noisy_limb,
    "plate 5 mm and gains 2 % off, base loaded and tared": _loaded_limb,
    "the same, base turns to and fro by 3 to 4 degrees": _swaying_limb,
}
"""Faults of a limb by its seed."""


def jointed(folder: Path) -> Iterator[Case]:
    """Viscosity of mechanical joints that rub, or whose limb does not spin."""
    for name, kind in KINDS.items():
        for unknown, covered in dampings(kind, FIRST).items():
            if len(covered.held):
                yield Case(
                    unknown=unknown,
                    noise=f"{name}; simulated by MuJoCo",
                    truths=JOINTS,
                    covered=covered,
                    promised=95,
                )


def dropped(folder: Path) -> Iterator[Case]:
    """Viscosity, stiffness and dry friction of a knee by drops of the shank."""
    for noise, kind in DROPPED.items():
        seeds = range(FIRST, FIRST + RELAXED)
        runs = [relaxed.simulated_run(kind, seed) for seed in seeds]
        for name, label in relaxed.QUANTITIES.items():
            own = [run for run in runs if name in run.leg.truth and name in run.result.estimates]
            if own:
                truth = [run.leg.truth[name] for run in own]
                covered = _limits(truth, [run.result.estimates[name] for run in own])
                yield Case(
                    unknown=label,
                    noise=f"{noise}; simulated by MuJoCo",
                    truths=len(own),
                    covered=covered,
                    promised=95,
                )


def _limits(truth: Sequence[float], found: Sequence[Interval]) -> Covered:
    """Compare intervals with the truth."""
    return Covered.of_limits(
        truth=np.array(truth),
        low=np.array([interval.low for interval in found]),
        high=np.array([interval.high for interval in found]),
    )


def drawn(folder: Path) -> Iterator[Case]:
    """Drawn limits of results of a walk, as users get them."""
    for noise, errors in (("errors as assumed", Sources()), ("skin and plates off twice", OTHER)):
        people = [
            distances_from_limits(folder, "walking1", errors, person, seed=FIRST)
            for person in range(DRAWN_PEOPLE)
        ]
        for table, title in TITLES.items():
            apart = np.concatenate([one[table] for one in people])
            none = np.full(len(apart), np.nan)
            yield Case(
                unknown=title.replace("_", " "),
                noise=noise,
                truths=DRAWN_PEOPLE,
                covered=Covered(
                    held=np.asarray(apart <= FACTORS[table]), width=none, prior_width=none
                ),
            )


def numbered(folder: Path) -> Iterator[Case]:
    """Numbers of drawn curves that are no linear function of them."""
    noise = "a constant, and skin that is alike for 0.1 s"
    for what, covered in numbers_of_curves(folder, FIRST).items():
        yield Case(unknown=f"{what} of joint angles", noise=noise, truths=CURVES, covered=covered)
    for error in SCORE_ERRORS:
        yield Case(
            unknown=f"gait profile score of walkers {AWAY:g} degrees from the norm",
            noise=f"a constant of {error:g} degrees in every variable",
            truths=WALKERS,
            covered=gait_profile_scores(error, FIRST),
        )


ESTIMATORS: Mapping[str, Callable[[Path], Iterator[Case]]] = {
    "calibrate": calibrated,
    "mounting of sensors": mounted,
    "pose of a plate": placed_plates,
    "identify": identified,
    "refine": refined,
    "EMG gains": gained,
    "personalize": personalized,
    "viscosity, swings": swung,
    "viscosity, mechanical joints": jointed,
    "viscosity, drops": dropped,
    "drawn limits": drawn,
    "numbers of draws": numbered,
}


def _student(error: Array, sd: Array, freedom: float) -> Covered:
    """Compare Student intervals of 90 % with errors (intervals,)."""
    half = stdtrit(freedom, 0.95) * sd
    return Covered.of_limits(np.zeros(len(error)), error - half, error + half)


def main() -> None:
    """Measure some estimators, print their rows, and put them into the table."""
    names = sys.argv[1:] or list(ESTIMATORS)
    rows: dict[str, list[Mapping[str, object]]] = {}
    for row in load(TABLE):
        rows.setdefault(row["estimator"], []).append(row)
    for name in names:
        rows[name] = list(measure(data_folder(), [name]))
        for row in rows[name]:
            print("; ".join(f"{key}: {value}" for key, value in row.items()), flush=True)
        ordered = [row for estimator in ESTIMATORS for row in rows.get(estimator, [])]
        save(TABLE, ordered, "python -m benchmarks.validation coverage")


if __name__ == "__main__":
    main()
