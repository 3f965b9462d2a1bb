"""Soft tissue that `identify` finds where coordinates have noise.

In persons without any, in persons with some, and where markers move less than the mass.

The truths are simulated by MuJoCo from motions of closed form; noise and soft tissue are added to
the true coordinates.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import scipy
from threadpoolctl import threadpool_limits

import myomorph as mm
from myomorph.body.identify.recordings import RecordingOptions, usable
from myomorph.body.identify.soft_tissue import Use
from myomorph.body.identify.subject import Identification, IdentificationOptions
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Marker
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.turns import floating_coordinates
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape
from truths.simulated_engines import TreeEngine
from truths.simulated_subject import (
    Amplitudes,
    Instruments,
    Movement,
    Recording,
    Subject,
    SubjectOptions,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
)
from truths.small_person import person

Row = dict[str, object]

CUTOFF = 6.0
"""Of coordinates and forces alike [Hz]."""
RATE = 100.0
DURATION = 6.0
BANDS = {"fast": (0.4, 3.0), "slow": (0.2, 1.2)}
"""Of the sines that each coordinate is the sum of [Hz]."""
AMPLITUDES = Amplitudes(share=0.35, root=(0.04, 0.15))
SPACING = 0.04
"""Of the mass points [m]."""
ALIKE = 0.9
"""Correlation of noise from one frame to the next, where it is not white."""
SEEDS = 6
FIRST_SEED = 300
"""Of the truths that are reported; others were used while working."""
EDGE = 0.3
"""Torques are compared farther from both ends than this [s]."""


@dataclass(frozen=True, kw_only=True)
class Truth:
    """What markers show of the motion.

    Attributes
    ----------
    name : in the table
    alpha : markers show q - alpha q'' [s^2]
    noise : standard deviation of each coordinate [degrees; of translations as many mm]
    alike : correlation of the noise from frame to frame
    motion : one of `BANDS`
    """

    name: str
    alpha: float = 0.0
    noise: float = 0.0
    alike: float = 0.0
    motion: str = "fast"


NOTHING = "as the mass"
MORE = "more than the mass"
LESS = "less than the mass"
TRUTHS = (
    Truth(name=NOTHING),
    Truth(name=NOTHING, noise=0.05),
    Truth(name=NOTHING, noise=0.1),
    Truth(name=NOTHING, noise=0.3),
    Truth(name=NOTHING, noise=0.1, alike=ALIKE),
    Truth(name=NOTHING, noise=0.3, alike=ALIKE),
    Truth(name=NOTHING, noise=0.05, motion="slow"),
    Truth(name=NOTHING, noise=0.1, motion="slow"),
    Truth(name=NOTHING, noise=0.3, motion="slow"),
    Truth(name=LESS, alpha=-3e-4, noise=0.1, motion="slow"),
    Truth(name=LESS, alpha=-3e-4, noise=0.1),
    Truth(name=LESS, alpha=-3e-4, noise=0.3),
    Truth(name=MORE, alpha=4e-4),
    Truth(name=MORE, alpha=4e-4, noise=0.1),
    Truth(name=MORE, alpha=4e-4, noise=0.3),
    Truth(name=MORE, alpha=4e-4, noise=0.1, alike=ALIKE),
)


@dataclass(frozen=True, eq=False)
class Person:
    """A simulated person and what was recorded.

    Attributes
    ----------
    subject : generic masses and true ones, of the same lengths
    recording : true motion and wrench of the plate
    """

    subject: Subject
    recording: Recording


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each truth."""
    seeds = range(FIRST_SEED, FIRST_SEED + SEEDS)
    everybody = {motion: [simulated_person(seed, motion) for seed in seeds] for motion in BANDS}
    for truth in TRUTHS:
        people = everybody[truth.motion]
        found = [
            identified(one, truth, seed, "auto") for seed, one in zip(seeds, people, strict=True)
        ]
        yield _row(truth, people, found)


def simulated_person(seed: int, motion: str = "fast") -> Person:
    """Simulate a person with masses of its own who moves every joint.

    Parameters
    ----------
    seed : of masses and motion
    motion : one of `BANDS`
    """
    compiled = person()
    bare = model_from_mujoco(compiled, name="person")
    # The engine asks for markers.
    markers = [Marker(body.name, body.name, body.mass_center) for body in bare.bodies]
    generic = bare.with_markers(tuple(markers))
    options = SubjectOptions(length=0.0, asymmetry=0.0, marker_shift=0.0, seed=seed)
    subject = random_subject(generic, options)
    names, middles, reaches = middles_and_reaches(subject.person, AMPLITUDES)
    recording = record(
        subject,
        TreeEngine(compiled, subject.person),
        Movement(
            names=names,
            curves=exciting_curves(middles, reaches, seed=seed, band=BANDS[motion]),
            duration=DURATION,
        ),
        Instruments(rate=RATE, seed=seed),
    )
    return Person(subject=subject, recording=recording)


