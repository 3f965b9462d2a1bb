"""`calibrate`."""

from __future__ import annotations

from pathlib import Path

from myomorph.cli.options import (
    ModelFile,
    Threads,
    documented,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import made
from myomorph.motion.calibration import CalibrationOptions

CalibrateSettings = options_class(CalibrationOptions)
CalibrateInputs = inputs_class("tasks", "labels", "time")


@documented
def calibrate_command(
    *,
    model: ModelFile,
    out: Path,
    markers: tuple[Path, ...] = (),
    static: Path | None = None,
    marker_set: Path | None = None,
    inputs: CalibrateInputs | None = None,  # type: ignore[valid-type]
    options: CalibrateSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Link lengths and marker positions of the body that the recordings show.

    Parameters
    ----------
    out : model to write (.osim); tables of lengths and markers stand beside it
    markers : recordings: .trc, .c3d, .mat or .h5, one or more
    static : recording of standing still
    marker_set : OpenSim marker set (.xml) that comes before the model's markers
    """
    # Imported by the command that needs it: --help and the others start without.
    from myomorph.store.settings import with_settings
    from myomorph.study.inputs.labels import Labels
    from myomorph.study.inputs.tasks import TasksFile
    from myomorph.study.inputs.time_span import TimeSpan
    from myomorph.study.subject import calibrating
    from myomorph.study.subject.calibrating import CalibrationFiles
    from myomorph.study.subject.subjects import check_out_model, tables_folder

    use_threads(threads)
    shared = inputs_of_flags(inputs)
    named = (shared.or_default(TasksFile).tasks, shared.or_default(TimeSpan).time, shared.or_default(Labels).labels)
    files = CalibrationFiles(model, markers, static, marker_set, *named)
    check_out_model(out, read=(model,))
    calibrated = calibrating.calibrate_files(files, with_settings(CalibrationOptions(), settings_dict(options)))
    lost = calibrating.write_calibrated(calibrated, out)
    notes = (*map(str, calibrated.findings), *calibrated.warnings, *calibrated.found.notes, *lost)
    return made(out, tables_folder(out, calibrating.STEP.tables), calibrating.summary(calibrated.found), notes)
