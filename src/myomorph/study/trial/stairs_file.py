"""Stairs or a ladder of load cells as a file (.toml) describes them: steps, cells, paws and the recording."""

from __future__ import annotations

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal

import numpy as np
from pydantic import Field, FiniteFloat

from myomorph.contact.feet_on_steps import FeetOnSteps, Unmeasured, feet_on_steps, stair_wrenches
from myomorph.contact.sites import foot_sites
from myomorph.contact.stairs import StairOptions, Step, StepLoads, step_loads
from myomorph.io.channels import read_channels
from myomorph.model.arrays import Array
from myomorph.model.contacts import Cone, Contacts, Site, Touch
from myomorph.model.errors import BadData, BadFile, MyomorphError, UnknownName
from myomorph.model.model import Model
from myomorph.model.series import Z_UP_TO_Y_UP, Motion, Wrenches
from myomorph.model.spatial import Transform
from myomorph.store.study_file import Strict, checked, existing, read_tables, read_toml, refuse

Vector = tuple[FiniteFloat, FiniteFloat, FiniteFloat]
WORDS = ("stairs", "steps", "cells", "ladder")


class _Stairs(Strict):
    recording: str | None = None
    up: Literal["model", "z"] = "model"
    force_on: Literal["animal", "step"] = "animal"
    unmeasured: Unmeasured = "unknown"
    tare: Literal["quiet", "none"] = "quiet"
    loaded: float = Field(default=0.04, gt=0.0, lt=1.0)
    unloaded: float = Field(default=0.02, gt=0.0, lt=1.0)
    search_range: float = Field(default=0.25, gt=0.0)


class _Step(Strict):
    name: str = Field(min_length=1)
    position: Vector
    orientation: Vector = (0.0, 0.0, 0.0)
    size: tuple[float, float]
    measures: list[str] = Field(min_length=1)
    channels: list[str] = Field(min_length=1)
    matrix: list[list[FiniteFloat]] | None = None
    origin: Vector = (0.0, 0.0, 0.0)


class _Paw(Strict):
    body: str
    point: Vector = (0.0, 0.0, 0.0)
    name: str = ""
    friction: float = 0.8


class _File(Strict):
    stairs: _Stairs = Field(default_factory=_Stairs)
    step: list[_Step] = Field(min_length=1)
    paw: list[_Paw] = Field(default_factory=list)


@dataclass(frozen=True, eq=False)
class Stairs:
    """Loads of the steps of a recording, and who may stand on them.

    Attributes
    ----------
    paws : contact sites of the model
    recording : file of the channels
    """

    path: Path
    loads: StepLoads
    paws: tuple[Site, ...]
    recording: Path
    options: StairOptions
    unmeasured: Unmeasured

    def paws_in(self, model: Model, motion: Motion, sites: tuple[Site, ...] = ()) -> FeetOnSteps:
        """Who stands where while the model moves."""
        return feet_on_steps(model, motion, sites or self.paws, self.loads, self.options)


def read_stairs(path: str | Path, model: Model, trial: Path | None = None) -> Stairs:
    """Stairs of a file, with the loads that were recorded.

    Parameters
    ----------
    trial : file of the markers; with it, `recording` may leave the file out (channels in a C3D file of markers, or a
        table `STEM_stairs.csv` beside it) and `{trial}` in it stands for the stem

    Raises
    ------
    BadFile : with a list of all that is wrong
    """
    path = Path(path)
    raw, _, twice = read_tables(path, "stairs file")
    found, problems = checked(_File, raw)
    problems = [*twice, *problems]
    steps: list[Step] = []
    paws: list[Site] = []
    for one in () if found is None else found.step:
        try:
            steps.append(_step(one, found.stairs))
        except MyomorphError as error:
            problems.append(str(error))
    for one in () if found is None else found.paw:
        if one.body not in model.body_names:
            problems.append(str(UnknownName("body", one.body, model.body_names)))
        else:
            cone = Cone(direction=np.array(model.up), friction=one.friction)
            paws.append(Site(one.name or one.body, one.body, np.array([one.point]), cone))
    recording = None if found is None else _recording(found.stairs.recording, path, trial, problems)
    refuse(path, problems)
    assert found is not None
    assert recording is not None
    told, hint = found.stairs, ""
    try:
        options = StairOptions(told.loaded, told.unloaded, search_range=told.search_range, tare=told.tare)
        loads = step_loads(steps, read_channels(recording), model.weight, options)
        hint = "name paws ([[paw]] body, point)"
        sites = tuple(paws) or foot_sites(model)
    except BadFile:
        raise
    except MyomorphError as error:
        raise BadFile(path, str(error), hint) from None
    return Stairs(path, loads, sites, recording, options, told.unmeasured)


