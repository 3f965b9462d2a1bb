"""Muscle tensions of a trial: alone, with contacts that nobody measured, and with EMG."""

from __future__ import annotations

from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from typing import TYPE_CHECKING

import numpy as np

from myomorph.io.contact_events import write_events
from myomorph.io.loads import write_external_loads
from myomorph.io.sto import write_sto
from myomorph.model.contacts import Contacts
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series, Table, Wrenches
from myomorph.motion.envelope import EnvelopeOptions
from myomorph.report.trial.given import EstimatedContacts, ReportInput, ShownTension
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.frames import over_frames
from myomorph.store import contact_store
from myomorph.store import stored as store
from myomorph.store.joint_contact_store import get_joint_contacts
from myomorph.store.progress import progress
from myomorph.store.results import Stored
from myomorph.store.settings import Differentiation, EmgUse, ForceOptions, TensionTables
from myomorph.study.trial.contact_step import ContactSetting, Measurements, all_loads, during, set_contacts
from myomorph.study.trial.contact_warnings import (
    contact_warnings,
    get_infeasible_contacts,
    get_intervals,
    interval_table,
    put_warnings,
)
from myomorph.study.trial.emg_tables import EMG_TABLE, EmgTargets, write_calibration, write_conflicts
from myomorph.study.trial.fiber_step import fiber_numbers, fiber_signals, write_fibers
from myomorph.study.trial.joint_contact_step import (
    joint_contact_numbers,
    joint_contact_signals,
    solve_joint_contacts,
)
from myomorph.study.trial.step import Step, StepOutput
from myomorph.study.trial.steps.id import Torques, cutoff_of, put_dynamics, solve_dynamics, torque_table
from myomorph.study.trial.steps.ik import Poses
from myomorph.study.trial.trial_inputs import OptionSet, Signals, TrialInputs, Value, all_drawn, statistics_of
from myomorph.tension.emg_calibration import EmgOptions, EmgTrial, calibrate_emg, emg_targets
from myomorph.tension.passive_share import LARGE, passive_notes
from myomorph.tension.problem import TensionProblem, tension_problem
from myomorph.tension.reaction import joint_reactions
from myomorph.tension.solve import Tension, TensionOptions, solve_tension
from myomorph.tension.terms.actuators import default_reserves
from myomorph.tension.terms.contacts import ContactOptions, ContactTask

if TYPE_CHECKING:
    from myomorph.study.trial.trial_strides import TrialStrides

OBJECT_RESIDUAL = 0.01
"""Optimal force of what holds an object beside its contacts, as a share of that of a body's residuals."""

CONTACT_FORCES, CONTACTS, ALL_TORQUES = "contact_forces", "contacts.csv", "torques_with_contacts.sto"


@dataclass(frozen=True, eq=False)
class Tensions:
    """Muscle tensions of a motion.

    Attributes
    ----------
    contacts : which site touches what, where contact forces were estimated
    loads : every external force, those of estimated contacts included
    carried : generalized forces of the motion under all of them
    """

    tension: Tension
    contacts: Contacts | None = None
    loads: Wrenches | None = None
    carried: Series | None = None
    notes: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class TensionTask:
    """The tension problem of a recording.

    Attributes
    ----------
    torques : of those external forces alone that are known exactly
    actuators : beside the model's own
    setting : contacts, where their forces are asked for
    emg : what EMG tells, where it takes part
    """

    model: Model
    motion: Motion
    torques: Series
    options: TensionOptions
    actuators: tuple[Actuator, ...]
    setting: ContactSetting | None
    emg: EmgTargets | None

    def solved(self, advance: Callable[[int], None]) -> tuple[Tension, TensionProblem | None]:
        """The tensions; the solved problem too where it can be asked what it leaves open of contact forces."""
        contacts = None if self.setting is None else self.setting.task
        emg = None if self.emg is None else self.emg.target
        told = (self.model, self.motion, self.torques, self.options, self.actuators)
        elastic = self.options.tendons == "elastic"
        # What contacts leave open is asked of the power criterion alone.
        closed = elastic or self.options.recruitment == "minmax"
        if contacts is None or contacts.options.formulation == "sequential" or closed:
            return solve_tension(*told, advance, contacts=contacts, emg=emg), None
        problem, names = tension_problem(*told, contacts=contacts, emg=emg)
        over_frames(problem.solve, len(self.motion), advance, problem.window)
        return problem.result(names), problem


