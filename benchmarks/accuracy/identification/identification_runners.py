"""Identified masses of simulated runners, and the coverage of intervals.

The runners' markers move on soft tissue.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from threadpoolctl import threadpool_limits

import myomorph as mm
from benchmarks.accuracy.identification.identification import CUTOFF, SPACING, SUBJECTS, opened
from myomorph.body.identify.base_parameters import base_parameters
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.link_prior import LINK_SD
from myomorph.body.identify.motion_noise import coordinate_noise, noise_of, plus
from myomorph.body.identify.parts import parts_of
from myomorph.body.identify.recordings import RecordingOptions, Usable, usable
from myomorph.body.identify.soft_tissue import Use
from myomorph.body.identify.subject import GENERIC, IdentificationOptions
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import inertial_parameters, parameters_of, pseudo_inertias
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.rigid.regressor import base_regressor, reference_points
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape

RUNNER = "Hamner, calibrated"
TRAIN = "run200"
TEST = "run500"
SEEDS = 6
MARKER_NOISE = 1e-3
"""Of each marker along one axis, white [m]."""
ALPHAS = 4e-4
ALPHA_SD = 1e-4
"""Of each coordinate by itself, where coordinates are too large [s^2]."""
RESONANCES = (8.0, 12.0)
DAMPING = (0.2, 0.4)
"""Of the springs under the markers of a body [Hz], and shares of critical damping."""

LIMBS: Mapping[str, Mapping[str, tuple[str, ...]]] = {
    "trunk and legs": {
        "trunk": ("pelvis", "torso"),
        **{
            f"leg {side}": tuple(
                f"{body}_{side}" for body in ("femur", "tibia", "talus", "calcn", "toes")
            )
            for side in "rl"
        },
    },
    "thighs, shanks, feet": {
        f"{name} {side}": tuple(f"{body}_{side}" for body in bodies)
        for name, bodies in (
            ("thigh", ("femur",)),
            ("shank", ("tibia",)),
            ("foot", ("talus", "calcn", "toes")),
        )
        for side in "rl"
    },
    "arms": {
        f"arm {side}": tuple(f"{body}_{side}" for body in ("humerus", "ulna", "radius", "hand"))
        for side in "rl"
    },
}
"""Bodies whose masses are judged together."""
USES: tuple[Use, ...] = ("never", "auto")

Tissue = Callable[[mm.Model, mm.Motion, np.random.Generator], mm.Markers]
Row = dict[str, object]


def too_large_coordinates(
    model: mm.Model, motion: mm.Motion, random: np.random.Generator
) -> mm.Markers:
    """Return markers on a body whose every coordinate is q - alpha q''.

    A filter of the gain 1 / (1 + alpha w^2) undoes that.
    """
    alpha = np.maximum(ALPHAS + ALPHA_SD * random.normal(size=len(motion.names)), 0.0)
    return mm.marker_positions(
        model, replace(motion, values=motion.values - alpha * motion.accelerations)
    )


def sprung_markers(model: mm.Model, motion: mm.Motion, random: np.random.Generator) -> mm.Markers:
    """Return markers on damped springs, driven by the body below them.

    The markers of each body resonate at a frequency of its own.
    """
    markers = mm.marker_positions(model, motion)
    step = float(np.median(np.diff(markers.time)))
    frequencies = {body: random.uniform(*RESONANCES) for body in model.body_names}
    damping = {body: random.uniform(*DAMPING) for body in model.body_names}
    values = np.array(markers.values)
    for index, name in enumerate(markers.names):
        body = model.marker(name).body
        # The trend is carried as it is, and the ends are mirrored about themselves, so that nothing
        # rings there.
        path = values[:, index]
        trend = path[0] + (path[-1] - path[0]) * np.linspace(0.0, 1.0, len(path))[:, None]
        swing = path - trend
        whole = np.concatenate([swing, -swing[-2:0:-1]])
        ratio = np.fft.rfftfreq(len(whole), step) / frequencies[body]
        # What excites a spring from below reaches the mass on it through spring and damper.
        through = (1.0 + 2j * damping[body] * ratio) / (1.0 - ratio**2 + 2j * damping[body] * ratio)
        moved = np.fft.irfft(np.fft.rfft(whole, axis=0) * through[:, None], len(whole), axis=0)
        values[:, index] = trend + moved[: len(path)]
    return replace(markers, values=values)


TISSUES: Mapping[str, Tissue] = {
    "coordinates too large": too_large_coordinates,
    "markers on springs": sprung_markers,
}


@dataclass(frozen=True, eq=False)
class _Runner:
    """A simulated runner: true masses, and each recording as measured, with its true motion."""

    truth: Array
    seen: Mapping[str, Usable]
    recorded: Mapping[str, SubjectTrial]


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each kind of soft tissue and way to identify."""
    subject = next(subject for subject in SUBJECTS if subject.name == RUNNER)
    if not (folder / subject.model).exists():
        return
    model, trials = opened(folder, subject)
    points, _, _ = body_points(model, BodyShape(), model.mass, BodyOptions(spacing=SPACING))
    generic = inertial_parameters(model)
    heavy = generic[:, 0] > 0.0
    for tissue, moved in TISSUES.items():
        random = np.random.default_rng(7)
        runners = [
            _runner(model, trials, drawn_body(model, heavy, random), moved, random)
            for _ in range(SEEDS)
        ]
        yield _row(
            tissue, "true masses", [_ratio(model, runner, runner.truth, None) for runner in runners]
        )
        for use in USES:
            found = [_identified(model, runner, points, use) for runner in runners]
            yield _row_of_way(tissue, "identify", use, _outcomes(model, runners, found))
        for use in USES:
            found = [_refined(model, runner, use) for runner in runners]
            yield _row_of_way(tissue, "refine", use, _outcomes(model, runners, found))
        errors = [_limb_errors(model, runner, generic) for runner in runners]
        yield _row(tissue, "generic", [np.ones(2)], errors)


