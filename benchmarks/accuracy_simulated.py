"""What calibration and identification recover of a simulated subject whose truth is known.

`python -m benchmarks.accuracy_simulated [CASE]` measures one case alone.
"""

from __future__ import annotations

import sys
import time
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from benchmarks.cases import data_folder
from benchmarks.simulated_bodies import full_body, many_coordinates
from benchmarks.simulated_engines import Engine, SimbodyEngine, TreeEngine
from benchmarks.simulated_subject import (
    Instruments,
    Recording,
    Subject,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
    step_curves,
)
from benchmarks.simulated_truth import frames_between, joint_distances, moved, own_wrench, predicted
from myomorph.identify import base
from myomorph.identify.recordings import RecordingOptions, usable
from myomorph.io.models import read_model
from myomorph.model.inertia import inertial_parameters
from myomorph.model.model import Model
from myomorph.model.spatial import Array
from myomorph.motion.calibrate import CalibrationOptions, calibrate
from myomorph.motion.ik import inverse_kinematics
from myomorph.rigid.regressor import base_wrench

CUTOFF = 4.0
"""Of markers' coordinates and plate forces alike [Hz]; the motion lies below about 2 Hz."""
FREE, MARKED = "every coordinate moves, kinematics known", "kinematics from markers"

Row = dict[str, object]


@dataclass(frozen=True)
class Case:
    """A generic body and the engine that measures a person made from it."""

    name: str
    make: Callable[[Path, bool], tuple[Model, Callable[[Model], Engine]]]


def _full_body(folder: Path, free: bool) -> tuple[Model, Callable[[Model], Engine]]:
    compiled, model = full_body(free)
    return model, lambda person: TreeEngine(compiled, person)


def _many_coordinates(folder: Path, free: bool) -> tuple[Model, Callable[[Model], Engine]]:
    path = folder / "fullbody-many-muscles" / "cyclistFullBodyMuscle.osim"
    return many_coordinates(read_model(path), free), SimbodyEngine


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
    first = record(subject, engine, names, exciting_curves(middles, reaches), size.exciting)
    curves = step_curves(middles, reaches, size.held_out)
    return Trials(subject, first, record(subject, engine, names, curves, size.held_out, Instruments(seed=6)))


def measure(folder: Path, size: Size | None = None, only: str = "") -> Iterator[Row]:
    """Rows of all cases: quantity, value, and the target where there is one."""
    size = size or Size()
    for case in CASES:
        if only not in case.name:
            continue
        for way in (_with_known_kinematics, _from_markers):
            began = time.perf_counter()
            for name, value, target in way(case, folder, size):
                yield {"model": case.name, "quantity": name, "value": value, "target": target}
            print(f"simulated subject, {case.name}: {way.__name__[1:]} took {time.perf_counter() - began:.0f} s")


Facts = Iterator[tuple[str, object, str]]


def _with_known_kinematics(case: Case, folder: Path, size: Size) -> Facts:
    """Plate noise alone: the true coordinates of the true lengths are given."""
    got = trials(case, folder, free=True, size=size)
    person, one, other = got.subject.person, got.exciting, got.held_out
    gap = np.nanmax(np.abs(own_wrench(person, other.motion, other.center) - other.exact_wrench), axis=0)
    yield f"{FREE}: coordinates that move", len(one.motion.names), ""
    yield "our base wrench less the engine's, largest [N m]", float(gap[:3].max()), ""
    yield "our base wrench less the engine's, largest [N]", float(gap[3:].max()), ""
    reference = tuple(map(float, one.center))
    fit = base.fit_base(
        person, [base.Recording(one.motion, one.wrenches)], options=base.BaseOptions(reference=reference)
    )
    yield from _base_facts(FREE, fit, inertial_parameters(person))
    wrench = predicted(person, other.motion, other.center, standard_of(fit))
    yield from _wrench_facts("held-out wrench", wrench - other.exact_wrench, other.sigma, "2")


def _from_markers(case: Case, folder: Path, size: Size) -> Facts:
    """Marker and plate noise: lengths, markers, coordinates and masses are all found."""
    got = trials(case, folder, free=False, size=size)
    person = got.subject.person
    yield f"{MARKED}: coordinates that move", len(got.exciting.motion.names), ""
    found = calibrate(got.subject.generic, [got.exciting.markers], CalibrationOptions())
    yield "lengths and markers of so many frames", sum(len(one) for one in found.frames), ""
    yield "noise of a marker, found and true [mm]", f"{1e3 * found.noise:.3f}, {1e3 * Instruments().marker:g}", ""
    yield from _length_facts(found.model, got.subject)
    for name, model in (("lengths and markers known", person), ("lengths and markers found", found.model)):
        fit, seen = _fitted(model, got)
        shift = frames_between(person, got.held_out.motion, model, seen.motion)
        if model is not person:
            yield from _marker_facts(model, person, shift)
        truth = moved(inertial_parameters(person), *shift)
        yield from _base_facts(name, fit, truth)
        yield from _held_out_facts(name, got, model, {"true masses": truth, "base": standard_of(fit)}, seen)


