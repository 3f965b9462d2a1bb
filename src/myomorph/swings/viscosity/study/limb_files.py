"""Relaxed limbs of a study file, and their recordings as drops."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import NamedTuple

import numpy as np
from numpy.typing import NDArray
from pydantic import Field

from myomorph.core.model.errors import BadFile, listing
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import located
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.ik import inverse_kinematics
from myomorph.core.motion.sync import cut
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.store import named_files, study_file
from myomorph.lab.study.inputs.beside import plain_stem
from myomorph.lab.study.inputs.emg import emg_by_name
from myomorph.lab.study.inputs.emg_files import channels_of
from myomorph.lab.study.inputs.reading import (
    TABLE_FILES,
    about,
    fitted_to,
    read_motion,
    read_recording,
    whole_motion,
)
from myomorph.swings.viscosity.relaxed.drops import (
    FORCE_AFTER,
    MIN_HALVES,
    Activity,
    Drop,
    activities,
    at_rest,
    find_drops,
)
from myomorph.swings.viscosity.relaxed.identify import UNITS, LimbBody
from myomorph.swings.viscosity.relaxed.swing_equation import SwingEquation, swing_equation
from myomorph.swings.viscosity.study.study_folder import StudyFolder

MOVED = 0.02
TURNED = np.deg2rad(5.0)  # How far the bone above the joint may move and turn unnamed [m], [rad].


class DropTable(study_file.Strict):
    """A recording given by a table, where its EMG does not follow the rule of names."""

    recording: str
    emg: str | None = None
    name: str = ""
    time: tuple[float, float] | None = None


class LimbTable(study_file.Strict):
    """A relaxed limb in a study file."""

    name: str
    model: str
    coordinate: str
    drops: list[str | DropTable] = Field(min_length=1)
    muscles: list[str] = Field(default_factory=list)
    time: tuple[float, float] | None = None
    truth: dict[str, float] = Field(default_factory=dict)


@dataclass(frozen=True)
class DropFiles:
    """A recording of drops: markers or coordinates, and raw EMG beside them if there is any."""

    name: str
    recording: Path
    emg: Path | None = None
    time: tuple[float, float] | None = None


@dataclass(frozen=True)
class LimbFiles:
    """What is known of a limb before anything is read.

    Attributes
    ----------
    name : of the limb
    model : file
    coordinate : that swings
    drops : recordings
    muscles : channels of EMG that must be silent, () for all
    truth : true values of `relaxed.identify.UNITS`
    """

    name: str
    model: Path
    coordinate: str
    drops: tuple[DropFiles, ...]
    muscles: tuple[str, ...] = ()
    truth: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))


def limb_files(table: LimbTable, folder: StudyFolder) -> LimbFiles:
    """Find the files of a limb; what is wrong is added to the folder's problems.

    Parameters
    ----------
    table : of the study file
    folder : of the study file
    """
    where = f"limb '{table.name}'"
    problems = folder.problems
    model = named_files.existing(folder.path, table.model, f"{where}: model", problems)
    problems += [
        f"{where}: unknown quantity '{name}' in 'truth': there are {listing(name, UNITS)}"
        for name in table.truth
        if name not in UNITS
    ]
    drops = tuple(_drops(table, where, folder))
    names = [drop.name for drop in drops]
    problems += [
        f"{where}: two recordings are named '{name}': give one a 'name'"
        for name in dict.fromkeys(names)
        if names.count(name) > 1
    ]
    muscles = tuple(table.muscles)
    truth = FrozenMap(table.truth)
    return LimbFiles(
        name=table.name,
        model=model or folder.path,
        coordinate=table.coordinate,
        drops=drops,
        muscles=muscles,
        truth=truth,
    )


def _drops(table: LimbTable, where: str, folder: StudyFolder) -> Iterator[DropFiles]:
    """Find recordings of drops, and the EMG beside them."""
    problems = folder.problems
    for entry in table.drops:
        drop = DropTable(recording=entry) if isinstance(entry, str) else entry
        time = drop.time or table.time
        named_files.check_time(time, f"{where}: time", problems)
        for path in named_files.matching(folder.path, drop.recording, f"{where}: drops", problems):
            emg = named_files.existing(folder.path, drop.emg, f"{where}: emg", problems)
            if drop.emg is None:
                in_it = path if table.muscles and path.suffix.lower() == ".c3d" else None
                emg = emg_by_name(path) or in_it
                if emg is not None and emg != in_it:
                    folder.remarks.append(f"{path.name}: EMG from {emg.name}")
            yield DropFiles(name=drop.name or plain_stem(path), recording=path, emg=emg, time=time)


def limb_body(model: Model, coordinate: str, equation: SwingEquation) -> LimbBody:
    """Take all that a coordinate moves as one body, as the equation of its swing has it."""
    joint = next(joint for joint in model.joints if coordinate in joint.coordinates)
    tree = compile_tree(model)
    moves = tree.hanging(joint.child)
    mass = sum(body.mass for body in model.bodies if moves[tree.body_index[body.name]])
    return LimbBody.of(equation, mass, float(np.linalg.norm(model.gravity)))


class OpenedDrops(NamedTuple):
    """The drops of a recording, and notes on it."""

    drops: list[Drop]
    notes: list[str]


def open_drops(files: DropFiles, model: Model, limb: LimbFiles, cutoff: float) -> OpenedDrops:
    """Read the drops of a recording; half swings in which a muscle was active are left out.

    Parameters
    ----------
    files : of the recording
    model : of the person
    limb : that swings
    cutoff : of the low-pass of the motion [Hz]
    """
    motion, notes = _motion(files, model)
    column = motion.names.index(limb.coordinate)
    measured = motion.values[:, column]
    with about(files.recording.name):
        known = np.asarray(np.isfinite(motion.values).all(axis=1))
        if not known.all():
            motion = _filled(motion, known)
            notes.append(
                f"{files.name}: {(~known).sum()} of {len(known)} frames are unknown and not"
                " compared"
            )
        smooth = differentiate(motion, cutoff)
        assert smooth.velocities is not None
        equation = swing_equation(model, limb.coordinate, smooth)
        angles = smooth.values[:, column]
        rates = smooth.velocities[:, column]
        drops = list(find_drops(files.name, equation, measured, angles, rates))
    notes += _moved_base(smooth, model, limb.coordinate, drops)
    if files.emg is None:
        return OpenedDrops(drops=drops, notes=notes)
    with about(files.emg.name):
        emg = channels_of(files.emg)
        active = activities(emg, limb.muscles or emg.names, at_rest(drops))
    silent = []
    for drop in drops:
        notes += _active_notes(drop, active)
        silent.append(_silent(drop, active))
    enough = [drop for drop in silent if drop.used.sum() >= MIN_HALVES - 1]
    return OpenedDrops(drops=enough, notes=notes)


def _filled(motion: Motion, known: NDArray[np.bool_]) -> Motion:
    """Bridge frames that are unknown along straight lines."""
    time = motion.time
    filled = [np.interp(time, time[known], values[known]) for values in motion.values.T]
    return replace(motion, values=np.array(filled).T)


def _silent(drop: Drop, active: Sequence[Activity]) -> Drop:
    """Leave half swings out in which a muscle may pull."""
    used = np.array(drop.used)
    for half in range(len(used)):
        begin, end = drop.time(half)
        used[half] &= not any(_pulls(each, begin, end) for each in active)
    return replace(drop, used=used)


def _active_notes(drop: Drop, active: Sequence[Activity]) -> list[str]:
    """Name muscles that are active in a drop."""
    begin, _ = drop.time(0)
    _, end = drop.time(len(drop.used) - 1)
    return [
        f"{drop.name}: '{each.muscle}' is active from {each.start:.2f} to {each.stop:.2f} s,"
        f" {each.ratio:.1f} times its level at rest: the half swings it touches are left out"
        for each in active
        if _pulls(each, begin, end)
    ]


def _pulls(activity: Activity, begin: float, end: float) -> bool:
    """Return whether a muscle may pull between two times [s]."""
    return activity.start < end and activity.stop + FORCE_AFTER > begin


def _motion(files: DropFiles, model: Model) -> tuple[Motion, list[str]]:
    path = files.recording
    if path.suffix.lower() in TABLE_FILES:
        motion, lacking = whole_motion(read_motion(path, model), model)
        notes = (
            [f"{files.name}: lacks {', '.join(lacking)}: they stay at their defaults"]
            if lacking
            else []
        )
    else:
        trial = fitted_to(model, read_recording(path))
        if trial.markers is None:
            raise BadFile(
                path, "holds no markers", "give markers (.trc, .c3d) or coordinates (.mot, .sto)"
            )
        motion = inverse_kinematics(model, trial.markers).motion
        notes = [*located(files.name, (text for text in trial.warnings if "plate" not in text))]
    return (motion if files.time is None else cut(motion, *files.time)), notes


def _moved_base(motion: Motion, model: Model, coordinate: str, drops: list[Drop]) -> Iterator[str]:
    """Yield a line of each drop in which the bone above the joint moves far."""
    tree = compile_tree(model)
    joint = next(joint for joint in model.joints if coordinate in joint.coordinates)
    base = tree.body_index[joint.parent]
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    ends = poses.origins[:, base] + poses.rotations[:, base] @ joint.parent_frame.translation
    for drop in drops:
        part = slice(int(drop.turns[0]), int(drop.turns[-1]))
        turned = np.einsum("fij,ij->f", poses.rotations[part, base], poses.rotations[part, base][0])
        angle = float(np.arccos(np.clip(0.5 * (turned.min() - 1.0), -1.0, 1.0)))
        moved = float(np.linalg.norm(ends[part] - ends[part][0], axis=1).max())
        if angle > TURNED or moved > MOVED:
            yield (
                f"{drop.name}: '{joint.parent}' turns by up to {np.rad2deg(angle):.0f} degrees and"
                f" its end moves by {100.0 * moved:.0f} cm; its measured motion is taken into"
                " account"
            )
