"""From a subject's recordings to a model with that person's muscles.

It is `personalize` and the step of a study.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, fields, replace
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.body.personalize.fit import STEPS
from myomorph.body.personalize.personalize import Personalized, PersonalizeOptions, personalize
from myomorph.body.personalize.recordings import PersonalTrial
from myomorph.core.io.sto import motion_from_table, read_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance, Source
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.emg_activation import USUAL
from myomorph.core.tension.emg_targets import EmgOptions, emg_targets
from myomorph.core.tension.terms.emg import EmgTarget
from myomorph.lab.report.page.parts import Note, PageHead
from myomorph.lab.report.trial.personalized import personalized_page
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_source, file_sources, provenance_of
from myomorph.lab.store.settings import Differentiation, ForceOptions, plain_settings, with_settings
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.emg import EmgFiles, RecordedEmg
from myomorph.lab.study.inputs.error_size_tables import write_error_sizes
from myomorph.lab.study.inputs.input import ByType
from myomorph.lab.study.inputs.loads import ExternalLoads, LoadsFile
from myomorph.lab.study.inputs.motion import MotionFile, RecordedMotion
from myomorph.lab.study.inputs.time_span import TimeSpan
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.step.folder_steps import FolderOutput, write_notes
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.found_errors import personal_errors
from myomorph.lab.study.subject.subject_files import (
    SubjectFiles,
    SubjectInputs,
    recordings_provenance,
)
from myomorph.lab.study.subject.subjects import Made, ModelOutput, write_made_model, write_rows
from myomorph.lab.study.trial.steps.id import solve_dynamics
from myomorph.lab.study.trial.steps.ik import recorded_poses, solve_kinematics
from myomorph.lab.study.trial.trial_inputs import TrialFiles, TrialInputs, open_trial

TABLE = "personalized_muscles.csv"
HELD_OUT = "held_out.csv"
FIBERS = "fiber_lengths.csv"
REPORT = "report.html"


@dataclass(frozen=True)
class PersonalFiles:
    """The files of a personalization, one per recording in the same order.

    `inputs` are settings of all recordings.
    """

    model: Path
    motion: tuple[Path, ...] = ()
    loads: tuple[Path, ...] = ()
    torques: tuple[Path, ...] = ()
    emg: tuple[Path, ...] = ()
    passive: tuple[Path, ...] = ()
    generic: Path | None = None
    inputs: ByType = field(default_factory=ByType)

    def check(self) -> None:
        """Raise `BadData` where recordings lack a part."""
        if self.loads and self.torques:
            raise BadData("give --loads or --torques, not both: torques come from one of them")
        for name in ("loads", "torques", "emg"):
            value = getattr(self, name)
            if value and len(value) != len(self.motion):
                raise BadData(
                    f"{len(self.motion)} motions but {len(value)} files of {name}: give one of each"
                    " for every recording, in the same order"
                )
        if self.motion and not (self.loads or self.torques):
            raise BadData("motions without torques: give --loads, or --torques of inverse dynamics")

    def inputs_of(self, index: int) -> ByType:
        """Return settings of the inputs of a recording."""
        loads = self.inputs.or_default(LoadsFile)
        channels = self.inputs.or_default(EmgFiles)
        return self.inputs.having(
            MotionFile(self.motion[index]),
            replace(loads, loads=self.loads[index]) if self.loads else None,
            replace(channels, emg=self.emg[index]) if self.emg else None,
        )


def personalize_files(
    files: PersonalFiles, settings: Mapping[str, Any], model: Model | None = None
) -> Made[Personalized]:
    """Fit muscles to the recordings of files."""
    files.check()
    model = reading.open_model(files.model) if model is None else model
    options = with_settings(PersonalizeOptions(), settings)
    of_motion = _settings_of_motion(settings)
    warnings = list(model.warnings)
    sources = [file_source("model", files.model)]
    trials = []
    for index, motion in enumerate(files.motion):
        recorded = TrialFiles(files.model, inputs=files.inputs_of(index))
        trial = open_trial(recorded, {"tension": of_motion}, model)
        warnings += [text for text in trial.warnings if text not in warnings]
        sources += [source for source in trial.sources if source not in sources]
        table = files.torques[index] if files.torques else None
        sources += file_sources(("torques", table))
        trials.append(_trial(trial, recorded_poses(trial).recorded, motion.stem, table))
    trials += [read_passive(path, model) for path in files.passive]
    generic = None if files.generic is None else reading.open_model(files.generic)
    with reading.about(files.model), progress("muscles of the person", STEPS, "steps") as advance:
        personalized = personalize(model, trials, options, generic=generic, advance=advance)
    used = plain_settings(options) | of_motion | {"time": files.inputs.or_default(TimeSpan).time}
    sources += _sources(files)
    return Made(personalized, provenance_of("personalize", sources, used), tuple(warnings))


def _settings_of_motion(settings: Mapping[str, Any]) -> dict[str, Any]:
    """Return settings of derivatives and of checks of forces, such as the low-pass filter."""
    names = {field.name for kind in (Differentiation, ForceOptions) for field in fields(kind)}
    return {name: value for name, value in settings.items() if name in names and value is not None}


def _trial(
    trial: TrialInputs, recorded: Motion, name: str, table: Path | None = None
) -> PersonalTrial:
    """Return a recording with its torques and EMG."""
    dynamics = solve_dynamics(trial, recorded)
    motion = dynamics.motion
    torques = dynamics.torques
    if table is not None:
        torques = _torques(table, motion)
    return PersonalTrial(name=name, motion=motion, torques=torques, emg=_emg(trial, motion))


def _torques(path: Path, motion: Motion) -> Series:
    """Torques of a table at a motion's times."""
    with reading.about(path):
        read = read_sto(path)
        names = tuple(_coordinate(name) for name in read.names)
        start = read.time[0]
        stop = read.time[-1]
        inside = (motion.time >= start - 1e-6) & (motion.time <= stop + 1e-6)
        if not inside.any():
            raise BadData(
                f"has times {start:g} to {stop:g} s, the motion {motion.time[0]:g} to"
                f" {motion.time[-1]:g} s"
            )
        values = np.array([np.interp(motion.time, read.time, column) for column in read.values.T]).T
        values[~inside] = np.nan
        return Series(motion.time, names, values)


