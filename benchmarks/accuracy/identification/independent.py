"""Identified masses of simulated people with moving skin, or of whom only masses are unknown.

Simbody reports where bodies are and MuJoCo what the ground gives them; nothing of the estimator
takes part. `python -m benchmarks.accuracy.identification.independent [SEED ...]` measures some
people.
"""

from __future__ import annotations

import sys
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import myomorph as mm
from benchmarks.errors import rms
from data_collection import data_folder
from myomorph.body.identify.base_parameters import base_parameters, held_in
from myomorph.body.identify.mass_points import MassPointOptions
from myomorph.body.identify.parts import parts_of
from myomorph.body.identify.recordings import RecordingOptions, Usable, usable
from myomorph.body.identify.subject import Identification, IdentificationOptions
from myomorph.body.identify.unseen import Paper
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import (
    inertial_parameters,
    pseudo_inertias,
    with_inertial_parameters,
)
from myomorph.core.model.model import Joint
from myomorph.core.model.scale import scale
from myomorph.core.model.segments import segments_of
from myomorph.core.model.sides import other_side
from myomorph.core.motion.lengths import factors_of, lengths_of, mirrored_lengths
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape
from truths.simulated_bodies import many_coordinates
from truths.simulated_engines import SimbodyEngine
from truths.simulated_subject import (
    Instruments,
    Movement,
    Recording,
    Subject,
    exciting_curves,
    middles_and_reaches,
    on_one_foot,
    parameters_of,
    record,
    step_curves,
)

MODEL = "rajagopal-walk-emg/subject_walk_scaled.osim"
MANY_LINKS = "fullbody-many-muscles/cyclistFullBodyMuscle.osim"
SEEDS = (201, 202, 203, 204, 205, 206)
"""Of the people in the table. The estimator was made with people of other seeds, 1 to 22."""
SECONDS = (60.0, 30.0)
"""Of the exciting motion that masses are identified from, and of another that is predicted."""
RATE = 50.0
CUTOFF = 6.0
SPACING = 0.02
LENGTH_SD = 0.01
"""Of a segment's length, of itself: joint centers are off by up to 5 mm."""
PLACE_SD = 3e-3
"""Of a marker's place on the model along one axis [m]."""
SKIN = 6e-3
"""Root mean square by which skin carries a marker along with the joints beside it [m]."""
MASS_SD = 0.15
SIDE_SD = 0.03
CENTER = 0.1
SHAPE = 0.1
"""Standard deviations of a segment's mass, of itself; of the difference of both sides; of its mass
center, over its radius of gyration; and of its extent along and across its axes.
"""
EXTENT = 1e-3
"""Least root mean square of a body's mass along an axis, from its mass center [m]."""
HEAVY = 0.01
"""Share of the body's mass from which a body counts."""
PLACEHOLDER = 1e-5
"""Share of the body's mass up to which a link is there for its joints alone."""
ROUNDING = 1e-4
"""Share of a mass by which it is farther from the truth before that counts."""
SPREADS = (100.0, 1.0, 0.2)
"""Multiples of a base parameter's size within which [D]'s weights hold what no frame shows."""
TRUNK = ("lower_trunk", "upper_trunk", "head")
Row = dict[str, object]


@dataclass(frozen=True, eq=False)
class Person:
    """A simulated person and what a laboratory recorded of them.

    Attributes
    ----------
    model : given to the estimator, at the person's mass
    truth : (bodies, 10) inertial parameters of the person
    points : mass points of the model's own envelopes
    exciting, other : recordings, to identify from and to predict
    """

    model: mm.Model
    truth: Array
    points: Mapping[str, mm.MassPoints]
    exciting: Usable
    other: Usable


