"""The base wrench on held-out motion.

Compared are the generic model, shape, least squares, and possible bodies.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from functools import cache
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

import myomorph as mm
from benchmarks.recordings import read_markers
from myomorph.body.identify.base_parameters import base_parameters, held_in
from myomorph.body.identify.least_squares import Recording
from myomorph.body.identify.mass_points import MassPointOptions, solve_mass_points
from myomorph.body.identify.parts import parts_of
from myomorph.body.identify.pseudo_inertia import (
    PseudoInertiaOptions,
    possible_reference,
    solve_ridge,
)
from myomorph.body.identify.recordings import RecordingOptions, Usable, usable
from myomorph.body.identify.subject import CONIC, GENERIC, Identification, IdentificationOptions
from myomorph.body.shape.points import MassPoints
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.osim.setup_parts import read_ik_tasks
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.lab.report.trial.identification_tables import segment_sheet
from myomorph.lab.study.inputs.external_forces import force_table
from myomorph.lab.study.subject.body_points import OWN, body_points
from myomorph.lab.study.subject.identifying import MAPS
from myomorph.lab.study.subject.subject_files import BodyOptions, BodyShape

CUTOFF = 6.0
SPACING = 0.02
MARKERS = "soft tissue never"
LOOSE = 5.0
"""A prior that hardly holds masses."""
OPENCAP = "opencap-subject4-multitask"
RUN = "hamner-run-subject04"
GAIT = "opensim-gait-subject01"
RAJAGOPAL = "rajagopal-walk-emg"
FEET = {"R_ground_force_": "calcn_r", "L_ground_force_": "calcn_l"}


@dataclass(frozen=True, eq=False)
class Subject:
    """A subject of the collection.

    `model`: file, scaled or, where it is `calibrated` first, generic; `trials`: by name, marker
    file and force file; `static`: recording of standing still, for the calibration; `tasks`:
    weights of markers.
    """

    name: str
    model: str
    mass: float
    trials: dict[str, tuple[str, str]]
    calibrated: bool = False
    static: str = ""
    tasks: str = ""


@dataclass(frozen=True)
class Split:
    """What is identified from, and what it is held against: trials, or halves of one."""

    subject: Subject
    train: tuple[str, ...]
    test: str


_OPENCAP_TRIALS = {
    name: (f"{OPENCAP}/markers/{name}.trc", f"{OPENCAP}/grf/{name}_external_forces.xml")
    for name in ("walking1", "DJ1", "STS1")
}
_RUN_TRIALS = {
    name: (f"{RUN}/{name}/markers.trc", f"{RUN}/{name}/grf.mot") for name in ("run200", "run500")
}
SUBJECTS = (
    Subject(
        name="OpenCap, calibrated",
        model=f"{OPENCAP}/models/unscaled_generic.osim",
        mass=62.6,
        trials=_OPENCAP_TRIALS,
        calibrated=True,
        static=f"{OPENCAP}/markers/static1.trc",
    ),
    Subject(
        name="OpenCap, scaled by an expert",
        model=f"{OPENCAP}/models/manually_scaled.osim",
        mass=62.6,
        trials=_OPENCAP_TRIALS,
    ),
    Subject(
        name="gait2354, ScaleTool",
        model=f"{GAIT}/ref_scale/std_subject01_simbody.osim",
        mass=72.6,
        trials={
            "walk": (
                f"{GAIT}/experiment/subject01_walk1.trc",
                f"{GAIT}/experiment/subject01_walk1_grf.xml",
            )
        },
        tasks=f"{GAIT}/ref_ik/gait2354_IK_Tasks.xml",
    ),
    Subject(
        name="Rajagopal, scaled by an expert",
        model=f"{RAJAGOPAL}/subject_walk_scaled.osim",
        mass=85.27,
        trials={"walk": (f"{RAJAGOPAL}/markers_walk.trc", f"{RAJAGOPAL}/grf_walk.xml")},
    ),
    Subject(
        name="Rajagopal, calibrated",
        model=f"{RAJAGOPAL}/subject_walk_scaled.osim",
        mass=85.27,
        trials={"walk": (f"{RAJAGOPAL}/markers_walk.trc", f"{RAJAGOPAL}/grf_walk.xml")},
        calibrated=True,
    ),
    Subject(
        name="Hamner, calibrated",
        model=f"{RUN}/unscaled_generic.osim",
        mass=82.0,
        trials=_RUN_TRIALS,
        calibrated=True,
    ),
    Subject(
        name="Hamner, generic lengths",
        model=f"{RUN}/unscaled_generic.osim",
        mass=82.0,
        trials={"run200": _RUN_TRIALS["run200"]},
    ),
)


def splits(subject: Subject) -> Iterator[Split]:
    """Every trial held out in turn; of a cyclic motion also one half by the other."""
    names = tuple(subject.trials)
    if len(names) > 1:
        for name in names:
            yield Split(subject, tuple(one for one in names if one != name), name)
    if len(names) == 1 or subject.name.startswith("Hamner"):
        for name in names:
            yield Split(subject, (f"{name} 1st half",), f"{name} 2nd half")
            yield Split(subject, (f"{name} 2nd half",), f"{name} 1st half")


@cache
def opened(folder: Path, subject: Subject) -> tuple[mm.Model, dict[str, Usable]]:
    """Read the subject's model at its mass, and every trial with the frames that can be used."""
    model = mm.read_model(folder / subject.model)
    markers = {name: read_markers(folder / files[0]) for name, files in subject.trials.items()}
    weights = read_ik_tasks(folder / subject.tasks).marker_weights if subject.tasks else {}
    if subject.calibrated:
        static = read_markers(folder / subject.static) if subject.static else None
        model = mm.calibrate(
            model, list(markers.values()), mm.CalibrationOptions(mass=subject.mass, static=static)
        ).model
    found = {}
    for name, (_, loads) in subject.trials.items():
        known = {one: weight for one, weight in weights.items() if one in model.marker_names}
        tracking = mm.InverseKinematicsOptions(marker_weights=known, only_weighted=bool(known))
        motion = mm.inverse_kinematics(model, markers[name], tracking).motion
        found[name] = usable(
            model,
            motion,
            _loads(folder / loads),
            mass=subject.mass,
            name=name,
            options=RecordingOptions(cutoff=CUTOFF),
        )
    share = subject.mass / model.mass
    return with_inertial_parameters(model, inertial_parameters(model) * share), found


