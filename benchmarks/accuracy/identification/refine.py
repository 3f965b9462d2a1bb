"""Motion, body and masses refined at once: in-sample, held-out and of simulated people."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter

import mujoco
import numpy as np
from threadpoolctl import threadpool_limits

import myomorph as mm
from benchmarks.accuracy.identification.identification import (
    SPACING,
    SUBJECTS,
    Subject,
    _loads,
    read_markers,
)
from benchmarks.accuracy.kinematics.calibration import GAIT, HAMNER, OPENCAP, RAJAGOPAL, recorded
from benchmarks.accuracy.kinematics.calibration_static import KNEE, LENHART
from myomorph.body.identify.subject import IdentificationOptions
from myomorph.body.refine.fit import refine
from myomorph.body.refine.notes import refined_parts
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.predictions import errors_on
from myomorph.body.refine.refinement import Errors, Refinement
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.body.refine.trial_data import opened
from myomorph.core.io.mjcf.read import model_from_mujoco
from myomorph.core.io.osim.setup_parts import read_marker_set
from myomorph.core.model.arrays import Array
from myomorph.core.model.inertia import with_inertial_parameters
from myomorph.core.model.model import Marker
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.motion.lengths import lengths_of
from myomorph.core.motion.sync import cut
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.subject.body_points import body_points
from myomorph.lab.study.subject.calibrating import standing_markers
from myomorph.lab.study.subject.identifying import MAPS
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape
from myomorph.lab.study.trial.steps.ik import solve_kinematics
from myomorph.lab.study.trial.trial_inputs import open_trial
from truths.simulated_bodies import TETRAHEDRON
from truths.simulated_engines import TreeEngine
from truths.simulated_subject import (
    Instruments,
    Movement,
    Recording,
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
SKIN = 0.005
"""Root mean square by which skin moves markers along one axis [m]."""
NINETY = 1.645
"""Standard deviations to either side that hold 90 %."""


def measure(folder: Path) -> Iterator[Row]:
    """Yield a row for each trial: errors before and after, and predicted from the others."""
    for name, trials in CASES:
        subject = next(one for one in SUBJECTS if one.name == name)
        if (folder / subject.model).exists():
            yield from rows_of(subject, trials, refined(folder, subject, trials))


def refined(folder: Path, subject: Subject, trials: tuple[str, ...]) -> Refinement:
    """Calibrate a subject, then refine it from the same trials."""
    markers = {name: read_markers(folder / subject.trials[name][0]) for name in trials}
    static = read_markers(folder / subject.static) if subject.static else None
    settings = mm.CalibrationOptions(mass=subject.mass, static=static)
    model = mm.calibrate(
        mm.read_model(folder / subject.model), list(markers.values()), settings
    ).model
    given = [
        SubjectTrial(name, one, _loads(folder / subject.trials[name][1]))
        for name, one in markers.items()
    ]
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
            "soft tissue": "none" if found.soft_tissue is None else found.soft_tissue.words,
        }


def _parts(found: Refinement) -> str:
    body = ["body"] if "lengths" in found.fit else []
    masses = ["masses"] if "masses" in found.fit else []
    return ", ".join(["motions", *body, *masses])


def _text(one: Errors) -> str:
    return f"{1e3 * one.markers:.1f} mm, {one.force:.1f} N, {one.moment:.1f} N m"


def measure_simulated(seeds: tuple[int, ...] = (1, 2, 3), seconds: float = 8.0) -> Iterator[Row]:
    """Yield a row for each simulated person.

    It has the errors of lengths and masses of the legs, before and after.
    """
    for seed in seeds:
        person, given, found = simulated(seed, seconds)
        yield {
            "person": seed,
            "markers [mm]": f"{1e3 * found.before.markers:.1f} -> {1e3 * found.after.markers:.1f}",
            "force [N]": f"{found.before.force:.1f} -> {found.after.force:.1f}",
            "moment [N m]": f"{found.before.moment:.1f} -> {found.after.moment:.1f}",
            **_legs(person, given, found),
            "refined": _parts(found),
        }


def _legs(person: mm.Model, given: mm.Model, found: Refinement) -> Row:
    """Return errors of lengths and masses of the legs, and how many intervals hold the truth."""
    links = [f"{name}_{side}" for name in ("femur", "tibia") for side in "rl"]
    truth = np.array([person.body(name).mass for name in links])
    before = np.array([given.body(name).mass for name in links])
    after = np.array([found.model.body(name).mass for name in links])
    sd = np.array([found.mass_sd[found.model.body_names.index(name)] for name in links])
    masses_inside = int((np.abs(after - truth) <= NINETY * sd).sum())

    lengths = {one.name: one.extent for one in lengths_of(person)}
    named = [one for one in lengths_of(given) if one.along and one.segment in links]
    true = np.array([lengths[one.name] for one in named])
    start = np.array([one.extent for one in named])
    at = [found.lengths.index(one.name) for one in named]
    off = start * np.asarray(found.factors)[at] - true
    length_sd = np.asarray(found.factors_sd)[at]
    inside = int((np.abs(off) <= NINETY * start * length_sd).sum())
    return {
        "lengths, largest error [mm]": (
            f"{1e3 * np.abs(start - true).max():.1f} -> {1e3 * np.abs(off).max():.1f}"
        ),
        "masses, largest error [%]": (
            f"{_percent(before, truth):.1f} -> {_percent(after, truth):.1f}"
        ),
        "lengths inside": f"{inside} of {len(off)}",
        "masses inside": f"{masses_inside} of {len(sd)}",
    }


def _percent(masses: Array, truth: Array) -> float:
    return float(100.0 * np.abs(masses / truth - 1.0).max())


@dataclass(frozen=True, kw_only=True)
class Truth:
    """How a simulated person and its laboratory differ from what is assumed.

    Attributes
    ----------
    skin : from markers (frames, markers, 3), their times (frames,) and a seed to markers that move
        on the body [m]
    mass : largest relative difference of a link's mass from the generic model's
    late : what the times of forces lack [s]
    """

    skin: Callable[[Array, Array, int], Array]
    mass: float = SubjectOptions.mass
    late: float = 0.0


def simulated(
    seed: int, seconds: float, options: RefineOptions | None = None, truth: Truth | None = None
) -> tuple[mm.Model, mm.Model, Refinement]:
    """Simulate a person with unequal legs and moving skin, and refine it.

    Parameters
    ----------
    seed : of person, movement and noise
    seconds : of the recording
    options : of the refinement
    truth : what differs; by default skin that moves in waves

    Returns
    -------
    the person, the calibrated model at its mass, and the refinement
    """
    truth = truth or Truth(skin=waving_skin)
    compiled = mujoco.MjModel.from_xml_string(_person())
    model = model_from_mujoco(compiled, name="person")
    markers = tuple(
        Marker(f"{one.name}_{i}", one.name, one.mass_center + 0.06 * offset)
        for one in model.bodies
        for i, offset in enumerate(TETRAHEDRON)
    )
    subject = random_subject(
        model.with_markers(markers),
        SubjectOptions(length=0.05, asymmetry=0.09, mass=truth.mass, seed=seed),
    )
    engine = TreeEngine(compiled, subject.person)
    names, middles, reaches = middles_and_reaches(subject.person)
    tools = Instruments(rate=50.0, seed=seed)
    found = record(
        subject,
        engine,
        Movement(names=names, curves=exciting_curves(middles, reaches), duration=seconds),
        tools,
    )
    trial = _with_errors(found, truth, seed)
    mass = subject.person.mass
    calibrated = mm.calibrate(
        subject.generic, [trial.markers], mm.CalibrationOptions(mass=mass)
    ).model
    return subject.person, calibrated, refine(calibrated, [trial], mass, options)


def _with_errors(found: Recording, truth: Truth, seed: int) -> SubjectTrial:
    """Move skin and the clock of a recording."""
    markers = found.markers
    moving = truth.skin(markers.values, markers.time, seed)
    wrenches = replace(found.wrenches, time=found.wrenches.time - truth.late)
    return SubjectTrial("exciting", replace(markers, values=moving), wrenches)


def waving_skin(values: Array, time: Array, seed: int) -> Array:
    """Move markers on the body by 5 mm, see `with_skin`.

    Parameters
    ----------
    values : (frames, markers, 3) positions on the bones [m]
    time : (frames,) [s]
    seed : of the waves

    Returns
    -------
    (frames, markers, 3) [m]
    """
    return with_skin(values, time, SKIN, seed)


def with_skin(values: Array, time: Array, sd: float, seed: int) -> Array:
    """Return markers that move on the body by three waves each.

    Parameters
    ----------
    values : (frames, markers, 3) positions on the bones [m]
    time : (frames,) [s]
    sd : root mean square of the movement [m]
    seed : of the waves

    Returns
    -------
    (frames, markers, 3) [m]
    """
    random = np.random.default_rng(100 + seed)
    pace = random.uniform(2.0, 9.0, (3, *values.shape[1:]))
    phase = random.uniform(0.0, 2.0 * np.pi, pace.shape)
    waves = np.sin(time[:, None, None, None] * pace + phase)
    return np.asarray(values + sd * np.sqrt(2.0 / 3.0) * waves.sum(axis=1))


def _person() -> str:
    """Eleven boxes of a person's masses on a free pelvis, as MJCF."""
    size = {
        "pelvis": 0.1,
        "torso": 0.25,
        "humerus": 0.14,
        "ulna": 0.12,
        "femur": 0.2,
        "tibia": 0.2,
        "calcn": 0.1,
    }
    kg = {
        "pelvis": 10.0,
        "torso": 32.0,
        "humerus": 2.0,
        "ulna": 1.5,
        "femur": 8.5,
        "tibia": 3.5,
        "calcn": 1.1,
    }
    hinge = '<joint name="{0}_flexion" axis="0 1 0" range="0.1 1.5"/>'
    ball = "".join(
        f'<joint name="{{0}}_{name}" axis="{axis}" range="-0.9 0.9"/>'
        for name, axis in (("x", "1 0 0"), ("y", "0 1 0"), ("z", "0 0 1"))
    )

    def body(name: str, place: str, joints: str, inside: str = "") -> str:
        part = name.split("_")[0]
        return (
            f'<body name="{name}" pos="{place}">{joints.format(name)}<geom type="box" size="0.05'
            f' 0.06 {size[part]}" pos="0.01 0.01 -{size[part]}" mass="{kg[part]}"/>{inside}</body>'
        )

    limbs = ""
    arms = ""
    for side, y in (("r", -1.0), ("l", 1.0)):
        shank = body(f"tibia_{side}", "0 0 -0.4", hinge, body(f"calcn_{side}", "0 0 -0.4", hinge))
        limbs += body(f"femur_{side}", f"0 {0.09 * y} -0.1", ball, shank)
        arms += body(
            f"humerus_{side}", f"0 {0.2 * y} 0.45", ball, body(f"ulna_{side}", "0 0 -0.28", hinge)
        )
    tree = body(
        "pelvis",
        "0 0 1",
        "<freejoint name='root'/>",
        body("torso", "-0.05 0 0.1", ball, arms) + limbs,
    )
    return f"<mujoco><compiler angle='radian'/><worldbody>{tree}</worldbody></mujoco>"


