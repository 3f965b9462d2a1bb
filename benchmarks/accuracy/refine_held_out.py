"""Bodies calibrated, identified and refined from some recordings, on others of the same subject."""

from __future__ import annotations

import tempfile
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from time import perf_counter

from threadpoolctl import threadpool_limits

import myomorph as mm
from benchmarks.accuracy.calibration import GAIT, HAMNER, OPENCAP, RAJAGOPAL, recorded
from benchmarks.accuracy.calibration_static import KNEE, LENHART
from benchmarks.accuracy.identification import SPACING, SUBJECTS, Subject, _loads
from myomorph.identify.refine.fit import refine, refined_parts
from myomorph.identify.refine.options import RefineOptions
from myomorph.identify.refine.predictions import errors_on
from myomorph.identify.refine.refinement import Errors, SubjectTrial
from myomorph.identify.refine.trial_data import opened
from myomorph.identify.subject import IdentificationOptions
from myomorph.io.osim.marker_set import read_marker_set
from myomorph.model.inertia import with_inertial_parameters
from myomorph.model.soft_tissue import SoftTissue
from myomorph.motion.sync import cut
from myomorph.study.inputs.loads import ExternalLoads
from myomorph.study.subject.body_points import body_points
from myomorph.study.subject.calibrating import _recording
from myomorph.study.subject.identifying import MAPS
from myomorph.study.subject.subject_files import BodyOptions, BodyShape
from myomorph.study.trial.steps.ik import solve_kinematics
from myomorph.study.trial.trial_inputs import open_trial

PLUGIN = "c3d-gait-plugingait"
LENHART_MASS = 73.3
"""What the plates of the walk weigh: the collection does not have it [kg]."""

CHOSEN, SEEN, NEW = "priors chosen on it", "defaults seen on it", "not seen before"
Row = dict[str, object]


