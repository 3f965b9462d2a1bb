"""What calibration and identification recover of a simulated subject whose truth is known.

`python -m benchmarks.accuracy.identification.simulated [CASE]` measures one case alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

import myomorph as mm
from benchmarks.errors import rms
from data_collection import data_folder
from myomorph.body.identify import base, least_squares
from myomorph.body.identify.recordings import RecordingOptions, Usable, usable
from myomorph.body.identify.subject import GENERIC, SHAPE, Identification, IdentificationOptions
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.rigid.regressor import base_wrench
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape
from truths.simulated_bodies import full_body, many_coordinates
from truths.simulated_engines import Engine, SimbodyEngine, TreeEngine
from truths.simulated_subject import (
    Instruments,
    Movement,
    Recording,
    Subject,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
    step_curves,
)
from truths.simulated_truth import frames_between, joint_distances, moved, own_wrench, predicted

CUTOFF = 4.0
"""Of markers' coordinates and plate forces alike [Hz]; the motion lies below about 2 Hz."""
SPACING = 0.01
"""Of the mass points that fill the bodies' envelopes [m]."""

Row = dict[str, object]
Facts = Iterator[tuple[str, object, str]]
"""Quantity, value, and the target where there is one: "<= 2"."""


@dataclass(frozen=True)
class Case:
    """A generic body and the engine that measures a person made from it."""

    name: str
    make: Callable[[Path, bool], tuple[mm.Model, Callable[[mm.Model], Engine]]]


def _full_body(folder: Path, free: bool) -> tuple[mm.Model, Callable[[mm.Model], Engine]]:
    compiled, model = full_body(free)
    return model, lambda person: TreeEngine(compiled, person)


def _many_coordinates(folder: Path, free: bool) -> tuple[mm.Model, Callable[[mm.Model], Engine]]:
    path = folder / "fullbody-many-muscles" / "cyclistFullBodyMuscle.osim"
    return many_coordinates(mm.read_model(path), free), SimbodyEngine


CASES = (Case("MyoFullBody", _full_body), Case("171 coordinates", _many_coordinates))


@dataclass(frozen=True)
class Size:
    """How long the motions are [s], and of how many frames lengths are calibrated."""

    exciting: float = 180.0
    held_out: float = 60.0


@dataclass(frozen=True, eq=False)
class Trials:
    """A subject and its two recordings."""

    subject: Subject
    exciting: Recording
    held_out: Recording


def trials(case: Case, folder: Path, free: bool, size: Size) -> Trials:
    """Both recordings of a case."""
    generic, engine_of = case.make(folder, free)
    subject = random_subject(generic)
    engine = engine_of(subject.person)
    names, middles, reaches = middles_and_reaches(subject.person)
    first = record(
        subject,
        engine,
        Movement(names=names, curves=exciting_curves(middles, reaches), duration=size.exciting),
    )
    curves = step_curves(middles, reaches, size.held_out)
    return Trials(
        subject,
        first,
        record(
            subject,
            engine,
            Movement(names=names, curves=curves, duration=size.held_out),
            Instruments(seed=6),
        ),
    )


def measure(folder: Path, size: Size | None = None, only: str = "") -> Iterator[Row]:
    """Rows of all cases: quantity, value, and the target where there is one."""
    size = size or Size()
    for case in CASES:
        if only not in case.name:
            continue
        for way in (from_markers, with_known_kinematics):
            began = time.perf_counter()
            for name, value, target in way(case, folder, size):
                yield {"model": case.name, "quantity": name, "value": value, "target": target}
            print(
                f"simulated subject, {case.name}: {way.__name__} took"
                f" {time.perf_counter() - began:.0f} s",
                flush=True,
            )


