"""Files that a simulation takes: where the body begins, and what drives it."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.model.provenance import Source
from myomorph.core.model.series import Motion, Series, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import cut, resample_wrenches
from myomorph.core.rigid.loops import closed_motion
from myomorph.forward.causes import FLOOR
from myomorph.forward.contact_law import NO_GROUND, Ground
from myomorph.forward.drives import Drives
from myomorph.forward.feet import MAX_DEPTH, depth_at, floor_under_feet
from myomorph.forward.reserves import read_reserves
from myomorph.lab.store.results import file_sources, read_result
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.external_forces import read_loads
from myomorph.lab.study.inputs.torques import read_torques

MIN_FRAMES = 4
STATE = "/activation"
TENSION = "tension"
TENSION_RESULT = "tension.nc"


@dataclass(frozen=True, kw_only=True)
class SimulationFiles:
    """Files of a simulation.

    Attributes
    ----------
    start : coordinates over time, whose first frame is where the body begins
    activations, excitations, torques : what drives it, at most one of them
    reserves : what acts beside activations or excitations
    loads : external forces
    time : part of the motion, begin and end [s]
    cutoff : low-pass of the motion and the external forces [Hz], 0 for none
    follow : natural frequency of a feedback to the motion [Hz], 0 for none
    contacts : "auto" for spheres under the feet, "none"
    floor : height of the floor that they touch [m]
    """

    start: Path | None = None
    activations: Path | None = None
    excitations: Path | None = None
    torques: Path | None = None
    reserves: Path | None = None
    loads: Path | None = None
    time: tuple[float, float] | None = None
    cutoff: float = 0.0
    follow: float = 0.0
    contacts: str = "none"
    floor: float = 0.0

    @property
    def sources(self) -> tuple[Source, ...]:
        """The files with their hashes."""
        return file_sources(
            ("motion", self.start),
            ("activations", self.activations),
            ("excitations", self.excitations),
            ("torques", self.torques),
            ("reserves", self.reserves),
            ("forces", self.loads),
        )


@dataclass(frozen=True, eq=False, kw_only=True)
class SimulationInputs:
    """What the files hold.

    Attributes
    ----------
    start : motion with velocities; None for the model's defaults
    drives : of the body
    passive : whether passive forces of muscles took part in the tensions whose activations drive
        it; None where no result of them lies beside the activations
    notes : on the files
    """

    start: Motion | None
    drives: Drives
    passive: bool | None = None
    notes: tuple[Message, ...] = ()


def read_inputs(files: SimulationFiles, model: Model) -> SimulationInputs:
    """Read the files of a simulation.

    Parameters
    ----------
    files : to read
    model : that they are for

    Raises
    ------
    BadFile, BadData, UnknownName : a file is not what it should be, or not for the model
    """
    if files.start is None:
        _refuse_without_start(files)
    motion, notes = _motion(files, model)
    torques = None
    if files.torques is not None:
        torques, unused = read_torques(files.torques, model)
        notes = (*notes, *unused)
    reserves = None
    if files.reserves is not None:
        reserves, unused = read_reserves(files.reserves, model, motion)
        notes = (*notes, *unused)
    ground, deep = _ground(files, model, motion)
    notes = (*notes, *deep)
    drives = Drives(
        torques=torques,
        activations=_of_muscles(files.activations, model),
        excitations=_of_muscles(files.excitations, model),
        reserves=reserves,
        loads=_loads(files, model, motion),
        ground=ground,
        follow=motion if files.follow > 0.0 else None,
        feedback=files.follow,
    )
    drives.check(model)
    passive = None if files.activations is None else _passive_beside(files.activations)
    return SimulationInputs(start=motion, drives=drives, passive=passive, notes=notes)


def _passive_beside(activations: Path) -> bool | None:
    """Read whether passive forces took part in the result of `tension` in a table's folder."""
    result = activations.parent / TENSION_RESULT
    if not result.is_file():
        return None
    made = read_result(result).provenance.get(TENSION)
    if made is None:
        return None
    stated = made.options.get("tension.passive")
    elastic = made.options.get("tension.tendons") == "elastic"
    return elastic if stated is None else bool(stated)


def _refuse_without_start(files: SimulationFiles) -> None:
    """Refuse what has no meaning without a motion."""
    for name in ("loads", "time", "follow"):
        if getattr(files, name):
            raise BadData(f"--{name} needs --start MOTION, whose clock it has: give both")


def _motion(files: SimulationFiles, model: Model) -> tuple[Motion | None, tuple[Message, ...]]:
    """Read the motion with its velocities, and notes; None where there is none."""
    if files.start is None:
        return None, ()
    read = reading.read_noted_motion(files.start, model)
    motion, _ = reading.whole_motion(read.motion, model)
    motion, apart = reading.coupled_motion(motion, model)
    if len(motion) >= MIN_FRAMES:
        motion = differentiate(motion, cutoff=files.cutoff or None)
    else:
        motion = replace(motion, velocities=np.zeros_like(motion.values))
    span = reading.cut_to(files.time, motion, files.start)
    motion, opened = closed_motion(model, motion if span is None else cut(motion, *span))
    return motion, (*read.notes, *apart, *opened)


def _loads(files: SimulationFiles, model: Model, motion: Motion | None) -> Wrenches | None:
    """Read external forces at the motion's times."""
    if files.loads is None or motion is None:
        return None
    wrenches = read_loads(files.loads, model, motion)
    return resample_wrenches(wrenches, motion.time, cutoff=files.cutoff or None)


def _ground(
    files: SimulationFiles, model: Model, motion: Motion | None
) -> tuple[Ground, tuple[Message, ...]]:
    """Make what the feet touch, and a note where they begin deep in it."""
    if files.contacts == "none":
        return NO_GROUND, ()
    ground = floor_under_feet(model, files.floor)
    depth = depth_at(model, ground, motion)
    if depth <= MAX_DEPTH:
        return ground, ()
    text = f"the feet begin {100 * depth:.2g} cm deep in the floor and are pushed out: give --floor"
    return ground, (FLOOR.message(f"{text} {files.floor - depth:.3f}, or another start"),)


def _of_muscles(path: Path | None, model: Model) -> Series | None:
    """Read a table of activations or excitations, by muscle.

    Columns are named as muscles, or as OpenSim's states (`/forceset/soleus_r/activation`).
    """
    if path is None:
        return None
    if path.suffix.lower() not in reading.TABLE_FILES:
        raise BadFile(
            path, f"is no table of muscles: its name ends in '{path.suffix}'", "expected .sto"
        )
    with reading.about(path):
        table = read_sto(path)
    columns = {}
    for column, name in enumerate(table.names):
        muscle = name.removesuffix(STATE).rpartition("/")[2]
        if muscle in model.muscle_names:
            columns[muscle] = column
    if not columns:
        raise UnknownName(
            "muscle", table.names[0] if table.names else "", model.muscle_names, where="the model"
        )
    values = table.values[:, list(columns.values())]
    if not np.isfinite(values).all():
        frame, column = np.argwhere(~np.isfinite(values))[0].tolist()
        raise BadData(
            f"{path}: '{list(columns)[column]}' has no value at {table.time[frame]:g} s: fill the"
            " gap"
        )
    return Series(table.time, tuple(columns), values)
