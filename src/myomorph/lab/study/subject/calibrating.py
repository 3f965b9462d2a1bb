"""Kinematic calibration from files.

A model and recordings of markers give the model of that body, and its page.
"""

from __future__ import annotations

from collections.abc import Iterable
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.body.calibrate.calibrate import calibrate
from myomorph.body.calibrate.calibration import SOURCES, Calibration, CalibrationOptions
from myomorph.body.calibrate.patella_fit import PatellaDistance
from myomorph.core.io.osim.setup_parts import read_ik_tasks, read_marker_set
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import Finding, messages_of_findings
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message, located
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Provenance
from myomorph.core.model.series import Markers
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.motion.label_repair import repaired_labels
from myomorph.core.motion.lengths import length_unit
from myomorph.core.motion.marker_sides import side_findings
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.report.trial.summary_lines import calibration_line
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import findings_text
from myomorph.lab.store.settings import with_settings
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.error_size_tables import write_error_sizes
from myomorph.lab.study.step.folder_steps import FolderOutput, write_notes
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.found_errors import calibrated_errors
from myomorph.lab.study.subject.subject_files import (
    SubjectFiles,
    SubjectInputs,
    recordings_provenance,
)
from myomorph.lab.study.subject.subjects import Made, ModelOutput, write_made_model, write_rows
from myomorph.lab.study.trial.steps.ik import UsedMarkers, used_markers

PATELLAE = "patellae.csv"
FINDINGS = "findings.json"  # What checks of the markers found, in the folder of tables.


@dataclass(frozen=True, eq=False, kw_only=True)
class Calibrated(Made[Calibration]):
    """A calibration, the names of its recordings in its order, and findings on their markers."""

    recordings: tuple[str, ...]
    findings: tuple[Finding, ...] = ()


def calibrated(subject: SubjectInputs, options: CalibrationOptions, made: Provenance) -> Calibrated:
    """Lengths and marker positions of the body that all recordings of a subject show."""
    files = subject.files
    model = subject.model
    trials = subject.trials()
    reading.check_labels(files.labels, model)
    warnings = [*located(files.model.name, model.warnings)]
    findings = list[Finding]()
    warnings += [text for trial in trials for text in trial.warnings]
    recordings = {}
    for trial in trials:
        markers = trial.recording.markers
        if markers is not None:
            recordings[trial.name] = _checked(
                trial.name, used_markers(trial, markers), model, findings
            )
            weights = trial.options[InverseKinematicsOptions].marker_weights
            options = replace(options, marker_weights=weights or options.marker_weights)
    if files.static is not None:
        standing, texts = standing_markers(files.static, files, model)
        warnings += texts
        static = _checked(files.static.name, UsedMarkers(standing), model, findings)
        options = replace(options, static=static)
    if not recordings and options.static is None:
        raise BadData(
            f"subject '{files.name}': no trial has markers, so 'calibrate' has nothing to fit"
        )
    with (
        reading.about(files.model),
        progress(f"{files.name}: calibration", options.iterations, "steps") as advance,
    ):
        calibration = calibrate(
            model, list(recordings.values()), options, advance, default_path_lengths
        )
    names = (*recordings, *((files.static.stem,) if files.static else ()))
    return Calibrated(
        calibration,
        made,
        tuple(dict.fromkeys(warnings)),
        recordings=names[-len(calibration.frames) :],
        findings=(*calibration.warnings, *findings),
    )


def standing_markers(
    path: Path, files: SubjectFiles, model: Model
) -> tuple[Markers, list[Message]]:
    """Markers of a subject standing still, in the model's ground and names, and warnings."""
    recorded = files.static_laboratory.trial(reading.read_recording(path))
    standing = reading.fitted_to(model, reading.with_labels(recorded, files.labels))
    assert standing.markers is not None
    return standing.markers, [*located(path.name, standing.warnings)]


