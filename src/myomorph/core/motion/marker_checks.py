"""Checks of inverse kinematics: what of a marker recording may not be believed, and its repair.

Before the fit: markers that jump and labels exchanged for some frames show in time alone. After it:
labels exchanged throughout, a marker off its position, coordinates held at their bounds or shown by
no marker, a body that lies. Names that the model does not have show without any frame.
"""

from __future__ import annotations

import difflib
import re
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
import scipy
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import LABELS, MARKERS
from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.findings import Finding, Repair, Span, pairs_text, repaired, times_text
from myomorph.core.model.frozen_map import grouped
from myomorph.core.model.model import Model
from myomorph.core.model.series import Markers
from myomorph.core.motion.doubled_markers import DOUBLED, doubled_findings
from myomorph.core.motion.drawn_markers import drawn_findings
from myomorph.core.motion.gap_filling import bridge
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    KinematicsFit,
    inverse_kinematics,
    pose_problem,
)
from myomorph.core.motion.label_repair import SwapSearch, swap_findings
from myomorph.core.motion.lengths import length_unit
from myomorph.core.motion.lost_frames import FROZEN, LOST, lost_findings
from myomorph.core.motion.marker_influence import hidden_findings, place_findings
from myomorph.core.motion.model_size import size_findings
from myomorph.core.motion.pose_checks import pose_findings
from myomorph.core.motion.sensors.sensor_fit import SensorFit
from myomorph.core.motion.tasks.coordinates import CoordinateTask
from myomorph.core.rigid.loops import free_coordinates
from myomorph.core.rigid.tree import compile_tree

WHOLE = ("mirrored axis", "left and right", "vertical axis")
"""Kinds of findings in view of which a motion judges no forces."""
FEW = 0.5  # Share of the model's markers, and of those recorded, below which too few match
NEAR = 0.8  # Likeness of two names, letters alone, from which one may be meant for the other


@dataclass(frozen=True)
class MarkerCheckOptions:
    """Options of the checks of markers.

    Attributes
    ----------
    repair : correct evident errors: exchange labels back, bridge a jumping marker, leave out frames
        with too few markers; otherwise they are only reported
    """

    repair: bool = True


@dataclass(frozen=True, eq=False)
class CheckedFit:
    """Inverse kinematics of a recording after repairs.

    Attributes
    ----------
    fit : of the repaired recording
    markers : the repaired recording
    findings : what may not be believed, and what was repaired
    sensors : the fit with inertial sensors, None without them
    """

    fit: KinematicsFit
    markers: Markers
    findings: tuple[Finding, ...]
    sensors: SensorFit | None = None


def checked_kinematics(
    model: Model,
    markers: Markers,
    options: InverseKinematicsOptions | None = None,
    checks: MarkerCheckOptions | None = None,
    progress: Callable[[int], None] | None = None,
) -> CheckedFit:
    """Solve inverse kinematics of a recording after repairs, with findings about its labels.

    Parameters
    ----------
    model : of the recorded body
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    options : of inverse kinematics
    checks : whether to repair
    progress : called with the number of frames just done

    Returns
    -------
    the fit, the repaired recording and the findings

    Raises
    ------
    BadData : model and recording share no marker that has a weight, or so few that they cannot
        determine the pose while the others have other names; see `inverse_kinematics`
    """
    options = options or InverseKinematicsOptions()
    checks = checks or MarkerCheckOptions()
    unit = length_unit(compile_tree(model))
    _check_matched(model, markers, options)
    used, in_time = repaired(markers, time_findings(model, markers, unit), checks.repair)
    fit = inverse_kinematics(model, used, options, progress)
    # Which of two labels of one marker is wrong, no label shows.
    sure = checks.repair and not any(item.kind == DOUBLED for item in in_time)
    fit, swapped = swap_findings(model, used, fit, options, SwapSearch(repair=sure))
    used, swapped = repaired(used, swapped, sure)
    problem = pose_problem(compile_tree(model), fit.marker_names, fit.marker_weight, options)
    fit, hidden = repaired(fit, hidden_findings(model, used, fit, problem), checks.repair)
    shared = set(model.marker_names)
    unknown = tuple(name for name in fit.unused_markers if name not in shared)
    findings = [
        *name_findings(fit.missing_markers, unknown, len(fit.marker_names)),
        *swapped,
        *in_time,
        *hidden,
    ]
    # Poses under wrong labels show nothing more.
    if all(finding.repaired for finding in swapped):
        columns = [used.names.index(name) for name in fit.marker_names]
        findings += size_findings(model, fit.marker_names, used.values[:, columns])
        findings += place_findings(model, used, fit, problem, unit)
        findings += pose_findings(model, used, fit, problem, options)
    doubted = replace(fit.motion, findings=doubts_of(findings))
    return CheckedFit(replace(fit, motion=doubted), used, tuple(findings))


