"""What EMG and torques cannot both have, in result files."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.store.results import ResultWriter, Stored
from myomorph.tension.emg_conflicts import EmgConflict

PLACE = "emg_conflict"
NUMBERS = {
    "start": ("s", "begin of a stretch in which EMG and torques contradict each other"),
    "stop": ("s", "its end"),
    "worst": ("s", "when they are farthest apart"),
    "emg": ("1", "activation by EMG then, or torque wanted where a reserve bears it"),
    "found": ("1", "activation of the solution then, or torque of the reserve"),
}


def put_conflicts(writer: ResultWriter, conflicts: Sequence[EmgConflict]) -> None:
    """Write conflicts, none of them too: an empty table says that EMG took part and nothing contradicts it."""
    writer.sizes(PLACE, len(conflicts))
    for name in ("muscle", "coordinate"):
        writer.texts(f"{PLACE}_{name}", PLACE, [getattr(conflict, name) for conflict in conflicts])
    for name, (unit, meaning) in NUMBERS.items():
        values = np.array([getattr(conflict, name) for conflict in conflicts], dtype=np.float64)
        writer.put(f"{PLACE}_{name}", (PLACE,), values, unit, meaning)


def get_conflicts(stored: Stored) -> tuple[EmgConflict, ...] | None:
    """What `put_conflicts` wrote, None where EMG took no part."""
    if f"{PLACE}_start" not in stored.values:
        return None
    numbers = zip(*(stored.values[f"{PLACE}_{name}"].tolist() for name in NUMBERS), strict=True)
    muscles, coordinates = (stored.names[f"{PLACE}_{name}"] for name in ("muscle", "coordinate"))
    return tuple(
        EmgConflict(muscle, coordinate, *values)
        for muscle, coordinate, values in zip(muscles, coordinates, numbers, strict=True)
    )
