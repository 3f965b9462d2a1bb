"""The step of muscle tensions: alone, with contacts that nobody measured, and with EMG."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING, Any

from myomorph.io.loads_write import write_external_loads
from myomorph.io.sto import write_sto
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series, Table, Wrenches
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.frames import over_frames
from myomorph.study import contact_store
from myomorph.study import stored as store
from myomorph.study.emg_step import EMG_TABLE, emg_takes_part, told_by_emg, write_calibration
from myomorph.study.progress import progress
from myomorph.study.results import ResultWriter
from myomorph.study.steps import Found, Take, solve_dynamics, torque_table
from myomorph.tension.actuators import default_reserves
from myomorph.tension.contacts import ContactOptions, ContactTask
from myomorph.tension.emg import EmgTarget
from myomorph.tension.problem import TensionProblem, tension_problem
from myomorph.tension.reaction import joint_reactions
from myomorph.tension.solve import Tension, TensionOptions, solve_tension

if TYPE_CHECKING:
    from myomorph.report.given import Situation
    from myomorph.study.contact_file import ContactPlan
    from myomorph.study.contact_step import ContactSetting

OBJECT_RESIDUAL = 0.01
"""Optimal force of what holds an object beside its contacts, as a share of that of a body's residuals."""

CONTACT_FORCES, CONTACTS, ALL_TORQUES = "contact_forces", "contacts.csv", "torques_with_contacts.sto"