def _run(trial: TrialInputs, output: StepOutput, poses: Poses, torques: Torques | None) -> Tensions:
    """Solve for muscle tensions, and for contact forces where they are asked for; write what was found."""
    notes: tuple[str, ...] = ()
    if torques is None:
        torques = solve_dynamics(trial, poses.recorded)
        notes = torques.notes
        put_dynamics(output, torques, trial.model)
    task = _task(trial, poses, torques)
    with progress(f"{trial.name}: muscle tensions", len(task.motion)) as advance:
        tension, problem = task.solved(advance)
    notes = (*passive_notes(tension), *notes)
    if task.setting is not None and tension.options.recruitment == "minmax":
        notes += ("recruitment minmax: no intervals of the contact forces, and no list of contacts that cannot carry",)
    _write_tension(trial, tension, task.actuators, output)
    notes += write_fibers(tension, trial.model, task.motion, output)
    if task.emg is not None:
        write_calibration(task.emg, trial.emg_muscles, output.folder / EMG_TABLE)
        notes = (*write_conflicts(trial.model, tension, task.emg.target, output), *task.emg.notes, *notes)
    known = torques.wrenches if task.setting is None else task.setting.exact
    frame = trial.options[TensionTables].reactions
    if frame != "none":
        reactions = joint_reactions(trial.model, task.motion, tension, known, frame=frame, actuators=task.actuators)
        write_sto(reactions.table(), output.folder / "joint_reactions.sto")
    if trial.contact_points is not None:
        told = (tension, known, trial.contact_points, task.actuators, output)
        notes += solve_joint_contacts(trial.model, task.motion, *told)
    if task.setting is None:
        return Tensions(tension, notes=notes)
    loads, carried = _write_contacts(trial, task.motion, tension, task.setting, output)
    notes += task.setting.notes
    if problem is not None:
        notes += _write_warnings(trial, problem, tension, output)
    return Tensions(tension, task.setting.contacts, loads, carried, notes)


def _task(trial: TrialInputs, poses: Poses, found: Torques) -> TensionTask:
    options = trial.options[TensionOptions]
    actuators, motion, torques, setting = added_actuators(trial, options), found.motion, found.torques, None
    if trial.contacts is not None:
        cutoff = cutoff_of(trial, poses.recorded)
        known = Measurements(poses.recorded, found.wrenches, trial.plates, trial.plate_time, cutoff)
        setting = set_contacts(trial.contacts, trial.model, motion, known, trial.options[ContactOptions])
        if setting.exact is not found.wrenches:
            torques = inverse_dynamics(trial.model, motion, setting.exact)
    emg = None
    if emg_takes_part(trial):
        emg = emg_targets_of(trial, motion, torques, options, actuators, None if setting is None else setting.task)
    return TensionTask(trial.model, motion, torques, options, actuators, setting, emg)


def emg_takes_part(trial: TrialInputs) -> bool:
    """Whether EMG was given to take part in the tensions, rather than to be shown."""
    options = trial.options
    return trial.emg is not None and options.get(EmgOptions) is not None and not options[EmgUse].emg_display_only


