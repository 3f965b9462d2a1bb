"""The steps from markers to muscle tensions, each from a recording and what earlier steps found to files."""

from __future__ import annotations

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from myomorph.io.sto import table_from_motion, write_sto
from myomorph.model.provenance import Provenance
from myomorph.store import stored as store
from myomorph.store.results import ResultWriter, Stored, provenance_of
from myomorph.store.settings import plain_settings
from myomorph.study.trial.inputs import about
from myomorph.study.trial.motion_steps import solve_dynamics, solve_kinematics, told_torques, with_derivatives
from myomorph.study.trial.step_tables import error_table, torque_table
from myomorph.study.trial.take import CHAIN, Found, Take

if TYPE_CHECKING:
    pass


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
