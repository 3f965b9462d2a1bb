"""`calibrate`."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

from myomorph.body.calibrate.calibration import CalibrationOptions
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import messages_of_findings
from myomorph.lab.cli import options as flags
from myomorph.lab.cli.output import made

CalibrateSettings = flags.options_class(CalibrationOptions)
CalibrateInputs = flags.inputs_class("tasks", "labels", "time")


@flags.documented
def calibrate_command(
    *,
    model: flags.ModelFile,
    out: Path,
    markers: tuple[Path, ...] = (),
    static: Path | None = None,
    marker_set: Path | None = None,
    inputs: CalibrateInputs | None = None,  # type: ignore[valid-type]
    options: CalibrateSettings | None = None,  # type: ignore[valid-type]
    threads: flags.Threads = None,
) -> int:
    """Link lengths and marker positions of the body that the recordings show.

    Parameters
    ----------
    out : model to write (.osim); tables of lengths and markers stand beside it
    markers : recordings: .trc, .c3d, .mat or .h5, one or more
    static : recording of standing still
    marker_set : OpenSim marker set (.xml) that comes before the model's markers
    """
    from myomorph.lab.store.results import file_sources, provenance_of
    from myomorph.lab.store.settings import plain_settings, with_settings
    from myomorph.lab.study.inputs.labels import Labels
    from myomorph.lab.study.inputs.markers import MarkersFile
    from myomorph.lab.study.inputs.reading import open_model
    from myomorph.lab.study.inputs.tasks import TasksFile
    from myomorph.lab.study.inputs.time_span import TimeSpan
    from myomorph.lab.study.subject import calibrating
    from myomorph.lab.study.subject.subject_files import SubjectFiles, SubjectInputs
    from myomorph.lab.study.subject.subjects import tables_folder
    from myomorph.lab.study.trial.trial_inputs import TrialFiles

    flags.use_threads(threads)
    if not markers and static is None:
        raise BadData("no recording to calibrate from: give --markers FILE, --static FILE or both")
    tables = tables_folder(out, calibrating.STEP.tables, (model,))
    shared = flags.inputs_of_flags(inputs)
    settings = flags.settings_dict(options)
    tasks = shared.or_default(TasksFile).tasks
    labels = shared.or_default(Labels).labels
    body = open_model(model)
    chosen = with_settings(CalibrationOptions(), settings)
    if marker_set is not None:
        body = calibrating.with_marker_set(body, marker_set)
    if tasks is not None:
        chosen = replace(chosen, marker_weights=calibrating.task_weights(tasks, body))
    each = shared.without(TasksFile)
    trials = tuple(
        TrialFiles(model, path.name, inputs=each.having(MarkersFile(path))) for path in markers
    )
    files = SubjectFiles(model.stem, model, static=static, trials=trials, labels=labels)
    subject = SubjectInputs(files=files, settings={"calibrate": settings}, path=model, model=body)
    time = shared.or_default(TimeSpan).time
    recorded = (*(("markers", path) for path in markers), ("static", static))
    sources = file_sources(
        ("model", model), *recorded, ("marker set", marker_set), ("tasks", tasks)
    )
    plain = plain_settings(chosen) | {"time": time} | ({"labels": dict(labels)} if labels else {})
    made_from = provenance_of("calibrate", sources, plain)
    calibrated = calibrating.calibrated(subject, chosen, made_from)
    lost = calibrating.write_calibrated(calibrated, out, tables)
    notes = (
        *messages_of_findings(calibrated.findings),
        *calibrated.warnings,
        *calibrated.found.notes,
        *lost,
    )
    return made(out, tables, calibrating.summary(calibrated.found), notes)