def emg_targets_of(
    trial: TrialInputs,
    motion: Motion,
    torques: Series,
    options: TensionOptions,
    actuators: Sequence[Actuator],
    contacts: ContactTask | None,
) -> EmgTargets:
    """Targets of activations, with delay and gains that this recording tells (see `calibrate_emg`).

    Parameters
    ----------
    torques, options, actuators, contacts : as for the tensions that EMG is to take part in
    """
    assert trial.emg is not None
    chosen = trial.options[EmgOptions]
    if not trial.emg_muscles:
        names = ", ".join(trial.emg.names)
        note = f"EMG takes no part: no channel's name tells a muscle of the model; name them in emg_muscles ({names})"
        return EmgTargets(None, None, (note,))
    recorded = EmgTrial(motion, torques, trial.emg, contacts)
    maxima = {name: one for name, one in trial.emg_maxima.items() if name in trial.emg_muscles}
    calibration = calibrate_emg(trial.model, [recorded], trial.emg_muscles, chosen, options, actuators, maxima)
    target = emg_targets(trial.emg, trial.emg_muscles, trial.model, motion.time, chosen, calibration)
    return EmgTargets(target, calibration, calibration.warnings)


def added_actuators(trial: TrialInputs, options: TensionOptions) -> tuple[Actuator, ...]:
    """Actuators beside the model's own: those of a file, or a weak reserve for every free coordinate.

    What holds an object is weaker still: nothing but its contacts does.
    """
    if trial.actuators is not None:
        return trial.actuators
    objects = {f"{name}_{name}" for name, told in trial.parts.items() if isinstance(told, dict)}
    return tuple(
        replace(one, optimal_force=OBJECT_RESIDUAL * one.optimal_force) if one.body in objects else one
        for one in default_reserves(trial.model, options.reserve, options.residual)
    )


def _write_tension(trial: TrialInputs, tension: Tension, added: tuple[Actuator, ...], output: StepOutput) -> None:
    by_name = {one.name: one.coordinate for one in (*trial.model.actuators, *added)}
    store.put_tension(output.writer, tension, tuple(by_name.get(name, "") for name in tension.reserve_names))
    tables = (
        ("activations", tension.muscles, tension.activations),
        ("forces", tension.muscles, tension.forces),
        ("reserves", tension.reserve_names, tension.reserves),
    )
    for name, columns, values in tables:
        facts = FrozenMap({"name": f"Muscle tensions: {name}"})
        write_sto(Table(tension.time, columns, values, facts=facts), output.folder / f"{name}.sto")


def _write_contacts(
    trial: TrialInputs, motion: Motion, tension: Tension, setting: ContactSetting, output: StepOutput
) -> tuple[Wrenches, Series]:
    """Contact forces as external loads, touches as a table; returns all loads, and the torques that they leave."""
    assert trial.contacts is not None
    assert tension.contacts is not None
    writer, folder = output.writer, output.folder
    loads = all_loads(setting.exact, tension.contacts)
    torques = inverse_dynamics(trial.model, motion, loads)
    contact_store.put_contact_forces(writer, tension.contacts)
    contact_store.put_contacts(writer, setting.contacts, trial.contacts.situation)
    contact_store.put_forces_with_contacts(writer, torques)
    write_external_loads(loads, folder / f"{CONTACT_FORCES}.sto", folder / f"{CONTACT_FORCES}.xml")
    write_sto(torque_table(torques, trial.model), folder / ALL_TORQUES)
    write_events(during(setting.contacts, float(motion.time[0]), float(motion.time[-1])), folder / CONTACTS)
    return loads, torques


def _write_warnings(
    trial: TrialInputs, problem: TensionProblem, tension: Tension, output: StepOutput
) -> tuple[str, ...]:
    """What is left open and what contacts cannot carry, as files; returns the latter, one line a stretch of time."""
    warnings = contact_warnings(problem, tension, trial.options[TensionTables].intervals, trial.name)
    put_warnings(output.writer, warnings)
    if warnings.intervals:
        write_sto(interval_table(warnings.intervals), output.folder / "contact_intervals.sto")
    return warnings.lines


def _read(stored: Stored, options: OptionSet) -> Tensions | None:
    tension = store.get_tension(stored, options[TensionOptions])
    return None if tension is None else Tensions(tension, carried=contact_store.get_forces_with_contacts(stored))