def person(folder: Path, seed: int, exact: bool = False, links: bool = False) -> Person:
    """Simulate a person and two recordings of them.

    Parameters
    ----------
    folder : of the data collection
    seed : of the person
    exact : whether lengths, motion and forces are known without any error
    links : whether the person has 80 links

    Returns
    -------
    the person, and the model that is given to the estimator
    """
    random = np.random.default_rng(seed)
    generic = mm.read_model(folder / (MANY_LINKS if links else MODEL))
    if links:
        generic = many_coordinates(generic)
    generic = replace(generic, muscles=(), wrap_objects=())
    grown = scale(generic, _factors(generic, random), inertia="affine")
    truth = drawn_masses(grown, random)
    markers = tuple(
        replace(marker, location=marker.location + PLACE_SD * random.standard_normal(3))
        for marker in grown.markers
    )
    true_model = with_inertial_parameters(replace(grown, markers=markers), truth)
    known = grown if exact else generic
    share = true_model.mass / known.mass
    model = with_inertial_parameters(known, inertial_parameters(known) * share)
    skin = None if exact else Skin.of(true_model, random)
    seen = [_seen(model, true_model, made, skin) for made in _recordings(true_model, seed)]
    exciting, other = seen
    points, _, _ = body_points(model, BodyShape(), model.mass, BodyOptions(spacing=SPACING))
    return Person(model=model, truth=truth, points=points, exciting=exciting, other=other)


def _recordings(model: mm.Model, seed: int) -> Iterator[Recording]:
    """Record the exciting motion, and another."""
    subject = Subject(generic=model, person=model)
    engine = SimbodyEngine(model)
    names, middles, reaches = middles_and_reaches(model)
    curves = (
        exciting_curves(middles, reaches, seed=seed),
        step_curves(middles, reaches, SECONDS[1], seed=seed),
    )
    for number, (curve, seconds) in enumerate(zip(curves, SECONDS, strict=True)):
        instruments = Instruments(rate=RATE, seed=100 * seed + number)
        yield record(
            subject, engine, Movement(names=names, curves=curve, duration=seconds), instruments
        )


def _seen(model: mm.Model, person: mm.Model, made: Recording, skin: Skin | None) -> Usable:
    """Measure a recording as a laboratory does: markers on skin, or without it the exact motion."""
    if skin is None:
        wrenches = on_one_foot(person, made.motion.time, made.exact_wrench, made.center)
        return usable(model, made.motion, wrenches, mass=model.mass)
    motion = mm.inverse_kinematics(model, skin.carried(made)).motion
    options = RecordingOptions(cutoff=CUTOFF)
    return usable(model, motion, made.wrenches, mass=model.mass, options=options)


def _factors(model: mm.Model, random: np.random.Generator) -> dict[str, Array]:
    """Draw scale factors of the bodies, alike on both sides."""
    lengths = lengths_of(model)
    values = 1.0 + LENGTH_SD * random.standard_normal(len(lengths))
    for left, right in mirrored_lengths(lengths):
        values[left] = values[right]
    return dict(factors_of(lengths, values))


def drawn_masses(model: mm.Model, random: np.random.Generator) -> Array:
    """Draw a body: every segment's mass scaled, shifted and stretched, nearly alike on both sides.

    Parameters
    ----------
    model : whose masses are changed
    random : generator, which advances

    Returns
    -------
    (bodies, 10)
    """
    table = inertial_parameters(model).copy()
    names = model.body_names
    mirror = np.diag([1.0, 1.0, -1.0])
    for i, name in enumerate(names):
        other = other_side(name)
        if other in names and names.index(other) < i:
            continue
        size = np.exp(MASS_SD * random.standard_normal())
        stretch = SHAPE * random.standard_normal((3, 3))
        shift = CENTER * random.standard_normal(3)
        table[i] = _deformed(table[i], size, stretch, shift)
        if other in names:
            j = names.index(other)
            size = size * (1.0 + SIDE_SD * random.standard_normal())
            table[j] = _deformed(table[j], size, mirror @ stretch @ mirror, mirror @ shift)
    return table