def run_tension(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    """Solve for muscle tensions, and for contact forces where they are asked for; write what was found."""
    if found.torques is None:
        found = solve_dynamics(take, found)
        assert found.motion is not None
        assert found.torques is not None
        store.put_derivatives(writer, found.motion, take.model)
        store.put_torques(writer, found.torques, found.wrenches)
    assert found.motion is not None
    assert found.torques is not None
    options = take.tension or TensionOptions()
    added = added_actuators(take, options)
    setting = None if take.contacts is None else _setting(take, found)
    torques = found.torques
    more: dict[str, Any] = {}
    if setting is not None:
        more["contacts"] = setting.task
        if setting.exact is not found.wrenches:
            torques = inverse_dynamics(take.model, found.motion, setting.exact)
    notes: tuple[str, ...] = ()
    if emg_takes_part(take):
        told = told_by_emg(take, found.motion, torques, options, added, None if setting is None else setting.task)
        more["emg"], notes = told.target, told.notes
        write_calibration(told, take.emg_muscles, folder / EMG_TABLE)
    with progress(f"{take.name}: muscle tensions", len(found.motion)) as advance:
        tension, problem = _solve(take.model, found.motion, torques, options, added, advance, **more)
    _write_tension(take, tension, added, writer, folder)
    if take.tables.reactions != "none":
        known = found.wrenches if setting is None else setting.exact
        reactions = joint_reactions(
            take.model, found.motion, tension, known, frame=take.tables.reactions, actuators=added
        )
        write_sto(reactions.table(), folder / "joint_reactions.sto")
    found = replace(found, tension=tension, notes=(*found.notes, *notes))
    if setting is None:
        return found
    loads, carried = _write_contacts(take, found, setting, writer, folder)
    lines = () if problem is None else _write_doubts(take, problem, tension, writer, folder)
    notes = (*found.notes, *setting.notes, *lines)
    return replace(found, contacts=setting.contacts, loads=loads, carried=carried, notes=notes)


def _solve(
    model: Model,
    motion: Motion,
    torques: Series,
    options: TensionOptions,
    actuators: tuple[Actuator, ...],
    advance: Callable[[int], None],
    contacts: ContactTask | None = None,
    emg: EmgTarget | None = None,
) -> tuple[Tension, TensionProblem | None]:
    """The tensions; the solved problem too where it can be asked what it leaves open of contact forces."""
    if contacts is None or contacts.options.formulation == "sequential":
        return solve_tension(model, motion, torques, options, actuators, advance, contacts=contacts, emg=emg), None
    problem, names = tension_problem(model, motion, torques, options, actuators, contacts=contacts, emg=emg)
    over_frames(problem.solve, len(motion), advance, problem.window)
    return problem.result(names), problem


def _setting(take: Take, found: Found) -> ContactSetting:
    from myomorph.study.contact_step import Measurements, set_contacts

    assert take.contacts is not None
    assert found.motion is not None
    options = take.contact_options or ContactOptions()
    recorded = found.motion if found.recorded is None else found.recorded
    known = Measurements(recorded, found.wrenches, take.plates, take.plate_time, take.derivatives.cutoff)
    return set_contacts(take.contacts, take.model, found.motion, known, options)


def _write_tension(
    take: Take, tension: Tension, added: tuple[Actuator, ...], writer: ResultWriter, folder: Path
) -> None:
    by_name = {one.name: one.coordinate for one in (*take.model.actuators, *added)}
    store.put_tension(writer, tension, tuple(by_name.get(name, "") for name in tension.reserve_names))
    tables = (
        ("activations", tension.muscles, tension.activations),
        ("forces", tension.muscles, tension.forces),
        ("reserves", tension.reserve_names, tension.reserves),
    )
    for name, columns, values in tables:
        facts = MappingProxyType({"name": f"Muscle tensions: {name}"})
        write_sto(Table(tension.time, columns, values, facts=facts), folder / f"{name}.sto")


def _write_contacts(
    take: Take, found: Found, setting: ContactSetting, writer: ResultWriter, folder: Path
) -> tuple[Wrenches, Series]:
    """Contact forces as external loads, touches as a table; returns all loads, and the torques that they leave."""
    from myomorph.io.contact_events import write_events
    from myomorph.study.contact_step import all_loads

    assert found.tension is not None
    assert found.motion is not None
    assert take.contacts is not None
    forces = found.tension.contacts
    assert forces is not None
    loads = all_loads(setting.exact, forces)
    torques = inverse_dynamics(take.model, found.motion, loads)
    contact_store.put_contact_forces(writer, forces)
    contact_store.put_contacts(writer, setting.contacts, _situation(take.contacts))
    contact_store.put_carried(writer, torques)
    write_external_loads(loads, folder / f"{CONTACT_FORCES}.sto", folder / f"{CONTACT_FORCES}.xml")
    write_sto(torque_table(torques, take.model), folder / ALL_TORQUES)
    write_events(setting.contacts, folder / CONTACTS)
    return loads, torques


def _situation(plan: ContactPlan) -> Situation:
    """Which of the situations of [D] chapter 4 it is."""
    if plan.sound is not None:
        return "sound"
    return "shared" if plan.measured == "shared" else "unknown"


def _write_doubts(
    take: Take, problem: TensionProblem, tension: Tension, writer: ResultWriter, folder: Path
) -> tuple[str, ...]:
    """What is left open and what contacts cannot carry, as files; returns the latter, one line a stretch of time."""
    from myomorph.study.contact_doubts import contact_doubts, interval_table, put_doubts

    doubts = contact_doubts(problem, tension, take.tables.intervals, take.name)
    put_doubts(writer, doubts)
    if doubts.intervals:
        write_sto(interval_table(doubts.intervals), folder / "contact_intervals.sto")
    return doubts.lines


def added_actuators(take: Take, options: TensionOptions) -> tuple[Actuator, ...]:
    """Actuators beside the model's own: those of a file, or a weak reserve for every free coordinate.

    What holds an object is weaker still: nothing but its contacts does.
    """
    if take.actuators is not None:
        return take.actuators
    objects = {f"{name}_{name}" for name, told in take.parts.items() if isinstance(told, dict)}
    return tuple(
        replace(one, optimal_force=OBJECT_RESIDUAL * one.optimal_force) if one.body in objects else one
        for one in default_reserves(take.model, options.reserve, options.residual)
    )
