"""State of OpenSim's AnalyzeTool at each frame.

It consists of motion, states of muscles, forces and what these cause.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from pathlib import Path

import numpy as np

from myomorph.core.io.sto import read_sto
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Actuator, Model
from myomorph.core.model.series import Motion, Series, Table, Wrenches
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.splines import natural_spline
from myomorph.core.motion.sync import resample_wrenches
from myomorph.core.muscles.coupled_arms import ANGULAR_SPEEDS
from myomorph.core.muscles.fiber_states import (
    FiberStates,
    fiber_states,
    state_names,
    without_fibers,
)
from myomorph.core.muscles.kinematics import MuscleKinematics, muscle_kinematics
from myomorph.core.rigid.dynamics import motion_arrays
from myomorph.core.rigid.loops import closed_motion
from myomorph.core.rigid.tree import Tree, compile_tree
from myomorph.core.tension.reaction import caused_motion
from myomorph.exchange.causes import SETUPS
from myomorph.exchange.opensim.outputs import needed
from myomorph.exchange.opensim.tool_setups import AnalyzeSetup
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs import reading
from myomorph.lab.study.inputs.external_forces import read_loads

# A frame that follows within this share of the usual step stands at the time of the one before.
TWIN = 1e-6
# Frames that OpenSim makes of uneven ones at most, those it adds before and after included.
MAX_FRAMES = 100_000
# External forces of a setup act as OpenSim takes them.
AS_GIVEN = ForceOptions(force_checks="report")
States = Mapping[tuple[str, str], Array]

Tables = dict[str, Table]

Result = tuple[Tables, str, tuple[Message, ...]]
"""What an analysis gives: tables by the ends of their names, one line for the terminal, and
warnings.
"""


@dataclass(frozen=True, eq=False)
class Analyzed:
    """A model in a motion, as analyses see it."""

    # with the muscles and actuators that take part: without its own forces where the setup replaces
    # them
    model: Model
    actuators: tuple[Actuator, ...]  # those that the setup adds
    recorded: Motion  # the whole motion as the file has it
    motion: Motion  # the frames analysed, with velocities and accelerations
    first: int  # number of the first of them in the file
    # (frames,) states of muscles by muscle and name that the file holds
    stored: States = field(default_factory=lambda: FrozenMap({}))
    balanced: bool = False  # whether muscles are put into equilibrium first
    loads: Path | None = None  # the file of external forces

    def every(self, step: int) -> Analyzed:
        """Return the frames that OpenSim takes of these, see `stepped`."""
        frames = stepped(self.first, len(self.motion), step)
        if len(frames) == len(self.motion):
            return self
        stored = {key: values[frames] for key, values in self.stored.items()}
        return replace(self, motion=self.motion.frames(frames), stored=stored)

    @cached_property
    def tree(self) -> Tree:
        """Of the model."""
        return compile_tree(self.model)

    @cached_property
    def arrays(self) -> tuple[Array, Array, Array]:
        """Coordinates, rates and accelerations (frames, coordinates) of the motion."""
        return motion_arrays(self.tree, self.motion)

    def table(
        self, names: Sequence[str], values: Array, title: str, in_degrees: bool = False
    ) -> Table:
        """Return a table of the motion's frames under OpenSim's column titles.

        Parameters
        ----------
        names : of the columns
        values : (frames, columns)
        title : of the table
        in_degrees : whether angles are in degrees

        Returns
        -------
        table
        """
        facts = FrozenMap({"name": title})
        return Table(self.motion.time, tuple(names), values, in_degrees=in_degrees, facts=facts)

    @cached_property
    def wrenches(self) -> Wrenches | None:
        """External forces at the motion's times."""
        return loads_at(self.loads, self.model, self.recorded, self.motion)

    @cached_property
    def paths(self) -> MuscleKinematics:
        """Lengths, velocities and moment arms of the muscles."""
        return muscle_kinematics(self.model, self.motion)

    @property
    def without_fibers(self) -> tuple[str, ...]:
        """Classes of muscles whose fibers are not built."""
        return without_fibers(self.model)

    @cached_property
    def _fibers(self) -> tuple[FiberStates, States]:
        assert self.paths.muscle_velocity is not None
        return fiber_states(
            self.model,
            self.paths.muscle_length,
            self.paths.muscle_velocity,
            self.stored,
            self.balanced,
        )

    @property
    def fibers(self) -> FiberStates:
        """Fibers and tendons of the muscles."""
        return self._fibers[0]

    @property
    def unbalanced(self) -> tuple[Message, ...]:
        """A line where muscles found no equilibrium."""
        missing = ~self.fibers.in_balance
        if not missing.any():
            return ()
        names = [
            name
            for name, gone in zip(
                self.model.muscle_names, np.atleast_1d(missing.any(axis=0)), strict=True
            )
            if gone
        ]
        return (
            SETUPS.message(
                f"no equilibrium of {quoted(names)} in {int(missing.sum())} of {missing.size}"
                " fibers and frames: the given fiber lengths are kept there, as in OpenSim"
            ),
        )

    @property
    def states(self) -> States:
        """States of muscles by muscle and name, those in equilibrium included."""
        return self._fibers[1]

    @cached_property
    def forces(self) -> Series | None:
        """Return forces of muscles and actuators that are switched on.

        Without controls actuators do nothing.
        """
        helpers = [
            actuator.name
            for actuator in (*self.model.actuators, *self.actuators)
            if actuator.enabled
        ]
        muscles = [index for index, muscle in enumerate(self.model.muscles) if muscle.enabled]
        if not helpers and not muscles:
            return None
        pulls = self.fibers.tendon_force[:, muscles] if muscles else np.zeros((len(self.motion), 0))
        names = (*(self.model.muscle_names[muscle] for muscle in muscles), *helpers)
        return Series(
            self.motion.time, names, np.hstack([pulls, np.zeros((len(self.motion), len(helpers)))])
        )

    @cached_property
    def caused(self) -> Motion:
        """Return the motion with the accelerations that all forces together cause.

        These are what OpenSim reports.
        """
        reading.has_mass(self.model, "accelerations")
        return caused_motion(self.model, self.motion, self.forces, self.wrenches, self.actuators)