def _checked(name: str, used: UsedMarkers, model: Model, findings: list[Finding]) -> Markers:
    """Put back exchanged labels of a recording, before a calibration moves markers after them.

    Findings are added.
    """
    markers, exchanged = repaired_labels(model, used.markers)
    beside = side_findings(markers, model.marker_names, length_unit(compile_tree(model)))
    known = {(finding.kind, finding.place) for finding in findings}
    new = [
        *used.findings,
        *(one for one in (*exchanged, *beside) if (one.kind, one.place) not in known),
    ]
    findings += [replace(finding, text=finding.text.within(name)) for finding in new]
    return markers


def task_weights(path: Path, model: Model) -> dict[str, float]:
    """Weights of a task set; markers that it does not name do not count."""
    weights = read_ik_tasks(path).marker_weights
    return {name: weights.get(name, 0.0) for name in model.marker_names}


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    options = with_settings(
        CalibrationOptions(mass=subject.files.mass), subject.settings.get("calibrate", {})
    )
    write_calibrated(calibrated(subject, options, output.made), output.path("model"), output.tables)


def write_calibrated(calibrated: Calibrated, out: Path, tables: Path) -> tuple[str, ...]:
    """Write the model, and a folder of tables, report and findings, whole or not at all.

    What is lost in the model's file is returned.
    """
    calibration = calibrated.found

    def fill(folder: Path) -> None:
        from myomorph.lab.study.trial.reporting import REPORT  # only now, as all of the report

        write_rows(length_rows(calibration), folder / "lengths.csv")
        write_rows(marker_rows(calibration), folder / "markers.csv")
        write_rows(zero_rows(calibration), folder / "zero_angles.csv")
        if calibration.patella is not None:
            write_rows(patella_rows(calibration.patella), folder / PATELLAE)
        write_error_sizes(folder, STEP.name, calibrated_errors(calibration))
        (folder / FINDINGS).write_text(findings_text(calibrated.findings), encoding="utf-8")
        write_notes(folder, messages_of_findings(calibrated.findings))
        (folder / REPORT).write_text(calibration_page(calibrated), encoding="utf-8")

    return write_made_model(
        calibration.model, calibrated.provenance, ModelOutput(out, tables), fill
    )


def length_rows(calibration: Calibration) -> list[dict[str, object]]:
    """Return a row for every length.

    It holds factor and metres before and after, and how far the length is known.
    """
    return [
        {
            "length": length.length.name,
            "bodies": " ".join(dict.fromkeys(body for body, _ in length.length.stretched)),
            "factor": length.factor,
            "factor_sd": length.sd,
            "generic_m": length.generic,
            "calibrated_m": length.value,
            "calibrated_sd_m": length.length.extent * length.sd,
            "joint_to_joint": length.length.along and length.length.between_joints,
            "identifiable": length.shown,
        }
        for length in calibration.lengths
    ]


def marker_rows(calibration: Calibration) -> list[dict[str, object]]:
    """Return a row for every marker.

    It holds its position, how far that is known, and its errors before and after.
    """
    return [
        {
            "marker": marker.name,
            "body": marker.body,
            **{
                f"{axis}_m": float(value)
                for axis, value in zip("xyz", marker.location, strict=True)
            },
            **{f"{axis}_sd_m": float(value) for axis, value in zip("xyz", marker.sd, strict=True)},
            "shift_m": float(np.linalg.norm(marker.shift)),
            "rms_before_m": marker.before,
            "rms_after_m": marker.after,
        }
        for marker in calibration.markers
    ]


def zero_rows(calibration: Calibration) -> list[dict[str, object]]:
    """Return a row for every angle.

    It holds its zero against the generic model's, a 90 % interval, and what fixes it.
    """
    return [
        {
            "coordinate": angle.coordinate,
            "offset_deg": float(np.degrees(angle.offset)),
            "low_deg": float(np.degrees(angle.interval[0])),
            "high_deg": float(np.degrees(angle.interval[1])),
            "sd_deg": float(np.degrees(angle.sd)),
            "fixed_by": angle.source,
            **{f"share_{name.replace(' ', '_')}": angle.shares[name] for name in SOURCES},
        }
        for angle in calibration.zero_angles
    ]