class Found(NamedTuple):
    """Masses of a runner.

    Attributes
    ----------
    parameters : (bodies, 10)
    expected : (bodies,) expected masses [kg]
    sd : (bodies,) their standard deviations [kg]
    tissue : soft tissue, None where it was not used
    """

    parameters: Array
    expected: Array
    sd: Array
    tissue: SoftTissue | None


@dataclass(frozen=True, eq=False)
class _Outcome:
    """Masses of a runner compared with the truth.

    Attributes
    ----------
    ratio : (2,) misfit of the held-out recording over the generic model's, moment and force
    errors : of each limb, (segments,) error of its masses, of themselves
    inside : (heavy,) whether the interval of a mass holds the truth
    taken : soft tissue was used
    """

    ratio: Array
    errors: Sequence[Array]
    inside: Array
    taken: bool


def _outcomes(
    model: mm.Model, runners: Sequence[_Runner], found: Sequence[Found]
) -> list[_Outcome]:
    heavy = inertial_parameters(model)[:, 0] > 0.0
    outcomes = []
    for runner, one in zip(runners, found, strict=True):
        off = np.abs(one.expected - runner.truth[:, 0]) / np.maximum(one.sd, 1e-12)
        outcomes.append(
            _Outcome(
                ratio=_ratio(model, runner, one.parameters, one.tissue),
                errors=_limb_errors(model, runner, one.parameters),
                inside=off[heavy] < half_width(1.0),
                taken=one.tissue is not None,
            )
        )
    return outcomes


def _row_of_way(tissue: str, way: str, use: Use, outcomes: Sequence[_Outcome]) -> Row:
    return _row(
        tissue,
        way if use == "auto" else f"{way}, soft tissue never",
        [one.ratio for one in outcomes],
        [one.errors for one in outcomes],
        float(np.mean([one.inside for one in outcomes])),
        sum(one.taken for one in outcomes),
    )


def _limb_errors(model: mm.Model, runner: _Runner, parameters: Array) -> list[Array]:
    return [_errors(model, runner.truth, parameters, limbs) for limbs in LIMBS.values()]