@dataclass(frozen=True, eq=False)
class Recorded:
    """A subject's generic model and recordings.

    `use`: what it was used for: "priors chosen on it", "defaults were seen on it" or "not seen before".
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
    return Recorded("gait2354", model, 72.6, recorded(files, "subject01_static.trc"), {"walk": walk}, CHOSEN)


def _lenhart(folder: Path) -> Recorded:
    model = mm.read_model(folder / "lenhart2015.osim")
    model = model.with_markers(read_marker_set(folder / "lenhart2015_markers.xml", model))
    motion = folder / "motion"
    walk = recorded(motion, "overground_17.trc"), _loads(motion / "overground_17_ext_loads.xml")
    return Recorded("Lenhart", model, LENHART_MASS, recorded(motion, "static1.trc"), {"walk": walk}, NEW)


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
    """What `myomorph analyze` makes of raw recordings: its generic model, and markers and forces in its axes."""
    with tempfile.TemporaryDirectory() as home:
        plan = mm.read_plan(mm.prepare_study(files, home, mass, height, static).study)
        ((subject, about),) = plan.subjects.items()
        trials = [open_trial(one, plan.settings_of(subject, one.name)) for one in about.trials]
        model = trials[0].model
        assert about.static is not None
        still = _recording(about.static, model, None, [], about.labels, about.static_laboratory)
        found = {}
        for one in trials:
            checked = solve_kinematics(one)
            found[one.name] = (checked.markers, one.inputs[ExternalLoads].of(checked.fit.motion))
        return Recorded(name, model, mass, still, found, use)


def _known(folder: Path, name: str, trials: tuple[str, ...]) -> Recorded:
    one: Subject = next(one for one in SUBJECTS if one.name == name)
    static = recorded(folder, one.static) if one.static else None
    files = {trial: one.trials[trial] for trial in trials}
    found = {trial: (recorded(folder, markers), _loads(folder / loads)) for trial, (markers, loads) in files.items()}
    return Recorded(name.split(",")[0], mm.read_model(folder / one.model), one.mass, static, found, SEEN)


Part = tuple[str, mm.Markers, mm.Wrenches]


def splits(person: Recorded) -> Iterator[tuple[list[Part], Part]]:
    """Recordings to learn from and one to test on: each in turn, or the halves of a single one."""
    parts: list[Part] = [(name, *one) for name, one in person.trials.items()]
    if len(parts) == 1:
        ((name, markers, forces),) = parts
        first, last = max(markers.time[0], forces.time[0]), min(markers.time[-1], forces.time[-1])
        middle = 0.5 * (first + last)
        parts = [
            (f"{name} 1st half", cut(markers, first, middle), forces),
            (f"{name} 2nd half", cut(markers, middle, last), forces),
        ]
    for k, test in enumerate(parts):
        yield [one for i, one in enumerate(parts) if i != k], test


def measure(folder: Path) -> Iterator[Row]:
    """A row a split: marker error, residual force and moment of the unseen recording, and ratios to the calibrated."""
    with threadpool_limits(limits=1, user_api="blas"):
        for person in people(folder):
            for train, test in splits(person):
                yield row(person, train, test)


def row(person: Recorded, train: list[Part], test: Part) -> Row:
    """Calibrated, identified and refined from the one, held against the other."""
    settings = mm.CalibrationOptions(mass=person.mass, static=person.static)
    model = mm.calibrate(person.model, [markers for _, markers, _ in train], settings).model
    trials = [SubjectTrial(*one) for one in train]
    unseen, options = SubjectTrial(*test), RefineOptions()
    on_given = opened(model, unseen, options)
    given = errors_on(model, on_given)
    identified = _identified(model, trials, person.mass)
    begun = perf_counter()
    found = refine(model, trials, person.mass)
    seconds = perf_counter() - begun

    def errors(made: mm.Model, tissue: SoftTissue | None = None) -> Errors:
        seen = opened(made, unseen, options)
        if tissue is not None:
            seen = replace(seen, usable=replace(seen.usable, recording=seen.usable.recording.moved(tissue.of)))
        return errors_on(made, seen, None, on_given.usable.use)

    return {
        "subject": person.name,
        "from": " + ".join(name for name, _, _ in train),
        "held against": test[0],
        "frames": int(on_given.usable.use.sum()),
        "calibrated": _text(given),
        "identify": "refused" if identified is None else _against(errors(*identified), given),
        "refine": _against(errors(found.model), given),
        "refined": refined_parts(replace(options, body=found.body, masses=found.masses)),
        "warned": bool(found.notes),
        "in-sample before": _text(found.before),
        "in-sample after": _text(found.after),
        "s": seconds,
        "recording": person.use,
    }


def _identified(model: mm.Model, trials: list[SubjectTrial], mass: float) -> tuple[mm.Model, SoftTissue | None] | None:
    """The same by `identify` with its defaults, each link's own envelope filled with points; None where it refuses."""
    points, _, _ = body_points(model, BodyShape(), mass, BodyOptions(spacing=SPACING))
    seen = [opened(model, one, RefineOptions()).usable for one in trials]
    try:
        found = mm.identify(model, seen, {MAPS[name]: one for name, one in points.items()}, mass=mass,
                         options=IdentificationOptions())  # fmt: skip
    except mm.BadData:
        return None
    return with_inertial_parameters(model, found.parameters[found.chosen]), found.soft_tissue


def _text(one: Errors) -> str:
    return f"{1e3 * one.markers:.1f} mm, {one.force:.1f} N, {one.moment:.1f} N m"


def _against(one: Errors, given: Errors) -> str:
    ratios = [getattr(one, name) / getattr(given, name) for name in ("markers", "force", "moment")]
    return (
        f"{1e3 * one.markers:.1f} mm ({ratios[0]:.2f}), {one.force:.1f} N ({ratios[1]:.2f}), "
        f"{one.moment:.1f} N m ({ratios[2]:.2f})"
    )
