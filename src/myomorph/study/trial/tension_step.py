"""The step of muscle tensions: alone, with contacts that nobody measured, and with EMG."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

from myomorph.io.loads_write import write_external_loads
from myomorph.io.sto import write_sto
from myomorph.model.model import Actuator, Model
from myomorph.model.series import Motion, Series, Table, Wrenches
from myomorph.rigid.dynamics import inverse_dynamics
from myomorph.rigid.frames import over_frames
from myomorph.store import contact_store
from myomorph.store import stored as store
from myomorph.store.progress import progress
from myomorph.store.results import ResultWriter
from myomorph.study.trial.emg_step import EMG_TABLE, ToldByEmg, emg_takes_part, told_by_emg, write_calibration
from myomorph.study.trial.motion_steps import solve_dynamics
from myomorph.study.trial.step_tables import torque_table
from myomorph.study.trial.take import Found, Take
from myomorph.tension.problem import TensionProblem, tension_problem
from myomorph.tension.reaction import joint_reactions
from myomorph.tension.solve import Tension, TensionOptions, solve_tension
from myomorph.tension.terms.actuators import default_reserves
from myomorph.tension.terms.contacts import ContactOptions

if TYPE_CHECKING:
    from myomorph.report.trial.given import Situation
    from myomorph.study.trial.contact_file import ContactPlan
    from myomorph.study.trial.contact_step import ContactSetting

OBJECT_RESIDUAL = 0.01
"""Optimal force of what holds an object beside its contacts, as a share of that of a body's residuals."""

CONTACT_FORCES, CONTACTS, ALL_TORQUES = "contact_forces", "contacts.csv", "torques_with_contacts.sto"


@dataclass(frozen=True, eq=False)
class Asked:
    """What the tension problem of a recording is told.

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
    emg: ToldByEmg | None

    def solved(self, advance: Callable[[int], None]) -> tuple[Tension, TensionProblem | None]:
        """The tensions; the solved problem too where it can be asked what it leaves open of contact forces."""
        contacts = None if self.setting is None else self.setting.task
        emg = None if self.emg is None else self.emg.target
        told = (self.model, self.motion, self.torques, self.options, self.actuators)
        if contacts is None or contacts.options.formulation == "sequential":
            return solve_tension(*told, advance, contacts=contacts, emg=emg), None
        problem, names = tension_problem(*told, contacts=contacts, emg=emg)
        over_frames(problem.solve, len(self.motion), advance, problem.window)
        return problem.result(names), problem


def run_tension(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    """Solve for muscle tensions, and for contact forces where they are asked for; write what was found."""
    if found.torques is None:
        found = solve_dynamics(take, found)
        assert found.motion is not None
        assert found.torques is not None
        store.put_derivatives(writer, found.motion, take.model)
        store.put_torques(writer, found.torques, found.wrenches)
    asked = _asked(take, found)
    with progress(f"{take.name}: muscle tensions", len(asked.motion)) as advance:
        tension, problem = asked.solved(advance)
    _write_tension(take, tension, asked.actuators, writer, folder)
    notes: tuple[str, ...] = found.notes
    if asked.emg is not None:
        write_calibration(asked.emg, take.emg_muscles, folder / EMG_TABLE)
        notes += asked.emg.notes
    known = found.wrenches if asked.setting is None else asked.setting.exact
    if take.tables.reactions != "none":
        reactions = joint_reactions(
            take.model, asked.motion, tension, known, frame=take.tables.reactions, actuators=asked.actuators
        )
        write_sto(reactions.table(), folder / "joint_reactions.sto")
    if asked.setting is None:
        return replace(found, tension=tension, notes=notes)
    loads, carried = _write_contacts(take, asked.motion, tension, asked.setting, writer, folder)
    notes += asked.setting.notes
    if problem is not None:
        notes += _write_doubts(take, problem, tension, writer, folder)
    return replace(found, tension=tension, contacts=asked.setting.contacts, loads=loads, carried=carried, notes=notes)


def _asked(take: Take, found: Found) -> Asked:
    assert found.motion is not None
    assert found.torques is not None
    options = take.tension or TensionOptions()
    actuators = added_actuators(take, options)
    setting = None if take.contacts is None else _setting(take, found)
    torques = found.torques
    if setting is not None and setting.exact is not found.wrenches:
        torques = inverse_dynamics(take.model, found.motion, setting.exact)
    emg = None
    if emg_takes_part(take):
        task = None if setting is None else setting.task
        emg = told_by_emg(take, found.motion, torques, options, actuators, task)
    return Asked(take.model, found.motion, torques, options, actuators, setting, emg)


def _setting(take: Take, found: Found) -> ContactSetting:
    from myomorph.study.trial.contact_step import Measurements, set_contacts

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
    take: Take, motion: Motion, tension: Tension, setting: ContactSetting, writer: ResultWriter, folder: Path
) -> tuple[Wrenches, Series]:
    """Contact forces as external loads, touches as a table; returns all loads, and the torques that they leave."""
    from myomorph.io.contact_events import write_events
    from myomorph.study.trial.contact_step import all_loads, during

    assert take.contacts is not None
    assert tension.contacts is not None
    loads = all_loads(setting.exact, tension.contacts)
    torques = inverse_dynamics(take.model, motion, loads)
    contact_store.put_contact_forces(writer, tension.contacts)
    contact_store.put_contacts(writer, setting.contacts, _situation(take.contacts))
    contact_store.put_carried(writer, torques)
    write_external_loads(loads, folder / f"{CONTACT_FORCES}.sto", folder / f"{CONTACT_FORCES}.xml")
    write_sto(torque_table(torques, take.model), folder / ALL_TORQUES)
    write_events(during(setting.contacts, float(motion.time[0]), float(motion.time[-1])), folder / CONTACTS)
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
    from myomorph.study.trial.contact_doubts import contact_doubts, interval_table, put_doubts

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