def _emg(trial: TrialInputs, motion: Motion) -> EmgTarget | None:
    recorded = trial.get(RecordedEmg)
    if recorded is None:
        return None
    if not recorded.muscles:
        names = ", ".join(recorded.emg.names)
        raise BadData(
            f"no EMG channel's name contains a muscle of the model ({names}): name channels as"
            " muscles, or give --emg-side"
        )
    options = replace(EmgOptions(), delay=USUAL)
    return emg_targets(recorded.emg, recorded.muscles, trial.model, motion.time, options)


def read_passive(path: Path, model: Model) -> PersonalTrial:
    """Read torques of resting muscles, measured in poses: a table of one pose per row.

    Columns named as coordinates hold the pose; columns named `COORDINATE_moment` (or `_force`) the
    torque that muscles and joints apply about the coordinate, which turns it up where positive [N m
    or N], blank where it was not measured.
    """
    with reading.about(path):
        table = read_sto(path)
        poses = motion_from_table(table, model)
        missing = np.isnan(poses.values)
        if missing.any():
            row, column = np.argwhere(missing)[0]
            raise BadData(
                f"coordinate '{poses.names[column]}' has no value in row {row + 1}: a pose needs"
                " all coordinates that have a column"
            )
        names = {
            name: _coordinate(name)
            for name in table.names
            if _coordinate(name) in model.coordinate_names
        }
        columns = [index for index, name in enumerate(table.names) if names.get(name, name) != name]
        if not columns:
            raise BadData(f"no column is a torque: name them as '{poses.names[0]}_moment'")
        torques = Series(
            table.time,
            tuple(names[table.names[column]] for column in columns),
            table.values[:, columns],
        )
        still = np.zeros_like(poses.values)
        return PersonalTrial(
            path.stem, replace(poses, velocities=still, accelerations=still), torques, passive=True
        )


def _coordinate(name: str) -> str:
    """Of a column of torques, as `id` writes it."""
    return name.removesuffix("_moment").removesuffix("_force")


def write_personalized(made: Made[Personalized], out: Path, tables: Path) -> tuple[str, ...]:
    """Write the model, and a folder of tables, whole or not at all.

    What is lost in the model's file is returned.
    """
    return write_made_model(
        made.found.model,
        made.provenance,
        ModelOutput(out, tables),
        lambda folder: _write(made, folder),
    )


def _write(made: Made[Personalized], folder: Path) -> None:
    personalized = made.found
    _write_rows(estimate_rows(personalized), folder / TABLE)
    write_error_sizes(folder, STEP.name, personal_errors(personalized))
    if len(personalized.recordings):
        _write_rows(fiber_rows(personalized), folder / FIBERS)
    if personalized.held_out is not None:
        _write_rows(held_out_rows(personalized), folder / HELD_OUT)
    write_notes(folder, (*personalized.notes, *made.warnings))
    (folder / REPORT).write_text(_page(made), encoding="utf-8")


