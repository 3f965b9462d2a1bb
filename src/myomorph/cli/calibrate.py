"""`calibrate`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated

from cyclopts import Parameter

from myomorph.cli.options import (
    ModelFile,
    Threads,
    inputs_class,
    inputs_of_flags,
    options_class,
    settings_dict,
    use_threads,
)
from myomorph.cli.output import said, warn
from myomorph.motion.calibration import CalibrationOptions

CalibrateSettings = options_class(CalibrationOptions)
CalibrateInputs = inputs_class("tasks", "labels", "time")


def calibrate_command(
    *,
    model: ModelFile,
    out: Annotated[Path, Parameter(help="Model to write (.osim); tables of lengths and markers stand beside it.")],
    markers: Annotated[
        tuple[Path, ...], Parameter(help="Recordings: .trc, .c3d, .mat or .h5, one or more.", consume_multiple=True)
    ] = (),
    static: Annotated[Path | None, Parameter(help="Recording of standing still.")] = None,
    marker_set: Annotated[
        Path | None, Parameter(help="OpenSim marker set (.xml) that comes before the model's markers.")
    ] = None,
    inputs: CalibrateInputs | None = None,  # type: ignore[valid-type]
    options: CalibrateSettings | None = None,  # type: ignore[valid-type]
    threads: Threads = None,
) -> int:
    """Link lengths and marker positions of the body that the recordings show."""
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
    warn((*map(str, calibrated.findings), *calibrated.warnings, *calibrated.found.notes, *lost))
    for line in calibrating.summary(calibrated.found):
        said(line)
    said(f"wrote {out} and {tables_folder(out, calibrating.STEP.tables)}")
    return 0
