"""The steps from markers to muscle tensions, each from a recording and what earlier steps found to files."""

from __future__ import annotations

import json
from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from myomorph.io.sto import table_from_motion, write_sto
from myomorph.model.errors import BadData
from myomorph.model.model import Actuator, Model
from myomorph.model.provenance import Provenance, Source
from myomorph.model.series import Emg, Event, ForcePlate, Markers, Motion, Series, Table, Wrenches
from myomorph.model.spatial import Array
from myomorph.motion.crossings import CrossingOptions, crossings, within_crossings
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.motion.sync import cut, resample_wrenches
from myomorph.store import stored as store
from myomorph.store.progress import progress
from myomorph.store.results import ResultWriter, Stored, provenance_of
from myomorph.store.settings import Differentiation, EmgUse, ReportOptions, TensionTables, TorqueTable, plain_settings
from myomorph.study.trial.inputs import about, has_mass

if TYPE_CHECKING:
    from myomorph.model.contacts import Contacts
    from myomorph.study.trial.contact_file import ContactPlan
    from myomorph.tension.contacts import ContactOptions
    from myomorph.tension.emg_targets import EmgOptions
    from myomorph.tension.solve import Tension, TensionOptions

CHAIN = ("ik", "id", "muscles", "tension")
"""Steps in the order in which they run."""


@dataclass(frozen=True, eq=False)
class Take:
    """One recording of one subject with all that the steps need, whatever files or programs it came from.

    Attributes
    ----------
    loads : external forces of a motion, or None where there are none
    mass : of the subject [kg], None where only the model tells
    time : start and end of what is used [s], None for all
    kinematics, crossings, derivatives, torque_table, tension, contact_options, emg_options, emg_use, tables : what the
        steps are told
    contacts : what is known of contacts whose forces are to be estimated, None to estimate none
    actuators : beside the model's own; None adds a weak reserve for every coordinate
    plates : force plates, for pictures and for feet that share one
    plate_time : clock of their forces (samples,) [s]
    emg_muscles : EMG channel to the muscles it was measured on
    root_note : what the forces at the root are where they are not residuals, see `ReportInput`
    real, assumed, simulated : sentences for the first lines of the report
    truth : where the recording was simulated, what is known of it: "motion", "torques", "activations"
    sources : inputs by their hashes
    report : how the report looks at the motion
    phases : parts of the motion that the report tells apart, name to start and end [s]
    parts : of a recording that joins those of several subjects and objects: each part's name, and the file of its
        model or what makes the model of an object
    """

    name: str
    subject: str
    model: Model
    markers: Markers | None = None
    loads: Callable[[Motion], Wrenches] | None = None
    emg: Emg | None = None
    events: tuple[Event, ...] = ()
    mass: float | None = None
    time: tuple[float, float] | None = None
    kinematics: InverseKinematicsOptions = field(default_factory=InverseKinematicsOptions)
    crossings: CrossingOptions = field(default_factory=CrossingOptions)
    derivatives: Differentiation = field(default_factory=Differentiation)
    torque_table: TorqueTable = field(default_factory=TorqueTable)
    tension: TensionOptions | None = None
    contacts: ContactPlan | None = None
    contact_options: ContactOptions | None = None
    emg_options: EmgOptions | None = None
    emg_use: EmgUse = field(default_factory=EmgUse)
    tables: TensionTables = field(default_factory=TensionTables)
    actuators: tuple[Actuator, ...] | None = None
    plates: tuple[ForcePlate, ...] = ()
    plate_time: Array = field(default_factory=lambda: np.zeros(0))
    emg_muscles: Mapping[str, tuple[str, ...]] = field(default_factory=lambda: MappingProxyType({}))
    root_note: str = ""
    real: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    truth: Mapping[str, Series] = field(default_factory=lambda: MappingProxyType({}))
    sources: tuple[Source, ...] = ()
    warnings: tuple[str, ...] = ()
    report: ReportOptions = field(default_factory=ReportOptions)
    phases: Mapping[str, tuple[float, float]] = field(default_factory=lambda: MappingProxyType({}))
    parts: Mapping[str, str | dict[str, object]] = field(default_factory=lambda: MappingProxyType({}))


@dataclass(frozen=True, eq=False)
class Found:
    """What the steps have found so far.

    Attributes
    ----------
    fit : of inverse kinematics
    recorded : coordinates as inverse kinematics or a file gave them
    motion : coordinates that forces belong to (filtered where asked for), with derivatives
    wrenches : external forces at the motion's times, as measured
    loads : every external force, those of estimated contacts included
    carried : generalized forces of the motion under all of them
    contacts : which site touches what
    notes : what was done about doubtful input, one line each
    """

    fit: KinematicsFit | None = None
    recorded: Motion | None = None
    motion: Motion | None = None
    wrenches: Wrenches | None = None
    torques: Series | None = None
    tension: Tension | None = None
    loads: Wrenches | None = None
    carried: Series | None = None
    contacts: Contacts | None = None
    notes: tuple[str, ...] = ()