def _deformed(row: Array, size: float, stretch: Array, shift: Array) -> Array:
    """Scale the mass of a body, shift its mass center and stretch it about that.

    Parameters
    ----------
    row : (10,) parameters
    size : factor of the mass
    stretch : (3, 3) relative change of its extent
    shift : (3,) of its mass center, over its radius of gyration
    """
    J = pseudo_inertias(row)
    mass = J[3, 3]
    if mass == 0.0:
        return row
    center = J[:3, 3] / mass
    extent, axes = np.linalg.eigh(J[:3, :3] - mass * np.outer(center, center))
    spread = (axes * np.maximum(extent, mass * EXTENT**2)) @ axes.T
    change = np.eye(3) + 0.5 * (stretch + stretch.T)
    moved = center + np.sqrt(np.trace(spread) / mass / 2.0) * shift
    J[3, 3] = size * mass
    J[:3, 3] = size * mass * moved
    J[3, :3] = size * mass * moved
    J[:3, :3] = size * (change @ spread @ change.T + mass * np.outer(moved, moved))
    return parameters_of(J)


@dataclass(frozen=True, eq=False)
class Skin:
    """Skin that carries markers along with the joints beside it: a law that no step knows.

    Attributes
    ----------
    model : with the markers
    beside : (markers, coordinates) whether a coordinate moves a joint at the marker's body
    slopes, bends : (markers, coordinates, 3) of displacement in body axes with a coordinate's
        deviation from its mean and with its square, in units that `SKIN` scales
    """

    model: mm.Model
    beside: np.ndarray
    slopes: Array
    bends: Array

    @classmethod
    def of(cls, model: mm.Model, random: np.random.Generator) -> Skin:
        """Draw a skin: half of its motion is that of a segment's whole skin."""
        locked = {one.name for one in model.coordinates if one.locked}
        gone = locked | set(model.dependent_coordinates)
        beside = np.zeros((len(model.markers), len(model.coordinates)), bool)
        shape = (len(model.markers), len(model.coordinates), 3)
        drawn = []
        bodies = [marker.body for marker in model.markers]
        for _ in range(2):
            own = random.standard_normal(shape)
            whole = {name: random.standard_normal(shape[1:]) for name in model.body_names}
            drawn.append(np.sqrt(0.5) * (own + np.array([whole[body] for body in bodies])))
        for index, body in enumerate(bodies):
            for joint in _joints_at(model, body):
                for name in joint.coordinates:
                    beside[index, model.coordinate_names.index(name)] = name not in gone
        slopes, bends = drawn
        return cls(model=model, beside=beside, slopes=slopes, bends=bends)

    def carried(self, made: Recording) -> mm.Markers:
        """Move markers of a recording along with the skin."""
        tree = compile_tree(self.model)
        values = tree.coordinates_of(made.motion)
        deviation = values - values.mean(axis=0)
        sizes = deviation.std(axis=0)
        deviation = deviation / np.where(sizes > 0.0, sizes, 1.0)
        square = (np.square(deviation) - 1.0) / np.sqrt(2.0)
        moved = np.einsum("mc,fc,mck->fmk", self.beside, deviation, self.slopes)
        moved += np.einsum("mc,fc,mck->fmk", self.beside, square, self.bends)
        rms = np.sqrt(np.mean(np.sum(moved**2, axis=2), axis=0))
        moved *= (SKIN / np.where(rms > 0.0, rms, np.inf))[:, None]
        poses = forward_kinematics(tree, values)
        numbers = [tree.body_index[marker.body] for marker in self.model.markers]
        shift = np.einsum("fmij,fmj->fmi", poses.rotations[:, numbers], moved)
        return replace(made.markers, values=made.markers.values + shift)


def _joints_at(model: mm.Model, body: str) -> Iterator[Joint]:
    """Joints of a body with others, not with the ground."""
    for joint in model.joints:
        if joint.parent != "ground" and body in (joint.parent, joint.child):
            yield joint