def shown(one: Person, truth: Truth, seed: int) -> mm.Motion:
    """Return the coordinates that inverse kinematics would give.

    Parameters
    ----------
    one : the person
    truth : what markers show
    seed : of the noise
    """
    motion = one.recording.motion
    random = np.random.default_rng((seed, 7))
    white = random.normal(size=motion.values.shape)
    white[1:] *= np.sqrt(1.0 - truth.alike**2)
    noise = scipy.signal.lfilter([1.0], [1.0, -truth.alike], white, axis=0)
    model = one.subject.person
    turns = [model.coordinate(name).motion == "rotational" for name in motion.names]
    sizes = truth.noise * np.where(turns, np.radians(1.0), 1e-3)
    values = motion.values - truth.alpha * motion.accelerations + sizes * noise
    return mm.Motion(motion.time, motion.names, values)


def identified(one: Person, truth: Truth, seed: int, use: Use) -> Identification:
    """Identify the masses of a person from what markers show.

    Parameters
    ----------
    one : the person
    truth : what markers show
    seed : of the noise
    use : of soft tissue
    """
    model = one.subject.generic
    mass = one.subject.person.mass
    options = RecordingOptions(cutoff=CUTOFF)
    motion = shown(one, truth, seed)
    recording = usable(model, motion, one.recording.wrenches, mass=mass, options=options)
    points, _, _ = body_points(model, BodyShape(), mass, BodyOptions(spacing=SPACING))
    return mm.identify(
        model,
        [recording],
        points,
        mass=mass,
        options=IdentificationOptions(compare=False, soft_tissue=use),
        recording=options,
    )


def _row(truth: Truth, people: Sequence[Person], found: Sequence[Identification]) -> Row:
    """Write what was found of all persons."""
    tissues = [each.soft_tissue for each in found]
    evidence = [each.tissue_evidence for each in found]
    taken = [
        (one, tissue, seed)
        for seed, (one, tissue) in enumerate(zip(people, tissues, strict=True), FIRST_SEED)
        if tissue is not None
    ]
    alphas = [float(np.median(tissue.alpha)) for _, tissue, _ in taken]
    changes = [torque_error(one, truth, seed, tissue) for one, tissue, seed in taken]
    shown = [one for one in evidence if one is not None and one.shown]
    return {
        "markers move": truth.name,
        "motion": truth.motion,
        "alpha [1e-4 s^2]": 1e4 * truth.alpha,
        "noise [degrees]": truth.noise,
        "alike from frame to frame": truth.alike,
        "persons": len(people),
        "forces show soft tissue": len(shown),
        "soft tissue taken": len(taken),
        "found alpha, median [1e-4 s^2]": _median([1e4 * alpha for alpha in alphas]),
        "error of torques, of that without soft tissue": _median(changes),
    }


def _median(values: Sequence[float]) -> float | None:
    return float(np.median(values)) if values else None


def torque_error(one: Person, truth: Truth, seed: int, tissue: SoftTissue) -> float:
    """Compute the error of joint torques with soft tissue, over that without.

    Parameters
    ----------
    one : the person, whose true masses are used
    truth : what markers show
    seed : of the noise
    tissue : as it was found
    """
    model = one.subject.person
    recording = one.recording
    filtered = mm.differentiate(shown(one, truth, seed), CUTOFF)
    true = _joint_torques(model, recording.motion, recording.wrenches)
    inside = slice(int(EDGE * RATE), -int(EDGE * RATE))
    errors = [
        np.sqrt(
            np.mean(np.square(_joint_torques(model, motion, recording.wrenches) - true)[inside])
        )
        for motion in (tissue.of(filtered), filtered)
    ]
    with_tissue, without = errors
    return float(with_tissue / without)


def _joint_torques(model: mm.Model, motion: mm.Motion, wrenches: mm.Wrenches) -> Array:
    """Compute torques (frames, joints) [N m]."""
    torques = mm.inverse_dynamics(model, motion, wrenches)
    root = floating_coordinates(model)
    columns = [index for index, name in enumerate(torques.names) if name not in root]
    return np.asarray(torques.values[:, columns])
