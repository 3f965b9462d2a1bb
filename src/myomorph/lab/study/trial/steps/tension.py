"""Muscle tensions of a trial: alone, with unmeasured contacts, and with EMG."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from myomorph.body.sensors.sensor_recording import SensorRecording
from myomorph.body.tension.task import (
    EmgRecording,
    EmgTargets,
    TensionTask,
    added_reserves,
    contact_warnings,
    evenly_spaced,
    tension_task,
)
from myomorph.core.contact.plan import ContactPlan
from myomorph.core.contact.plate_forces import PlateForces
from myomorph.core.contact.site_motion import root_places, walked
from myomorph.core.io.contact_events import write_events
from myomorph.core.io.loads import write_external_loads
from myomorph.core.io.sto import write_sto
from myomorph.core.model import contact_quantities
from myomorph.core.model.contact_quantities import IMPACT_TABLE
from myomorph.core.model.contacts import Contacts
from myomorph.core.model.findings import Finding, messages_of_findings
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.envelope import EnvelopeOptions
from myomorph.core.tension import emg_quantities, fiber_quantities, load_quantities
from myomorph.core.tension.contact_setting import ContactSetting, Measurements, during
from myomorph.core.tension.dual import INFEASIBLE, STALLED
from myomorph.core.tension.emg_quantities import CHANNEL_TABLE
from myomorph.core.tension.emg_targets import EmgOptions
from myomorph.core.tension.joint_contact import JointPoints
from myomorph.core.tension.load_quantities import (
    CONTACT_GROUP_FORCE,
    CONTACT_LOAD,
    INTERVAL_LOW,
    JOINT_FORCE_NORM,
    STATIC_LOAD_HIGH,
    STATIC_LOAD_LOW,
    STATIC_LOADS,
)
from myomorph.core.tension.quantities import (
    ACTIVATION,
    ACTUATOR_COORDINATE,
    ACTUATOR_FORCE,
    GENERALIZED_FORCE_WITH_CONTACTS,
    MUSCLE_FORCE,
    TENSION,
)
from myomorph.core.tension.recruitment import RecruitmentOptions, settled_recruitment
from myomorph.core.tension.relaxation import relaxation_messages
from myomorph.core.tension.shown_contacts import (
    open_contact_findings,
    open_contacts,
    with_alone,
)
from myomorph.core.tension.solve import ContactSolution
from myomorph.core.tension.tension import Tension, TensionOptions, contact_notes, missing_support
from myomorph.core.tension.terms.contacts import ContactOptions
from myomorph.lab.analysis.strides import Strides
from myomorph.lab.analysis.walking import walking_strides
from myomorph.lab.report.trial.report_input import EstimatedContacts, ReportInput, Situation
from myomorph.lab.report.trial.summary_lines import residual_verdict, tension_line
from myomorph.lab.store import contact_store
from myomorph.lab.store import stored as store
from myomorph.lab.store.outcome import Outcome
from myomorph.lab.store.progress import progress
from myomorph.lab.store.quantity_files import write_series
from myomorph.lab.store.results import Stored, get_findings, put_findings
from myomorph.lab.store.settings import Differentiation, EmgUse, ForceOptions, TensionTables
from myomorph.lab.store.stored_tension import get_conflicts, get_tension, put_tension
from myomorph.lab.study.inputs.actuators import Actuators
from myomorph.lab.study.inputs.emg import RecordedEmg
from myomorph.lab.study.inputs.input import ByType, OptionSet
from myomorph.lab.study.inputs.loads import ExternalLoads
from myomorph.lab.study.inputs.torques import RecordedTorques
from myomorph.lab.study.step.step import Step, StepCommand, StepOutput
from myomorph.lab.study.trial.default_filter import cutoff_of, with_bridges
from myomorph.lab.study.trial.emg_tables import write_channels, write_conflicts
from myomorph.lab.study.trial.fiber_step import fiber_numbers, fiber_signals, write_fibers
from myomorph.lab.study.trial.impact_table import write_impacts
from myomorph.lab.study.trial.joint_contact_step import (
    joint_contact_numbers,
    joint_contact_signals,
    write_joint_contacts,
)
from myomorph.lab.study.trial.joint_force import carried_tension, write_reactions
from myomorph.lab.study.trial.measured_force import put_measured
from myomorph.lab.study.trial.root_support import refuse_missing_support, with_default_contacts
from myomorph.lab.study.trial.static_load_step import write_static_loads
from myomorph.lab.study.trial.steps.id import (
    Torques,
    filter_summary,
    put_dynamics,
    solve_dynamics,
)
from myomorph.lab.study.trial.steps.ik import Poses
from myomorph.lab.study.trial.trial_inputs import (
    JoinedParts,
    Signals,
    TrialInputs,
    Value,
    statistics_of,
    tidy_signals,
)
from myomorph.lab.study.trial.unmeasured_limbs import without_unmeasured_limbs

if TYPE_CHECKING:
    from myomorph.lab.study.trial.trial_strides import TrialStrides

CONTACTS = "contacts.csv"
FINDINGS = "tension_findings"


@dataclass(frozen=True, eq=False)
class Tensions:
    """Muscle tensions of a motion.

    Attributes
    ----------
    tension : the solution
    contacts : contact intervals by site, where contact forces were estimated
    loads : every external force, those of estimated contacts included
    carried : the generalized forces under all of them
    notes : one line each
    findings : where contacts cannot carry the body
    residuals : how far measured forces leave the root, "" where inverse dynamics has reported it
    """

    tension: Tension
    contacts: Contacts | None = None
    loads: Wrenches | None = None
    carried: Series | None = None
    notes: tuple[Message, ...] = ()
    findings: tuple[Finding, ...] = ()
    residuals: str = ""


def _run(trial: TrialInputs, output: StepOutput, poses: Poses, torques: Torques | None) -> Tensions:
    """Solve for muscle tensions, and for contact forces where they are requested.

    What was found is written.
    """
    dynamics = torques or _solved_dynamics(trial, poses, output)
    supported = with_default_contacts(trial, dynamics.motion, dynamics.wrenches)
    trial = supported.trial
    task = task_of(trial, poses.recorded, dynamics)
    with progress(f"{trial.name}: muscle tensions", len(task.motion)) as advance:
        tension, solution = task.solved(advance)
    tension = without_unmeasured_limbs(
        tension, trial.model, _where_nothing_is_estimated(task, dynamics.wrenches), _driven(task)
    )
    notes = supported.notes + task.notes(tension) + (() if torques is not None else dynamics.notes)
    _write_tension(tension, task, output)
    points = trial.get(JointPoints)
    strides = (
        strides_of_trial(trial, poses, dynamics) if tension.fibers is not None or points else None
    )
    notes += write_fibers(tension, trial.model, strides, output)
    if task.emg is not None:
        notes = _write_emg(trial, tension, task.emg, output) + notes
    notes += _write_joint_loads(trial, tension, task, strides, output)
    if task.setting is not None and trial.get(ContactPlan) is not None:
        found = Tensions(tension, contacts=task.setting.contacts, notes=notes)
        return _with_contacts(found, trial, task, solution, output)
    residuals = _residual_verdict(trial, dynamics) if torques is None else ""
    return Tensions(tension, notes=notes, residuals=residuals)


def _where_nothing_is_estimated(task: TensionTask, wrenches: Wrenches | None) -> Wrenches | None:
    """Return known forces with findings on loads that no contact's estimate takes the place of."""
    if task.setting is None or wrenches is None:
        return wrenches
    return (
        task.setting.supports.without_estimated(wrenches) if task.setting.supports.alone else None
    )