def _hashed(trial: TrialInputs) -> Sequence[object]:
    """Options of contacts and EMG count where a trial has them; those of EMG envelopes are among the sources."""
    options = trial.options
    told = (
        options.get(TensionOptions),
        None if trial.contacts is None else options.get(ContactOptions),
        None if trial.emg is None else options.get(EmgOptions),
    )
    return *(one for one in told if one is not None), options[EmgUse], options[TensionTables]


def _show(given: ReportInput, stored: Stored) -> ReportInput:
    tension, forces = store.get_tension(stored, TensionOptions()), contact_store.get_contact_forces(stored)
    carried = contact_store.get_forces_with_contacts(stored)
    if carried is not None:
        given = replace(given, dynamics=replace(given.dynamics, torques=carried))
    contacts = EstimatedContacts(
        contact_store.get_contacts(stored),
        forces,
        get_intervals(stored),
        None if forces is None else _residuals(tension),
        get_infeasible_contacts(stored),
        contact_store.get_situation(stored),
    )
    shown = None
    if tension is not None:
        shown = ShownTension(
            tension.time,
            tension.muscles,
            tension.activations,
            tension.forces,
            tension.reserves,
            stored.names.get("actuator_coordinate", ()),
            tension.optimal,
            tension.overstretched,
            _large_shares(tension) if "muscle_passive_share" in stored.values else None,
            tension.fibers,
        )
    return replace(given, contacts=contacts, tension=shown, joint_contacts=get_joint_contacts(stored))


def _large_shares(tension: Tension) -> tuple[tuple[str, float, float], ...]:
    """Muscles with much passive force: name, share of the maximum isometric force, time [s], from the largest on."""
    order = [i for i in np.argsort(-tension.passive_share) if tension.passive_share[i] > LARGE]
    return tuple((tension.muscles[i], float(tension.passive_share[i]), float(tension.passive_time[i])) for i in order)


def _residuals(tension: Tension | None) -> Series | None:
    """Forces and torques that hold a floating root, as far as they are not the contacts' (frames, residuals)."""
    if tension is None or not tension.residual_names:
        return None
    columns = [tension.reserve_names.index(name) for name in tension.residual_names]
    return Series(tension.time, tension.residual_names, tension.reserves[:, columns])


def _signals(stored: Stored, model: Model, mass: float) -> Sequence[Signals]:
    statistics = ("maximum", "mean")
    own = tuple(
        all_drawn(
            "tension", Series(stored.time, stored.names["muscle"], stored.values[name]), ending, unit, statistics, curve
        )
        for name, ending, unit, curve in (
            ("activation", "_activation", "1", "muscle activation"),
            ("muscle_force", "_force", "N", "muscle force [N]"),
        )
        if name in stored.values
    )
    return *own, *fiber_signals(stored, model), *joint_contact_signals(stored)


def _numbers(stored: Stored, model: Model, strides: TrialStrides | None) -> Iterator[Value]:
    """Frames without an optimum, the largest reserve of each coordinate, and loads of contact points."""
    if "tension_status" not in stored.values:
        return
    yield Value("tension", "frames not optimal", float((stored.values["tension_status"] != 0).sum()), "1")
    yield from fiber_numbers(stored)
    yield from joint_contact_numbers(stored, strides)
    forces = stored.values.get("actuator_force")
    if forces is None or not forces.size:
        return
    largest = statistics_of(np.abs(forces))["maximum"]
    for k, name in enumerate(stored.names.get("actuator_coordinate", ())):
        if name in model.coordinate_names:
            unit = "N m" if model.coordinate(name).motion == "rotational" else "N"
            yield Value("tension", f"{name}_reserve, largest", float(largest[k]), unit)


STEP = Step(
    name="tension",
    title="muscle tensions",
    gives=Tensions,
    needs=(Poses,),
    uses=(Torques,),
    options=(
        *(Differentiation, ForceOptions, TensionOptions, ContactOptions, EmgOptions),
        *(EnvelopeOptions, EmgUse, TensionTables),
    ),
    grows_with="muscles",
    hashed=_hashed,
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
    numbers=_numbers,
    numbers_last=True,
)
