"""From the files of a subject's motions to an identified model.

It is `myomorph identify` and the step of a study.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.identify.recordings import RecordingOptions, Usable, usable
from myomorph.body.identify.subject import (
    GENERIC,
    SHAPE,
    Identification,
    IdentificationOptions,
    identify,
)
from myomorph.body.identify.validation import CrossValidation, cross_validate
from myomorph.core.model.causes import FILTER
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import with_inertial_parameters
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import Model, index_of
from myomorph.core.model.provenance import Provenance, Source
from myomorph.core.model.series import Motion, Wrenches
from myomorph.core.model.soft_tissue import SoftTissue
from myomorph.core.model.surface import Surface
from myomorph.core.motion.cutoff_choice import choose_cutoff
from myomorph.lab.report.page.parts import Note, PageHead
from myomorph.lab.report.trial.identification_tables import identification_tables
from myomorph.lab.report.trial.report_input import IdentificationInput, Recorded, ReportInput
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_source, file_sources, provenance_of
from myomorph.lab.store.settings import ForceOptions, SettingGroup
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.error_size_tables import write_error_sizes
from myomorph.lab.study.inputs.external_forces import load_tables, read_loads
from myomorph.lab.study.inputs.loads import ExternalLoads, LoadsFile
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.body_points import OWN, body_points
from myomorph.lab.study.subject.found_errors import identified_errors
from myomorph.lab.study.subject.subject_files import (
    BodyOptions,
    BodyShape,
    KnownBody,
    SubjectInputs,
    recordings_provenance,
)
from myomorph.lab.study.subject.subjects import Made, ModelOutput, write_made_model
from myomorph.lab.study.trial.steps.ik import trial_motion

MAPS = {"bone": "w_b", "cog": "w_d", "nearest": "w_n", OWN: "own link"}
"""Weight maps as the command names them, and as [D] and the tables do."""

LIGHTEST = 1e-3
HEAVIEST = 1e4  # Masses of a body that is not mistyped [kg]: from a mouse to an elephant.


@dataclass(frozen=True)
class CheckTrials:
    """Trials that are held out.

    Attributes
    ----------
    check : Names of trials, between commas, that masses are not fitted to; their forces are only
        predicted.
    """

    check: str = ""


@dataclass(frozen=True)
class IdentifyOptions(SettingGroup):
    """All that identification may be told, each part in its own place."""

    trials: CheckTrials = field(default_factory=CheckTrials)
    recording: RecordingOptions = field(default_factory=RecordingOptions)
    identification: IdentificationOptions = field(default_factory=IdentificationOptions)
    body: BodyOptions = field(default_factory=BodyOptions)


@dataclass(frozen=True, eq=False)
class SubjectMotion:
    """One motion of a subject and its forces, as recorded.

    One that is held out is only compared afterwards.
    """

    name: str
    motion: Motion
    wrenches: Wrenches
    time: tuple[float, float] | None = None
    held_out: bool = False


@dataclass(frozen=True, eq=False, kw_only=True)
class Identified(Made[Identification]):
    """What identification found, with the motions it was compared on, and what it was made from."""

    validation: Mapping[str, CrossValidation]


@dataclass(frozen=True, kw_only=True)
class MotionFiles:
    """Files of a subject's motions and of their forces, in pairs in their order.

    Attributes
    ----------
    motions : coordinates over time
    loads : external forces of each
    bodies : that forces act on, where they are not the nearest feet
    held_out : masses are not fitted to these motions
    """

    motions: Sequence[Path]
    loads: Sequence[Path]
    bodies: LoadsFile = field(default_factory=LoadsFile)
    held_out: bool = False


def open_motions(
    model: Model,
    files: MotionFiles,
    time: tuple[float, float] | None = None,
    forces: ForceOptions | None = None,
) -> list[SubjectMotion]:
    """Read motions and their forces.

    `time`: start and end of what is used [s], None for all; `forces`: how forces are checked and
    corrected, and their clock. Raises `BadData` where motions and forces are not in pairs.
    """
    if len(files.motions) != len(files.loads):
        raise BadData(
            f"{len(files.motions)} motions but {len(files.loads)} files of forces: give one of each"
            " for every recording, in the same order"
        )
    result = []
    bodies = files.bodies
    for motion_path, loads_path in zip(files.motions, files.loads, strict=True):
        motion = reading.read_motion(motion_path, model)
        cut_to = reading.cut_to(time, motion, motion_path)
        wrenches = read_loads(
            loads_path, model, motion, bodies.bodies, plates=bodies.plates, options=forces
        )
        result.append(
            SubjectMotion(
                name=motion_path.name,
                motion=motion,
                wrenches=wrenches,
                time=cut_to,
                held_out=files.held_out,
            )
        )
    return result


def check_mass(model: Model, mass: float | None) -> float:
    """Return the mass to use [kg]; raise `BadData` where it is none that a body has."""
    reading.has_mass(model, "identification")
    if mass is None:
        return model.mass
    if not LIGHTEST <= mass <= HEAVIEST:
        raise BadData(f"--mass {mass:g}: expected the body's mass in kilograms, as 72.6")
    if not 0.4 <= mass / model.mass <= 2.5:
        raise BadData(
            f"--mass {mass:g}: the model weighs {model.mass:.4g} kg; scale it to the subject first,"
            " or is the mass in another unit than kilograms?"
        )
    return mass


def identify_subject(
    model: Model,
    motions: Sequence[SubjectMotion],
    body: KnownBody,
    options: IdentifyOptions,
    sources: Sequence[Source] = (),
) -> Identified:
    """Identify the masses of a scaled model from a subject's motions."""
    mass = check_mass(model, body.mass)
    used = list[Usable]()
    held_out = list[Usable]()
    for part in motions:
        recording = usable(
            model,
            part.motion,
            part.wrenches,
            mass=mass,
            time=part.time,
            name=part.name,
            options=options.recording,
        )
        (held_out if part.held_out else used).append(recording)
    if not used:
        raise BadData("no motion to identify from: give at least one with its forces")
    points, inside, notes_of_points = body_points(
        model, body.shape, mass, options.body, options.identification.compare, _surfaces(model)
    )
    ways = len(points) + 1 if options.identification.compare else 1
    # The matrices are small: waking further threads of BLAS for them costs more than they save.
    with (
        progress("identification", ways, "solutions") as advance,
        threadpool_limits(limits=1, user_api="blas"),
    ):
        identification = identify(
            model,
            used,
            {MAPS[name]: point for name, point in points.items()},
            mass=mass,
            inside=inside,
            options=options.identification,
            recording=options.recording,
            unseen=held_out,
            advance=advance,
        )
    force_notes = (
        note for motion in motions for note in located(motion.name, motion.wrenches.notes)
    )
    # What identification says of itself comes first: whether its masses may be believed.
    notes = (*identification.notes, *force_notes, *notes_of_points)
    notes += _unfiltered(model, motions, options.recording)
    identification = replace(identification, notes=notes)
    made = provenance_of("identify", sources, {"mass": mass, **options.plain()})
    return Identified(identification, made, validation=_validation(model, identification, held_out))