def _write_joint_loads(
    trial: TrialInputs,
    tension: Tension,
    task: TensionTask,
    strides: Strides | None,
    output: StepOutput,
) -> tuple[Message, ...]:
    """Write what joints carry, as far as it is asked for, and what statics allow of it."""
    frame = trial.options[TensionTables].reactions
    points = trial.get(JointPoints)
    if frame == "none" and points is None:
        return ()
    carried = tension
    notes: tuple[Message, ...] = ()
    if task.setting is not None:
        # Forces under feet that plates measured stay what they are, whatever holds the root.
        estimated = task.setting.supports.during(tension.time)
        carried, notes = carried_tension(tension, trial.model, estimated)
    reactions, forces = task.joint_loads(carried, frame, points)
    if reactions is not None:
        write_reactions(reactions, trial.model, output)
    if forces is not None and points is not None:
        notes += write_joint_contacts(forces, points, strides, output)
    statics = task.static_loads(tension)
    if statics is None:
        return notes
    known = np.asarray(np.isfinite(carried.muscle_force).any(axis=1))
    return notes + write_static_loads(statics.only(known), forces, output)


def _solved_dynamics(trial: TrialInputs, poses: Poses, output: StepOutput) -> Torques:
    """Solve inverse dynamics where that was no step of its own, and store what it gives."""
    dynamics = solve_dynamics(trial, poses.recorded)
    put_dynamics(output, dynamics, trial.model)
    put_measured(trial, poses.recorded, output)
    return dynamics