def doubts_of(findings: Sequence[Finding]) -> tuple[Finding, ...]:
    """Choose what makes a motion that of a mirrored or fallen body, or ends its clock.

    Parameters
    ----------
    findings : of the markers

    Returns
    -------
    those that were not put right: of the whole recording, without times, and of frames that are
    repeated or missing
    """
    return tuple(
        finding
        for finding in findings
        if not finding.repaired
        and ((finding.kind in WHOLE and not finding.times) or finding.kind in (FROZEN, LOST))
    )


def _check_matched(model: Model, markers: Markers, options: InverseKinematicsOptions) -> None:
    """Refuse a recording of which next to no marker is the model's, so that any pose fits it.

    Parameters
    ----------
    model : with markers
    markers : as recorded
    options : with tasks that may show the pose besides

    Raises
    ------
    BadData : fewer than half of both are matched, with fewer coordinates than the pose has
    """
    matched = [name for name in model.marker_names if name in set(markers.names)]
    few = len(matched) < FEW * len(model.marker_names) and len(matched) < FEW * len(markers.names)
    shown = 3 * len(matched) + sum(not isinstance(task, CoordinateTask) for task in options.tasks)
    if not matched or not few or shown >= len(free_coordinates(compile_tree(model))):
        return
    missing = [name for name in model.marker_names if name not in matched]
    unused = [name for name in markers.names if name not in matched]
    (finding,) = name_findings(missing, unused, len(matched))
    raise BadData(f"{finding.text}; too few for a pose")


def time_findings(model: Model, markers: Markers, unit: float) -> tuple[Finding, ...]:
    """Find labels exchanged for some frames, and what jumps or was drawn once these are put back.

    Parameters
    ----------
    model : whose markers count
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    unit : what stands for one metre, see `length_unit` [m]

    Returns
    -------
    findings with their repairs
    """
    names = [name for name in markers.names if name in set(model.marker_names)]
    doubled = tuple(doubled_findings(markers, names, unit))
    once = [name for name in names if not any(name in item.place.split(", ") for item in doubled)]
    swapped = tuple(_exchange_findings(markers, once, unit))
    right, _ = repaired(markers, swapped)
    drawn = tuple(drawn_findings(model, right, names, unit))
    right, _ = repaired(right, drawn)
    return (
        *lost_findings(markers, names),
        *doubled,
        *swapped,
        *drawn,
        *_jump_findings(right, names, unit),
    )


def _exchange_findings(markers: Markers, names: Sequence[str], unit: float) -> Iterator[Finding]:
    """Find pairs of labels that are exchanged in the same frames together."""
    values = markers.values[:, [markers.names.index(name) for name in names]]
    found = _short_side(exchanges(values, edges_of(markers.time, values, unit)), len(values))
    parts = grouped(
        ((exchange.start, exchange.stop), (names[exchange.first], names[exchange.second]))
        for exchange in found
    )
    for (start, stop), pairs in parts.items():
        span = float(markers.time[start]), float(markers.time[stop - 1])
        text = MARKERS.message(
            f"labels {pairs_text(pairs)} are exchanged {times_text([span])}"
            f" ({_frames_text(stop - start)}), as their paths go on in each other"
        )
        repair = Repair(
            partial(_exchanged, pairs=pairs, part=slice(start, stop)), "exchanged back there"
        )
        yield Finding(
            kind="swapped labels",
            place=pairs_text(pairs).replace("'", ""),
            text=text,
            times=(span,),
            repair=repair,
        )


