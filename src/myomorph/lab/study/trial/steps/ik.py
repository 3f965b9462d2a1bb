"""Inverse kinematics of a trial.

It finds the coordinates that explain its markers and inertial sensors best.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING, NamedTuple

import numpy as np

from myomorph.body.sensors.sensor_recording import SensorRecording, TrackedMarkers
from myomorph.core.contact.site_motion import root_places, walked
from myomorph.core.io.sto import table_from_motion, write_sto
from myomorph.core.model.causes import HIDDEN
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import Finding, messages_of_findings
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers, Motion, Series, Table
from myomorph.core.model.series_quantities import (
    COORDINATE_UNIT,
    COORDINATE_VALUE,
    MARKER_POSITION,
)
from myomorph.core.motion.crossings import CrossingOptions, best_crossings, within_crossings
from myomorph.core.motion.ik import InverseKinematicsOptions, KinematicsFit
from myomorph.core.motion.marker_checks import (
    CheckedFit,
    MarkerCheckOptions,
    checked_kinematics,
    doubts_of,
)
from myomorph.core.motion.quantities import FIT, MARKER_ERROR, SENSOR_ERROR
from myomorph.core.motion.sensors.dropouts import gaps_filled
from myomorph.core.motion.sensors.mounting import SensorOptions, trunk_acceleration
from myomorph.core.motion.sync import cut
from myomorph.lab.report.trial.report_input import Kinematics, ReportInput
from myomorph.lab.report.trial.summary_lines import kinematics_line
from myomorph.lab.store import stored as store
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.progress import progress
from myomorph.lab.store.quantity_files import write_series
from myomorph.lab.store.results import Stored, get_findings, put_findings
from myomorph.lab.store.stored_fit import get_fit, put_fit
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.inputs.motion import RecordedMotion
from myomorph.lab.study.inputs.refined import RefinedMotion, refined_fit
from myomorph.lab.study.step.step import Step, StepCommand, StepOutput
from myomorph.lab.study.trial.trial_inputs import Signals, TrialInputs, Value, tidy_signals

if TYPE_CHECKING:
    from myomorph.lab.study.trial.trial_strides import TrialStrides

FINDINGS = "ik_findings"


@dataclass(frozen=True, eq=False)
class Poses:
    """Coordinates over time, as inverse kinematics (`fit`) or a file gave them.

    Findings of marker checks come with them.
    """

    recorded: Motion
    fit: KinematicsFit | None = None
    notes: tuple[Message, ...] = ()
    findings: tuple[Finding, ...] = ()


def solve_kinematics(trial: TrialInputs) -> CheckedFit:
    """Solve inverse kinematics of the part of a recording that is used.

    It uses markers, their labels checked, and sensors.
    """
    recorded = trial.recording.markers
    sensors = trial.get(SensorRecording)
    options = trial.options
    if recorded is None and sensors is None:
        raise BadData(f"{trial.name}: holds no markers, and no inertial sensors")
    checked = None
    if recorded is not None:
        used = used_markers(trial, recorded)
        with progress(f"{trial.name}: inverse kinematics", len(used.markers)) as advance:
            chosen = (options[InverseKinematicsOptions], options[MarkerCheckOptions])
            checked = checked_kinematics(trial.model, used.markers, *chosen, advance)
        checked = replace(checked, findings=(*used.findings, *checked.findings))
    return checked if sensors is None and checked is not None else _with_sensors(trial, checked)


def trial_motion(trial: TrialInputs) -> Motion:
    """Coordinates that a trial begins with, else those of inverse kinematics."""
    recorded = trial.get(RecordedMotion)
    if recorded is None:
        return solve_kinematics(trial).fit.motion
    return recorded.motion if trial.time is None else cut(recorded.motion, *trial.time)


def _with_sensors(trial: TrialInputs, checked: CheckedFit | None) -> CheckedFit:
    """Return the fit of markers and sensors, or of sensors alone."""
    # Recordings of markers alone never ask how sensors sit.
    from myomorph.body.sensors.sensor_kinematics import sensor_kinematics

    options = trial.options
    recording = replace(trial.inputs[SensorRecording], sizes=options[SensorOptions])
    if checked is None:
        clock = gaps_filled(recording.sensors.time)
        empty = Markers(clock, (), np.empty((len(clock), 0, 3)))
        markers = empty if trial.time is None else cut(empty, *trial.time)
    else:
        markers = checked.markers
    marked = None if checked is None else checked.fit
    tracked = TrackedMarkers(markers=markers, fit=marked)
    with progress(f"{trial.name}: inertial sensors", len(markers)) as advance:
        tracking = options[InverseKinematicsOptions]
        sensors = sensor_kinematics(trial.model, recording, tracked, tracking, advance)
    if marked is None and root_places(trial.model):
        felt = trunk_acceleration(
            trial.model, sensors.mounting, sensors.sensors, sensors.fit.motion.time
        )
        fit = replace(sensors.fit, motion=walked(trial.model, sensors.fit.motion, felt))
        sensors = replace(sensors, fit=fit)
    return CheckedFit(
        fit=sensors.fit,
        markers=markers,
        findings=() if checked is None else checked.findings,
        sensors=sensors,
    )


class UsedMarkers(NamedTuple):
    """The part of a recording that is used, and what its choice must say."""

    markers: Markers
    findings: tuple[Finding, ...] = ()


def used_markers(trial: TrialInputs, markers: Markers) -> UsedMarkers:
    """Return the part of a recording that is used.

    With passes through the capture volume only, markers are hidden elsewhere.
    """
    markers = markers if trial.time is None else cut(markers, *trial.time)
    options = trial.options[CrossingOptions]
    if not options.only:
        return UsedMarkers(markers)
    passes = best_crossings(markers, trial.model, options)
    if not passes.spans:
        raise BadData(
            f"{trial.name}: no part of {options.min_duration:g} s shows"
            f" {100 * options.min_visible:g} % of the possible marker information: lower the limits"
            " (passes_min_visible, passes_min_duration)"
        )
    used = within_crossings(markers, passes.spans)
    if passes.share >= options.min_visible:
        return UsedMarkers(used)
    text = HIDDEN.message(
        f"no part of {options.min_duration:g} s shows {100 * options.min_visible:g} % of the"
        f" possible marker information: the parts that show {100 * passes.share:.0f} % are used"
    )
    return UsedMarkers(used, (Finding("passes that show less", "markers", text),))


def error_table(fit: KinematicsFit) -> Table:
    """Marker errors as a table: root mean square, largest, and each marker's [m]."""
    values = np.column_stack([fit.rms, fit.largest, fit.marker_error])
    return Table(fit.motion.time, ("rms", "largest", *fit.marker_names), values)


