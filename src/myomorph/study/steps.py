"""The steps from markers to muscle tensions, each from a recording and what earlier steps found to files."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from types import MappingProxyType
from typing import TYPE_CHECKING

import numpy as np

from myomorph.io.sto import table_from_motion, write_sto
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.provenance import Provenance, Source
from myomorph.model.series import Emg, Event, Markers, Motion, Series, Table, Wrenches
from myomorph.motion.filters import differentiate
from myomorph.motion.ik import InverseKinematicsOptions, KinematicsFit, inverse_kinematics
from myomorph.motion.sync import cut, resample_wrenches
from myomorph.study import stored as store
from myomorph.study.inputs import has_mass
from myomorph.study.progress import progress
from myomorph.study.results import ResultWriter, Stored, provenance_of
from myomorph.study.settings import Differentiation, plain_settings

if TYPE_CHECKING:
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
    kinematics, derivatives, tension : what the steps are told
    real, assumed, simulated : sentences for the first lines of the report
    truth : where the recording was simulated, what is known of it, by the name of the estimate
    sources : inputs by their hashes
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
    derivatives: Differentiation = field(default_factory=Differentiation)
    tension: TensionOptions | None = None
    real: tuple[str, ...] = ()
    assumed: tuple[str, ...] = ()
    simulated: tuple[str, ...] = ()
    truth: Mapping[str, Series] = field(default_factory=lambda: MappingProxyType({}))
    sources: tuple[Source, ...] = ()
    warnings: tuple[str, ...] = ()


@dataclass(frozen=True, eq=False)
class Found:
    """What the steps have found so far.

    Attributes
    ----------
    fit : of inverse kinematics
    recorded : coordinates as inverse kinematics or a file gave them
    motion : coordinates that forces belong to (filtered where asked for), with derivatives
    wrenches : external forces at the motion's times
    """

    fit: KinematicsFit | None = None
    recorded: Motion | None = None
    motion: Motion | None = None
    wrenches: Wrenches | None = None
    torques: Series | None = None
    tension: Tension | None = None


def solve_kinematics(take: Take) -> KinematicsFit:
    """Inverse kinematics of the part of a recording that is asked for."""
    if take.markers is None:
        raise BadData(f"{take.name}: holds no markers")
    markers = take.markers if take.time is None else cut(take.markers, *take.time)
    with progress(f"{take.name}: inverse kinematics", len(markers)) as advance:
        return inverse_kinematics(take.model, markers, take.kinematics, advance)


def with_derivatives(take: Take, recorded: Motion) -> Motion:
    """The motion with velocities and accelerations, cut to the time that is asked for.

    Derivatives are taken of all frames first, as OpenSim does, so the cut leaves no edges.
    """
    motion = differentiate(recorded, take.derivatives.cutoff)
    return motion if take.time is None else cut(motion, *take.time)


def loads_at(take: Take, recorded: Motion, motion: Motion) -> Wrenches | None:
    """External forces at the motion's times, filtered as the motion."""
    if take.loads is None:
        return None
    return resample_wrenches(take.loads(recorded), motion.time, take.derivatives.cutoff)


def solve_dynamics(take: Take, found: Found) -> Found:
    """Inverse dynamics of the coordinates found so far."""
    from myomorph.rigid.dynamics import inverse_dynamics

    has_mass(take.model, "inverse dynamics")
    recorded = _recorded(take, found)
    motion = with_derivatives(take, recorded)
    wrenches = loads_at(take, recorded, motion)
    torques = inverse_dynamics(take.model, motion, wrenches)
    return replace(found, motion=motion, wrenches=wrenches, torques=torques)


def _recorded(take: Take, found: Found) -> Motion:
    if found.recorded is None:
        raise BadData(f"{take.name}: has no motion yet: run 'ik' first")
    return found.recorded


def run_step(step: str, take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    """Run one of `CHAIN`, write its tables into a folder and its values into a result file."""
    after = RUNNERS[step](take, found, writer, folder)
    writer.provenance(step_provenance(step, take))
    return after


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
        return plain_settings(take.kinematics)
    if step == "tension" and take.tension is not None:
        return plain_settings(take.tension)
    return plain_settings(take.derivatives)


def _run_ik(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    fit = solve_kinematics(take)
    write_sto(table_from_motion(fit.motion, take.model), folder / "coordinates.mot")
    write_sto(error_table(fit), folder / "marker_errors.sto")
    store.put_fit(writer, fit, take.model)
    store.put_events(writer, take.events)
    return replace(found, fit=fit, recorded=fit.motion)


def _run_id(take: Take, found: Found, writer: ResultWriter, folder: Path) -> Found:
    after = solve_dynamics(take, found)
    assert after.motion is not None and after.torques is not None
    write_sto(torque_table(after.torques, take.model), folder / "torques.sto")
    store.put_derivatives(writer, after.motion, take.model)
    store.put_torques(writer, after.torques, after.wrenches)
    return after


RUNNERS: dict[str, Callable[[Take, Found, ResultWriter, Path], Found]] = {"ik": _run_ik, "id": _run_id}


def read_step(step: str, found: Found, stored: Stored) -> Found:
    """What a step found, from the file in which it was stored."""
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