def _exchanged(markers: Markers, pairs: Sequence[tuple[str, str]], part: slice) -> Markers:
    """Exchange labels in some frames."""
    values = np.array(markers.values)
    for pair in pairs:
        columns = [markers.names.index(name) for name in pair]
        values[part, columns] = values[part, columns[::-1]]
    return replace(markers, values=values)


def _short_side(exchanges: Sequence[Exchange], frames: int) -> Iterator[Exchange]:
    """Put each exchange on the side that is shorter.

    An odd one at the end may be right there and wrong before.
    """
    for exchange in exchanges:
        if exchange.stop == frames and exchange.start < frames - exchange.start:
            yield Exchange(
                first=exchange.first, second=exchange.second, start=0, stop=exchange.start
            )
        else:
            yield exchange


def _jump_findings(markers: Markers, names: Sequence[str], unit: float) -> Iterator[Finding]:
    """Find jumping markers, to be bridged from before to after.

    A marker that is left out for some frames lets the pose jump, for no marker fits exactly: a
    bridge does not. At the ends of the recording markers are left out.
    """
    values = markers.values[:, [markers.names.index(name) for name in names]]
    jumping = grouped(
        (names[excursion.marker], (excursion.start, excursion.stop, excursion.size))
        for excursion in excursions(markers.time, edges_of(markers.time, values, unit))
    )
    for name, parts in jumping.items():
        spans: list[Span] = [
            (float(markers.time[start]), float(markers.time[stop - 1])) for start, stop, _ in parts
        ]
        worst = max(size for _, _, size in parts)
        count = sum(stop - start for start, stop, _ in parts)
        text = MARKERS.message(
            f"marker '{name}' jumps by up to {100 * worst:.1f} cm and back {times_text(spans)}"
            f" ({_frames_text(count)})",
            size=100.0 * worst,
        )
        bridged = partial(_bridged, name=name, parts=[part[:2] for part in parts])
        path = bridged(markers).values[[start for start, _, _ in parts], markers.names.index(name)]
        gone = bool(np.isnan(path).any())
        repair = Repair(
            bridged, "left out there" if gone else "bridged there from the frames around"
        )
        yield Finding(
            kind="jumping marker", place=name, text=text, times=tuple(spans), repair=repair
        )


def _bridged(markers: Markers, name: str, parts: Sequence[tuple[int, int]]) -> Markers:
    """Bridge the path of a marker in some parts, frames [start, stop)."""
    values = np.array(markers.values)
    column = markers.names.index(name)
    for start, stop in parts:
        values[start:stop, column] = bridge(markers.time, values[:, column], start, stop)
    return replace(markers, values=values)


def _frames_text(count: int) -> str:
    return f"{count} frame" + ("" if count == 1 else "s")


def spelling(name: str) -> str:
    """Reduce a name to what laboratories spell alike.

    Without case, dots, blanks, underscores and a subject's prefix.
    """
    return re.sub(r"[^a-z0-9]", "", name.rsplit(":", 1)[-1].lower())


def near_names(wanted: Sequence[str], offered: Sequence[str]) -> dict[str, str]:
    """Match wanted names with offered ones that probably mean them; sides are never exchanged.

    Parameters
    ----------
    wanted, offered : names

    Returns
    -------
    the offered name by wanted one, where there is one
    """
    result: dict[str, str] = {}
    by_spelling = {spelling(name): name for name in reversed(offered)}
    for name in wanted:
        spelled = spelling(name)
        if spelled in by_spelling:
            result[name] = by_spelling[spelled]
    left = {spelling(name): name for name in offered if name not in result.values()}
    for name in wanted:
        if name in result or len(spelling(name)) < 4:
            continue
        spelled = spelling(name)
        for other in difflib.get_close_matches(spelled, list(left), n=3, cutoff=NEAR):
            # Another letter may be the side, another digit the number in a cluster: letters may
            # only be missing.
            if _only_adds(spelled, other) or _only_adds(other, spelled):
                result[name] = left.pop(other)
                break
    return result