def _step(one: _Step, stairs: _Stairs) -> Step:
    pose = Transform.from_euler_xyz(np.radians(one.orientation), one.position)
    matrix = None if one.matrix is None else _matrix(one)
    step = Step(
        one.name,
        pose,
        one.size,
        tuple(name.lower() for name in one.measures),
        tuple(one.channels),
        matrix,
        np.array(one.origin),
        1 if stairs.force_on == "animal" else -1,
    )
    return step.rotated(Z_UP_TO_Y_UP) if stairs.up == "z" else step


def _matrix(one: _Step) -> Array:
    if len({len(row) for row in one.matrix or ()}) != 1:
        raise BadData(f"the matrix of step '{one.name}' has rows of several lengths")
    return np.array(one.matrix, dtype=np.float64)


def _recording(given: str | None, path: Path, trial: Path | None, problems: list[str]) -> Path | None:
    if given is not None:
        if "{trial}" in given and trial is None:
            problems.append(f"stairs: recording = '{given}': '{{trial}}' needs a trial of a study")
            return None
        stem = "" if trial is None else trial.stem
        return existing(path.parent, given.replace("{trial}", stem), "stairs: recording", problems)
    if trial is not None:
        beside = [
            trial.with_name(f"{trial.stem}_{word}{ending}") for word in WORDS for ending in (".csv", ".mot", ".sto")
        ]
        found = next((one for one in beside if one.is_file()), trial if trial.suffix.lower() == ".c3d" else None)
        if found is not None:
            return found
    problems.append("stairs: 'recording' is missing: the file of the load cells' channels (.c3d, .csv, .mot, .sto)")
    return None


def old_stairs_names(path: Path) -> list[str]:
    """Notices of the old names in a file of stairs; none for one that cannot be read: its use refuses it."""
    try:
        return read_tables(path, "stairs file")[1]
    except BadFile:
        return []


def recording_of(path: Path, trial: Path | None = None) -> tuple[Path, ...]:
    """The file of the channels that a file of stairs names, () where it cannot be told."""
    table = read_toml(path).get("stairs")
    given = table.get("recording") if isinstance(table, dict) else None
    found = _recording(given if isinstance(given, str) else None, path, trial, [])
    return () if found is None else (found,)


def stairs_wrenches(stairs: Stairs, model: Model, motion: Motion) -> Wrenches:
    """Forces on bodies at the cells' times, as far as the motion reaches; what they leave open is in their notes."""
    time = stairs.loads.time
    inside = (time >= motion.time[0] - 1e-9) & (time <= motion.time[-1] + 1e-9)
    if not inside.any():
        raise BadData(
            f"{stairs.recording}: runs from {time[0]:g} to {time[-1]:g} s, the motion from {motion.time[0]:g} to "
            f"{motion.time[-1]:g} s: they have no time in common"
        )
    at = time[inside]
    columns = [np.interp(at, motion.time, column) for column in motion.values.T]
    moving = Motion(at, motion.names, np.array(columns).T)
    wrenches, notes = stair_wrenches(stairs.paws_in(model, moving), stairs.unmeasured)
    return replace(wrenches, notes=tuple(notes))


def stairs_contacts(paws: FeetOnSteps) -> Contacts:
    """Touches of the paws that stood on a step, as its cell tells."""
    touches = []
    for i, site in enumerate(paws.sites):
        on = paws.standing[:, :, i]
        for k, step in enumerate(paws.steps):
            edges = np.flatnonzero(np.diff(np.concatenate([[False], on[:, k], [False]]).astype(np.int8))).reshape(-1, 2)
            touches += [
                Touch(site.name, float(paws.time[a]), float(paws.time[b - 1]), source=f"step {step.name}")
                for a, b in edges
            ]
    return Contacts(tuple(site.name for site in paws.sites), tuple(touches))