def _write_emg(
    trial: TrialInputs, tension: Tension, emg: EmgTargets, output: StepOutput
) -> tuple[Message, ...]:
    """Write gains of channels and where tensions contradict EMG; return what there is to say."""
    if emg.calibration is not None:
        measured = trial.inputs[RecordedEmg].muscles
        write_channels(emg.calibration, measured, output.folder / CHANNEL_TABLE)
    return (*write_conflicts(trial.model, tension, emg, output), *emg.notes)


def _with_contacts(
    found: Tensions,
    trial: TrialInputs,
    task: TensionTask,
    solution: ContactSolution | None,
    output: StepOutput,
) -> Tensions:
    """Write contact forces, and find where contacts cannot carry the body.

    Parameters
    ----------
    found : tensions, contacts and notes so far
    task : with contacts
    solution : problem that contact forces come from, None where it cannot be asked
    """
    assert task.setting is not None
    tension = found.tension
    situation = trial.inputs[ContactPlan].situation
    loads, carried = _write_contacts(task, tension, situation, output)
    refuse_missing_support(trial, task.motion, loads)
    notes = found.notes + task.setting.notes
    infeasible: tuple[Message, ...] = ()
    unknown: tuple[Finding, ...] = ()
    if solution is not None:
        infeasible, unknown = _write_warnings(trial, task.setting, solution, output)
        # Where the tensions have passive force too, their own notes say it.
        notes = (*(() if tension.options.has_passive else contact_notes(solution.tension)), *notes)
    estimated = task.setting.supports.during(tension.time)
    findings = missing_support(tension, trial.model.weight, infeasible, estimated)
    notes += () if findings else infeasible
    findings += unknown
    put_findings(output.writer, FINDINGS, findings)
    return replace(found, loads=loads, carried=carried, notes=notes, findings=findings)


def _residual_verdict(trial: TrialInputs, torques: Torques) -> str:
    """Judge what measured forces leave at the root; "" where nothing was measured."""
    if torques.wrenches is None:
        return ""
    return residual_verdict(trial.model, torques.motion, torques.torques, torques.wrenches)


def strides_of_trial(trial: TrialInputs, poses: Poses, torques: Torques | None) -> Strides | None:
    """Return strides as the report and the tables of values have them.

    They are found by plates, else events, else the motion.
    """
    wrenches = None if torques is None else torques.wrenches
    events = trial.recording.events
    return walking_strides(trial.model, poses.recorded, poses.fit, wrenches=wrenches, events=events)


def task_of(trial: TrialInputs, recorded: Motion, torques: Torques) -> TensionTask:
    """Return the tension problem of a trial.

    It is of coordinates as recorded and the torques that belong to them.
    """
    options = trial.options
    tension = trial.options[TensionOptions]
    actuators = trial.get(Actuators)
    cutoff = None
    standing = None
    if trial.get(ContactPlan) is not None:
        cutoff = cutoff_of(trial, recorded)
        if (
            trial.get(SensorRecording) is not None
            and trial.recording.markers is None
            and root_places(trial.model)
        ):
            # Errors of angles lift feet that accelerations do not hold down.
            standing = walked(trial.model, torques.motion)
    return tension_task(
        trial.model,
        torques.motion,
        torques.torques,
        tension,
        # Those of a file take the place of reserves.
        (
            added_reserves(trial.model, tension, _objects(trial))
            if actuators is None
            else actuators.actuators
        ),
        Measurements(
            recorded=with_bridges(recorded, torques.motion),
            wrenches=_wrenches(trial, torques),
            plates=_plates(trial, recorded, torques),
            cutoff=cutoff,
            standing=standing,
        ),
        trial.get(ContactPlan),
        options[ContactOptions],
        _emg_that_takes_part(trial),
        recruitment_of(trial),
    )