def analyzed(
    setup: AnalyzeSetup, model: Model, actuators: tuple[Actuator, ...], source: Path
) -> tuple[Analyzed, list[Message]]:
    """Return the model in the motion that a setup names, and notes of what was odd about it.

    OpenSim takes a file of states row by row; of a file of coordinates it filters and
    differentiates, and its muscles stand at their default states.
    """
    path = needed(setup.states or setup.coordinates, "coordinates_file", source)
    notes = []
    if setup.states is not None and setup.coordinates is not None:
        notes.append(SETUPS.message("coordinates_file is left out: there is a states_file"))
    everything, odd = reading.read_noted_motion(path, model)
    notes += odd
    kept = _apart(everything.time)
    recorded = everything.frames(kept)
    cutoff = setup.cutoff if setup.states is None else None
    if cutoff is not None:
        even = _at_even_times(recorded, path, notes)
        if even is not recorded:
            everything = recorded = even
            kept = np.ones(len(even), bool)
    # As OpenSim's tool, which assembles the model in every frame; its InverseDynamicsTool does not.
    whole, gaps = closed_motion(model, differentiate(recorded, cutoff))
    notes += gaps
    whole = with_twins(whole, everything, kept)
    if setup.states is not None:
        whole = with_speeds(read_sto(path), model, whole)
    motion = indexed_frames(whole, setup.time_range, path)
    first = int(np.searchsorted(whole.time, motion.time[0]))
    frames = slice(first, first + len(motion))
    stored = stored_states(read_sto(path), model, frames) if setup.states is not None else {}
    notes += _of_default_fibers(setup, model)
    taking_part = model
    if setup.replace_forces:
        taking_part = replace(model, muscles=(), actuators=(), passive_torques=(), bushings=())
    return (
        Analyzed(
            model=taking_part,
            actuators=actuators,
            recorded=recorded,
            motion=motion,
            first=first,
            stored=stored,
            balanced=setup.equilibrium,
            loads=setup.loads,
        ),
        notes,
    )


def _apart(time: Array) -> np.ndarray:
    """Return whether each time (frames,) comes later than the one before.

    Integrators log frames at the time of the one before, which no spline bears.
    """
    steps = np.diff(time)
    if not len(steps):
        return np.array([True])
    return np.concatenate([[True], steps > TWIN * np.median(steps)])


def _at_even_times(recorded: Motion, path: Path, notes: list[Message]) -> Motion:
    """Interpolate a motion to even times, with a note, where its frames are uneven.

    OpenSim's filter makes uneven frames even, and what it writes has those.
    """
    time = even_times(recorded.time)
    if time is recorded.time:
        return recorded
    notes.append(
        SETUPS.message(
            f"{path.name}: {len(recorded)} uneven frames became {len(time)} even ones for the"
            " filter",
            severity="good to know",
        )
    )
    spline = natural_spline(recorded.time, recorded.values)
    return replace(recorded, time=time, values=spline(time))


def _of_default_fibers(setup: AnalyzeSetup, model: Model) -> list[Message]:
    """Report that states of muscles are the model's defaults, where they are."""
    if setup.states is not None or setup.equilibrium or setup.replace_forces or not model.muscles:
        return []
    return [
        SETUPS.message(
            "no states_file, and equilibrium is not requested: fibers and forces of muscles"
            " are those of the model's default activations and fiber lengths, as in OpenSim;"
            " lengths and moment arms do not depend on them"
        )
    ]