def _identified(
    model: mm.Model, runner: _Runner, points: Mapping[str, mm.MassPoints], use: Use
) -> Found:
    options = IdentificationOptions(compare=False, soft_tissue=use)
    found = mm.identify(
        model,
        [runner.seen[TRAIN]],
        points,
        mass=model.mass,
        options=options,
        recording=RecordingOptions(CUTOFF),
    )
    masses = found.parameters[found.chosen]
    return Found(
        parameters=masses,
        expected=found.expected[:, 0],
        sd=found.sd[:, 0],
        tissue=found.soft_tissue,
    )


def _refined(model: mm.Model, runner: _Runner, use: Use) -> Found:
    """Lengths and marker positions are the model's, which are true."""
    options = mm.RefineOptions(cutoff=CUTOFF, fit=("masses",), soft_tissue=use)
    found = mm.refine(model, [runner.recorded[TRAIN]], model.mass, options)
    return Found(
        parameters=found.parameters,
        expected=found.parameters[:, 0],
        sd=found.mass_sd,
        tissue=found.soft_tissue,
    )


def _row(
    tissue: str,
    way: str,
    ratios: Sequence[Array],
    errors: Sequence[Sequence[Array]] = (),
    inside: float | None = None,
    taken: int | None = None,
) -> Row:
    moment, force = np.mean(ratios, axis=0)
    return {
        "soft tissue": tissue,
        "masses": way,
        "runners": SEEDS,
        "held-out force, of generic": float(force),
        "held-out moment, of generic": float(moment),
        **{
            f"{name}, RMS error [%]": 100.0
            * float(np.sqrt(np.mean(np.square([row[i] for row in errors]))))
            if len(errors)
            else None
            for i, name in enumerate(LIMBS)
        },
        "masses inside 90 % intervals [%]": None if inside is None else 100.0 * inside,
        "soft tissue taken": taken,
    }


def _runner(
    model: mm.Model,
    trials: Mapping[str, Usable],
    truth: Array,
    moved: Tissue,
    random: np.random.Generator,
) -> _Runner:
    """Return recordings as the laboratory would have them.

    Forces are exact, of the true motion. Markers move more.
    """
    seen = {}
    recorded = {}
    for name in (TRAIN, TEST):
        recording = trials[name].recording
        # All frames: which of them count is found from what was measured.
        motion = recording.motion
        wrench = base_regressor(model, motion) @ truth.ravel()
        wrenches = mm.Wrenches(
            motion.time,
            ("plate",),
            (model.body_names[0],),
            wrench[:, None, 3:],
            reference_points(model, motion)[:, None],
            wrench[:, None, :3],
        )
        markers = moved(model, motion, random)
        markers = replace(
            markers, values=markers.values + MARKER_NOISE * random.normal(size=markers.values.shape)
        )
        recorded[name] = SubjectTrial(name, markers, wrenches)
        tracked = mm.inverse_kinematics(model, markers).motion
        seen[name] = usable(model, tracked, wrenches, name=name, options=RecordingOptions(CUTOFF))
    return _Runner(truth, seen, recorded)


def _ratio(model: mm.Model, runner: _Runner, parameters: Array, tissue: SoftTissue | None) -> Array:
    """(2,) misfit of the unseen recording over the generic model's, moment and force."""
    recording = runner.seen[TEST].recording
    base = base_parameters(model)

    def misfit(recording: Recording, parameters: Array) -> Array:
        return parts_of(model, [recording], base, least=1).rms(parameters)

    generic = misfit(recording, inertial_parameters(model))
    return misfit(recording if tissue is None else recording.moved(tissue.of), parameters) / generic


def _errors(
    model: mm.Model, truth: Array, parameters: Array, segments: Mapping[str, tuple[str, ...]]
) -> Array:
    """(segments,) error of each segment's mass, of itself."""
    rows = [[model.body_names.index(body) for body in bodies] for bodies in segments.values()]
    true = np.array([truth[row, 0].sum() for row in rows])
    return np.array([parameters[row, 0].sum() for row in rows]) / true - 1.0