def _only_adds(short: str, long: str) -> bool:
    """Return whether a name is another with letters inserted, and the same start and digits."""
    if short[:1] != long[:1] or re.findall(r"\d", short) != re.findall(r"\d", long):
        return False
    rest = iter(long)
    return all(letter in rest for letter in short)


def name_findings(
    missing: Sequence[str], unused: Sequence[str], matched: int
) -> tuple[Finding, ...]:
    """Report too few markers that match, and names that are nearly those of the model.

    Parameters
    ----------
    missing : markers of the model that were not recorded
    unused : recorded markers that the model does not have
    matched : number of the others

    Returns
    -------
    one finding or none
    """
    model = matched + len(missing)
    recorded = matched + len(unused)
    near = near_names(missing, unused)
    hints = [f"'{other}' for '{name}'" for name, other in list(near.items())[:4]]
    more = ", ..." if len(near) > 4 else ""
    hint = f"is {', '.join(hints)}{more} meant? " if near else ""
    if matched < FEW * model and matched < FEW * recorded:
        text = LABELS.message(
            f"only {matched} of the model's {model} markers are among the {recorded} recorded: not"
            f" in the model are {quoted(unused)}; {hint}map the names with"
            " --labels (labels in a study)",
            severity="changes results",
        )
        return (Finding("unmatched markers", "markers", text),)
    if near:
        text = LABELS.message(
            f"{len(missing)} of the model's {model} markers were not recorded, and {len(unused)}"
            f" recorded ones are not in the model: {hint} Map the names with --labels (labels in a"
            " study)"
        )
        return (Finding("near names", ", ".join(near), text),)
    return ()


LEAST = 0.03  # Excess of a step below which it is no edge, on a body of human size [m]
# An edge's excess is at least so many times what nine of ten steps of the marker have
OUTSTANDING = 6.0
RETURNS = 0.25  # A marker that returns later did not jump for a few frames: it may have moved [s]
GAP = 0.1  # Steps over longer gaps are not compared [s]
AROUND = 3  # Steps either way that make the usual one
# What may be left of a jump after the marker has returned, or of two after their labels are
# exchanged
CLOSES = 0.35


@dataclass(frozen=True)
class Excursion:
    """Frames in which a marker is off its path.

    Attributes
    ----------
    marker : its number
    start, stop : frames [start, stop)
    size : distance from the path [m]
    """

    marker: int
    start: int
    stop: int
    size: float


@dataclass(frozen=True)
class Exchange:
    """Frames in which the labels of two markers are exchanged against their neighbors.

    Attributes
    ----------
    first, second : numbers of the markers
    start, stop : frames [start, stop)
    """

    first: int
    second: int
    start: int
    stop: int


@read_only
class Steps:
    """Steps of a marker that stand out.

    Attributes
    ----------
    start, stop : (steps,) frames from which and to which
    predicted : (steps, 3) position expected after the step [m]
    excess : (steps, 3) position less the one expected [m]
    """

    start: NDArray[np.int64]
    stop: NDArray[np.int64]
    predicted: Array
    excess: Array


NONE = Steps(
    start=np.zeros(0, np.int64),
    stop=np.zeros(0, np.int64),
    predicted=np.zeros((0, 3)),
    excess=np.zeros((0, 3)),
)


def edges_of(time: Array, values: Array, unit: float = 1.0) -> tuple[Steps, ...]:
    """Find for each marker the steps that stand out of those around.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, markers, 3) [m], NaN where unseen
    unit : what stands for one metre, see `length_unit` [m]

    Returns
    -------
    the steps of each marker
    """
    return tuple(_edges(time, values[:, marker], unit) for marker in range(values.shape[1]))