def _run(trial: TrialInputs, output: StepOutput) -> Poses:
    if trial.get(RecordedMotion) is not None:
        used = trial_motion(trial)
        write_series(output.folder, replace(used, quantity=COORDINATE_VALUE), trial.model)
        store.put_motion(output.writer, used, trial.model)
        return Poses(used)
    checked = solve_kinematics(trial)
    writer = output.writer
    notes = messages_of_findings(checked.findings)
    if checked.sensors is not None:
        notes = (*notes, *checked.sensors.mounting.notes)
        of_sensors = Series(
            checked.fit.motion.time,
            checked.fit.sensor_names,
            checked.fit.sensor_error,
            quantity=SENSOR_ERROR,
        )
        write_series(output.folder, of_sensors)
    refined = trial.get(RefinedMotion)
    recorded = trial.recording.markers
    if refined is not None:
        write_sto(
            table_from_motion(checked.fit.motion, trial.model), output.folder / "coordinates_ik.mot"
        )
        checked, more = refined_fit(trial.name, trial.model, refined, checked)
        notes = (*notes, *more)
    fit = checked.fit
    write_series(output.folder, replace(fit.motion, quantity=COORDINATE_VALUE), trial.model)
    write_sto(error_table(fit), output.folder / MARKER_ERROR.file)
    put_fit(writer, fit, trial.model)
    if recorded is not None:
        kept = np.isin(recorded.time, fit.motion.time)
        shown = replace(recorded, time=fit.motion.time, values=recorded.values[kept])
        repaired = any(finding.repaired for finding in checked.findings)
        store.put_markers(writer, checked.markers if repaired else shown)
    put_findings(writer, FINDINGS, checked.findings)
    return Poses(recorded=fit.motion, fit=fit, notes=notes, findings=checked.findings)


def recorded_poses(trial: TrialInputs) -> Poses:
    """Coordinates that a trial begins with; raises `KeyError` where it begins with markers."""
    return Poses(trial.inputs[RecordedMotion].motion)