MOTIONS = ("gait2354, ScaleTool", "Hamner, generic lengths", "Rajagopal, scaled by an expert")
"""The correction for noise was made with the first two; the third was not looked at before."""
NOISES = (0.0002, 0.002)
INTERVAL_SEEDS = 12
HEAVY = 0.003
"""Share of the body's mass from which a link counts."""


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure_intervals(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each motion and noise.

    It has the share of the parameters inside their interval, over bodies drawn at random.
    """
    for subject in SUBJECTS:
        if subject.name not in MOTIONS or not (folder / subject.model).exists():
            continue
        model, trials = opened(folder, subject)
        heavy = inertial_parameters(model)[:, 0] > HEAVY * model.mass
        points, _, _ = body_points(model, BodyShape(), model.mass, BodyOptions(spacing=SPACING))
        for sd in NOISES:
            random = np.random.default_rng(0)
            errors = []
            kept = 0
            ranks = []
            shown = []
            for _ in range(INTERVAL_SEEDS):
                truth = drawn_body(model, heavy, random)
                seen = [_recorded(model, truth, one, sd, random) for one in trials.values()]
                options = IdentificationOptions(compare=False, motion_sd=sd)
                found = mm.identify(model, seen, points, mass=model.mass, options=options)
                errors.append(((found.expected - truth) / found.sd)[heavy])
                kept += found.chosen == GENERIC
                ranks.append(found.known.rank)
                shown.append(int(found.known.data.sum()))
            inside = np.abs(np.array(errors)) < half_width(1.0)
            yield {
                "motion": subject.name,
                "noise of coordinates [mrad, mm]": 1e3 * sd,
                "bodies": INTERVAL_SEEDS,
                "masses inside [%]": 100.0 * float(inside[..., 0].mean()),
                "first moments inside [%]": 100.0 * float(inside[..., 1:4].mean()),
                "inertias inside [%]": 100.0 * float(inside[..., 4:].mean()),
                "worst mass [SD]": float(np.abs(np.array(errors)[..., 0]).max()),
                "rank": float(np.mean(ranks)),
                "parameters determined": float(np.mean(shown)),
                "generic kept": kept,
            }


def drawn_body(model: mm.Model, heavy: np.ndarray, random: np.random.Generator) -> Array:
    """Draw parameters of a possible body near the model.

    Each link's distribution of mass is stretched and sheared.

    Parameters
    ----------
    model : the generic one
    heavy : (bodies,) whether a body has mass
    random : to draw with

    Returns
    -------
    (bodies, 10) inertial parameters with the model's mass
    """
    generic = inertial_parameters(model)
    truth = generic.copy()
    for i in np.flatnonzero(heavy):
        P = pseudo_inertias(generic[i : i + 1])[0]
        values, axes = np.linalg.eigh(P)
        root = axes * np.sqrt(np.maximum(values, 1e-9 * values[-1]))
        change = np.eye(4) + 0.5 * LINK_SD * random.normal(size=(4, 4))
        truth[i] = parameters_of((root @ change @ change.T @ root.T)[None])[0]
    result: Array = truth * (model.mass / truth[:, 0].sum())
    return result


def _recorded(
    model: mm.Model, truth: Array, one: Usable, sd: float, random: np.random.Generator
) -> Usable:
    """Return the recording as it would be of that body.

    It has the body's exact forces, and its motion with noise.
    """
    motion = one.recording.motion
    wrench = base_regressor(model, motion) @ truth.ravel()
    points = reference_points(model, motion)[:, None]
    wrenches = mm.Wrenches(
        motion.time,
        ("plate",),
        (model.body_names[0],),
        wrench[:, None, 3:],
        points,
        wrench[:, None, :3],
    )
    return replace(
        one,
        recording=Recording(
            plus(motion, noise_of(motion, coordinate_noise(motion, sd, 6.0), random)),
            wrenches,
            one.recording.use,
        ),
        notes=(),
    )