PLUGIN = "c3d-gait-plugingait"
LENHART_MASS = 73.3
"""What the plates of the walk weigh: the collection does not have it [kg]."""

CHOSEN = "priors chosen on it"
SEEN = "defaults seen on it"
NEW = "not seen before"


@dataclass(frozen=True, eq=False)
class Recorded:
    """A subject's generic model and recordings.

    `use`: what it was used for: "priors chosen on it", "defaults were seen on it" or "not seen
    before".
    """

    name: str
    model: mm.Model
    mass: float
    static: mm.Markers | None
    trials: Mapping[str, tuple[mm.Markers, mm.Wrenches]]
    use: str


def people(folder: Path) -> Iterator[Recorded]:
    """Subjects of the collection with markers and plates; those that are absent are left out."""
    made: tuple[tuple[str, Callable[[], Recorded]], ...] = (
        (GAIT, lambda: _gait(folder / GAIT)),
        (LENHART, lambda: _lenhart(folder / LENHART)),
        (PLUGIN, partial(_child, folder / PLUGIN / "HC030A", ("05", "22", "01"), 45.8, 1.48)),
        (PLUGIN, partial(_child, folder / PLUGIN / "HC002D", ("06", "25", "02"), 32.1, 1.45)),
        (KNEE, lambda: _implant(folder / KNEE)),
        (RAJAGOPAL, partial(_known, folder, "Rajagopal, calibrated", ("walk",))),
        (OPENCAP, partial(_known, folder, "OpenCap, calibrated", ("walking1", "DJ1", "STS1"))),
        (HAMNER, partial(_known, folder, "Hamner, calibrated", ("run200",))),
        (HAMNER, partial(_known, folder, "Hamner, calibrated", ("run200", "run500"))),
    )
    for name, person in made:
        if (folder / name).is_dir():
            yield person()


