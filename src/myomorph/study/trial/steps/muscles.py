"""Muscle lengths, velocities and moment arms of a motion, straight into files: memory does not grow with frames."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.io.sto import write_sto
from myomorph.model.arrays import Array, read_only
from myomorph.model.errors import BadModel
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.functions import PiecewisePolynomial
from myomorph.model.model import Model
from myomorph.model.series import Motion, Series, Table
from myomorph.muscles.coupled_arms import LoopGroup, loop_couplings, loop_groups
from myomorph.muscles.path import Paths, compile_paths
from myomorph.report.trial.given import MusclePaths, ReportInput
from myomorph.rigid.coordinates import Ints
from myomorph.store import stored as store
from myomorph.store.progress import progress
from myomorph.store.results import ResultWriter, Stored, file_name
from myomorph.store.settings import Differentiation
from myomorph.study.trial.step import Step, StepOutput
from myomorph.study.trial.steps.id import Torques, with_derivatives
from myomorph.study.trial.steps.ik import Poses
from myomorph.study.trial.trial_inputs import EXTREMES, OptionSet, Signals, TrialInputs, all_drawn

BLOCK = 512
"""Frames that are in memory at a time."""


@read_only
@dataclass(frozen=True, eq=False)
class Crossings:
    """The pairs of a muscle and a coordinate that can have a moment arm, and how to fill them.

    Attributes
    ----------
    muscle, coordinate : (pairs,) indices; the first pairs are those of `Paths.arm_muscle`
    followers : of each coupler, the pairs of its dependent coordinate and, for each of its two sources,
        the pairs they follow; -1 for none
    loops : groups of coordinates that closed loops tie together, each with (muscles, group) pairs of the muscles
        that cross it
    order : (pairs,) by coordinate, then muscle
    """

    muscle: Ints
    coordinate: Ints
    followers: tuple[tuple[Ints, tuple[Ints, Ints]], ...]
    loops: tuple[tuple[LoopGroup, Ints], ...]
    order: Ints


def crossings(paths: Paths) -> Crossings:
    """Pairs that the paths' pattern holds, and those of dependent coordinates with what their sources move."""
    pairs = {
        pair: i for i, pair in enumerate(zip(paths.arm_coordinate.tolist(), paths.arm_muscle.tolist(), strict=True))
    }
    by_coordinate: dict[int, list[int]] = {}
    for coordinate, muscle in pairs:
        by_coordinate.setdefault(coordinate, []).append(muscle)
    tree = paths.tree.arrays
    followers = []
    for dependent, sources in zip(tree.coupler_coordinate.tolist(), tree.coupler_source.tolist(), strict=True):
        muscles = sorted({muscle for source in sources for muscle in by_coordinate.get(source, ())})
        for muscle in muscles:
            if (dependent, muscle) not in pairs:
                pairs[dependent, muscle] = len(pairs)
                by_coordinate.setdefault(dependent, []).append(muscle)
        own = np.array([pairs[dependent, muscle] for muscle in muscles], np.int64)
        led = tuple(np.array([pairs.get((source, muscle), -1) for muscle in muscles], np.int64) for source in sources)
        followers.append((own, (led[0], led[1])))
    loops = []
    for group in loop_groups(paths.tree):
        members = group.coordinates.tolist()
        muscles = sorted({muscle for one in members for muscle in by_coordinate.get(one, ())})
        for muscle, coordinate in product(muscles, members):
            pairs.setdefault((coordinate, muscle), len(pairs))
        table = [[pairs[coordinate, muscle] for coordinate in members] for muscle in muscles]
        loops.append((group, np.array(table, np.int64).reshape(-1, len(members))))
    coordinates, crossed = np.array(list(pairs), np.int64).reshape(-1, 2).T
    order = np.lexsort((crossed, coordinates))
    return Crossings(crossed, coordinates, tuple(followers), tuple(loops), order)


def coupler_slopes(paths: Paths, coordinates: Array) -> Array:
    """(frames, couplers, 2) derivatives of dependent coordinates in what they follow; 0 where not a polynomial."""
    model, tree = paths.tree.model, paths.tree.arrays
    slopes = np.zeros((len(coordinates), len(tree.coupler_coordinate), 2))
    for k, (dependent, source) in enumerate(zip(tree.coupler_coordinate, tree.coupler_source[:, 0], strict=True)):
        function = model.dependent_coordinates[model.coordinate_names[dependent]].function
        if isinstance(function, PiecewisePolynomial) and source >= 0:
            slopes[:, k, 0] = function(coordinates[:, source], 1)
    return slopes


def arms_as_reported(paths: Paths, pattern: Crossings, coordinates: Array, arms: Array) -> Array:
    """Moment arms (frames, pairs in `order`) as OpenSim reports them; see `MuscleKinematics.dense`."""
    table = np.zeros((len(arms), len(pattern.muscle) + 1))
    table[:, : arms.shape[1]] = arms
    slopes = coupler_slopes(paths, coordinates)
    for k, (own, led) in enumerate(pattern.followers):
        square = (slopes[:, k] ** 2).sum(axis=1)
        moves = square > 0.0
        reached = sum(slopes[:, k, s, None] * table[:, led[s]] for s in range(2))
        table[np.ix_(moves, own)] = (reached / np.where(moves, square, 1.0)[:, None])[moves]
    for group, pairs in pattern.loops:
        couplings = loop_couplings(paths.tree, group, coordinates)
        table[:, pairs] = np.einsum("fml,flk->fmk", table[:, pairs[:, group.leading]], couplings)
    return table[:, pattern.order]