def _page(made: Made[Personalized]) -> str:
    personalized = made.found
    notes = (Note("real", f"Recordings: {', '.join(personalized.recordings) or 'none'}."),)
    title = f"{personalized.model.name}: muscles of the person"
    head = PageHead.of(title, made.provenance, notes, (*personalized.notes, *made.warnings))
    return personalized_page(head, personalized)


def estimate_rows(personalized: Personalized) -> list[dict[str, object]]:
    """Return a row for every parameter."""
    return [
        {
            "muscle or group": estimate.of,
            "parameter": estimate.parameter.replace("_", " "),
            "generic": estimate.generic,
            "person": estimate.person,
            "low": estimate.low,
            "high": estimate.high,
            "variance ratio": estimate.variance_ratio,
            "identifiable": estimate.identifiable,
            "at bound": estimate.bound,
            "keeps generic value": estimate.kept,
        }
        for estimate in personalized.estimates
    ]


def fiber_rows(personalized: Personalized) -> list[dict[str, object]]:
    """Return a row for every muscle.

    It holds its normalized fiber lengths in the recordings before and after.
    """
    return [
        {
            "muscle": name,
            "minimum, generic [optimal fiber length]": personalized.before[m, 0],
            "maximum, generic [optimal fiber length]": personalized.before[m, 1],
            "minimum, person [optimal fiber length]": personalized.after[m, 0],
            "maximum, person [optimal fiber length]": personalized.after[m, 1],
        }
        for m, name in enumerate(personalized.model.muscle_names)
    ]


def held_out_rows(personalized: Personalized) -> list[dict[str, object]]:
    """Return a row for every coordinate.

    It holds the torque that generic and personal muscles leave in what was held out.
    """
    assert personalized.held_out is not None
    return [
        {
            "coordinate": name,
            "RMS residual torque, generic [N m or N]": before,
            "RMS residual torque, person [N m or N]": after,
        }
        for name, before, after in zip(
            personalized.coordinates,
            personalized.held_out.left_generic,
            personalized.held_out.left,
            strict=True,
        )
    ]


def _write_rows(rows: Sequence[Mapping[str, object]], path: Path) -> None:
    """Write a table in which what is not known is empty."""
    known = (
        {
            name: "" if isinstance(value, float) and np.isnan(value) else value
            for name, value in row.items()
        }
        for row in rows
    )
    write_rows(list(known), path)


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    """Run the step of a study.

    It uses trials with external forces or torques, and measured passive torques.
    """
    options = with_settings(PersonalizeOptions(), subject.settings.get("personalize", {}))
    files = subject.files
    trials = []
    warnings = []
    for trial in subject.trials():
        forces = trial.get(ExternalLoads) or trial.get(RecordedTorques)
        angles = trial.get(RecordedMotion)
        if forces is None:
            continue
        motion = solve_kinematics(trial).fit.motion if angles is None else angles.motion
        trials.append(_trial(trial, motion, trial.name))
        warnings += list(trial.warnings)
    trials += [read_passive(path, subject.model) for path in files.passive]
    if not trials:
        raise BadData(
            f"subject '{files.name}': no trial has external forces, so 'personalize' has no torques"
            " to fit muscles to; give forces, or tables of measured passive torques ('passive')"
        )
    # What calibration lengthened had fibers that fitted; a morph's muscles come from other bones.
    scaled = "calibrate" in subject.done and "morph" not in subject.done and not files.model_of
    generic_path = files.generic or (files.model if scaled else None)
    generic = None if generic_path is None else reading.open_model(generic_path)
    with reading.about(files.model), progress(f"{files.name}: muscles", STEPS, "steps") as advance:
        personalized = personalize(subject.model, trials, options, generic=generic, advance=advance)
    result = Made(personalized, output.made, tuple(dict.fromkeys(warnings)))
    write_personalized(result, output.path("model"), output.tables)


def _made_from(subject: SubjectInputs) -> Provenance:
    made = recordings_provenance("personalize", subject, earlier=("ik", "id"))
    return replace(made, sources=(*made.sources, *_sources(subject.files)))


def _sources(files: PersonalFiles | SubjectFiles) -> tuple[Source, ...]:
    """Files beside the recordings."""
    passive = (("passive torques", path) for path in files.passive)
    return file_sources(*passive, ("generic model", files.generic))


STEP = Step(
    name="personalize",
    scope="subject",
    title="muscles of the person",
    options=(PersonalizeOptions,),
    tables="personalization",
    leaves=FrozenMap({"model": "personalized.osim"}),
    run=_run,
    made_from=_made_from,
)