def _wrenches(trial: TrialInputs, torques: Torques) -> Wrenches | None:
    """Return external forces.

    Where contacts share them, the foot that each was put on by its nearness says nothing.
    """
    plan = trial.get(ContactPlan)
    loads = trial.get(ExternalLoads)
    wrenches = torques.wrenches
    if (
        wrenches is None
        or plan is None
        or loads is None
        or plan.measured != "shared"
        or not loads.nearest
    ):
        return wrenches
    return replace(wrenches, bodies=("",) * len(wrenches.bodies))


def _plates(trial: TrialInputs, recorded: Motion, torques: Torques) -> PlateForces | None:
    """Return what plates measured of the feet on them, filtered like the motion.

    It is None where contacts do not use it.
    """
    plan = trial.get(ContactPlan)
    loads = trial.get(ExternalLoads)
    if plan is None or plan.measured == "exact" or loads is None or torques.wrenches is None:
        return None
    measured = loads.as_measured(recorded)
    return measured.at(torques.motion.time, cutoff_of(trial, recorded))


def recruitment_of(trial: TrialInputs) -> RecruitmentOptions:
    """Costs beside the effort; loads of joints need the forces on the body."""
    external = trial.get(RecordedTorques) is None
    return settled_recruitment(
        trial.options[RecruitmentOptions], trial.model, trial.options[TensionOptions], external
    )


def _emg_that_takes_part(trial: TrialInputs) -> EmgRecording | None:
    """EMG that was given to take part in the tensions, rather than to be shown."""
    chosen = trial.options.get(EmgOptions)
    recorded = trial.get(RecordedEmg)
    if recorded is None or chosen is None or trial.options[EmgUse].emg_display_only:
        return None
    return EmgRecording(
        emg=recorded.emg,
        muscles=recorded.muscles,
        maxima=recorded.maxima,
        options=chosen,
        calibration=recorded.gains,
    )


def _objects(trial: TrialInputs) -> set[str]:
    """Bodies of the objects of a recording that joins several models."""
    parts = trial.get(JoinedParts)
    models = {} if parts is None else parts.models
    return {f"{name}_{name}" for name, part in models.items() if isinstance(part, dict)}


def _driven(task: TensionTask) -> dict[str, str]:
    """Actuators to the coordinates that they drive, "" where they drive none."""
    return {
        actuator.name: actuator.coordinate for actuator in (*task.model.actuators, *task.actuators)
    }


def _write_tension(tension: Tension, task: TensionTask, output: StepOutput) -> None:
    driven = _driven(task)
    put_tension(
        output.writer, tension, tuple(driven.get(name, "") for name in tension.reserve_names)
    )
    columns = (
        (ACTIVATION, tension.muscles),
        (MUSCLE_FORCE, tension.muscles),
        (ACTUATOR_FORCE, tension.reserve_names),
    )
    for quantity, names in columns:
        series = Series(tension.time, names, quantity.of(tension), quantity=quantity)
        write_series(output.folder, series)


def _write_contacts(
    task: TensionTask, tension: Tension, situation: Situation, output: StepOutput
) -> tuple[Wrenches, Series]:
    """Write contact forces as external loads, and intervals as a table.

    All loads are returned, and the torques that they leave.
    """
    assert task.setting is not None
    writer = output.writer
    folder = output.folder
    contacts = task.setting.contacts
    start = float(task.motion.time[0])
    stop = float(task.motion.time[-1])
    loads, carried = task.loads(tension)
    contact_store.put_contact_forces(writer, task.contact_forces(tension))
    contact_store.put_contacts(writer, contacts, situation)
    contact_store.put_plate_forces(writer, task.setting.plates)
    if task.setting.heard is not None:
        contact_store.put_impacts(writer, task.setting.heard.impacts)
        write_impacts(task.setting.heard.impacts, folder / IMPACT_TABLE)
    contact_store.put_forces_with_contacts(writer, carried)
    write_external_loads(loads, folder / CONTACT_LOAD.file, folder / f"{CONTACT_LOAD.stem}.xml")
    write_sto(task.contact_groups(tension), folder / CONTACT_GROUP_FORCE.file)
    carried_quantity = replace(carried, quantity=GENERALIZED_FORCE_WITH_CONTACTS)
    write_series(folder, carried_quantity, task.model)
    write_events(during(contacts, start, stop), folder / CONTACTS)
    return loads, carried


