"""Muscle lengths, velocities and moment arms of a motion, straight into files.

Memory does not grow with frames.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import groupby
from operator import itemgetter
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.sto import write_sto
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series
from myomorph.core.motion.sync import cut
from myomorph.core.muscles.kinematics import ReportedPaths
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.muscles.quantities import (
    CROSSING_COORDINATE,
    CROSSING_MUSCLE,
    MOMENT_ARM,
    MUSCLE_LENGTH,
    MUSCLE_VELOCITY,
)
from myomorph.core.rigid.loops import closed_motion
from myomorph.lab.report.trial.report_input import MusclePaths, ReportInput
from myomorph.lab.report.trial.summary_lines import muscles_line
from myomorph.lab.store import stored as store
from myomorph.lab.store.progress import progress
from myomorph.lab.store.quantities import create_quantity, put_quantity
from myomorph.lab.store.quantity_files import quantity_table, write_series
from myomorph.lab.store.results import ResultWriter, Stored, file_name
from myomorph.lab.store.settings import Differentiation
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.step.step import Step, StepCommand, StepOutput
from myomorph.lab.study.trial.steps.id import Torques, filter_summary, with_derivatives
from myomorph.lab.study.trial.steps.ik import Poses
from myomorph.lab.study.trial.trial_inputs import Signals, TrialInputs, tidy_signals

BLOCK = 512  # Frames that are in memory at a time.


def write_muscles(
    model: Model, motion: Motion, recorded: Motion, output: StepOutput, title: str
) -> str:
    """Write lengths, velocities and moment arms of a motion with velocities, and return one line.

    The files are `lengths.sto`, `velocities.sto` and `moment_arms_<coordinate>.sto`; the same goes
    into a result. The line says what was found.

    Moment arms belong to the motion, as tensions do; lengths are those of the frames as recorded: a
    filter cuts off turning points, and noise shows in velocities alone. Only pairs of a muscle and
    a coordinate that can have a moment arm are computed and written; a coordinate that no muscle
    crosses gets no file. Frames without coordinates (NaN) stay NaN.
    """
    writer = output.writer
    paths = ReportedPaths(model)
    stored = _variables(writer, model, motion, paths.pairs)
    lengths = np.empty((len(motion), len(model.muscles)))
    velocities = np.empty((len(motion), len(model.muscles)))
    with progress(title, len(motion)) as advance:
        for start in range(0, len(motion), BLOCK):
            part = slice(start, min(start + BLOCK, len(motion)))
            _, velocities[part], stored[part] = paths.evaluate(motion, part, advance)
            lengths[part] = paths.evaluate(recorded, part)[0]
    put_quantity(writer, MUSCLE_LENGTH, lengths)
    put_quantity(writer, MUSCLE_VELOCITY, velocities)
    for quantity, values in ((MUSCLE_LENGTH, lengths), (MUSCLE_VELOCITY, velocities)):
        series = Series(motion.time, model.muscle_names, values, quantity=quantity)
        write_series(output.folder, series)
    _arm_tables(motion, paths.pairs, stored, output.folder)
    return muscles_line(model, motion.time, lengths, velocities)


def _variables(
    writer: ResultWriter, model: Model, motion: Motion, crossing: Sequence[tuple[str, str]]
) -> Any:
    """Return the variable of moment arms.

    Its columns are the pairs of muscle and coordinate that can have one.
    """
    writer.time(motion.time)
    writer.names("muscle", model.muscle_names)
    writer.sizes("crossing", len(crossing))
    put_quantity(writer, CROSSING_MUSCLE, [muscle for muscle, _ in crossing])
    put_quantity(writer, CROSSING_COORDINATE, [coordinate for _, coordinate in crossing])
    return create_quantity(writer, MOMENT_ARM)


def _arm_tables(
    motion: Motion, crossing: Sequence[tuple[str, str]], arms: Any, folder: Path
) -> None:
    """Write one table per coordinate, its columns the muscles that cross it.

    Pairs are in order of coordinates.
    """
    start = 0
    for coordinate, pairs in groupby(crossing, key=itemgetter(1)):
        names = tuple(muscle for muscle, _ in pairs)
        columns = slice(start, start := start + len(names))
        about = MOMENT_ARM.replaced(
            title=MOMENT_ARM.title.format(coordinate=coordinate), dims=("time", "muscle")
        )
        series = Series(motion.time, names, arms[:, columns], quantity=about)
        table = quantity_table(series)
        write_sto(table, folder / MOMENT_ARM.file.format(coordinate=file_name(coordinate)))


@dataclass(frozen=True, eq=False)
class MuscleLengths:
    """Lengths and velocities of muscle-tendon paths.

    Attributes
    ----------
    lengths : (frames, muscles) [m], None where they are in the file alone, as moment arms always
        are
    velocities : (frames, muscles) [m/s], None as lengths
    notes : one line each
    summary : what a command prints, "" where the result was read back
    """

    lengths: Series | None = None
    velocities: Series | None = None
    notes: tuple[Message, ...] = ()
    summary: str = ""


def _run(
    trial: TrialInputs, output: StepOutput, poses: Poses, torques: Torques | None
) -> MuscleLengths:
    notes: tuple[Message, ...] = ()
    if torques is None:
        whole = with_derivatives(trial, poses.recorded)
        motion = whole.motion
        notes = whole.notes
        store.put_derivatives(output.writer, motion, trial.model)
    else:
        motion = torques.motion
    recorded = poses.recorded if trial.time is None else cut(poses.recorded, *trial.time)
    exact = closed_motion(trial.model, Motion(recorded.time, recorded.names, recorded.values))[
        0
    ].values
    # In gaps that were bridged, as smoothed.
    exact = np.where(np.isfinite(exact), exact, motion.values)
    recorded = replace(motion, values=np.where(np.isfinite(motion.values), exact, np.nan))
    title = f"{trial.name}: muscle paths"
    kinematics = write_muscles(trial.model, motion, recorded, output, title)
    return MuscleLengths(notes=notes, summary=kinematics)


def _read(stored: Stored, options: OptionSet) -> MuscleLengths | None:
    lengths = store.get_series(stored, MUSCLE_LENGTH)
    if lengths is None:
        return None
    return MuscleLengths(lengths, store.get_series(stored, MUSCLE_VELOCITY))


def _show(report_input: ReportInput, stored: Stored) -> ReportInput:
    crossed = tuple(dict.fromkeys(stored.names.get("crossing_coordinate", ())))
    if not crossed and report_input.model is not None and report_input.model.muscles:
        # No step wrote moment arms: the paths tell which coordinates at least one muscle crosses.
        used = sorted(set(compile_paths(report_input.model).arm_coordinate.tolist()))
        crossed = tuple(report_input.model.coordinate_names[j] for j in used)
    shown = MusclePaths(
        store.get_series(stored, MUSCLE_LENGTH), store.get_series(stored, MUSCLE_VELOCITY), crossed
    )
    return replace(report_input, muscles=shown)


def _signals(stored: Stored, model: Model, mass: float) -> Sequence[Signals]:
    lengths = store.get_series(stored, MUSCLE_LENGTH)
    if lengths is None:
        return ()
    return (tidy_signals("muscles", lengths, model),)


def _line(trial: TrialInputs, results: ByType) -> str:
    """Return the ranges of lengths, and the filter."""
    return results[MuscleLengths].summary + filter_summary(trial, results[Poses].recorded)


STEP = Step(
    name="muscles",
    title="muscle paths",
    gives=MuscleLengths,
    quantities=(
        *(MUSCLE_LENGTH, MUSCLE_VELOCITY, MOMENT_ARM),
        *(CROSSING_MUSCLE, CROSSING_COORDINATE),
    ),
    needs=(Poses,),
    uses=(Torques,),
    inputs=("time",),
    options=(Differentiation,),
    roles=("model", "markers", "tasks", "motion", "imu", "refined motion", "soft tissue"),
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
    large=(MOMENT_ARM.name,),
    tables="muscles",
    command=StepCommand(_line),
)
