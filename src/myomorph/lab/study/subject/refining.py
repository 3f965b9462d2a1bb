"""Motion, body and masses at once from files: `myomorph refine` and the step of a study."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.body.refine.fit import refine
from myomorph.body.refine.options import RefineOptions
from myomorph.body.refine.refinement import ClockOffset, Errors, Refinement
from myomorph.body.refine.subject_trial import SubjectTrial
from myomorph.core.io.sto import table_from_motion, write_sto
from myomorph.core.model.causes import SETTINGS
from myomorph.core.model.errors import BadData, counted
from myomorph.core.model.findings import messages_of_findings
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.inertia import inertial_parameters
from myomorph.core.model.messages import Message, located
from myomorph.core.model.provenance import Provenance
from myomorph.core.motion.ik import InverseKinematicsOptions
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.lab.report.page.parts import Grid, Note, PageHead, Section
from myomorph.lab.report.trial.identification_tables import tissue_sheet
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.store.progress import progress
from myomorph.lab.store.results import file_name, provenance_of
from myomorph.lab.store.settings import TrialMotion, plain_settings, with_settings
from myomorph.lab.study.inputs.error_size_tables import write_error_sizes
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.motion import RecordedMotion
from myomorph.lab.study.inputs.reading import open_model
from myomorph.lab.study.inputs.refined import CLOCKS
from myomorph.lab.study.inputs.soft_tissue import SOFT_TISSUE
from myomorph.lab.study.step.folder_steps import FolderOutput
from myomorph.lab.study.step.step import Step
from myomorph.lab.study.subject.found_errors import refined_errors
from myomorph.lab.study.subject.identifying import check_mass, tissue_line
from myomorph.lab.study.subject.subject_files import SubjectInputs, recordings_provenance
from myomorph.lab.study.subject.subjects import Made, ModelOutput, write_made_model, write_rows
from myomorph.lab.study.trial.steps.ik import solve_kinematics
from myomorph.lab.study.trial.trial_inputs import Settings, TrialFiles, TrialInputs, open_trial

Rows = Sequence[Mapping[str, object]]
MOTIONS = "motions"  # Folder of refined coordinates.
# Of predictions, whose frames nothing was fitted to.
NOT_USED = {"frames": "", "frames_with_plates": ""}


def refine_files(
    model_file: Path,
    recordings: Sequence[TrialFiles],
    mass: float | None,
    options: RefineOptions,
    settings: Settings,
) -> Made[Refinement]:
    """Refine a calibrated model and its motions from files of markers and forces.

    The mass is by default the model's.
    """
    model = open_model(model_file)
    mass = check_mass(model, mass)
    trials = [open_trial(recording, settings, model) for recording in recordings]
    return refined(trials, mass, options, model_file.name)


def refined(
    trials: Sequence[TrialInputs], mass: float | None, options: RefineOptions, name: str
) -> Made[Refinement]:
    """Refine from opened trials; those without markers or forces are left out."""
    recordings = []
    warnings: list[Message] = []
    for trial in trials:
        warnings += located(trial.name, trial.warnings)
        loads = trial.get(ExternalLoads)
        if trial.recording.markers is None or loads is None:
            continue
        if trial.get(RecordedMotion) is not None:
            warnings.append(
                SETTINGS.message(
                    f"{trial.name}: refined from its markers; the motion from 'transfer' is not"
                    " used"
                )
            )
        checked = solve_kinematics(trial)
        wrenches = loads.of(checked.fit.motion)
        warnings += located(trial.name, (*messages_of_findings(checked.findings), *wrenches.notes))
        tracking = trial.options[InverseKinematicsOptions]
        recordings.append(
            SubjectTrial(
                name=trial.name, markers=checked.markers, wrenches=wrenches, tracking=tracking
            )
        )
    if not recordings:
        raise BadData(f"{name}: no trial has markers and external forces, so 'refine' has no data")
    model = trials[0].model
    pieces = 1 + (
        max(2, len(recordings))
        if options.check and (options.fits_body or options.fits_masses)
        else int(options.fits_clock)
    )
    with progress(f"{name}: refinement", pieces * options.iterations, "steps") as advance:
        refinement = refine(
            model, recordings, mass, options, default_path_lengths, lambda: advance(1)
        )
    sources = dict.fromkeys(source for trial in trials for source in trial.sources)
    made = provenance_of("refine", sources, plain_settings(options) | {"mass": mass})
    return Made(refinement, made, tuple(dict.fromkeys(warnings)))


def write_refined(refined: Made[Refinement], out: Path, tables: Path) -> tuple[str, ...]:
    """Write the model, and a folder of motions, tables and report, whole or not at all.

    What is lost in the model's file is returned.
    """
    refinement = refined.found

    def fill(folder: Path) -> None:
        motions = folder / MOTIONS
        motions.mkdir()
        for trial in refinement.trials:
            write_sto(
                table_from_motion(trial.motion, refinement.model),
                motions / f"{file_name(trial.name)}.mot",
            )
        write_rows(trial_rows(refinement), folder / "trials.csv")
        write_rows(mass_rows(refinement), folder / "masses.csv")
        write_error_sizes(folder, STEP.name, refined_errors(refinement))
        write_rows(length_rows(refinement), folder / "lengths.csv")
        if refinement.clocks:
            write_rows(clock_rows(refinement), folder / CLOCKS)
        (folder / SOFT_TISSUE).write_text(
            tissue_sheet(refinement.soft_tissue).csv(), encoding="utf-8"
        )
        from myomorph.lab.study.trial.reporting import REPORT

        (folder / REPORT).write_text(_page(refined), encoding="utf-8")

    return write_made_model(
        refinement.model, refined.provenance, ModelOutput(out, tables), fill, refinement.notes
    )


def trial_rows(refinement: Refinement) -> Rows:
    """Return a row for every trial before and after.

    A row for every prediction follows, by the model as it was and by the refined one.
    """
    rows = [
        {
            "trial": trial.name,
            "what": what,
            "frames": trial.frames,
            "frames_with_plates": trial.used,
        }
        | _numbers(errors)
        for trial in refinement.trials
        for what, errors in (("inverse kinematics", trial.before), ("refined", trial.after))
    ]
    rows += [
        {"trial": prediction.name, "what": f"predicted, {what}", **NOT_USED} | _numbers(errors)
        for prediction in refinement.predictions
        for what, errors in (
            ("given model", prediction.given),
            ("refined from the others", prediction.refined),
        )
    ]
    rows += [
        {
            "trial": prediction.name,
            "what": "predicted, body from the others' markers alone",
            **NOT_USED,
            **{"force_N": "", "moment_N_m": ""},
            "markers_mm": 1e3 * prediction.markers_alone,
        }
        for prediction in refinement.predictions
    ]
    return rows


def _numbers(errors: Errors) -> dict[str, object]:
    return {
        "markers_mm": 1e3 * errors.markers,
        "force_N": errors.force,
        "moment_N_m": errors.moment,
    }


def mass_rows(refinement: Refinement) -> Rows:
    """Return a row for every body.

    It holds the mass before and after with its standard deviation [kg], and the center of mass [m].
    """
    before = inertial_parameters(refinement.given)[:, 0]
    return [
        {
            "body": body.name,
            "given_kg": float(old),
            "refined_kg": body.mass,
            "sd_kg": float(sd),
            **{
                f"center_{axis}_m": float(value)
                for axis, value in zip("xyz", body.mass_center, strict=True)
            },
        }
        for body, old, sd in zip(refinement.model.bodies, before, refinement.mass_sd, strict=True)
    ]


def length_rows(refinement: Refinement) -> Rows:
    """Return a row for every length: its factor on the given model's and the standard deviation."""
    return [
        {"length": name, "factor": float(factor), "factor_sd": float(sd)}
        for name, factor, sd in zip(
            refinement.lengths, refinement.factors, refinement.factors_sd, strict=True
        )
    ]


