"""`calibrate`."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

from cyclopts import Parameter

from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import messages_of_findings
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made

if TYPE_CHECKING:
    from myomorph.core.model.model import Model
    from myomorph.core.model.provenance import Provenance
    from myomorph.lab.study.inputs.input import ByType
    from myomorph.lab.study.trial.trial_inputs import TrialFiles

CalibrateSettings = flags.options_class(CalibrationOptions)
CalibrateInputs = flags.inputs_class("tasks", "labels", "time")


@flags.documented
@dataclass(frozen=True, kw_only=True)
class CalibrateFiles:
    """The files of a calibration.

    Attributes
    ----------
    out : model to write (.osim); tables of lengths and markers go into a folder next to it
    markers : one or more recordings of markers (.trc, .c3d, .mat or .h5)
    static : recording of quiet standing
    marker_set : OpenSim marker set (.xml), whose markers are added to the model and replace those
        of the same name
    """

    model: flags.ModelFile
    out: Path
    markers: tuple[Path, ...] = ()
    static: Path | None = None
    marker_set: Path | None = None


@flags.documented
def calibrate_command(
    *,
    files: Annotated[CalibrateFiles, Parameter(name="*")],
    inputs: CalibrateInputs | None = None,  # type: ignore[valid-type]
    options: CalibrateSettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Fit link lengths and marker positions to the body that the recordings show."""
    from myomorph.lab.study.inputs.labels import Labels
    from myomorph.lab.study.inputs.reading import open_model
    from myomorph.lab.study.subject import calibrating
    from myomorph.lab.study.subject.subject_files import SubjectFiles, SubjectInputs
    from myomorph.lab.study.subject.subjects import tables_folder

    flags.use_threads(threads)
    if not files.markers and files.static is None:
        raise BadData("no recording to calibrate from: give --markers FILE, --static FILE or both")
    tables = tables_folder(files.out, calibrating.STEP.tables, (files.model,))
    shared = flags.inputs_of_flags(inputs)
    settings = flags.settings_dict(options)
    body = open_model(files.model)
    if files.marker_set is not None:
        body = calibrating.with_marker_set(body, files.marker_set)
    chosen = _chosen(body, shared, settings)
    recorded = SubjectFiles(
        files.model.stem,
        files.model,
        static=files.static,
        trials=_trials(files, shared),
        labels=shared.or_default(Labels).labels,
    )
    subject = SubjectInputs(
        files=recorded, settings={"calibrate": settings}, path=files.model, model=body
    )
    calibrated = calibrating.calibrated(subject, chosen, _provenance(files, shared, chosen))
    lost = calibrating.write_calibrated(calibrated, files.out, tables)
    notes = (
        *messages_of_findings(calibrated.findings),
        *calibrated.warnings,
        *calibrated.found.notes,
        *lost,
    )
    return made(files.out, tables, calibrating.summary(calibrated.found), notes)


def _chosen(body: Model, shared: ByType, settings: Mapping[str, Any]) -> CalibrationOptions:
    """Collect the options, with weights of a task set if there is one."""
    from myomorph.lab.store.settings import with_settings
    from myomorph.lab.study.inputs.tasks import TasksFile
    from myomorph.lab.study.subject import calibrating

    chosen = with_settings(CalibrationOptions(), settings)
    tasks = shared.or_default(TasksFile).tasks
    if tasks is None:
        return chosen
    return replace(chosen, marker_weights=calibrating.task_weights(tasks, body))


def _trials(files: CalibrateFiles, shared: ByType) -> tuple[TrialFiles, ...]:
    """Make a trial of each recording of markers."""
    from myomorph.lab.study.inputs.markers import MarkersFile
    from myomorph.lab.study.inputs.tasks import TasksFile
    from myomorph.lab.study.trial.trial_inputs import TrialFiles

    each = shared.without(TasksFile)
    return tuple(
        TrialFiles(files.model, path.name, inputs=each.having(MarkersFile(path)))
        for path in files.markers
    )


def _provenance(files: CalibrateFiles, shared: ByType, chosen: CalibrationOptions) -> Provenance:
    """Collect the files and options that the model is derived from."""
    from myomorph.lab.store.results import file_sources, provenance_of
    from myomorph.lab.store.settings import plain_settings
    from myomorph.lab.study.inputs.labels import Labels
    from myomorph.lab.study.inputs.tasks import TasksFile
    from myomorph.lab.study.inputs.time_span import TimeSpan

    labels = shared.or_default(Labels).labels
    recorded = (*(("markers", path) for path in files.markers), ("static", files.static))
    sources = file_sources(
        ("model", files.model),
        *recorded,
        ("marker set", files.marker_set),
        ("tasks", shared.or_default(TasksFile).tasks),
    )
    plain = plain_settings(chosen) | {"time": shared.or_default(TimeSpan).time}
    return provenance_of("calibrate", sources, plain | ({"labels": dict(labels)} if labels else {}))