def _validation(
    model: Model, identification: Identification, held_out: Sequence[Usable]
) -> FrozenMap[str, CrossValidation]:
    """Compare the forces of held-out recordings with those of each model's masses, by name."""
    models = {
        name: with_inertial_parameters(model, identification.parameters[name])
        for name in (identification.identified, SHAPE, GENERIC)
    }
    tissue = identification.soft_tissue
    tissues = {} if tissue is None else {identification.identified: tissue, SHAPE: tissue}
    return FrozenMap(
        {each.name: cross_validate(models, each.recording, tissues) for each in held_out}
    )


def _unfiltered(
    model: Model, motions: Sequence[SubjectMotion], options: RecordingOptions
) -> tuple[Message, ...]:
    """Report motions that ask for a filter and got none."""
    if options.cutoff != 0.0:
        return ()
    asked = {part.name: choose_cutoff(part.motion, model).cutoff for part in motions}
    noisy = ", ".join(f"{name} for {cutoff:.2g} Hz" for name, cutoff in asked.items() if cutoff)
    if not noisy:
        return ()
    return (
        FILTER.message(
            "no low-pass filter: noise of markers grows with the square of frequency in"
            f" accelerations, and motions need one ({noisy}): leave --cutoff 0 out"
        ),
    )


def input_sources(
    model: Path, motions: Sequence[Path], loads: Sequence[Path], shape: BodyShape
) -> list[Source]:
    """List the files that an identification is derived from."""
    sources = [*file_sources(("model", model), *(("motion", path) for path in motions))]
    for path in loads:
        sources += [file_source("loads", path), *load_tables(path)]
    return [*sources, *file_sources(("skin", shape.skin), ("landmarks", shape.landmarks))]