def clock_rows(refinement: Refinement) -> Rows:
    """Return a row for every trial whose clock was estimated.

    It holds what is to be added to the times of its forces, with its 90 % interval [s], and whether
    the trial shows it.
    """
    return [
        {
            "trial": clock.recording,
            "offset_s": clock.offset.value,
            "low_s": clock.offset.low,
            "high_s": clock.offset.high,
            "identifiable": "yes" if clock.shown else "no",
        }
        for clock in refinement.clocks
    ]


def summary(refinement: Refinement) -> list[str]:
    """Return the lines that the command prints: errors before and after, and what was predicted."""
    weight = refinement.given.mass * float(np.linalg.norm(refinement.given.gravity))
    before = refinement.before
    after = refinement.after
    used = sum(trial.used for trial in refinement.trials)
    frames = sum(trial.frames for trial in refinement.trials)
    lines = [
        f"{counted(len(refinement.trials), 'trial')}: markers"
        f" {1e3 * before.markers:.1f} -> {1e3 * after.markers:.1f} mm, residual force"
        f" {before.force:.1f} -> {after.force:.1f} N ({100 * after.force / weight:.2g} % of body"
        f" weight), moment {before.moment:.1f} -> {after.moment:.1f} N m"
        f" ({100 * after.moment / weight:.2g} % of body weight times 1 m);"
        f" {used} of {frames} frames with plates"
    ]
    if refinement.soft_tissue is not None:
        lines.append(tissue_line(refinement.soft_tissue))
    lines += [_clock_line(clock) for clock in refinement.clocks if clock.shown]
    lines += [
        f"{prediction.name}, not used: {_errors(prediction.refined)} (given model"
        f" {_errors(prediction.given)})"
        for prediction in refinement.predictions
    ]
    return lines