def even_times(time: Array) -> Array:
    """Return the times where their steps are equal, else even ones, as OpenSim's filter has them.

    Those start half the file's frames before it, mirrored, with its smallest step, and are at most
    `MAX_FRAMES`.

    Parameters
    ----------
    time : (frames,) of the file [s]

    Returns
    -------
    (n,) times within those of the file [s]
    """
    step = np.diff(time)
    if len(step) < 2 or step.max() - step.min() < 1e-3 * step.mean():
        return time
    pad = len(time) // 2
    start = 2.0 * time[0] - time[pad]
    end = 2.0 * time[-1] - time[-1 - pad]
    width = max(float(step.min()), (end - start) / MAX_FRAMES)
    even = start + width * np.arange(int((end - start) / width) + 1)
    return even[(even >= time[0]) & (even <= time[-1])]


def stepped(first: int, count: int, step: int) -> np.ndarray:
    """Choose the frames that OpenSim analyses: the ends, and every `step`-th of the file.

    Parameters
    ----------
    first : the file's index of the first of these frames
    count : of frames
    step : between frames of the file that are analysed

    Returns
    -------
    (n,) indices of frames
    """
    frames = np.arange(count)
    return frames[(frames == 0) | (frames == count - 1) | ((frames + first) % step == 0)]


def with_twins(motion: Motion, everything: Motion, kept: np.ndarray) -> Motion:
    """Put frames that were left out back into a motion.

    They have their own values, and derivatives of their twins.

    Parameters
    ----------
    motion : of the frames that were kept
    everything : motion of all frames
    kept : (frames,) whether a frame was kept

    Returns
    -------
    motion of all frames
    """
    if kept.all():
        return motion
    rows = np.cumsum(kept) - 1
    values = motion.values[rows]
    if motion.names == everything.names:
        values[~kept] = everything.values[~kept]
    rates = (
        None if rate is None else rate[rows] for rate in (motion.velocities, motion.accelerations)
    )
    velocities, accelerations = rates
    return replace(
        motion,
        time=everything.time,
        values=values,
        velocities=velocities,
        accelerations=accelerations,
    )


def stored_states(table: Table, model: Model, frames: slice) -> dict[tuple[str, str], Array]:
    """Read states of muscles from a table of states, as OpenSim 4 or 3 names them.

    Parameters
    ----------
    table : of states
    model : with the muscles
    frames : of the table to read

    Returns
    -------
    (frames,) values by muscle and state
    """
    columns = {name: index for index, name in enumerate(table.names)}
    result = {}
    for muscle in model.muscles:
        for state in state_names(muscle):
            for name in (
                f"/forceset/{muscle.name}/{state}",
                f"{muscle.name}/{state}",
                f"{muscle.name}.{state}",
            ):
                if name in columns:
                    result[muscle.name, state] = np.array(table.values[frames, columns[name]])
                    break
    return result


def with_speeds(table: Table, model: Model, motion: Motion) -> Motion:
    """Give the motion the speeds that a table of states of the same frames holds.

    Those that it lacks stay. OpenSim's speeds of joints that rotate freely are angular velocities
    and no rates: theirs stay too.
    """
    assert motion.velocities is not None
    turning = {
        name for joint in model.joints if joint.kind in ANGULAR_SPEEDS for name in joint.coordinates
    }
    velocities = motion.velocities.copy()
    for index, name in enumerate(motion.names):
        for column in table.names:
            if name not in turning and (column == f"{name}_u" or column.endswith(f"/{name}/speed")):
                rotates = model.coordinate(name).motion == "rotational"
                velocities[:, index] = table[column] * (
                    np.pi / 180.0 if table.in_degrees and rotates else 1.0
                )
    return replace(motion, velocities=velocities)


def indexed_frames(motion: Motion, span: tuple[float, float], path: Path) -> Motion:
    """Frames from the last at or before the start to the last at or before the end [s]."""
    start, end = overlap(span, motion.time, path)
    first = max(int(np.searchsorted(motion.time, start, side="right")) - 1, 0)
    last = max(int(np.searchsorted(motion.time, end, side="right")) - 1, 0)
    return motion.frames(slice(first, last + 1))


def overlap(span: tuple[float, float], time: Array, path: Path) -> tuple[float, float]:
    """Return the part of a span within the times of a file.

    Parameters
    ----------
    span : start and end [s]
    time : (frames,) of the file [s]
    path : of the file, for the error

    Returns
    -------
    start and end [s]

    Raises
    ------
    BadData : the file has no time within the span
    """
    start = max(span[0], float(time[0]))
    end = min(span[1], float(time[-1]))
    if start > end:
        raise BadData(
            f"{path}: runs from {time[0]:g} to {time[-1]:g} s, not over {span[0]:g} to"
            f" {span[1]:g} s"
        )
    return start, end


def loads_at(path: Path | None, model: Model, recorded: Motion, motion: Motion) -> Wrenches | None:
    """External forces at the motion's times, not filtered."""
    return (
        None
        if path is None
        else resample_wrenches(read_loads(path, model, recorded, options=AS_GIVEN), motion.time)
    )
