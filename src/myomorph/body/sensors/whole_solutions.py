"""Ways to read a recording of sensors, each solved to its end: the least residual is taken.

A recording that fits as it is labelled is taken so, and nothing else is tried. One that does not is
read with other conventions of its quaternions and with two sensors exchanged; last, each is left
out in turn, and one that so turns out to be wrong is tried with a heading of its own. What is
decisive is taken and named. What is not is named alone.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.body.causes import SENSOR_READING
from myomorph.body.sensors.arrangement import (
    Arrangement,
    exchanges,
    other_conventions,
    removals,
)
from myomorph.body.sensors.mounting_search import EVIDENCE, Draft, MountingSearch, SolvedMounting
from myomorph.body.sensors.steps import largest_step
from myomorph.core.model.errors import BadData, few
from myomorph.core.model.messages import Message
from myomorph.core.model.spatial import rotation_from_vector, vector_from_rotation
from myomorph.core.rigid.tree import compile_tree

MAX_COST = 1.2
"""A recording of which more is left, against noise of the size that the options state, does not fit
as it is labelled.
"""
MAX_LEFT = 2.0  # A recording of which more is left, and that nothing explains, is reported
SOLVED = 2  # Readings of the least rough cost that are solved to their end
MIN_SENSORS = 4  # With fewer, leaving one out explains anything
MAX_APART = 2  # Sensors that rotate about other axes may each have a heading of their own
HEADINGS = 12  # Of a single sensor, round the circle, that are tried
BETWEEN_FAULTS = 10.0
"""By so much, in squares of the noise, one fault has to explain more than another: with thigh and
shank exchanged, a slip of the shank by 41 degrees leaves 31 more.
"""
STEP_ROUNDS = 6
STEP_FACTOR = 1.6
"""Poses take a part of a step on themselves: it is turned back by more than is seen, several times.
"""
REFINED = 4  # Times that the step between them is halved about the best


@dataclass(frozen=True, kw_only=True, eq=False)
class WholeSolution:
    """A reading of a recording, solved to its end.

    Attributes
    ----------
    arrangement : the reading
    search : of the recording read so
    solved : mounting, and what it leaves
    draft : by few frames, of which `solved` is; None where the recording has no part in it
    """

    arrangement: Arrangement
    search: MountingSearch
    solved: SolvedMounting
    draft: Draft | None = None

    @property
    def excess(self) -> float:
        """What is left, against what noise of the stated size would leave."""
        misfit = self.solved.misfit
        return misfit.cost / max(misfit.freedom, 1.0)

    @property
    def fits(self) -> bool:
        """Whether noise explains what is left, no sensor slipped, and the heading is clear."""
        sure = not self.solved.ambiguous and not self.solved.misfit.slipped
        return sure and self.excess < MAX_COST

    def explains_better(self, other: WholeSolution, evidence: float = EVIDENCE) -> bool:
        """Whether it leaves so much less than another reading that chance does not make it.

        Parameters
        ----------
        other : reading
        evidence : by how much less, in squares of the noise
        """
        gain = other.solved.misfit.total - self.solved.misfit.total
        return gain > evidence * max(self.excess, 1.0)

    def replaces(self, labelled: WholeSolution) -> bool:
        """Whether it is decisively better, and noise explains what it leaves."""
        return self.explains_better(labelled) and self.excess < MAX_COST

    def explains_slip(self, labelled: WholeSolution) -> bool:
        """Whether it replaces the recording as labelled, also where a slip explains that.

        A slip is a fault as the other reading is, so that less decides between them.
        """
        if not labelled.solved.misfit.slipped:
            return self.replaces(labelled)
        return self.explains_better(labelled, BETWEEN_FAULTS) and self.excess < MAX_COST

    def on_all_frames(self, labelled: MountingSearch) -> WholeSolution:
        """Solve the reading on all frames of the recording.

        Parameters
        ----------
        labelled : search of the recording as it is labelled
        """
        search = _read(labelled, self.arrangement)
        if self.draft is None:
            return self
        return replace(self, search=search, solved=search.on_all_frames(self.draft), draft=None)

    def noted(self, *notes: Message) -> WholeSolution:
        """Add messages to the mounting."""
        mounting = self.solved.mounting
        mounting = replace(mounting, notes=(*notes, *mounting.notes))
        return replace(self, solved=self.solved._replace(mounting=mounting))


def whole_solution(search: MountingSearch, anywhere: bool, conventions: bool) -> WholeSolution:
    """Find the reading of a recording that leaves least, where it is decisive.

    Parameters
    ----------
    search : of the recording as it is labelled
    anywhere : whether each sensor has a heading of its own
    conventions : whether its orientations are a file's, so that they may mean something else

    Returns
    -------
    the reading that is taken, with what looks wrong

    Raises
    ------
    BadData : nothing says how the sensors are mounted, or a heading is not known
    UnknownName : a sensor, an axis or a frame of the model is unknown
    """
    few = _on_few_frames(search, Arrangement(), anywhere, slips=True)
    stepped = _with_step(few)
    if stepped is not None:
        note = _message(f"{stepped.arrangement.words}: turned back from there on", [stepped], few)
        return stepped.on_all_frames(search).noted(note)
    if few.fits:
        return few.on_all_frames(search)
    other = _other_reading(few, anywhere, conventions)
    if other is not None:
        return other.taken.on_all_frames(search).noted(*other.notes)
    labelled = few.on_all_frames(search)
    return labelled if labelled.excess < MAX_LEFT else labelled.noted(_of_misfit(labelled))


class _OtherReading(NamedTuple):
    """A reading that is taken, by few frames.

    Attributes
    ----------
    taken : the reading; that of the labels where two others are too near to each other
    notes : that say so
    """

    taken: WholeSolution
    notes: tuple[Message, ...]


def _other_reading(
    labelled: WholeSolution, anywhere: bool, conventions: bool
) -> _OtherReading | None:
    """Compare all readings of a recording that does not fit as it is labelled, on few frames.

    Parameters
    ----------
    labelled : the recording as it is labelled
    anywhere : whether each sensor has a heading of its own
    conventions : whether its orientations are a file's, so that they may mean something else

    Returns
    -------
    None where none is decisively better
    """
    search = labelled.search
    names = search.sensors.names
    readings = exchanges(compile_tree(search.model), names, search.bodies)
    if conventions:
        readings += other_conventions()
    found = _solved(search, readings, anywhere)
    free = _turned_since_the_pose(search, anywhere) if _by_pose(search) else labelled
    decisive = [one for one in found if one.explains_slip(free)]
    apart = search.apart()
    if not anywhere and 0 < len(apart) <= MAX_APART:
        turned = [_with_own_heading(labelled, name) for name in apart]
        decisive += [one for one in turned if one.replaces(labelled)]
    if decisive:
        return _taken(sorted(decisive, key=lambda one: one.solved.misfit.total), labelled)
    return _removal(labelled, anywhere)


def _by_pose(search: MountingSearch) -> bool:
    """Return whether the calibration pose alone says how sensors are mounted."""
    return search.sizes.imu_mounting == "pose"


def _turned_since_the_pose(search: MountingSearch, anywhere: bool) -> WholeSolution:
    """Solve a recording that is mounted by its pose as if sensors may have turned since then.

    What that explains is no other sensor's place.
    """
    sizes = replace(search.recording.sizes, imu_mounting="recording")
    free = replace(search, recording=replace(search.recording, sizes=sizes))
    return _on_few_frames(free, Arrangement(), anywhere, slips=True)


def _removal(labelled: WholeSolution, anywhere: bool) -> _OtherReading | None:
    """Leave out one sensor, or two, whose errors are far above the noise; see `_other_reading`.

    Where the pose alone or the model says how sensors are mounted, one that was turned since then
    errs as a loose one does, and is still worth more than none.
    """
    search = labelled.search
    names = search.sensors.names
    by_recording = search.sizes.imu_mounting == "recording"
    if len(names) < MIN_SENSORS or labelled.excess < MAX_COST or not by_recording:
        return None
    without = _solved(search, removals(names), anywhere)
    if without and without[0].replaces(labelled):
        return _without_one(without, labelled)
    if not without or len(names) == MIN_SENSORS:
        return None
    first = without[0].arrangement.left_out
    pairs = [
        replace(one, left_out=(*first, *one.left_out))
        for one in removals(names)
        if one.left_out != first
    ]
    two = _solved(search, pairs, anywhere)
    # Without two sensors less holds the body: what is left has to say which way it faces.
    if two and two[0].replaces(labelled) and not two[0].solved.ambiguous:
        return _without_one(two[:1], labelled)
    return None


def _with_step(labelled: WholeSolution) -> WholeSolution | None:
    """Turn a sensor back whose errors step at one moment, where that is decisive.

    Parameters
    ----------
    labelled : the recording as it is labelled

    Returns
    -------
    None where none does
    """
    misfit = labelled.solved.misfit
    step = largest_step(misfit.time, misfit.errors)
    if step is None or labelled.draft is None or labelled.search.tracked.fit is not None:
        return None
    name = labelled.search.sensors.names[step.sensor]
    back = np.eye(3)
    solution = labelled
    for _ in range(STEP_ROUNDS):
        misfit = solution.solved.misfit
        later = misfit.time > step.time
        errors = misfit.errors[:, step.sensor]
        seen = np.nanmean(errors[later], axis=0) - np.nanmean(errors[~later], axis=0)
        mounted = solution.solved.mounting.rotations[step.sensor]
        back = back @ rotation_from_vector(STEP_FACTOR * mounted.T @ seen)
        reading = Arrangement(
            stepped=name,
            step_time=step.time,
            step=tuple(vector_from_rotation(back).tolist()),
        )
        solution = _near(labelled, reading)
    return solution if solution.replaces(labelled) else None


def _near(labelled: WholeSolution, reading: Arrangement) -> WholeSolution:
    """Solve a reading from where the recording as it is labelled ended, on few frames."""
    assert labelled.draft is not None
    read = _read(labelled.search, reading)
    draft = labelled.draft._replace(slipped=frozenset())
    solved = read.on_all_frames(draft)
    return WholeSolution(
        arrangement=reading, search=read, solved=solved, draft=draft._replace(solved=solved)
    )


def _with_own_heading(labelled: WholeSolution, name: str) -> WholeSolution:
    """Solve the recording with the best heading of its own for one sensor to its end."""
    search = labelled.search
    # The heading of the others, which the wrong one has no part in.
    others = _on_few_frames(search, Arrangement(left_out=(name,)), anywhere=False)
    common = (float(np.median(others.solved.mounting.headings[0])),)

    def tried(angle: float) -> tuple[float, float]:
        reading = Arrangement(turned=name, angle=angle)
        return _read(search, reading).rough_cost(anywhere=False, angles=common), angle

    step = 2.0 * np.pi / HEADINGS
    best = min(tried(step * number) for number in range(HEADINGS))
    for _ in range(REFINED):
        step *= 0.5
        best = min(best, tried(best[1] - step), tried(best[1] + step))
    return _on_few_frames(search, Arrangement(turned=name, angle=best[1]), anywhere=False)


def _solved(
    search: MountingSearch, readings: Sequence[Arrangement], anywhere: bool
) -> list[WholeSolution]:
    """Solve the readings that look best to their ends.

    Parameters
    ----------
    search : of the recording as it is labelled
    readings : that are tried
    anywhere : whether each sensor has a heading of its own

    Returns
    -------
    the best first
    """
    rough = list[tuple[float, int]]()
    for index, reading in enumerate(readings):
        try:
            rough.append((_read(search, reading).rough_cost(anywhere), index))
        except BadData:
            # A named axis may stand upright in another reading: it is none.
            continue
    solutions = [
        _on_few_frames(search, readings[index], anywhere) for _, index in sorted(rough)[:SOLVED]
    ]
    return sorted(solutions, key=lambda one: one.solved.misfit.total)


def _on_few_frames(
    search: MountingSearch, reading: Arrangement, anywhere: bool, slips: bool = False
) -> WholeSolution:
    """Solve one reading of a recording on few frames."""
    read = _read(search, reading).coarse
    if read.sizes.imu_mounting != "recording":
        solved = read.solution(anywhere)
        return WholeSolution(arrangement=reading, search=read, solved=solved)
    draft = read.on_few_frames(anywhere, slips)
    return WholeSolution(arrangement=reading, search=read, solved=draft.as_solved(), draft=draft)


def _read(search: MountingSearch, reading: Arrangement) -> MountingSearch:
    """Set the search of a recording read another way."""
    names = search.sensors.names
    bodies = tuple(
        body
        for name, body in zip(names, search.bodies, strict=True)
        if name not in reading.left_out
    )
    return replace(search, recording=reading.read(search.recording), bodies=bodies)


def _taken(found: Sequence[WholeSolution], labelled: WholeSolution) -> _OtherReading:
    """Take the best reading where no other is near, else name both.

    Parameters
    ----------
    found : the best first
    labelled : the recording as it is labelled
    """
    best = found[0]
    near = [one for one in found[1:] if not best.explains_better(one)]
    text = (
        f"the recording fits with {best.arrangement.words}, which leaves {_left(best)} in the place"
        f" of {_left(labelled)}"
    )
    if near:
        words = " or ".join(one.arrangement.words for one in near)
        text = (
            f"{text}, and nearly as well with {words}: used as labelled, and angles beside"
            " these sensors are wrong"
        )
        return _OtherReading(labelled, (_message(text, [best, *near], labelled),))
    return _OtherReading(best, (_message(f"{text}: used so", [best], labelled),))


def _without_one(without: Sequence[WholeSolution], labelled: WholeSolution) -> _OtherReading:
    """Leave a sensor out whose errors are far above the noise, or name those that may be wrong.

    Parameters
    ----------
    without : the recording without each of some sensors, the best first
    labelled : the recording as it is labelled
    """
    best = without[0]
    near = [one for one in without[1:] if not best.explains_better(one)]
    if near:
        names = [name for one in (best, *near) for name in one.arrangement.left_out]
        text = (
            f"sensors {few(names)} do not agree, and the recording does not determine which of them"
            " is wrong: angles beside them are wrong. Leave one out (--imu-bodies SENSOR=-)"
        )
        return _OtherReading(labelled, (_message(text, [best, *near], labelled),))
    removed = best.arrangement.left_out
    if len(removed) == 1:
        turned = _with_own_heading(labelled, removed[0])
        if turned.replaces(labelled):
            return _taken([turned], labelled)
    subject = f"sensor {removed[0]} does"
    if len(removed) > 1:
        subject = f"sensors {few(removed)} do"
    text = (
        f"{subject} not fit the others at all: left out, which"
        f" leaves {_left(best)} in the place of {_left(labelled)}"
    )
    return _OtherReading(best, (_message(text, [best], labelled),))


def _of_misfit(labelled: WholeSolution) -> Message:
    """Say that nothing explains a recording."""
    worst = int(np.nanargmax(labelled.solved.misfit.by_sensor))
    name = labelled.search.sensors.names[worst]
    text = (
        f"sensors and model do not fit (misfit {labelled.excess:.1f} of 1), sensor {name} least,"
        " and neither another sensor's place nor another meaning of the quaternions explains it"
    )
    return SENSOR_READING.message(text, place=name, size=labelled.excess)


def _message(text: str, readings: Sequence[WholeSolution], labelled: WholeSolution) -> Message:
    """Make a message of readings, with the sensors that they are of."""
    names = dict.fromkeys(name for one in readings for name in one.arrangement.sensors)
    return SENSOR_READING.message(text, place=few(names), size=labelled.excess)


def _left(solution: WholeSolution) -> str:
    """Say what is left, against noise of the stated size."""
    return f"a misfit of {solution.excess:.1f}"