WAYS = {
    "points": IdentificationOptions(compare=False, if_worse="identified"),
    "points, expected masses": IdentificationOptions(
        compare=False, if_worse="identified", masses="expected"
    ),
    "pseudo-inertia": IdentificationOptions(
        compare=False, if_worse="identified", method="pseudo-inertia"
    ),
}


def parts(model: mm.Model) -> dict[str, list[int]]:
    """Bodies of each segment of the body, limbs by side."""
    found: dict[str, list[int]] = {}
    for index, name in enumerate(model.body_names):
        segment = segments_of(model)[name]
        found.setdefault(f"{segment.name} {segment.side}".strip(), []).append(index)
    return found


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure(folder: Path, seeds: Sequence[int] = SEEDS) -> Iterator[Row]:
    """Measure a row for each person and way: what is predicted, how far limbs are off."""
    if not (folder / MODEL).exists():
        return
    for seed in seeds:
        one = person(folder, seed)
        for way, options in WAYS.items():
            yield {"person": seed, "method": way, **facts(one, identified(one, options))}


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure_exact(folder: Path, seeds: Sequence[int] = SEEDS[:1]) -> Iterator[Row]:
    """Measure a row for each person and way where nothing but masses is unknown."""
    if not (folder / MODEL).exists():
        return
    for seed in seeds:
        one = person(folder, seed, exact=True)
        for way, options in WAYS.items():
            yield {"person": seed, "method": way, **facts(one, identified(one, options))}


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure_links(folder: Path, seeds: Sequence[int] = SEEDS[:1]) -> Iterator[Row]:
    """Measure a row for each person of 80 links."""
    if not (folder / MANY_LINKS).exists():
        return
    for seed in seeds:
        one = person(folder, seed, links=True)
        yield {"person": seed, **facts(one, identified(one, WAYS["points"]))}


@threadpool_limits.wrap(limits=1, user_api="blas")
def measure_paper(folder: Path, seeds: Sequence[int] = SEEDS[:2]) -> Iterator[Row]:
    """Measure a row for each person and multiple: [D]'s weights, whole mass free."""
    if not (folder / MODEL).exists():
        return
    for seed in seeds:
        one = person(folder, seed)
        recording = one.exciting.recording
        base = base_parameters(one.model, held=held_in(one.model, [recording.motion]))
        seen = parts_of(one.model, [recording], base)
        points = next(iter(one.points.values()))
        generic = inertial_parameters(one.model)
        for spread in SPREADS:
            paper = Paper(
                model=one.model,
                options=MassPointOptions(prior="paper"),
                mass=None,
                spread=spread,
            )
            masses = paper.solve(points, seen, seen.rms(generic)).parameters
            errors = _predicted(one, [generic, masses, one.truth])
            limbs = _limbs(one, generic, masses)
            yield {
                "person": seed,
                "base parameters within so many times their size": spread,
                "force: generic, identified, true masses [N]": _listed(errors[:, 1]),
                "moment: generic, identified, true masses [N m]": _listed(errors[:, 0]),
                "whole mass: identified, true [kg]": _listed(
                    [masses[:, 0].sum(), one.truth[:, 0].sum()]
                ),
                **{name: limbs[name] for name in list(limbs)[:4]},
            }


def identified(one: Person, options: IdentificationOptions) -> Identification:
    """Identify a person from the exciting motion."""
    return mm.identify(
        one.model,
        [one.exciting],
        one.points,
        mass=one.model.mass,
        options=options,
        recording=RecordingOptions(cutoff=CUTOFF),
    )