def solve_kinematics(take: Take) -> KinematicsFit:
    """Inverse kinematics of the part of a recording that is asked for."""
    if take.markers is None:
        raise BadData(f"{take.name}: holds no markers")
    markers = used_markers(take, take.markers)
    with progress(f"{take.name}: inverse kinematics", len(markers)) as advance:
        return inverse_kinematics(take.model, markers, take.kinematics, advance)


def used_markers(take: Take, markers: Markers) -> Markers:
    """The part of a recording that is asked for; with crossings only, markers are hidden elsewhere.

    Raises
    ------
    BadData
        where crossings are asked for, but there is none
    """
    markers = markers if take.time is None else cut(markers, *take.time)
    if not take.crossings.only:
        return markers
    spans = crossings(markers, take.model, take.crossings)
    if not spans:
        raise BadData(
            f"{take.name}: no part of {take.crossings.shortest:g} s shows {100 * take.crossings.shown:g} % of what its "
            "markers could tell: ask for less (crossings_shown, crossings_shortest)"
        )
    return within_crossings(markers, spans)


def with_derivatives(take: Take, found: Found) -> Found:
    """The motion with velocities and accelerations, cut to the time that is asked for, with closed loops closed.

    Derivatives are taken of all frames first, as OpenSim does, so the cut leaves no edges.
    """
    from myomorph.rigid.closed_motion import closed_motion

    motion = differentiate(_recorded(take, found), take.derivatives.cutoff)
    motion, notes = closed_motion(take.model, motion if take.time is None else cut(motion, *take.time))
    return replace(found, motion=motion, notes=(*found.notes, *notes))


def loads_at(take: Take, recorded: Motion, motion: Motion) -> Wrenches | None:
    """External forces at the motion's times, filtered as the motion."""
    if take.loads is None:
        return None
    return resample_wrenches(take.loads(recorded), motion.time, take.derivatives.cutoff)


def solve_dynamics(take: Take, found: Found) -> Found:
    """Inverse dynamics of the coordinates found so far."""
    from myomorph.rigid.dynamics import inverse_dynamics

    has_mass(take.model, "inverse dynamics")
    found = with_derivatives(take, found)
    assert found.motion is not None
    wrenches = loads_at(take, _recorded(take, found), found.motion)
    notes = found.notes if wrenches is None else (*found.notes, *wrenches.notes)
    torques = inverse_dynamics(take.model, found.motion, wrenches)
    return replace(found, wrenches=wrenches, torques=torques, notes=notes)


def told_torques(take: Take, motion: Motion, torques: Series) -> Series:
    """The torques that the table of inverse dynamics shows: all of them, or what its options leave."""
    if take.torque_table.net:
        from myomorph.muscles.passive import passive_generalized_forces

        torques = replace(torques, values=torques.values - passive_generalized_forces(take.model, motion).values)
    if take.torque_table.folded:
        from myomorph.rigid.closed_motion import loop_torques

        torques = loop_torques(take.model, motion, torques).torques
    return torques


def _recorded(take: Take, found: Found) -> Motion:
    if found.recorded is None:
        raise BadData(f"{take.name}: has no motion yet: run 'ik' first")
    return found.recorded