def _length_facts(model: Model, subject: Subject) -> Facts:
    found, true, generic = (joint_distances(one) for one in (model, subject.person, subject.generic))
    error = np.array([abs(found[pair] - true[pair]) for pair in true])
    before = np.array([abs(generic[pair] - true[pair]) for pair in true])
    worst = list(true)[int(np.argmax(error))]
    yield "distances between joints of a segment", len(error), ""
    yield (
        "their error on the generic model, RMS and largest [mm]",
        _listed(1e3 * np.array([_rms(before), before.max()])),
        "",
    )
    yield "their error on the found model, RMS [mm]", 1e3 * _rms(error), ""
    yield f"largest [mm] ({' to '.join(worst)})", 1e3 * float(error.max()), "2"


def _marker_facts(model: Model, person: Model, shift: tuple[Array, Array]) -> Facts:
    rotations, origins = shift
    true = {one.name: one for one in person.markers}
    raw, aligned = [], []
    for one in model.markers:
        b = model.body_names.index(one.body)
        raw.append(np.linalg.norm(one.location - true[one.name].location))
        aligned.append(np.linalg.norm(one.location - rotations[b] @ true[one.name].location - origins[b]))
    for name, error in (("in the body's own frame", raw), ("on the body", aligned)):
        yield (
            f"marker positions {name}: error, RMS and largest [mm]",
            _listed(1e3 * np.array([_rms(error), max(error)])),
            "",
        )
        yield f"marker positions {name}: within 3 mm [%]", 100.0 * float(np.mean(np.array(error) < 3e-3)), "100"


def _fitted(model: Model, got: Trials) -> tuple[base.BaseFit, base.Recording]:
    """Base parameters from both noises, and the held-out motion through the same filter."""
    seen = []
    for one in (got.exciting, got.held_out):
        motion = inverse_kinematics(model, one.markers).motion
        seen.append(usable(model, motion, one.wrenches, options=RecordingOptions(CUTOFF)).recording)
    options = base.BaseOptions(reference=tuple(map(float, got.exciting.center)))
    return base.fit_base(model, seen[:1], options=options), seen[1]


def standard_of(fit: base.BaseFit) -> Array:
    """(bodies, 10) standard parameters that have the base parameters found, the others zero."""
    table = np.zeros(10 * len(fit.base.bodies))
    table[fit.base.columns] = fit.estimate
    return table.reshape(-1, 10)


def _base_facts(name: str, fit: base.BaseFit, truth: Array) -> Facts:
    error = np.abs(fit.estimate - fit.base.of(truth)) / fit.sd
    yield f"{name}: base parameters, and those that the motion shows", f"{len(fit.base)}, {int(fit.shown.sum())}", ""
    yield f"{name}: within 3 standard deviations [%]", 100.0 * float(np.mean(error < 3.0)), "95"
    yield f"{name}: those shown, within 3 standard deviations [%]", 100.0 * float(np.mean(error[fit.shown] < 3.0)), "95"
    yield f"{name}: error / standard deviation, RMS", _rms(error), ""


def _wrench_facts(name: str, error: Array, sigma: Array, target: str) -> Facts:
    rms = np.sqrt(np.mean(error**2, axis=0))
    yield f"{name}: RMS error, moments [N m]", _listed(rms[:3]), ""
    yield f"{name}: RMS error, forces [N]", _listed(rms[3:]), ""
    yield f"{name}: RMS error / plate noise, largest of moments", float((rms / sigma)[:3].max()), target
    yield f"{name}: RMS error / plate noise, largest of forces", float((rms / sigma)[3:].max()), target


def _held_out_facts(name: str, got: Trials, model: Model, tables: Mapping[str, Array], other: base.Recording) -> Facts:
    center, used = got.held_out.center, np.flatnonzero(other.use)
    measured = base_wrench(model, other.motion, other.wrenches, center)[used]
    for what, table in tables.items():
        error = predicted(model, other.motion, center, table)[used] - measured
        yield from _wrench_facts(f"{name}, {what}: held-out wrench", error, got.held_out.sigma, "2")


def _rms(values: Sequence[float] | Array) -> float:
    return float(np.sqrt(np.mean(np.square(values))))


def _listed(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def main() -> None:
    """Measure and print."""
    for row in measure(data_folder(), only=sys.argv[1] if len(sys.argv) > 1 else ""):
        print("; ".join(f"{key}: {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