def write_muscles(model: Model, motion: Motion, writer: ResultWriter, folder: Path, title: str) -> None:
    """Write `lengths.sto`, `velocities.sto` and `moment_arms_<coordinate>.sto`, and the same into a result.

    Only pairs of a muscle and a coordinate that can have a moment arm are computed and written; a
    coordinate that no muscle crosses gets no file. Frames without coordinates (NaN) stay NaN.

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
    paths = compile_paths(model)
    tree = paths.tree
    pattern = crossings(paths)
    names = [
        (model.muscle_names[pattern.muscle[i]], model.coordinate_names[pattern.coordinate[i]]) for i in pattern.order
    ]
    stored = _variables(writer, model, motion, names)
    lengths, velocities = (np.empty((len(motion), len(model.muscles))) for _ in range(2))
    columns = {name: i for i, name in enumerate(motion.names)}
    with progress(title, len(motion)) as advance:
        for start in range(0, len(motion), BLOCK):
            part = slice(start, min(start + BLOCK, len(motion)))
            values = tree.coordinates_of(
                replace(motion, time=motion.time[part], values=motion.values[part], velocities=None, accelerations=None)
            )
            rates = np.zeros_like(values)
            for j, name in enumerate(model.coordinate_names):
                if name in columns:
                    rates[:, j] = motion.velocities[part, columns[name]]
            unknown = ~(np.isfinite(values).all(axis=1) & np.isfinite(rates).all(axis=1))
            values[unknown], rates[unknown] = tree.defaults, 0.0
            lengths[part], velocities[part], arms = paths.evaluate(values, rates, advance)
            reported = arms_as_reported(paths, pattern, values, arms)
            for found in (lengths[part], velocities[part], reported):
                found[unknown] = np.nan
            stored[part] = reported
    by_muscle = ("time", "muscle")
    writer.put("muscle_length", by_muscle, lengths, "m", "length of the muscle-tendon path")
    writer.put("muscle_velocity", by_muscle, velocities, "m/s", "lengthening velocity of the muscle-tendon path")
    _table(motion, model.muscle_names, lengths, "Lengths", folder / "lengths.sto")
    _table(motion, model.muscle_names, velocities, "Velocities", folder / "velocities.sto")
    _arm_tables(motion, names, stored, folder)


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
    write_sto(Table(motion.time, names, values, facts=FrozenMap({"name": title})), path)


@dataclass(frozen=True, eq=False)
class MuscleLengths:
    """Lengths and velocities of muscle-tendon paths; moment arms stay in the file.

    Attributes
    ----------
    lengths, velocities : (frames, muscles) [m], [m/s]; None where they are in the file alone
    """

    lengths: Series | None = None
    velocities: Series | None = None
    notes: tuple[str, ...] = ()


def _run(trial: TrialInputs, output: StepOutput, poses: Poses, torques: Torques | None) -> MuscleLengths:
    notes: tuple[str, ...] = ()
    if torques is None:
        motion, notes = with_derivatives(trial, poses.recorded)
        store.put_derivatives(output.writer, motion, trial.model)
    else:
        motion = torques.motion
    write_muscles(trial.model, motion, output.writer, output.folder, f"{trial.name}: muscle paths")
    return MuscleLengths(notes=notes)


def _read(stored: Stored, options: OptionSet) -> MuscleLengths | None:
    lengths = _by_muscle(stored, "muscle_length")
    return None if lengths is None else MuscleLengths(lengths, _by_muscle(stored, "muscle_velocity"))


def _by_muscle(stored: Stored, name: str) -> Series | None:
    values = stored.values.get(name)
    return None if values is None else Series(stored.time, stored.names["muscle"], values)


def _show(given: ReportInput, stored: Stored) -> ReportInput:
    crossed = tuple(dict.fromkeys(stored.names.get("crossing_coordinate", ())))
    if not crossed and given.model is not None and given.model.muscles:
        # No step wrote moment arms: the paths tell which coordinates at least one muscle crosses.
        used = sorted(set(compile_paths(given.model).arm_coordinate.tolist()))
        crossed = tuple(given.model.coordinate_names[j] for j in used)
    shown = MusclePaths(_by_muscle(stored, "muscle_length"), _by_muscle(stored, "muscle_velocity"), crossed)
    return replace(given, muscles=shown)


def _signals(stored: Stored, model: Model, mass: float) -> Sequence[Signals]:
    lengths = _by_muscle(stored, "muscle_length")
    if lengths is None:
        return ()
    return (all_drawn("muscles", lengths, "_length", "m", EXTREMES, "muscle length [mm]", 1000.0),)


STEP = Step(
    name="muscles",
    title="muscle paths",
    gives=MuscleLengths,
    needs=(Poses,),
    uses=(Torques,),
    options=(Differentiation,),
    grows_with="muscles",
    roles=("model", "markers", "tasks", "motion"),
    run=_run,
    read=_read,
    show=_show,
    signals=_signals,
    large=("moment_arm",),
    tables="muscles",
)