def _gait(folder: Path) -> Recorded:
    files = folder / "experiment"
    model = mm.read_model(files / "gait2354_simbody.osim")
    model = model.with_markers(read_marker_set(files / "gait2354_Scale_MarkerSet.xml", model))
    walk = recorded(files, "subject01_walk1.trc"), _loads(files / "subject01_walk1_grf.xml")
    return Recorded(
        name="gait2354",
        model=model,
        mass=72.6,
        static=recorded(files, "subject01_static.trc"),
        trials={"walk": walk},
        use=CHOSEN,
    )


def _lenhart(folder: Path) -> Recorded:
    model = mm.read_model(folder / "lenhart2015.osim")
    model = model.with_markers(read_marker_set(folder / "lenhart2015_markers.xml", model))
    motion = folder / "motion"
    walk = recorded(motion, "overground_17.trc"), _loads(motion / "overground_17_ext_loads.xml")
    return Recorded(
        name="Lenhart",
        model=model,
        mass=LENHART_MASS,
        static=recorded(motion, "static1.trc"),
        trials={"walk": walk},
        use=NEW,
    )


def _child(folder: Path, numbers: tuple[str, str, str], mass: float, height: float) -> Recorded:
    files = [
        folder / kind / f"{folder.name}{number}.c3d"
        for kind, number in zip(("Straight", "Turn", "Static"), numbers, strict=True)
    ]
    return _analyzed(f"child {folder.name}", tuple(files[:2]), files[2], mass, height, CHOSEN)