def _read(stored: Stored, options: OptionSet) -> Poses | None:
    fit = get_fit(stored)
    if fit is None:
        return Poses(store.get_motion(stored)) if COORDINATE_VALUE.name in stored.values else None
    findings = get_findings(stored, FINDINGS)
    fit = replace(fit, motion=replace(fit.motion, findings=doubts_of(findings)))
    return Poses(
        recorded=fit.motion, fit=fit, notes=messages_of_findings(findings), findings=findings
    )


def _hashed(trial: TrialInputs) -> Sequence[object]:
    crossed = trial.options[CrossingOptions]
    options = trial.options
    sensed = (options[SensorOptions],) if trial.get(SensorRecording) is not None else ()
    crossing = (crossed,) if crossed.only else ()
    return options[InverseKinematicsOptions], options[MarkerCheckOptions], *crossing, *sensed


def _show(report_input: ReportInput, stored: Stored) -> ReportInput:
    fit = get_fit(stored)
    coordinates = store.get_derivatives(stored) if fit is None else None
    if fit is None and coordinates is None and COORDINATE_VALUE.name in stored.values:
        coordinates = store.get_motion(stored)
    report_input = report_input.with_warnings(messages_of_findings(get_findings(stored, FINDINGS)))
    return replace(report_input, kinematics=Kinematics(store.get_markers(stored), fit, coordinates))


def _signals(stored: Stored, model: Model, mass: float) -> Sequence[Signals]:
    """Coordinates in degrees and metres."""
    if COORDINATE_VALUE.name not in stored.values:
        return ()
    return (tidy_signals("ik", store.get_motion(stored), model),)


def _numbers(stored: Stored, model: Model, strides: TrialStrides | None) -> Iterator[Value]:
    """Frames, marker errors and strides."""
    yield Value(step="ik", quantity="frames", value=float(len(stored.time)), unit="1")
    if len(stored.time):
        yield Value(
            step="ik", quantity="duration", value=float(stored.time[-1] - stored.time[0]), unit="s"
        )
    fit = get_fit(stored)
    if fit is not None and np.isfinite(fit.marker_error).any():
        yield Value(
            step="ik",
            quantity="marker error, RMS",
            value=float(np.sqrt(np.nanmean(fit.marker_error**2))),
            unit="m",
        )
        yield Value(
            step="ik",
            quantity="marker error, largest",
            value=float(np.nanmax(fit.marker_error)),
            unit="m",
        )
    if fit is not None and np.isfinite(fit.sensor_error).any():
        yield Value(
            step="ik",
            quantity="sensor error, RMS",
            value=float(np.degrees(np.sqrt(np.nanmean(fit.sensor_error**2)))),
            unit="deg",
        )
    if fit is not None and fit.seen.any():
        yield Value(
            step="ik",
            quantity="frames not converged",
            value=float((fit.seen & ~np.asarray(fit.converged, bool)).sum()),
            unit="1",
        )
    if strides is not None:
        yield from strides.numbers("ik")


def _outcome(outcome: Outcome, poses: Poses) -> Outcome:
    """Frames, marker errors and findings."""
    texts = messages_of_findings(poses.findings)
    outcome = replace(outcome, frames=len(poses.recorded), findings=(*outcome.findings, *texts))
    fit = poses.fit
    if fit is not None and np.isfinite(fit.marker_error).any():
        rms = float(np.nanmean(fit.rms))
        largest = float(np.nanmax(fit.largest))
        outcome = replace(outcome, rms=rms, largest=largest)
    return outcome


def _line(trial: TrialInputs, results: ByType) -> str:
    """Frames, markers and errors."""
    fit = results[Poses].fit
    assert fit is not None
    return kinematics_line(fit, trial.model, trial.recording.markers)


STEP = Step(
    name="ik",
    title="inverse kinematics",
    gives=Poses,
    quantities=(COORDINATE_VALUE, COORDINATE_UNIT, MARKER_POSITION, *FIT),
    options=(InverseKinematicsOptions, MarkerCheckOptions, CrossingOptions, SensorOptions),
    not_settings=("only_weighted",),
    inputs=("tasks", "labels", "laboratory", "imu", "time"),
    roles=("model", "markers", "tasks", "motion", "imu", "refined motion"),
    hashed=_hashed,
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
    numbers=_numbers,
    outcome=_outcome,
    outcome_variables=(
        *("time", "coordinate", "coordinate_value", "marker", "marker_error", "marker_weight"),
        *("sensor", "sensor_error"),
        *("ik_converged", "ik_iterations", "unused_marker", "missing_marker"),
    ),
    command=StepCommand(_line, COORDINATE_VALUE.file, draws=True),
)
