"""The files of one recording opened into what the steps take."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import partial
from typing import TYPE_CHECKING

from myomorph.analysis.presets import preset_of
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.model import Actuator, Model
from myomorph.model.segments import feet_of
from myomorph.motion.emg_checks import rate_against
from myomorph.motion.envelope import EnvelopeOptions
from myomorph.motion.ik import InverseKinematicsOptions
from myomorph.store.results import file_source, value_source
from myomorph.store.settings import (
    ForceOptions,
    ReportOptions,
    TensionTables,
    plain_settings,
    with_settings,
)
from myomorph.study.inputs import reading
from myomorph.study.inputs.by_type import OptionSet
from myomorph.study.inputs.emg_files import open_emg
from myomorph.study.inputs.emg_gains import read_gains, rescaled
from myomorph.study.inputs.error_sizes import read_error_sizes, tables_beside
from myomorph.study.inputs.external_forces import read_loads, recording_wrenches
from myomorph.study.inputs.torque_file import given_torques
from myomorph.study.step.step import step_head
from myomorph.study.step.step_table import REPORT, STEPS
from myomorph.study.trial.steps.ik import Poses, kinematics_options
from myomorph.study.trial.trial_files import Settings, TrialFiles, contact_sources, load_tables
from myomorph.study.trial.trial_inputs import TrialInputs, TrialNotes

if TYPE_CHECKING:
    from myomorph.contact.plan import ContactPlan
    from myomorph.tension.joint_contact import JointPoints


def open_trial(files: TrialFiles, settings: Settings, model: Model | None = None) -> TrialInputs:
    """Read the files of a recording and make of them what the steps take.

    Parameters
    ----------
    settings : of each step
    model : the model, where it was read already

    Raises
    ------
    MyomorphError
        where a file cannot be read, or does not fit the model
    """
    if files.markers is None and files.motion is not None:
        trial, poses = open_motion_trial(files, settings, model)
        return replace(trial, motion=poses.recorded)
    model = reading.open_model(files.model) if model is None else model
    trial = _common(files, settings, model)
    if files.markers is None:
        return trial
    reading.check_labels(files.labels, model)
    recorded = files.laboratory.trial(reading.read_recording(files.markers))
    recording = reading.fitted_to(model, reading.with_labels(recorded, files.labels))
    assert recording.markers is not None
    trial = replace(
        trial,
        markers=recording.markers,
        events=recording.events,
        time=reading.cut_to(files.time, recording.markers, files.markers),
        warnings=(
            *trial.warnings,
            *(f"{files.markers.name}: {text}" for text in reading.cut_warning(files.time, recording.markers)),
            *(f"{files.markers.name}: {text}" for text in recording.warnings),
            *_rate_warnings(trial, recording.markers.time),
            *_phase_warnings(files, recording.markers.time),
        ),
    )
    assumed: tuple[str, ...] = ()
    # Torques of a file hold whatever acts from outside.
    recorded_loads = files.torques is None and files.loads is None
    if recorded_loads and (files.plates or (recording.plates and feet_of(model))):
        if not files.plates:
            assumed = ("The force of each plate acts on the foot that is nearest to its center of pressure.",)
        trial = replace(
            trial,
            loads=partial(
                recording_wrenches,
                recording,
                model,
                plates=files.plates,
                options=_force_options(trial.options, trial.contacts),
            ),
        )
    trial = _with_refined(trial, files)
    notes = TrialNotes(_real(files, trial), (*files.assumed, *assumed))
    return replace(trial, notes=notes, plates=recording.plates, plate_time=recording.plate_time)


def _with_refined(trial: TrialInputs, files: TrialFiles) -> TrialInputs:
    """The trial with its refined motion, and its forces filtered as they were when the motion was refined."""
    if files.refined is None or not files.refined.is_file():
        return trial
    # Most trials start without: loaded where a trial has such input.
    from myomorph.study.inputs.refined_motion import filtered_loads, read_refined

    refined = read_refined(files.refined, files.refined_cutoff, trial.model)
    sources = (*trial.sources, file_source("refined motion", files.refined))
    loads = None if trial.loads is None else partial(filtered_loads, trial.loads, refined.cutoff)
    return replace(trial, refined=refined, loads=loads, sources=sources)


def open_motion_trial(files: TrialFiles, settings: Settings, model: Model | None = None) -> tuple[TrialInputs, Poses]:
    """The same for steps that begin with coordinates from a file; also returns these."""
    assert files.motion is not None
    if files.loads is None and (files.plates or files.bodies):
        raise BadData("bodies of forces without forces: give --loads FILE with --plates or --bodies")
    model = reading.open_model(files.model) if model is None else model
    trial = _common(files, settings, model)
    recorded, lacking = reading.whole_motion(reading.read_motion(files.motion, model), model)
    recorded, apart = reading.coupled_motion(recorded, model)
    warnings = (*trial.warnings, *_rate_warnings(trial, recorded.time))
    warnings = (*warnings, *(f"{files.motion.name}: {text}" for text in apart))
    if lacking:
        warnings = (*warnings, f"{files.motion.name}: lacks {', '.join(lacking)}: they rest at their defaults")
    time = reading.cut_to(files.time, recorded, files.motion)
    warnings = (*(f"{files.motion.name}: {text}" for text in reading.cut_warning(files.time, recorded)), *warnings)
    return replace(trial, time=time, warnings=warnings, notes=TrialNotes(_real(files, trial), files.assumed)), Poses(
        recorded
    )


def _phase_warnings(files: TrialFiles, time: Array) -> tuple[str, ...]:
    """Phases that are specified outside the recording."""
    start, stop = float(time[0]), float(time[-1])
    return tuple(
        f"phase '{name}' is specified from {first:g} to {last:g} s, the recording lasts from {start:g} to {stop:g} s"
        for name, (first, last) in files.phases.items()
        if last <= start or first >= stop
    )


def _rate_warnings(trial: TrialInputs, time: Array) -> tuple[str, ...]:
    """Whether EMG lasts so much longer or shorter than the whole motion that its rate is probably wrong."""
    text = "" if trial.emg is None else rate_against(trial.emg, time)
    return (text,) if text else ()


def _common(files: TrialFiles, settings: Settings, model: Model) -> TrialInputs:
    used = (
        ("model", files.model),
        ("markers", files.markers),
        ("motion", files.motion),
        ("loads", files.loads),
        ("torques", files.torques),
        ("emg", files.emg),
        ("tasks", files.tasks),
        ("actuators", files.actuators),
        *(("emg mvc", path) for path in files.emg_mvc),
        ("emg gains", files.emg_gains),
    )
    sources = [file_source(role, path) for role, path in used if path is not None]
    if files.loads is not None:
        sources += load_tables(files.loads, files.markers)
    if files.contacts:
        sources += contact_sources(files)
    if files.bodies or files.plates:
        sources.append(value_source("bodies", "bodies of the forces", sorted(files.bodies.items()), files.plates))
    name = files.name or (files.markers or files.motion or files.model).stem
    options = options_of(settings)
    reactions = bool(files.contact_points) or options[TensionTables].reactions != "none"
    torques, unused = given_torques(files.torques, model, files.loads, files.contacts, reactions)
    points, plan = _contact_points(files, model), contact_plan(files, model)
    if points is not None:
        sources.append(value_source("contact points", files.contact_points, points.points))
    found = None
    if files.emg is not None:
        envelope = options[EnvelopeOptions]
        found = open_emg(files.emg, model, files.emg_muscles, envelope, files.emg_mvc, files.emg_side)
        sources.append(value_source("emg", "settings of envelopes", sorted(plain_settings(envelope).items())))
    gains = None if files.emg_gains is None or found is None else read_gains(files.emg_gains)
    if gains is not None and found is not None:
        found = replace(found, emg=rescaled(found.emg, found.scale, gains.scale), scale=gains.scale)
    if files.laboratory:
        sources.append(value_source("laboratory", "axes of the laboratory", files.laboratory))
    if files.labels:
        sources.append(value_source("markers", "labels of markers", sorted(files.labels.items())))
    if files.emg_muscles or files.emg_side:
        sources.append(value_source("emg", "muscles of channels", sorted(files.emg_muscles.items()), files.emg_side))
    return TrialInputs(
        name=name,
        subject=files.subject or model.name,
        model=model,
        options=options.having(
            kinematics_options(files.tasks, options[InverseKinematicsOptions], model), *tension_parts(files, options)
        ),
        loads=None
        if files.loads is None
        else partial(
            read_loads,
            files.loads,
            model,
            bodies=files.bodies,
            trial=files.markers,
            plates=files.plates,
            laboratory=files.laboratory,
            options=_force_options(options, plan),
        ),
        torques=torques,
        emg=None if found is None else found.emg,
        emg_muscles={} if found is None else found.muscles,
        emg_maxima={} if found is None else found.maxima,
        emg_scale={} if found is None else found.scale,
        emg_gains=None if gains is None else gains.calibration,
        mass=files.mass,
        contacts=plan,
        contact_points=points,
        phases=files.phases,
        actuators=_actuators(files, model),
        error_sizes=read_error_sizes(files.error_sizes or tables_beside(files.model)),
        sources=tuple(sources),
        warnings=(
            *(f"{files.model.name}: {text}" for text in model.warnings),
            *(() if found is None else found.notes),
            *unused,
        ),
    )


def _force_options(options: OptionSet, plan: ContactPlan | None) -> ForceOptions:
    """What is done with external forces: forces that contacts share are not on one body each, and stay as they are."""
    given = options[ForceOptions]
    return replace(given, force_checks="none") if plan is not None and plan.measured == "shared" else given


def options_of(settings: Settings) -> OptionSet:
    """What a study file or a command says to the steps, as values of their options.

    Options that several steps have, as the low-pass filter, are one for all: the last step that names one counts.
    Steps to which nothing is said are not looked at, so that commands without them start faster.

    Raises
    ------
    UnknownName
        where the report is to use a preset that does not exist
    """
    result = OptionSet()
    for name in (*STEPS["trial"], REPORT):
        if settings.get(name):
            own = step_head(name).options
            result = result.having(*(with_settings(result[kind], settings[name]) for kind in own))
    if result[ReportOptions].preset:
        preset_of(result[ReportOptions].preset)
    return result


def contact_plan(files: TrialFiles, model: Model) -> ContactPlan | None:
    """What is known of contacts whose forces are to be estimated."""
    if not files.contacts:
        return None
    # Most trials start without: loaded where a trial has such input.
    from myomorph.study.inputs.contact_file import read_contacts

    return read_contacts(files.contacts, model, files.measured)


def tension_parts(files: TrialFiles, options: OptionSet) -> Iterator[object]:
    """Options of contacts and EMG, which count wherever a recording has contacts or EMG."""
    if files.contacts:
        # Most trials start without: loaded where a trial has such input.
        from myomorph.tension.terms.contacts import ContactOptions

        yield options[ContactOptions]
    if files.emg is not None:
        # As above.
        from myomorph.tension.emg_calibration import EmgOptions

        yield options[EmgOptions]


def _contact_points(files: TrialFiles, model: Model) -> JointPoints | None:
    """Points that share a joint's force, where they are asked for."""
    if not files.contact_points:
        return None
    # Most trials start without: loaded where a trial has such input.
    from myomorph.study.inputs.contact_points_file import contact_points

    return contact_points(files.contact_points, model)


def _actuators(files: TrialFiles, model: Model) -> tuple[Actuator, ...] | None:
    if files.actuators is None:
        return None
    # Most trials start without: loaded where a trial has such input.
    from myomorph.io.osim.actuators import read_actuators

    with reading.about(files.actuators):
        return read_actuators(files.actuators, model)


def _real(files: TrialFiles, trial: TrialInputs) -> tuple[str, ...]:
    """What was recorded, as a sentence for the first lines of the report."""
    parts = []
    if files.markers is not None:
        parts.append(f"markers from {files.markers.name}")
    if files.motion is not None:
        parts.append(f"coordinates from {files.motion.name}")
    if trial.refined is not None:
        parts.append("coordinates refined together with body, masses and forces")
    if trial.loads is not None:
        parts.append(f"external forces from {files.loads.name}" if files.loads else "external forces of the plates")
    if files.torques is not None:
        parts.append(f"joint torques from {files.torques.name}")
    if files.emg is not None:
        parts.append(f"EMG from {files.emg.name}")
    text = ", ".join(parts)
    return (f"{text[0].upper()}{text[1:]}.",) if parts else ()