def _edges(time: Array, path: Array, unit: float) -> Steps:
    """Find the steps of a path that stand out of those around.

    A step is predicted by the median velocity of the three before and the three after it. Its
    excess must be larger than 3 cm (on a human body) and six times what nine of ten steps have;
    steps over gaps longer than 0.1 s are not compared.

    Parameters
    ----------
    time : (frames,) [s]
    path : (frames, 3) [m], NaN where unseen
    unit : what stands for one metre [m]
    """
    seen = np.flatnonzero(np.isfinite(path).all(axis=1))
    if len(seen) < 2 * AROUND + 2:
        return NONE
    start = seen[:-1]
    stop = seen[1:]
    spans = (time[stop] - time[start])[:, None]
    near = spans[:, 0] <= GAP
    moved = path[stop] - path[start]
    speed = moved / spans
    # What changes less from step to step has no edge: most markers end here.
    if (
        not (np.linalg.norm(np.diff(speed, axis=0) * spans[1:], axis=1) > 0.5 * LEAST * unit).any()
        or not near.any()
    ):
        return NONE
    # The median of the steps around, the step itself left out.
    count = len(speed)
    index = np.arange(count)[:, None] + np.array(
        [shift for shift in range(-AROUND, AROUND + 1) if shift]
    )
    predicted = path[start] + np.median(speed[np.clip(index, 0, count - 1)], axis=1) * spans
    excess = path[stop] - predicted
    size = np.linalg.norm(excess, axis=1)
    limit = max(LEAST * unit, OUTSTANDING * float(np.quantile(size[near], 0.9)))
    edges = np.flatnonzero((size > limit) & near).astype(np.int64)
    return Steps(
        start=start[edges], stop=stop[edges], predicted=predicted[edges], excess=excess[edges]
    )


def excursions(time: Array, edges: Sequence[Steps]) -> tuple[Excursion, ...]:
    """Find markers that leave their path from one frame to the next and return as suddenly.

    With the excess out and back of two steps at most 0.25 s apart,

        |out + back| < 0.35 max(|out|, |back|)

    Parameters
    ----------
    time : (frames,) [s]
    edges : steps of every marker, of `edges_of`

    Returns
    -------
    excursions, marker by marker
    """
    spans = []
    for marker, steps in enumerate(edges):
        place = 0
        while place + 1 < len(steps.start):
            out = steps.excess[place]
            back = steps.excess[place + 1]
            size = float(np.linalg.norm(out))
            soon = time[steps.start[place + 1]] - time[steps.stop[place]] <= RETURNS
            if soon and np.linalg.norm(out + back) < CLOSES * max(
                size, float(np.linalg.norm(back))
            ):
                spans.append(
                    Excursion(
                        marker=marker,
                        start=int(steps.stop[place]),
                        stop=int(steps.start[place + 1]) + 1,
                        size=size,
                    )
                )
                place += 1
            place += 1
    return tuple(spans)


def exchanges(values: Array, edges: Sequence[Steps]) -> tuple[Exchange, ...]:
    """Find pairs of markers whose paths go on in each other from some frame on.

    The markers that step in a frame are matched to the positions predicted, least distances in all;
    a pair counts whose exchanged distances are below 0.35 of those as labeled.

    Parameters
    ----------
    values : (frames, markers, 3) [m], NaN where unseen
    edges : steps of every marker, of `edges_of`

    Returns
    -------
    exchanges, from one such frame to the next; the last of an odd number goes to the end
    """
    at = grouped(
        (int(frame), (marker, place))
        for marker, steps in enumerate(edges)
        for place, frame in enumerate(steps.stop)
    )
    changes: dict[tuple[int, int], list[int]] = {}
    for frame, group in sorted(at.items()):
        here = np.array([values[frame, marker] for marker, _ in group])
        ahead = np.array([edges[marker].predicted[before] for marker, before in group])
        apart = np.linalg.norm(here[:, None] - ahead, axis=2)
        taken = scipy.optimize.linear_sum_assignment(apart)[1]
        for i, j in enumerate(taken):
            stayed = apart[i, i] + apart[j, j]
            if i < j and taken[j] == i and apart[i, j] + apart[j, i] < CLOSES * stayed:
                changes.setdefault((group[i][0], group[j][0]), []).append(frame)
    swaps = []
    for (first, second), frames in changes.items():
        ends = [*frames, len(values)] if len(frames) % 2 else frames
        swaps += [
            Exchange(first=first, second=second, start=a, stop=b)
            for a, b in zip(ends[::2], ends[1::2], strict=True)
        ]
    return tuple(swaps)
