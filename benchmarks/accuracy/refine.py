"""Motion, body and masses at once: real recordings in-sample and held out, and simulated people with moving skin."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import mujoco
import numpy as np

import myomorph as mm
from benchmarks.accuracy.identification import SUBJECTS, Subject, _loads, read_markers
from myomorph.identify.refine.fit import refine
from myomorph.identify.refine.options import RefineOptions
from myomorph.identify.refine.refinement import Errors, Refinement, SubjectTrial
from myomorph.io.mjcf.read import model_from_mujoco
from myomorph.model.arrays import Array
from myomorph.model.model import Marker
from myomorph.motion.lengths import lengths_of
from truths.simulated_bodies import TETRAHEDRON
from truths.simulated_engines import TreeEngine
from truths.simulated_subject import (
    Instruments,
    SubjectOptions,
    exciting_curves,
    middles_and_reaches,
    random_subject,
    record,
)

Row = dict[str, object]
CASES = (
    ("OpenCap, calibrated", ("walking1", "DJ1")),
    ("OpenCap, calibrated", ("walking1", "DJ1", "STS1")),
    ("Rajagopal, calibrated", ("walk",)),
    ("Hamner, calibrated", ("run200",)),
)
"""Subjects and the trials refined together; sit-to-stand has a chair that no plate measures."""
NINETY = 1.645
"""Standard deviations to either side that hold 90 %."""


def measure(folder: Path) -> Iterator[Row]:
    """A row a trial: errors before and after, and predicted from the others."""
    for name, trials in CASES:
        subject = next(one for one in SUBJECTS if one.name == name)
        if (folder / subject.model).exists():
            yield from rows_of(subject, trials, refined(folder, subject, trials))


def refined(folder: Path, subject: Subject, trials: tuple[str, ...]) -> Refinement:
    """A subject calibrated from the same trials, then refined."""
    markers = {name: read_markers(folder / subject.trials[name][0]) for name in trials}
    static = read_markers(folder / subject.static) if subject.static else None
    settings = mm.CalibrationOptions(mass=subject.mass, static=static)
    model = mm.calibrate(mm.read_model(folder / subject.model), list(markers.values()), settings).model
    given = [SubjectTrial(name, one, _loads(folder / subject.trials[name][1])) for name, one in markers.items()]
    return refine(model, given, subject.mass)


def rows_of(subject: Subject, trials: tuple[str, ...], found: Refinement) -> Iterator[Row]:
    """Rows of one refinement."""
    for one in found.trials:
        unseen = [each for each in found.predictions if each.name.split(",")[0] == one.name]
        yield {
            "model": subject.name,
            "together": " + ".join(trials),
            "trial": one.name,
            "frames": f"{one.used} of {one.frames}",
            "before": _text(one.before),
            "after": _text(one.after),
            "predicted": "; ".join(
                f"{1e3 * each.refined.markers:.1f} mm ({each.markers_ratio:.2f}), "
                f"{each.refined.force:.1f} N ({each.refined.force / each.given.force:.2f}), "
                f"{each.refined.moment:.1f} N m ({each.refined.moment / each.given.moment:.2f})"
                for each in unseen
            ),
            "refined": _parts(found),
        }


def _parts(found: Refinement) -> str:
    parts = [text for text, one in (("body", found.body), ("masses", found.masses)) if one]
    return ", ".join(("motions", *parts))


def _text(one: Errors) -> str:
    return f"{1e3 * one.markers:.1f} mm, {one.force:.1f} N, {one.moment:.1f} N m"


def measure_simulated(seeds: tuple[int, ...] = (1, 2, 3), seconds: float = 8.0) -> Iterator[Row]:
    """A row a simulated person: errors of lengths and masses of the legs, before and after."""
    for seed in seeds:
        person, given, found = simulated(seed, seconds)
        links = [f"{name}_{side}" for name in ("femur", "tibia") for side in "rl"]
        truth, before, after = (
            np.array([one.body(name).mass for name in links]) for one in (person, given, found.model)
        )
        sd = np.array([found.mass_sd[found.model.body_names.index(name)] for name in links])
        lengths = {one.name: one.extent for one in lengths_of(person)}
        named = [one for one in lengths_of(given) if one.along and one.segment in links]
        true = np.array([lengths[one.name] for one in named])
        start = np.array([one.extent for one in named])
        factors = np.array([found.factors[found.lengths.index(one.name)] for one in named])
        factors_sd = np.array([found.factors_sd[found.lengths.index(one.name)] for one in named])
        off = start * factors - true
        yield {
            "person": seed,
            "markers [mm]": f"{1e3 * found.before.markers:.1f} -> {1e3 * found.after.markers:.1f}",
            "force [N]": f"{found.before.force:.1f} -> {found.after.force:.1f}",
            "moment [N m]": f"{found.before.moment:.1f} -> {found.after.moment:.1f}",
            "lengths, largest error [mm]": f"{1e3 * np.abs(start - true).max():.1f} -> {1e3 * np.abs(off).max():.1f}",
            "masses, largest error [%]": f"{_percent(before, truth):.1f} -> {_percent(after, truth):.1f}",
            "lengths inside": f"{int((np.abs(off) <= NINETY * start * factors_sd).sum())} of {len(off)}",
            "masses inside": f"{int((np.abs(after - truth) <= NINETY * sd).sum())} of {len(sd)}",
            "refined": _parts(found),
        }


def _percent(masses: Array, truth: Array) -> float:
    return float(100.0 * np.abs(masses / truth - 1.0).max())


def simulated(seed: int, seconds: float, options: RefineOptions | None = None) -> tuple[mm.Model, mm.Model, Refinement]:
    """A person with unequal legs and moving skin, the calibrated model at its mass, and the refinement."""
    compiled = mujoco.MjModel.from_xml_string(_person())
    model = model_from_mujoco(compiled, name="person")
    markers = tuple(
        Marker(f"{one.name}_{i}", one.name, one.mass_center + 0.06 * offset)
        for one in model.bodies
        for i, offset in enumerate(TETRAHEDRON)
    )
    subject = random_subject(model.with_markers(markers), SubjectOptions(length=0.05, asymmetry=0.09, seed=seed))
    engine = TreeEngine(compiled, subject.person)
    names, middles, reaches = middles_and_reaches(subject.person)
    tools = Instruments(rate=50.0, seed=seed)
    found = record(subject, engine, names, exciting_curves(middles, reaches), seconds, tools)
    moving = with_skin(found.markers.values, found.markers.time, 0.005, seed)
    trial = SubjectTrial("exciting", replace(found.markers, values=moving), found.wrenches)
    mass = subject.person.mass
    calibrated = mm.calibrate(subject.generic, [trial.markers], mm.CalibrationOptions(mass=mass)).model
    return subject.person, calibrated, refine(calibrated, [trial], mass, options)


def with_skin(values: Array, time: Array, sd: float, seed: int) -> Array:
    """Markers (frames, markers, 3) that move on the body by three waves each, with a root mean square of `sd` [m]."""
    random = np.random.default_rng(100 + seed)
    pace = random.uniform(2.0, 9.0, (3, *values.shape[1:]))
    phase = random.uniform(0.0, 2.0 * np.pi, pace.shape)
    waves = np.sin(time[:, None, None, None] * pace + phase)
    return np.asarray(values + sd * np.sqrt(2.0 / 3.0) * waves.sum(axis=1))


def _person() -> str:
    """Eleven boxes of a person's masses on a free pelvis, as MJCF."""
    size = {"pelvis": 0.1, "torso": 0.25, "humerus": 0.14, "ulna": 0.12, "femur": 0.2, "tibia": 0.2, "calcn": 0.1}
    kg = {"pelvis": 10.0, "torso": 32.0, "humerus": 2.0, "ulna": 1.5, "femur": 8.5, "tibia": 3.5, "calcn": 1.1}
    hinge = '<joint name="{0}_flexion" axis="0 1 0" range="0.1 1.5"/>'
    ball = "".join(
        f'<joint name="{{0}}_{name}" axis="{axis}" range="-0.9 0.9"/>'
        for name, axis in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    )

    def body(name: str, place: str, joints: str, inside: str = "") -> str:
        part = name.split("_")[0]
        return (
            f'<body name="{name}" pos="{place}">{joints.format(name)}<geom type="box" size="0.05 0.06 {size[part]}" '
            f'pos="0.01 0.01 -{size[part]}" mass="{kg[part]}"/>{inside}</body>'
        )

    limbs, arms = "", ""
    for side, y in (("r", -1.0), ("l", 1.0)):
        shank = body(f"tibia_{side}", "0 0 -0.4", hinge, body(f"calcn_{side}", "0 0 -0.4", hinge))
        limbs += body(f"femur_{side}", f"0 {0.09 * y} -0.1", ball, shank)
        arms += body(f"humerus_{side}", f"0 {0.2 * y} 0.45", ball, body(f"ulna_{side}", "0 0 -0.28", hinge))
    tree = body("pelvis", "0 0 1", "<freejoint name='root'/>", body("torso", "-0.05 0 0.1", ball, arms) + limbs)
    return f"<mujoco><compiler angle='radian'/><worldbody>{tree}</worldbody></mujoco>"