def _implant(folder: Path) -> Recorded:
    files = tuple(folder / f"walk{number}.c3d" for number in (1, 3))
    return _analyzed("knee implant", files, folder / "static.trc", 75.0, None, NEW)


def _analyzed(
    name: str, files: tuple[Path, ...], static: Path, mass: float, height: float | None, use: str
) -> Recorded:
    """Return what `myomorph analyze` makes of raw recordings.

    It is its generic model, and markers and forces in its axes.
    """
    with tempfile.TemporaryDirectory() as home:
        plan = mm.read_plan(mm.prepare_study(files, home, mass, height, static).study)
        ((subject, about),) = plan.subjects.items()
        trials = [open_trial(one, plan.settings_of(subject, one.name)) for one in about.trials]
        model = trials[0].model
        assert about.static is not None
        still, _ = standing_markers(about.static, about, model)
        found = {}
        for one in trials:
            checked = solve_kinematics(one)
            found[one.name] = (checked.markers, one.inputs[ExternalLoads].of(checked.fit.motion))
        return Recorded(name=name, model=model, mass=mass, static=still, trials=found, use=use)


def _known(folder: Path, name: str, trials: tuple[str, ...]) -> Recorded:
    one: Subject = next(one for one in SUBJECTS if one.name == name)
    static = recorded(folder, one.static) if one.static else None
    files = {trial: one.trials[trial] for trial in trials}
    found = {
        trial: (recorded(folder, markers), _loads(folder / loads))
        for trial, (markers, loads) in files.items()
    }
    return Recorded(
        name=name.split(",")[0],
        model=mm.read_model(folder / one.model),
        mass=one.mass,
        static=static,
        trials=found,
        use=SEEN,
    )