def _clock_line(clock: ClockOffset) -> str:
    value = clock.offset.value
    limits = f"{1e3 * clock.offset.low:+.1f} to {1e3 * clock.offset.high:+.1f}"
    return (
        f"{clock.recording}: {1e3 * value:+.1f} ms (90 % {limits}) to be added to the times of"
        f" forces: --force-shift {value:.4f} of later commands"
    )


def _errors(errors: Errors) -> str:
    return f"{errors.force:.1f} N, {errors.moment:.1f} N m, markers {1e3 * errors.markers:.1f} mm"


def refinement_section(refinement: Refinement) -> Section:
    """Tables of errors, masses and lengths."""
    grids = []
    for title, rows in (
        ("Errors before and after", trial_rows(refinement)),
        ("Masses", mass_rows(refinement)),
        ("Lengths", length_rows(refinement)),
        ("Clocks of forces", clock_rows(refinement)),
    ):
        if not rows and title.startswith("Clocks"):
            continue
        head = tuple(rows[0]) if rows else ()
        cells = tuple(tuple(_cell(value) for value in row.values()) for row in rows)
        grids.append(
            Grid(
                head=tuple(name.replace("_", " ") for name in head),
                rows=cells,
                title=title,
                folded=title == "Lengths",
            )
        )
    return Section(
        "refinement",
        "Motion, body and masses at once",
        " ".join(summary(refinement)),
        grids=tuple(grids),
    )


def _cell(value: object) -> str:
    return f"{value:.3g}" if isinstance(value, float) else str(value)


def _page(refined: Made[Refinement]) -> str:
    from myomorph.lab.report.trial.trial_page import report_page

    refinement = refined.found
    made = refined.provenance
    trials = ", ".join(trial.name for trial in refinement.trials)
    return report_page(
        ReportInput(
            PageHead.of(
                f"{refinement.model.name}: refined body and motions",
                made,
                (Note("real", f"Recordings: {trials}."),),
                (*refinement.notes, *refined.warnings),
            ),
            model=refinement.model,
            more=(refinement_section(refinement),),
        )
    )


def _run(subject: SubjectInputs, output: FolderOutput) -> None:
    options = with_settings(RefineOptions(), subject.settings.get("refine", {}))
    result = refined(
        subject.trials(), check_mass(subject.model, subject.files.mass), options, subject.files.name
    )
    write_refined(replace(result, provenance=output.made), output.path("model"), output.tables)


def _made_from(subject: SubjectInputs) -> Provenance:
    # Which motion trials go on with changes nothing here.
    ways = plain_settings(TrialMotion())
    settings = {
        name: value
        for name, value in subject.settings.get("refine", {}).items()
        if name not in ways
    }
    subject = replace(subject, settings={**subject.settings, "refine": settings})
    return recordings_provenance("refine", subject, earlier=("ik", "id"))


STEP = Step(
    name="refine",
    scope="subject",
    title="motion, body and masses at once",
    options=(RefineOptions, TrialMotion),
    tables="refinement",
    leaves=FrozenMap(
        {
            "model": "refined.osim",
            "motions": f"refinement/{MOTIONS}",
            "soft_tissue": f"refinement/{SOFT_TISSUE}",
        }
    ),
    run=_run,
    made_from=_made_from,
)