def write_identified(
    identified: Identified, out: Path, tables: Path, subject: str = ""
) -> tuple[str, ...]:
    """Write the model, and a folder of tables and a report, whole or not at all.

    What is lost in the model's file is returned.
    """
    model = identified.found.model
    name = subject or identified.found.model.name

    def fill(folder: Path) -> None:
        _write_tables(identified, folder, name)

    return write_made_model(
        model, identified.provenance, ModelOutput(out, tables), fill, identified.found.notes
    )


def _write_tables(identified: Identified, folder: Path, subject: str) -> None:
    from myomorph.lab.report.trial.trial_page import report_page
    from myomorph.lab.study.trial.reporting import REPORT

    identification = identified.found
    surfaces = _surfaces(identification.model)
    for name, sheet in identification_tables(identification, identified.validation).items():
        (folder / name).write_text(sheet.csv(), encoding="utf-8")
    write_error_sizes(
        folder, STEP.name, identified_errors(identification.model, identification.model_error)
    )
    recordings = ", ".join(recording.name for recording in identification.recordings)
    notes = [Note("real", f"Motions: {recordings}.")]
    notes.append(Note("assumed", f"Shape of the body: {identification.points.source}."))
    if identification.soft_tissue is not None:
        notes.append(Note("assumed", f"Soft tissue: {tissue_line(identification.soft_tissue)}."))
    elif identification.tissue_evidence is not None:
        notes.append(Note("assumed", f"{identification.tissue_evidence.sentence.capitalize()}."))
    page = report_page(
        ReportInput(
            PageHead.of(
                f"{subject}: identified body", identified.provenance, notes, identification.notes
            ),
            recorded=Recorded(
                subject,
                facts=FrozenMap(
                    {
                        "Body mass": (
                            f"{float(np.sum(identification.parameters[GENERIC][:, 0])):.4g} kg"
                        )
                    }
                ),
            ),
            model=identification.model,
            surfaces=surfaces,
            identification=IdentificationInput(
                identification.model, identification, identified.validation
            ),
        )
    )
    (folder / REPORT).write_text(page, encoding="utf-8")


def _surfaces(model: Model) -> Mapping[str, Surface]:
    from myomorph.lab.study.trial.reporting import surfaces_of

    return surfaces_of(model)