Part = tuple[str, mm.Markers, mm.Wrenches]


def splits(person: Recorded) -> Iterator[tuple[list[Part], Part]]:
    """Yield recordings to learn from and one to test on.

    Each is tested in turn, or the halves of a single one.
    """
    parts: list[Part] = [(name, *one) for name, one in person.trials.items()]
    if len(parts) == 1:
        ((name, markers, forces),) = parts
        first = max(markers.time[0], forces.time[0])
        last = min(markers.time[-1], forces.time[-1])
        middle = 0.5 * (first + last)
        parts = [
            (f"{name} 1st half", cut(markers, first, middle), forces),
            (f"{name} 2nd half", cut(markers, middle, last), forces),
        ]
    for k, test in enumerate(parts):
        yield [one for i, one in enumerate(parts) if i != k], test


def measure_held_out(folder: Path) -> Iterator[Row]:
    """Yield a row for each split.

    It has marker error, residual force and moment of the held-out recording, and ratios to the
    calibrated.
    """
    with threadpool_limits(limits=1, user_api="blas"):
        for person in people(folder):
            for train, test in splits(person):
                yield row(person, train, test)


def _trial(part: Part) -> SubjectTrial:
    name, markers, wrenches = part
    return SubjectTrial(name=name, markers=markers, wrenches=wrenches)


def row(person: Recorded, train: list[Part], test: Part) -> Row:
    """Calibrated, identified and refined from the one, held against the other."""
    settings = mm.CalibrationOptions(mass=person.mass, static=person.static)
    model = mm.calibrate(person.model, [markers for _, markers, _ in train], settings).model
    trials = [_trial(part) for part in train]
    unseen = _trial(test)
    options = RefineOptions()
    on_given = opened(model, unseen, options)
    given = errors_on(model, on_given)
    identified = _identified(model, trials, person.mass)
    begun = perf_counter()
    found = refine(model, trials, person.mass)
    seconds = perf_counter() - begun

    def errors(made: mm.Model, tissue: SoftTissue | None = None) -> Errors:
        return errors_on(made, opened(made, unseen, options), on_given.usable.use, tissue)

    return {
        "subject": person.name,
        "from": " + ".join(name for name, _, _ in train),
        "held against": test[0],
        "frames": int(on_given.usable.use.sum()),
        "calibrated": _ratio_text(given),
        "identify": "refused" if identified is None else _against(errors(*identified), given),
        "refine": _against(errors(found.model, found.soft_tissue), given),
        "refined": refined_parts(found.fit),
        "soft tissue": "none" if found.soft_tissue is None else found.soft_tissue.words,
        "warned": bool(found.notes),
        "in-sample before": _ratio_text(found.before),
        "in-sample after": _ratio_text(found.after),
        "s": seconds,
        "recording": person.use,
    }


def _identified(
    model: mm.Model, trials: list[SubjectTrial], mass: float
) -> tuple[mm.Model, SoftTissue | None] | None:
    """Identify the same by `identify` with its defaults.

    Each link's own envelope is filled with points. The result is None where `identify` refuses.
    """
    points, _, _ = body_points(model, BodyShape(), mass, BodyOptions(spacing=SPACING))
    seen = [opened(model, one, RefineOptions()).usable for one in trials]
    try:
        found = mm.identify(
            model,
            seen,
            {MAPS[name]: one for name, one in points.items()},
            mass=mass,
            options=IdentificationOptions(),
        )
    except mm.BadData:
        return None
    return with_inertial_parameters(model, found.parameters[found.chosen]), found.soft_tissue


def _ratio_text(one: Errors) -> str:
    return f"{1e3 * one.markers:.1f} mm, {one.force:.1f} N, {one.moment:.1f} N m"


def _against(one: Errors, given: Errors) -> str:
    ratios = [getattr(one, name) / getattr(given, name) for name in ("markers", "force", "moment")]
    return (
        f"{1e3 * one.markers:.1f} mm ({ratios[0]:.2f}), {one.force:.1f} N ({ratios[1]:.2f}), "
        f"{one.moment:.1f} N m ({ratios[2]:.2f})"
    )