def facts(one: Person, found: Identification) -> Row:
    """Compare what was identified of a person with the truth, and with the generic model."""
    generic = inertial_parameters(one.model)
    masses = found.parameters[found.identified]
    tables = {"generic": generic, "identified": masses, "true": one.truth}
    errors = _predicted(one, list(tables.values()))
    tissue = found.soft_tissue
    return {
        "force: generic, identified, true masses [N]": _listed(errors[:, 1]),
        "moment: generic, identified, true masses [N m]": _listed(errors[:, 0]),
        **_limbs(one, generic, masses),
        "expected masses of limbs: error, RMS [%]": _expected_error(one, found.expected),
        "single links farther": _links_farther(one, generic, masses),
        "trunk: generic, identified, true [kg]": _trunk(one, list(tables.values())),
        "masses inside 90 % intervals": _inside(one, found),
        "mass SD": found.mass_sd,
        "soft tissue": "none" if tissue is None else tissue.words,
        "said to be worse": found.unseen.worse,
    }


def _predicted(one: Person, tables: Sequence[Array]) -> Array:
    """Misfit (tables, 2) of moment and force on the other motion [N m], [N]."""
    recording = one.other.recording
    base = base_parameters(one.model, held=held_in(one.model, [recording.motion]))
    predicted = parts_of(one.model, [recording], base, least=1)
    return np.array([predicted.rms(table) for table in tables])


def _limbs(one: Person, generic: Array, masses: Array) -> Row:
    """Compare masses (bodies, 10) of limbs with the truth."""
    before = []
    after = []
    lost = []
    farther = []
    for name, rows in parts(one.model).items():
        if name.split()[0] in TRUNK:
            continue
        old = generic[rows, 0].sum()
        new = masses[rows, 0].sum()
        true = one.truth[rows, 0].sum()
        before.append(old / true - 1.0)
        after.append(new / true - 1.0)
        lost.append(abs(new / true - 1.0) - abs(old / true - 1.0))
        if lost[-1] > ROUNDING:
            farther.append(f"{name} {old:.2f} to {new:.2f} of {true:.2f} kg")
    return {
        "limbs: error of the generic masses, RMS [%]": 100.0 * rms(before),
        "of the identified ones [%]": 100.0 * rms(after),
        "largest of these [%]": 100.0 * float(np.abs(after).max()),
        "limbs farther from the truth than the generic model": f"{len(farther)} of {len(after)}",
        "by at most [% of the true mass]": 100.0 * max(max(lost), 0.0),
        "which": "; ".join(farther) or "none",
    }


def _expected_error(one: Person, expected: Array) -> float:
    """Root mean square error of limbs' masses in the middle of their intervals [%]."""
    errors = [
        expected[rows, 0].sum() / one.truth[rows, 0].sum() - 1.0
        for name, rows in parts(one.model).items()
        if name.split()[0] not in TRUNK
    ]
    return 100.0 * rms(errors)


def _links_farther(one: Person, generic: Array, masses: Array) -> str:
    """Count links whose mass is farther from the truth than the generic one."""
    true = one.truth[:, 0]
    massive = true > PLACEHOLDER * true.sum()
    lost = np.abs(masses[:, 0] - true) - np.abs(generic[:, 0] - true)
    farther = lost[massive] > ROUNDING * true[massive]
    return f"{int(farther.sum())} of {len(farther)}"


def _trunk(one: Person, tables: Sequence[Array]) -> str:
    rows = [i for name, found in parts(one.model).items() if name in TRUNK for i in found]
    return _listed([table[rows, 0].sum() for table in tables])


def _inside(one: Person, found: Identification) -> str:
    """Count heavy bodies whose mass is inside its interval."""
    heavy = one.truth[:, 0] > HEAVY * one.truth[:, 0].sum()
    off = np.abs(found.expected[:, 0] - one.truth[:, 0])[heavy]
    inside = off < half_width(found.known.sd[heavy, 0])
    return f"{int(inside.sum())} of {len(inside)}"


def _listed(values: Sequence[float] | Array) -> str:
    return ", ".join(f"{value:.3g}" for value in values)


def main() -> None:
    """Measure and print."""
    chosen = [int(value) for value in sys.argv[1:]] or list(SEEDS)
    for row in measure(data_folder(), chosen):
        print("\n".join(f"{key}: {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