def with_known_kinematics(case: Case, folder: Path, size: Size) -> Facts:
    """Identify with plate noise alone.

    The true coordinates of the true lengths are known, and every coordinate moves.
    """
    got = trials(case, folder, free=True, size=size)
    person = got.subject.person
    one = got.exciting
    other = got.held_out
    gap = np.nanmax(
        np.abs(own_wrench(person, other.motion, other.center) - other.exact_wrench), axis=0
    )
    yield "motion known: coordinates that move", len(one.motion.names), ""
    yield "our base wrench less the engine's, largest [N m]", float(gap[:3].max()), ""
    yield "our base wrench less the engine's, largest [N]", float(gap[3:].max()), ""
    options = base.BaseOptions(reference=tuple(map(float, one.center)), motion_sd=0.0)
    fit = base.fit_base(
        person, [least_squares.Recording(one.motion, one.wrenches)], options=options
    )
    yield from _base_facts("motion known", fit, inertial_parameters(person))
    error = predicted(person, other.motion, other.center, standard_of(fit)) - other.exact_wrench
    ratio = np.sqrt(np.mean(error**2, axis=0)) / other.sigma
    yield (
        "motion known, base parameters: error of the held-out wrench / plate noise, moments",
        float(ratio[:3].max()),
        "<= 2",
    )
    yield (
        "motion known, base parameters: error of the held-out wrench / plate noise, forces",
        float(ratio[3:].max()),
        "<= 2",
    )


def from_markers(case: Case, folder: Path, size: Size) -> Facts:
    """Marker and plate noise: lengths, markers, coordinates and masses are all found."""
    got = trials(case, folder, free=False, size=size)
    person = got.subject.person
    yield "motion from markers: coordinates that move", len(got.exciting.motion.names), ""
    found = mm.calibrate(
        got.subject.generic, [got.exciting.markers], mm.CalibrationOptions(noise=0.0)
    )
    yield "lengths and markers from so many frames", sum(len(one) for one in found.frames), ""
    yield (
        "noise of a marker, found and true [mm]",
        f"{1e3 * found.noise:.3f}, {1e3 * Instruments().marker:g}",
        "",
    )
    yield from _length_facts(found.model, got.subject)
    fit, seen = fitted(found.model, got)
    shift = frames_between(person, got.held_out.motion, found.model, seen[1].recording.motion)
    yield from _marker_facts(found.model, person, shift)
    truth = moved(inertial_parameters(person), *shift)
    yield from _base_facts("motion from markers", fit, truth)
    identified = _identified(found.model, seen[:1], person.mass)
    tables = {
        "the true masses": truth,
        "base parameters": standard_of(fit),
        "identify": identified.parameters[identified.chosen],
        "shape only": identified.parameters[SHAPE],
        "generic masses": identified.parameters[GENERIC],
    }
    links = identified.consistency[identified.chosen].links
    possible = sum(one.ok for one in links)
    yield (
        "links of the identified model that are physically possible",
        f"{possible} of {len(links)}",
        "",
    )
    yield from _held_out_facts(got, found.model, tables, seen[1].recording)


def _identified(model: mm.Model, seen: list[Usable], mass: float) -> Identification:
    """Identify masses in the way that predicts other motions best.

    Masses that are identifiable keep nearer to the generic ones.
    """
    points, inside, _ = body_points(model, BodyShape(), mass, BodyOptions(SPACING), compare=False)
    options = IdentificationOptions(compare=False, masses="expected")
    return mm.identify(model, seen, points, mass=mass, inside=inside, options=options)


def _length_facts(model: mm.Model, subject: Subject) -> Facts:
    found = joint_distances(model)
    true = joint_distances(subject.person)
    generic = joint_distances(subject.generic)
    error = np.array([abs(found[pair] - true[pair]) for pair in true])
    before = np.array([abs(generic[pair] - true[pair]) for pair in true])
    worst = list(true)[int(np.argmax(error))]
    yield "distances between joints of a segment", len(error), ""
    yield (
        "their error on the generic model, RMS and largest [mm]",
        _listed(1e3 * np.array([rms(before), before.max()])),
        "",
    )
    yield "their error on the found model, RMS [mm]", 1e3 * rms(error), ""
    yield f"largest [mm] ({' to '.join(worst)})", 1e3 * float(error.max()), "<= 2"


