"""Muscle lengths, velocities and moment arms of a motion, straight into files: memory does not grow with frames."""

from __future__ import annotations

from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np

from myomorph.io.sto import write_sto
from myomorph.model.errors import BadModel
from myomorph.model.model import Model
from myomorph.model.series import Motion, Table
from myomorph.model.spatial import Array
from myomorph.muscles.path import compile_paths
from myomorph.rigid.frames import over_frames
from myomorph.rigid.kinematics import couple_rates_frames
from myomorph.rigid.tree import compile_tree
from myomorph.study.progress import progress
from myomorph.study.results import ResultWriter, file_name

BLOCK = 2048
"""Frames that are in memory at a time."""


def write_muscles(model: Model, motion: Motion, writer: ResultWriter, folder: Path, title: str) -> None:
    """Write `lengths.sto`, `velocities.sto` and `moment_arms_<coordinate>.sto`, and the same into a result.

    Only pairs of a muscle and a coordinate that can have a moment arm are computed and written; a
    coordinate that no muscle crosses gets no file.

    Parameters
    ----------
    motion : with velocities

    Raises
    ------
    BadModel
        where the model has no muscles
    """
    if not model.muscles:
        raise BadModel(f"model '{model.name}' has no muscles")
    if motion.velocities is None:
        raise ValueError("the motion has no velocities")
    tree = compile_tree(model)
    paths = compile_paths(model, tree)
    muscle_of = np.repeat(np.arange(len(model.muscles)), np.diff(paths.start))
    order = np.lexsort((muscle_of, paths.coordinate))
    crossing = [(model.muscle_names[muscle_of[i]], model.coordinate_names[paths.coordinate[i]]) for i in order]
    arms = _variables(writer, model, motion, crossing)
    columns = {name: i for i, name in enumerate(motion.names)}
    values, rates = tree.coordinates_of(motion), np.zeros((len(motion), len(model.coordinates)))
    for j, name in enumerate(model.coordinate_names):
        if name in columns:
            rates[:, j] = motion.velocities[:, columns[name]]
    couple_rates_frames(tree.arrays, values, rates, np.zeros_like(rates))

    lengths, velocities = (np.empty((len(motion), len(model.muscles))) for _ in range(2))
    with progress(title, len(motion)) as advance:
        for start in range(0, len(motion), BLOCK):
            stop = min(start + BLOCK, len(motion))
            entries = np.empty((stop - start, len(order)))

            def part(first: int, last: int, start: int = start, entries: Array = entries) -> None:
                rows = slice(start + first, start + last)
                paths.evaluate(values[rows], rates[rows], lengths[rows], velocities[rows], entries[first:last])

            over_frames(part, stop - start, advance)
            arms[start:stop] = entries[:, order]
    by_muscle = ("time", "muscle")
    writer.put("muscle_length", by_muscle, lengths, "m", "length of the muscle-tendon path")
    writer.put("muscle_velocity", by_muscle, velocities, "m/s", "lengthening velocity of the muscle-tendon path")
    _table(motion, model.muscle_names, lengths, "Lengths", folder / "lengths.sto")
    _table(motion, model.muscle_names, velocities, "Velocities", folder / "velocities.sto")
    _arm_tables(motion, crossing, arms, folder)


def _variables(writer: ResultWriter, model: Model, motion: Motion, crossing: list[tuple[str, str]]) -> Any:
    """The variable of moment arms, its columns the pairs of muscle and coordinate that can have one."""
    writer.time(motion.time)
    writer.names("muscle", model.muscle_names)
    writer.sizes("crossing", len(crossing))
    writer.texts("crossing_muscle", "crossing", [muscle for muscle, _ in crossing])
    writer.texts("crossing_coordinate", "crossing", [coordinate for _, coordinate in crossing])
    meaning = "moment arm -d(length)/d(coordinate) of crossing_muscle about crossing_coordinate"
    return writer.create("moment_arm", ("time", "crossing"), "m", meaning)


def _arm_tables(motion: Motion, crossing: list[tuple[str, str]], arms: Any, folder: Path) -> None:
    """One table a coordinate, its columns the muscles that cross it; pairs are in order of coordinates."""
    start = 0
    while start < len(crossing):
        coordinate = crossing[start][1]
        stop = start
        while stop < len(crossing) and crossing[stop][1] == coordinate:
            stop += 1
        names = tuple(muscle for muscle, _ in crossing[start:stop])
        title = f"Moment arms about {coordinate}"
        _table(motion, names, arms[:, start:stop], title, folder / f"moment_arms_{file_name(coordinate)}.sto")
        start = stop


def _table(motion: Motion, names: tuple[str, ...], values: Array, title: str, path: Path) -> None:
    write_sto(Table(motion.time, names, values, facts=MappingProxyType({"name": title})), path)