def patella_rows(found: PatellaDistance) -> list[dict[str, object]]:
    """Return a row with how much farther patellae lie than the given model's, and how sure."""
    interval = found.interval
    return [
        {
            "patellae": " ".join(found.patellae),
            "markers": " ".join(found.markers),
            "farther_mm": 1e3 * interval.value,
            "lowest_mm": 1e3 * interval.low,
            "highest_mm": 1e3 * interval.high,
            "sd_mm": 1e3 * found.sd,
            "share": found.share,
            "shown": found.shown,
        }
    ]


def summary(calibration: Calibration) -> Iterable[str]:
    """Return what was found, as lines of text."""
    yield calibration_line(calibration)
    for length in calibration.lengths:
        if length.length.along and length.length.between_joints:
            yield (
                f"  {length.length.name:<16} {1e3 * length.generic:6.1f} ->"
                f" {1e3 * length.value:6.1f} mm (factor {length.factor:.3f}, SD"
                f" {1e3 * length.length.extent * length.sd:.1f} mm)"
                + ("" if length.shown else ", not determined by the recordings")
            )
    if calibration.patella is not None:
        yield f"  {calibration.patella.sentence}"


STEP = Step(
    name="calibrate",
    scope="subject",
    title="calibration of lengths and markers",
    options=(CalibrationOptions,),
    not_settings=("mass",),
    tables="calibration",
    leaves=FrozenMap({"model": "calibrated.osim"}),
    run=_run,
    made_from=lambda subject: recordings_provenance("calibrate", subject),
)


def calibration_page(calibrated: Calibrated) -> str:
    """Lengths and markers before and after as HTML text, see `report_page`."""
    # Workers calibrate many subjects and write their pages last: until then, nothing of the report
    # is loaded.
    from myomorph.lab.report.page.parts import Note, PageHead
    from myomorph.lab.report.trial.report_input import IdentificationInput, ReportInput
    from myomorph.lab.report.trial.trial_page import report_page
    from myomorph.lab.study.trial.reporting import surfaces_of

    calibration = calibrated.found
    surfaces = surfaces_of(calibration.model)
    return report_page(
        ReportInput(
            PageHead.of(
                f"{calibration.model.name}: calibrated body",
                calibrated.provenance,
                (Note("real", f"Recordings: {', '.join(calibrated.recordings)}."),),
                (*messages_of_findings(calibrated.findings), *calibrated.warnings),
            ),
            model=calibration.model,
            surfaces=surfaces,
            identification=IdentificationInput(
                calibration.model, calibration=calibration, recordings=calibrated.recordings
            ),
        )
    )


def with_marker_set(model: Model, path: str | Path) -> Model:
    """Return the model with the markers of a file.

    They replace those of the same names, and come last.

    Parameters
    ----------
    model : with the bodies that the markers are on
    path : of an OpenSim MarkerSet (.xml)

    Returns
    -------
    the same model with other markers [m]

    Raises
    ------
    BadFile
        where the file holds no MarkerSet
    UnknownName
        where a marker is on a body that the model does not have

    Examples
    --------
    >>> from pathlib import Path
    >>> import myomorph as mm
    >>> _ = Path("set.xml").write_text(
    ...     "<OpenSimDocument Version='40000'><MarkerSet name='set'><objects><Marker name='wrist'>"
    ...     "<socket_parent_frame>/bodyset/fore</socket_parent_frame><location>0 -0.3 0</location>"
    ...     "</Marker></objects></MarkerSet></OpenSimDocument>"
    ... )
    >>> mm.with_marker_set(mm.read_model("arm.osim"), "set.xml").markers[-1].name
    'wrist'
    """
    with reading.about(path):
        new = read_marker_set(path, model)
    names = {marker.name for marker in new}
    return replace(
        model, markers=(*(marker for marker in model.markers if marker.name not in names), *new)
    )
