"""Conflicts of EMG and torques: muscles that leave their EMG, reserves that bear the rest."""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.causes import EMG_CONFLICTS
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.core.muscles.model_paths import compile_paths
from myomorph.core.tension.tension import RESERVE, Tension
from myomorph.core.tension.terms.emg import EmgTarget

APART = 0.1
"""Distance of an activation from its EMG, beyond the slack, that is a conflict."""
MIN_DURATION = 0.03
"""Stretches that are shorter count for nothing [s]."""
BORNE = 0.05
"""Share of a joint's largest torque from which on a reserve bears too much of it."""


@dataclass(frozen=True)
class EmgConflict:
    """One stretch of time in which EMG and torques contradict each other.

    Attributes
    ----------
    muscle : with EMG; "" where a reserve bears what muscles and EMG leave
    coordinate : of the reserve, "" of a muscle
    start, stop : of the stretch [s]
    worst : time of the largest difference [s]
    emg : activation by EMG then; of a reserve the torque wanted [N m or N]
    found : activation by the solution then; of a reserve its torque [N m or N]
    """

    muscle: str
    coordinate: str
    start: float
    stop: float
    worst: float
    emg: float
    found: float


def emg_conflicts(model: Model, tension: Tension, target: EmgTarget) -> tuple[EmgConflict, ...]:
    """Stretches in which EMG and torques contradict each other, by muscle and then by reserve.

    Muscles count where they are more than `APART` from their EMG (driven ones: beyond the slack),
    reserves of coordinates that muscles with EMG cross where they bear more than `BORNE` of the
    largest torque.
    """
    return (*_by_muscle(tension, target), *_by_reserve(model, tension, target))


def _by_muscle(tension: Tension, target: EmgTarget) -> Iterator[EmgConflict]:
    """Yield stretches in which muscles leave their EMG."""
    limit = APART + (target.slack if target.mode == "driven" else 0.0)
    for name, measured in zip(target.muscles, target.activations.T, strict=True):
        result = tension.activation[:, tension.muscles.index(name)]
        distance = np.abs(result - measured)
        for stretch in _stretches(tension.time, distance, limit):
            yield EmgConflict(
                muscle=name,
                coordinate="",
                start=stretch.start,
                stop=stretch.stop,
                worst=float(tension.time[stretch.worst]),
                emg=float(measured[stretch.worst]),
                found=float(result[stretch.worst]),
            )


def _by_reserve(model: Model, tension: Tension, target: EmgTarget) -> Iterator[EmgConflict]:
    """Yield stretches in which reserves bear too much of what muscles with EMG should."""
    crossed = _crossed_coordinates(model, target.muscles)
    known = np.isfinite(target.activations).any(axis=1)
    for name, torques in zip(tension.reserve_names, tension.actuator_force.T, strict=True):
        coordinate = name.removeprefix(RESERVE)
        balanced = coordinate in crossed and coordinate in tension.coordinates
        if not (name.startswith(RESERVE) and balanced):
            continue
        wanted = tension.balanced_torque[:, tension.coordinates.index(coordinate)]
        largest = float(np.nanmax(np.abs(wanted), initial=0.0))
        borne = np.where(known, np.abs(torques), 0.0)
        for stretch in _stretches(tension.time, borne, max(BORNE * largest, 1e-9)):
            yield EmgConflict(
                muscle="",
                coordinate=coordinate,
                start=stretch.start,
                stop=stretch.stop,
                worst=float(tension.time[stretch.worst]),
                emg=float(wanted[stretch.worst]),
                found=float(torques[stretch.worst]),
            )


def _crossed_coordinates(model: Model, muscles: Sequence[str]) -> set[str]:
    """Names of the coordinates that muscles have moment arms about."""
    paths = compile_paths(model)
    numbers = [model.muscle_names.index(name) for name in muscles]
    columns = paths.arm_coordinate[np.isin(paths.arm_muscle, numbers)]
    return {model.coordinate_names[int(column)] for column in columns}


class Stretch(NamedTuple):
    """A stretch of time: where it begins and ends [s], and its worst frame."""

    start: float
    stop: float
    worst: int


def _stretches(time: Array, distance: Array, limit: float) -> Iterator[Stretch]:
    """Yield stretches in which a distance is beyond a limit.

    Parameters
    ----------
    time : (frames,) [s]
    distance : (frames,) NaN where it is not known
    limit : in the unit of the distance
    """
    for first, stop in runs(np.nan_to_num(distance) > limit):
        if time[stop - 1] - time[first] >= MIN_DURATION:
            yield Stretch(
                start=float(time[first]),
                stop=float(time[stop - 1]),
                worst=first + int(np.argmax(distance[first:stop])),
            )


def conflict_line(conflicts: Sequence[EmgConflict], table: str) -> tuple[Message, ...]:
    """Say all conflicts in one line, the largest first; () for none.

    Parameters
    ----------
    conflicts : of muscles and of reserves
    table : name of the file that lists them
    """
    muscles = [conflict for conflict in conflicts if conflict.muscle]
    reserves = [conflict for conflict in conflicts if conflict.coordinate]
    parts = []
    if muscles:
        parts.append(_of_muscles(muscles))
    if reserves:
        parts.append(_of_reserves(reserves))
    if not parts:
        return ()
    return (
        EMG_CONFLICTS.message(
            f"EMG and torques contradict each other: {'; '.join(parts)}; see {table}"
        ),
    )


def _of_muscles(conflicts: Sequence[EmgConflict]) -> str:
    """Clause on muscles that leave their EMG, with the worst conflict of three of them."""
    ordered = sorted(conflicts, key=lambda conflict: -abs(conflict.found - conflict.emg))
    worst: dict[str, EmgConflict] = {}
    for conflict in ordered:
        worst.setdefault(conflict.muscle, conflict)
    text = ", ".join(
        f"{conflict.muscle} {conflict.found:.2f} where EMG says {conflict.emg:.2f} at"
        f" {conflict.worst:.3g} s"
        for conflict in list(worst.values())[:3]
    )
    more = " ..." if len(worst) > 3 else ""
    return f"{len(worst)} muscles deviate from their EMG ({text}{more})"


def _of_reserves(conflicts: Sequence[EmgConflict]) -> str:
    """Clause on reserves that bear what EMG leaves, with the greatest of them."""
    joints = {conflict.coordinate for conflict in conflicts}
    greatest = min(conflicts, key=lambda conflict: -abs(conflict.found))
    return (
        f"reserves of {len(joints)} coordinates supply what EMG leaves ({greatest.coordinate}"
        f" {abs(greatest.found):.3g} of {abs(greatest.emg):.3g} at {greatest.worst:.3g} s)"
    )