def _loads(path: Path) -> mm.Wrenches:
    return read_external_loads(path) if path.suffix == ".xml" else force_table(path, FEET)


def part(trials: dict[str, Usable], name: str) -> Usable:
    """Return a trial, or the first or second half of its usable frames."""
    trial, _, half = name.partition(" ")
    whole = trials[trial]
    if not half:
        return whole
    frames = np.flatnonzero(whole.use)
    middle = frames[len(frames) // 2]
    index = np.arange(len(whole.use))
    use = whole.use & ((index < middle) if half.startswith("1st") else (index >= middle))
    return replace(whole, recording=replace(whole.recording, use=use), name=name)


@cache
def identified(
    folder: Path, subject: Subject, train: tuple[str, ...]
) -> tuple[Identification, dict[str, np.ndarray]]:
    """Identify a split in every way.

    Parameters
    ----------
    folder : of the collection
    subject : whose trials are used
    train : names of the trials, or of parts of them

    Returns
    -------
    The identification, and (bodies, 10) parameters of every way by its name
    """
    model, trials = opened(folder, subject)
    points = _points_of(model, subject)
    own = points[MAPS[OWN]]
    mass = subject.mass
    seen = [part(trials, name) for name in train]
    found = mm.identify(model, seen, points, mass=mass, options=IdentificationOptions())
    never = IdentificationOptions(compare=False, soft_tissue="never")
    markers = mm.identify(model, seen, {MAPS[OWN]: own}, mass=mass, options=never)
    tissue = found.soft_tissue
    moved = [one.recording if tissue is None else one.recording.moved(tissue.of) for one in seen]
    A, b = parts_of(model, moved, found.base.base).rows(found.noise)
    ridge = solve_ridge(
        A,
        b,
        possible_reference(inertial_parameters(model)),
        mass=mass,
        options=PseudoInertiaOptions(mass_sd=found.mass_sd),
    )
    loose = solve_mass_points(own, A, b, mass=mass, options=MassPointOptions(mass_sd=LOOSE))
    return found, {
        MARKERS: markers.parameters[markers.chosen],
        "ridge": ridge.parameters,
        "loose": loose.parameters,
    } | dict(found.parameters)


def _points_of(model: mm.Model, subject: Subject) -> dict[str, MassPoints]:
    """Return mass points of a body by every weight map."""
    body = BodyOptions(spacing=SPACING)
    points: dict[str, MassPoints] = {}
    for weights in (None, "bone", "cog", "nearest"):
        made, _, _ = body_points(model, BodyShape(), subject.mass, replace(body, weights=weights))
        points |= {MAPS[name]: one for name, one in made.items()}
    return points


def misfit(
    model: mm.Model,
    parameters: dict[str, np.ndarray],
    recording: Recording,
    tissue: SoftTissue | None,
) -> dict[str, np.ndarray]:
    """Return the root mean square error of every set of parameters.

    Parameters
    ----------
    model : of the subject
    parameters : (bodies, 10) inertial parameters by name
    recording : to predict
    tissue : identified soft tissue, None for none

    Returns
    -------
    (2,) errors of moment [N m] and force [N] by name
    """
    base = base_parameters(model, held=held_in(model, [recording.motion]))
    markers = parts_of(model, [recording], base, least=1)
    parts = (
        markers if tissue is None else parts_of(model, [recording.moved(tissue.of)], base, least=1)
    )
    # Least squares may give negative masses, which no model holds: parts take any parameters.
    return {
        name: (markers if name in (MARKERS, GENERIC) else parts).rms(one)
        for name, one in parameters.items()
    }


def measure(folder: Path) -> Iterator[dict[str, object]]:
    """Yield a row for each split.

    It has the force and moment error on the held-out motion, and their ratio to that of the generic
    model.
    """
    for subject in SUBJECTS:
        if not (folder / subject.model).exists():
            continue
        for split in splits(subject):
            yield row(folder, split)


@threadpool_limits.wrap(limits=1, user_api="blas")
def row(folder: Path, split: Split) -> dict[str, object]:
    """Return the row of one split."""
    model, trials = opened(folder, split.subject)
    found, parameters = identified(folder, split.subject, split.train)
    test = part(trials, split.test)
    errors = misfit(model, parameters, test.recording, found.soft_tissue)
    forearms = [
        [model.body_names.index(f"{body}_{side}") for body in ("ulna", "radius", "hand")]
        for side in "rl"
        if f"hand_{side}" in model.body_names
    ]
    shares = [
        parameters[found.chosen][arm, 0].sum() / parameters[GENERIC][arm, 0].sum()
        for arm in forearms
    ]
    moment, force = errors[GENERIC]

    def ratio(name: str) -> str:
        ratio = errors[name] / errors[GENERIC]
        return (
            f"{errors[name][1]:.1f} N ({ratio[1]:.2f}), {errors[name][0]:.1f} N m ({ratio[0]:.2f})"
        )

    return {
        "model": split.subject.name,
        "identified from": " + ".join(split.train),
        "frames": sum(int(part(trials, name).use.sum()) for name in split.train),
        "held against": split.test,
        "held-out frames": int(test.use.sum()),
        "generic scaled": f"{force:.1f} N, {moment:.1f} N m",
        "least squares, a bound": ratio("ridge"),
        "points, own link, soft tissue never": ratio(MARKERS),
        "points, own link": ratio("identified, own link"),
        "points, w_b": ratio("identified, w_b"),
        "points, w_d": ratio("identified, w_d"),
        "points, w_n": ratio("identified, w_n"),
        "pseudo-inertia": ratio(CONIC),
        f"points, own link, mass SD {LOOSE:g}": ratio("loose"),
        "soft tissue": "none" if found.soft_tissue is None else found.soft_tissue.words,
        "lightest forearm, of generic": min(shares) if shares else None,
        "mass SD of the prior": found.mass_sd,
        "parameters shown": (
            f"{int(found.known.data.sum())} of {found.known.data.size}, rank {found.known.rank}"
        ),
        "model gets": "generic masses" if found.chosen == GENERIC else "identified masses",
        "warned of worse": bool(found.unseen.worse or found.unseen.losses),
        "possible": found.consistency[found.chosen].ok,
    }


def measure_segments(folder: Path, chosen: Sequence[int] = (0, 5)) -> Iterator[dict[str, object]]:
    """Segment shares of body mass, identified from all trials, beside published athletes."""
    for subject in (SUBJECTS[i] for i in chosen):
        if not (folder / subject.model).exists():
            continue
        found, _ = identified(folder, subject, tuple(subject.trials))
        sheet = segment_sheet(found)
        for cells in sheet.rows:
            yield {"subject": subject.name} | dict(zip(sheet.head, cells, strict=True))
