"""What EMG and torques cannot both have: stretches where muscles leave their EMG, or reserves bear
what EMG leaves.
"""

from __future__ import annotations

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.model import Model
from myomorph.core.muscles.path import compile_paths
from myomorph.core.tension.tension import RESERVE, Tension
from myomorph.core.tension.terms.emg import EmgTarget

# Distance of an activation from its EMG that counts as a conflict, beyond the slack of driven
# muscles
APART = 0.1
SHORTEST = 0.03  # Stretches that are shorter count for nothing [s]
BORNE = 0.05  # Share of a joint's largest torque from which on a reserve bears too much of it


@dataclass(frozen=True)
class EmgConflict:
    """One stretch of time."""

    muscle: str  # with EMG; "" where a reserve bears what muscles and EMG leave
    coordinate: str  # of the reserve, "" of a muscle
    # start, stop, worst: times, the last that of the largest difference [s]
    start: float
    stop: float
    worst: float
    # emg, found: activation by EMG and by the solution then; of a reserve the torque wanted and the
    # reserve's [N m or N]
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
    limit = APART + (target.slack if target.mode == "driven" else 0.0)
    for name, measured in zip(target.muscles, target.activations.T, strict=True):
        result = tension.activations[:, tension.muscles.index(name)]
        yield from _stretches(
            tension.time, np.abs(result - measured), limit, (name, ""), (measured, result)
        )


def _by_reserve(model: Model, tension: Tension, target: EmgTarget) -> Iterator[EmgConflict]:
    paths = compile_paths(model)
    measured = [model.muscle_names.index(name) for name in target.muscles]
    crossed = {
        model.coordinate_names[int(j)]
        for m, j in zip(paths.arm_muscle, paths.arm_coordinate, strict=True)
        if int(m) in measured
    }
    known = np.isfinite(target.activations).any(axis=1)
    for name, values in zip(tension.reserve_names, tension.reserves.T, strict=True):
        coordinate = name.removeprefix(RESERVE)
        if (
            not name.startswith(RESERVE)
            or coordinate not in crossed
            or coordinate not in tension.coordinates
        ):
            continue
        wanted = tension.torques[:, tension.coordinates.index(coordinate)]
        largest = float(np.nanmax(np.abs(wanted), initial=0.0))
        borne = np.where(known, np.abs(values), 0.0)
        limit = max(BORNE * largest, 1e-9)
        yield from _stretches(tension.time, borne, limit, ("", coordinate), (wanted, values))


def _stretches(
    time: Array, apart: Array, limit: float, names: tuple[str, str], values: tuple[Array, Array]
) -> Iterator[EmgConflict]:
    """Stretches in which what is apart (frames,) is beyond a limit; `values`: by EMG and by the
    solution (frames,).
    """
    for first, stop in runs(np.nan_to_num(apart) > limit):
        if time[stop - 1] - time[first] >= SHORTEST:
            worst = first + int(np.argmax(apart[first:stop]))
            times = time[[first, stop - 1, worst]].tolist()
            yield EmgConflict(*names, *times, *(float(item[worst]) for item in values))


def conflict_line(conflicts: Sequence[EmgConflict], table: str) -> tuple[str, ...]:
    """One line for all conflicts, the largest first; () for none."""
    muscles = sorted(
        (conflict for conflict in conflicts if conflict.muscle),
        key=lambda conflict: -abs(conflict.found - conflict.emg),
    )
    reserves = sorted(
        (conflict for conflict in conflicts if conflict.coordinate),
        key=lambda conflict: -abs(conflict.found),
    )
    parts = []
    names = dict.fromkeys(muscle.muscle for muscle in muscles)
    if names:
        worst = [
            next(muscle for muscle in muscles if muscle.muscle == name) for name in list(names)[:3]
        ]
        text = ", ".join(
            f"{conflict.muscle} {conflict.found:.2f} where EMG says {conflict.emg:.2f} at"
            f" {conflict.worst:.3g} s"
            for conflict in worst
        )
        parts.append(
            f"{len(names)} muscles leave their EMG ({text}{' ...' if len(names) > 3 else ''})"
        )
    joints = dict.fromkeys(reserve.coordinate for reserve in reserves)
    if joints:
        one = reserves[0]
        parts.append(
            f"reserves of {len(joints)} coordinates bear what EMG leaves ({one.coordinate}"
            f" {abs(one.found):.3g} of {abs(one.emg):.3g} at {one.worst:.3g} s)"
        )
    return (
        (f"EMG and torques contradict each other: {'; '.join(parts)}; see {table}",)
        if parts
        else ()
    )