def _write_warnings(
    trial: TrialInputs, setting: ContactSetting, solution: ContactSolution, output: StepOutput
) -> tuple[tuple[Message, ...], tuple[Finding, ...]]:
    """Write what is unresolved and what contacts cannot carry, as files.

    The latter is returned, and of which contacts nothing is known.
    """
    estimated = np.flatnonzero(setting.supports.during(solution.tension.time))
    places = evenly_spaced(trial.options[TensionTables].intervals, len(estimated))
    frames = estimated[places].tolist()
    with progress(f"{trial.name}: intervals of contact forces", len(frames)) as advance:
        warnings = contact_warnings(solution, frames, advance)
    model = trial.model
    if warnings.intervals is not None:
        known = with_alone(warnings.intervals, setting.alone, np.asarray(model.up))
        warnings = replace(warnings, intervals=known)
    inside = set(estimated.tolist())
    infeasible = tuple(found for found in warnings.infeasible if found.frame in inside)
    contact_store.put_warnings(output.writer, warnings.intervals, infeasible)
    weight = model.mass * float(np.linalg.norm(model.gravity))
    unknown: tuple[Finding, ...] = ()
    if warnings.intervals is not None:
        write_sto(warnings.table(), output.folder / INTERVAL_LOW.file)
        assert solution.tension.contacts is not None
        sites = solution.tension.contacts.sites
        unknown = open_contact_findings(open_contacts(warnings.intervals, sites, weight))
    return relaxation_messages(infeasible, len(solution.tension), weight), unknown


def _read(stored: Stored, options: OptionSet) -> Tensions | None:
    tension = get_tension(stored, options[TensionOptions])
    if tension is None:
        return None
    carried = contact_store.get_forces_with_contacts(stored)
    return Tensions(tension, carried=carried, findings=get_findings(stored, FINDINGS))


def _without_contacts(trial: TrialInputs) -> bool:
    """Tell whether no contact force can be asked for, not even by default."""
    return trial.get(ContactPlan) is None and trial.get(ExternalLoads) is None


def _hashed(trial: TrialInputs) -> Sequence[object]:
    """Return options of contacts and EMG where a trial has them.

    Those of EMG envelopes are among the sources.
    """
    options = trial.options
    chosen = (
        options.get(TensionOptions),
        options[RecruitmentOptions],
        None if _without_contacts(trial) else options.get(ContactOptions),
        None if trial.get(RecordedEmg) is None else options.get(EmgOptions),
    )
    return (
        *(options_of_step for options_of_step in chosen if options_of_step is not None),
        options[EmgUse],
        options[TensionTables],
    )


def _show(report_input: ReportInput, stored: Stored) -> ReportInput:
    tension = get_tension(stored, TensionOptions())
    forces = contact_store.get_contact_forces(stored)
    carried = contact_store.get_forces_with_contacts(stored)
    dynamics = replace(
        report_input.dynamics,
        torques=report_input.dynamics.torques if carried is None else carried,
        joint_force=store.get_series(stored, JOINT_FORCE_NORM),
    )
    report_input = replace(report_input, dynamics=dynamics)
    contacts = EstimatedContacts(
        touches=contact_store.get_contacts(stored),
        forces=forces,
        intervals=contact_store.get_intervals(stored),
        residuals=None if forces is None else _residuals(tension),
        infeasible=contact_store.get_infeasible_contacts(stored),
        situation=contact_store.get_situation(stored),
        on_plates=contact_store.get_plate_forces(stored),
        impacts=contact_store.get_impacts(stored),
    )
    return replace(
        report_input.with_warnings(messages_of_findings(get_findings(stored, FINDINGS))),
        contacts=contacts,
        tension=tension,
        reserve_coordinates=stored.names.get("actuator_coordinate", ()),
        joint_contacts=contact_store.get_joint_contacts(stored),
        static_loads=_static_loads(stored),
        emg_conflicts=get_conflicts(stored),
    )