def summary(identified: Identified) -> list[str]:
    """Return the lines that the command prints.

    They are frames, misfits, what the data did not show, and motions that were held out.
    """
    identification = identified.found
    used = sum(int(recording.use.sum()) for recording in identification.recordings)
    total = sum(recording.frames for recording in identification.recordings)
    lines = [
        f"{used} of {total} frames used"
        + "".join(f"; {n} {reason}" for reason, n in identification.left_out.items())
    ]
    lines[0] += _filters(identification.recordings)
    flight = sum(recording.flight for recording in identification.recordings)
    if flight:
        lines[0] += f"; {flight} of those used without contact"
    generic = identification.residuals[GENERIC]
    now = identification.residuals[identification.identified]
    lines.append(
        f"misfit of the ground wrench: {now[1]:.1f} N, {now[0]:.1f} N m (generic {generic[1]:.1f}"
        f" N, {generic[0]:.1f} N m)"
        + (
            f"; {identification.unseen.what}: {identification.unseen.numbers}"
            if identification.unseen.known
            else ""
        )
    )
    if identification.chosen == GENERIC:
        lines[-1] += "; the generic masses are kept"
    if identification.tissue_evidence is not None:
        lines.append(identification.tissue_evidence.sentence)
    if identification.soft_tissue is not None:
        lines.append(tissue_line(identification.soft_tissue))
    data = identification.known.data
    lines.append(
        f"{int(data.sum())} of {data.size} parameters determined by the data (rank "
        f"{identification.known.rank}), the others "
        f"from the prior ({identification.points.source})"
    )
    lines.append(evidence_line(identification))
    lines.append(identification.consistency[identification.chosen].verdict)
    for name, validation in identified.validation.items():
        moment, force = validation.rms(identification.identified)
        generic = validation.rms(GENERIC)
        lines.append(
            f"{name}, not used: {force:.1f} N, {moment:.1f} N m (generic {generic[1]:.1f} N,"
            f" {generic[0]:.1f} N m)"
        )
    return lines


def _filters(recordings: Sequence[Usable]) -> str:
    """Low-pass filters of recordings, as the end of a line; "" where nothing was filtered."""
    cutoffs = dict.fromkeys(
        f"{recording.cutoff:.3g}" for recording in recordings if recording.cutoff is not None
    )
    return f"; low-pass filter at {', '.join(cutoffs)} Hz" if cutoffs else ""


def evidence_line(identification: Identification) -> str:
    """Return what is printed of masses: which of them forces show to differ from the shape's."""
    evidence = identification.mass_evidence
    named = [name for name, word in evidence.items() if word != "not shown"]
    return f"masses that forces show to differ from the shape's: {', '.join(named) or 'none'}"


def tissue_line(tissue: SoftTissue) -> str:
    """Return what is printed of soft tissue."""
    return (
        f"markers move more than the body's mass; alpha of 1 / (1 + alpha w^2): {tissue.words}; the"
        " masses are for the motion without it"
    )


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    files = subject.files
    motions = []
    shared = {
        name: value
        for step in ("id", "identify")
        for name, value in subject.settings.get(step, {}).items()
    }
    options = IdentifyOptions.of(shared)
    check = [name.strip() for name in options.trials.check.split(",") if name.strip()]
    for name in check:
        index_of(
            "trial", name, tuple(trial.name for trial in files.trials), f"subject '{files.name}'"
        )
    for trial in subject.trials():
        loads = trial.get(ExternalLoads)
        if loads is None:
            continue
        motion = trial_motion(trial)
        motions.append(
            SubjectMotion(trial.name, motion, loads.of(motion), held_out=trial.name in check)
        )
    if not motions:
        raise BadData(
            f"subject '{files.name}': no trial has external forces, so 'identify' has no data for"
            " masses"
        )
    body = KnownBody(shape=files.shape, mass=files.mass)
    identified = identify_subject(subject.model, motions, body, options)
    write_identified(
        replace(identified, provenance=output.made), output.path("model"), output.tables, files.name
    )


def _made_from(subject: SubjectInputs) -> Provenance:
    shape = subject.files.shape
    more = {f"shape.{name}": getattr(shape, name) for name in ("height", "chest", "sex", "age")}
    return recordings_provenance("identify", subject, more, ("ik", "id"))


STEP = Step(
    name="identify",
    scope="subject",
    title="identification of masses",
    options=(CheckTrials, RecordingOptions, IdentificationOptions, BodyOptions),
    tables="identification",
    leaves=FrozenMap({"model": "identified.osim", "soft_tissue": "identification/soft_tissue.csv"}),
    run=_run,
    made_from=_made_from,
)