def _marker_facts(model: mm.Model, person: mm.Model, shift: tuple[Array, Array]) -> Facts:
    rotations, origins = shift
    true = {one.name: one for one in person.markers}
    raw = []
    aligned = []
    for one in model.markers:
        b = model.body_names.index(one.body)
        raw.append(np.linalg.norm(one.location - true[one.name].location))
        aligned.append(
            np.linalg.norm(one.location - rotations[b] @ true[one.name].location - origins[b])
        )
    for name, error in (("in the body's own frame", raw), ("on the body", aligned)):
        yield (
            f"marker positions {name}: error, RMS and largest [mm]",
            _listed(1e3 * np.array([rms(error), max(error)])),
            "",
        )
        yield (
            f"marker positions {name}: within 3 mm [%]",
            100.0 * float(np.mean(np.array(error) < 3e-3)),
            ">= 100" if name == "on the body" else "",
        )


def fitted(model: mm.Model, got: Trials) -> tuple[base.BaseFit, list[Usable]]:
    """Fit base parameters from both noises; both motions and their forces are filtered alike."""
    seen = []
    for one in (got.exciting, got.held_out):
        motion = mm.inverse_kinematics(model, one.markers).motion
        mass = got.subject.person.mass
        seen.append(
            usable(model, motion, one.wrenches, mass=mass, options=RecordingOptions(CUTOFF))
        )
    options = base.BaseOptions(reference=tuple(map(float, got.exciting.center)))
    return base.fit_base(model, [seen[0].recording], options=options), seen


def standard_of(fit: base.BaseFit) -> Array:
    """Return standard parameters that have the estimated base parameters, the others zero.

    Parameters
    ----------
    fit : estimated base parameters

    Returns
    -------
    (bodies, 10)
    """
    table = np.zeros(10 * len(fit.base.bodies))
    table[fit.base.columns] = fit.estimate
    return table.reshape(-1, 10)


def _base_facts(name: str, fit: base.BaseFit, truth: Array) -> Facts:
    error = np.abs(fit.estimate - fit.base.of(truth)) / fit.sd
    yield (
        f"{name}: base parameters, and those that the motion shows",
        f"{len(fit.base)}, {int(fit.identifiable.sum())}",
        "",
    )
    yield (
        f"{name}: base parameters within 3 standard deviations [%]",
        100.0 * float(np.mean(error < 3.0)),
        ">= 95",
    )
    known = np.abs(error[fit.identifiable])
    yield (
        f"{name}: the same of the identifiable ones [%]",
        100.0 * float(np.mean(known < 3.0)),
        ">= 95",
    )
    yield f"{name}: error / standard deviation, RMS", rms(error), ""


def _held_out_facts(
    got: Trials, model: mm.Model, tables: Mapping[str, Array], other: least_squares.Recording
) -> Facts:
    """Compare tables with the first of them, which is the truth.

    Its error is that of the kinematics and the plate.
    """
    center = got.held_out.center
    sigma = got.held_out.sigma
    measured = base_wrench(model, other.motion, other.wrenches, center)[other.use]
    found = {
        name: np.sqrt(
            np.mean(
                (predicted(model, other.motion, center, table)[other.use] - measured) ** 2, axis=0
            )
        )
        for name, table in tables.items()
    }
    floor = next(iter(found.values()))
    for name, errors in found.items():
        judged = name in ("base parameters", "identify")
        yield f"held-out wrench by {name}: RMS error, moments [N m]", _listed(errors[:3]), ""
        yield f"held-out wrench by {name}: RMS error, forces [N]", _listed(errors[3:]), ""
        if judged:
            yield (
                f"held-out wrench by {name}: forces / plate noise",
                float((errors / sigma)[3:].max()),
                "<= 2",
            )
            yield (
                f"held-out wrench by {name}: moments / plate noise",
                float((errors / sigma)[:3].max()),
                "",
            )
            yield (
                f"held-out wrench by {name}: largest ratio to the true masses' error",
                float((errors / floor).max()),
                "<= 2",
            )


def _listed(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def main() -> None:
    """Measure and print."""
    for row in measure(data_folder(), only=sys.argv[1] if len(sys.argv) > 1 else ""):
        print("; ".join(f"{key}: {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