def run_step(step: str, take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    """Run one of `CHAIN`, write its tables into a folder and its values into a result file."""
    with about(take.name):
        after = RUNNERS[step](take, found, writer, folder)
    _put_take(writer, replace(take, warnings=tuple(dict.fromkeys((*take.warnings, *after.notes)))))
    writer.provenance(step_provenance(step, take))
    return after


def _put_take(writer: ResultWriter, take: Take) -> None:
    """What every result file tells of the recording, so that a report can be made of it alone."""
    store.put_events(writer, take.events)
    store.put_plates(writer, take.plates)
    store.put_truth(writer, take.truth)
    if take.emg is not None:
        store.put_emg(writer, take.emg)
    for name, text in take_facts(take).items():
        writer.fact(name, text)


def take_facts(take: Take) -> dict[str, str]:
    """What is told of a recording beside its values, by name."""
    return {
        "trial": take.name,
        "subject": take.subject,
        "mass": "" if take.mass is None else repr(take.mass),
        "root_note": take.root_note,
        "notes": json.dumps({"real": take.real, "assumed": take.assumed, "simulated": take.simulated}),
        "warnings": json.dumps(take.warnings),
        "preset": take.report.preset,
        "phases": json.dumps({name: list(span) for name, span in take.phases.items()}),
        "parts": json.dumps(dict(take.parts)),
        "emg_muscles": json.dumps({channel: list(names) for channel, names in take.emg_muscles.items()}),
    }


def step_provenance(step: str, take: Take) -> Provenance:
    """What a step's result is made from: all inputs, and the options of this step and those before it."""
    options: dict[str, object] = {"time": None if take.time is None else list(take.time)}
    for earlier in CHAIN[: CHAIN.index(step) + 1]:
        if earlier == "muscles" and step != "muscles":
            continue
        options |= {f"{earlier}.{name}": value for name, value in _options(earlier, take).items()}
    used = ("model", "markers", "tasks", "motion") if step in ("ik", "muscles") else None
    sources = [one for one in take.sources if used is None or one.role in used]
    return provenance_of(step, sources, options)


def _options(step: str, take: Take) -> dict[str, object]:
    if step == "ik":
        crossed = plain_settings(take.crossings) if take.crossings.only else {}
        return plain_settings(take.kinematics) | crossed
    if step == "tension":
        told = [one for one in (take.tension, take.contact_options, take.emg_options) if one is not None]
        return {
            name: value for one in (*told, take.emg_use, take.tables) for name, value in plain_settings(one).items()
        }
    if step == "id":
        return plain_settings(take.derivatives) | plain_settings(take.torque_table)
    return plain_settings(take.derivatives)


def _run_ik(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    fit = solve_kinematics(take)
    write_sto(table_from_motion(fit.motion, take.model), folder / "coordinates.mot")
    write_sto(error_table(fit), folder / "marker_errors.sto")
    store.put_fit(writer, fit, take.model)
    if take.markers is not None:
        kept = np.isin(take.markers.time, fit.motion.time)
        store.put_markers(writer, replace(take.markers, time=fit.motion.time, values=take.markers.values[kept]))
    return replace(found, fit=fit, recorded=fit.motion)


def _run_id(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    after = solve_dynamics(take, found)
    assert after.motion is not None
    assert after.torques is not None
    write_sto(torque_table(told_torques(take, after.motion, after.torques), take.model), folder / "torques.sto")
    store.put_derivatives(writer, after.motion, take.model)
    store.put_torques(writer, after.torques, after.wrenches)
    return after


def _run_muscles(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    from myomorph.study.trial.muscle_files import write_muscles

    if found.motion is None:
        found = with_derivatives(take, found)
        assert found.motion is not None
        store.put_derivatives(writer, found.motion, take.model)
    write_muscles(take.model, found.motion, writer, folder, f"{take.name}: muscle paths")
    return found


def _run_tension(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    from myomorph.study.trial.tension_step import run_tension

    return run_tension(take, found, writer, folder)


RUNNERS: dict[str, Callable[[Take, Found, ResultWriter, Path], Found]] = {
    "ik": _run_ik,
    "id": _run_id,
    "muscles": _run_muscles,
    "tension": _run_tension,
}


def read_step(step: str, take: Take, found: Found, stored: Stored) -> Found:
    """What a step found, from the file in which it was stored."""
    if step == "tension":
        from myomorph.tension.solve import TensionOptions

        return replace(found, tension=store.get_tension(stored, take.tension or TensionOptions()))
    if step == "ik":
        fit = store.get_fit(stored)
        return replace(found, fit=fit, recorded=None if fit is None else fit.motion)
    if step == "id":
        motion, wrenches = store.get_derivatives(stored), store.get_wrenches(stored)
        return replace(found, motion=motion, wrenches=wrenches, torques=store.get_torques(stored))
    return found


def error_table(fit: KinematicsFit) -> Table:
    """Marker errors as a table: root mean square, largest, and each marker's [m]."""
    values = np.column_stack([fit.rms, fit.largest, fit.errors])
    return Table(fit.motion.time, ("rms", "largest", *fit.marker_names), values)


def torque_table(torques: Series, model: Model) -> Table:
    """Generalized forces as OpenSim's inverse dynamics names them: `hip_flexion_r_moment`, `pelvis_tx_force`."""
    endings = {"rotational": "moment", "translational": "force", "coupled": "force"}
    names = tuple(f"{name}_{endings[model.coordinate(name).motion]}" for name in torques.names)
    facts = MappingProxyType({"name": "Inverse Dynamics Generalized Forces"})
    return Table(torques.time, names, torques.values, facts=facts)