def _static_loads(stored: Stored) -> tuple[Series, Series] | None:
    """Least and greatest forces of joints by statics, None where they were not asked for."""
    low = store.get_series(stored, STATIC_LOAD_LOW)
    high = store.get_series(stored, STATIC_LOAD_HIGH)
    return None if low is None or high is None else (low, high)


def _residuals(tension: Tension | None) -> Series | None:
    """Return forces and torques that hold a floating root (frames, residuals).

    Those of the contacts are not among them.
    """
    if tension is None or not tension.residual_names:
        return None
    columns = [tension.reserve_names.index(name) for name in tension.residual_names]
    return Series(tension.time, tension.residual_names, tension.actuator_force[:, columns])


def _signals(stored: Stored, model: Model, mass: float) -> Sequence[Signals]:
    columns = (ACTIVATION, MUSCLE_FORCE, JOINT_FORCE_NORM, *STATIC_LOADS)
    found = [store.get_series(stored, quantity) for quantity in columns]
    loads = tuple(tidy_signals("tension", series, model) for series in found if series is not None)
    return *loads, *fiber_signals(stored, model), *joint_contact_signals(stored, model)


def _numbers(stored: Stored, model: Model, strides: TrialStrides | None) -> Iterator[Value]:
    """Yield frames without an optimum, the largest reserve of each coordinate, and loads.

    Loads are those of contact points.
    """
    if "tension_status" not in stored.values:
        return
    failed = np.isin(stored.values["tension_status"], (INFEASIBLE, STALLED))
    yield Value(step="tension", quantity="frames not optimal", value=float(failed.sum()), unit="1")
    yield from fiber_numbers(stored)
    yield from joint_contact_numbers(stored, strides)
    forces = stored.values.get("actuator_force")
    if forces is None or not forces.size:
        return
    largest = statistics_of(np.abs(forces))["maximum"]
    for index, name in enumerate(stored.names.get("actuator_coordinate", ())):
        if name in model.coordinate_names:
            unit = "N m" if model.coordinate(name).motion == "rotational" else "N"
            yield Value(
                step="tension",
                quantity=f"{name}_reserve, largest",
                value=float(largest[index]),
                unit=unit,
            )


def _outcome(outcome: Outcome, tensions: Tensions) -> Outcome:
    """Where contacts cannot carry the body."""
    return replace(outcome, findings=(*outcome.findings, *messages_of_findings(tensions.findings)))


def _line(trial: TrialInputs, results: ByType) -> str:
    """Frames that are optimal, reserves, what forces leave at the root, and the filter."""
    found = results[Tensions]
    line = tension_line(trial.model, found.tension)
    if found.residuals:
        line += f"; residuals are {found.residuals}"
    return line + filter_summary(trial, results[Poses].recorded)


STEP = Step(
    name="tension",
    title="muscle tensions",
    gives=Tensions,
    quantities=(
        *(*TENSION, ACTUATOR_COORDINATE, GENERALIZED_FORCE_WITH_CONTACTS),
        *(*fiber_quantities.QUANTITIES, *load_quantities.QUANTITIES, *emg_quantities.QUANTITIES),
        *contact_quantities.QUANTITIES,
    ),
    needs=(Poses,),
    uses=(Torques,),
    options=(
        *(
            Differentiation,
            ForceOptions,
            TensionOptions,
            RecruitmentOptions,
            ContactOptions,
            EmgOptions,
        ),
        *(EnvelopeOptions, EmgUse, TensionTables),
    ),
    inputs=(
        "loads",
        "laboratory",
        "torques",
        "emg",
        "contacts",
        "contact points",
        "actuators",
        "soft tissue",
        "time",
    ),
    hashed=_hashed,
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
    numbers=_numbers,
    numbers_last=True,
    outcome=_outcome,
    outcome_variables=(
        *(
            "time",
            "muscle",
            "activation",
            "muscle_force",
            "balanced_coordinate",
            "balanced_torque",
            "tension_status",
        ),
        *(
            "equilibrium_residual",
            "tension_iterations",
            "activation_lower",
            "activation_upper",
            "muscle_overstretched",
        ),
    ),
    command=StepCommand(_line, draws=True),
)
