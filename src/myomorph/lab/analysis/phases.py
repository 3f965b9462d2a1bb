"""Events and phases of a movement from ground contact: gait, jumps, single contacts."""

from __future__ import annotations

import itertools
import re
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.errors import BadData
from myomorph.core.model.model import STANDARD_GRAVITY
from myomorph.core.model.series import Event, Series, Wrenches
from myomorph.core.model.sides import split_side

_SIDE_WORD = re.compile(r"(?<![a-z])(right|left)(?![a-z])", re.IGNORECASE)
STANDING = 0.2  # How far the force of one who stands may be from a known weight, as a share of it
THRESHOLD = 0.03  # Vertical force that is contact, as a share of body weight (0.03 is about 20 N)
SHORTEST_CONTACT = 0.03  # Contacts and gaps shorter than this are noise [s]
MAX_STRIDE = 5.0  # A stride is at most so many times as long as its stance
LONGEST = 1.6  # A stride so many times as long as the usual one is two, or has a stop in it
SHORTEST_FLIGHT = 0.12  # A jump flies at least so long [s]
QUIET_TIME = 0.3  # A jump starts from standing still so long [s]
# Standard deviation of the force that is still standing, as a share of body weight
QUIET_SPREAD = 0.03
# A jump begins where the force leaves body weight by so many SDs of quiet standing (Owen 2014)
ONSET_SPREAD = 5.0
ONSET_LEAD = 0.03  # The movement has begun so long before that [s] (the same)
LANDING = 0.5  # The peak of a landing is looked for within so long [s]
PEAK_FORCE = "Peak force"
BEFORE_TAKE_OFF = "before take-off"
OF_LANDING = "of landing"
ON_THE_PLATES = "Body weight on the plates"


@dataclass(frozen=True)
class Measure:
    """One number about a movement: name, value, unit and how it was found."""

    name: str
    value: float
    unit: str
    source: str = ""


@dataclass(frozen=True)
class GroundPhases:
    """What ground forces show."""

    kind: str = ""  # "gait", "jump", "contact" or "" where no force shows it
    events: tuple[Event, ...] = ()  # in order of time
    measures: tuple[Measure, ...] = ()  # numbers that usually go with such a movement


def side_of(name: str, body: str = "") -> str:
    """Side of a wrench from its body's name or its own: "Right", "Left" or ""."""
    for text in (body, name):
        side = split_side(text)[1] if text else ""
        word = _SIDE_WORD.search(text)
        side = side or (word[1].lower() if word else "")
        if side:
            return side.capitalize()
    return ""


def ground_phases(
    wrenches: Wrenches,
    up: Array,
    weight: float | None = None,
    height: Series | None = None,
    measured: Series | None = None,
) -> GroundPhases:
    """Find the events of a walk, a run or a jump from the ground forces.

    A jump is a flight of the whole body that follows standing still. It gets the phases of McMahon
    et al. 2018: onset, start of braking, lowest point, take-off, landing. Otherwise every side that
    touches and leaves the ground gets foot strikes and foot offs.

    Parameters
    ----------
    wrenches : measured forces of the ground [N]
    up : (3,) unit vector against gravity
    weight : of the body [N]; without it, the largest quiet force or a third of the peak stands in
    height : center of mass over time; its largest column along `up` gives the lowest point
    measured : (samples, bodies) vertical forces without a filter, which give the peaks [N]

    Returns
    -------
    GroundPhases; empty where nothing presses on the ground or there are fewer than three frames
    """
    vertical = np.nan_to_num(wrenches.forces @ up)
    if len(wrenches) < 3 or not vertical.size or np.max(vertical) <= 0.0:
        return GroundPhases()
    total = vertical.sum(axis=1)
    scale = weight or float(np.max(total)) / 3.0
    com = None
    if height is not None:
        com = np.interp(wrenches.time, height.time, height.values @ up, left=np.nan, right=np.nan)
    jump = _jump(wrenches.time, total, scale, com, weight is not None)
    if jump:
        return jump if measured is None else replace(jump, measures=_peaks_of(jump, measured))
    sides = [
        side_of(name, body) for name, body in zip(wrenches.names, wrenches.bodies, strict=True)
    ]
    return _gait(wrenches.time, vertical, sides, scale)


def contacts(
    time: Array, force: Array, threshold: float, shortest: float
) -> tuple[tuple[int, int], ...]:
    """Find the intervals [first, last] of samples with contact, in order.

    Contact is a force over the threshold, averaged over a hundredth of a second so that the noise
    of an unloaded plate does not touch it. It must reach three times the threshold and last
    `shortest`, and a gap shorter than that does not end it.

    Parameters
    ----------
    time : (samples,) [s]
    force : (samples,) [N]
    threshold : [N]
    shortest : duration of a contact and of a gap [s]

    Returns
    -------
    First and last sample of each interval
    """
    width = max(1, round(0.01 / max(float(np.median(np.diff(time))), 1e-9)))
    smooth = np.convolve(np.pad(force, width, mode="edge"), np.ones(width) / width, mode="same")[
        width:-width
    ]
    joined: list[tuple[int, int]] = []
    for start, end in runs(smooth > threshold):
        stop = end - 1
        if np.max(smooth[start : stop + 1]) < 3.0 * threshold:
            continue
        if joined and time[start] - time[joined[-1][1]] < shortest:
            joined[-1] = (joined[-1][0], stop)
        else:
            joined.append((start, stop))
    return tuple((start, stop) for start, stop in joined if time[stop] - time[start] >= shortest)


def _gait(time: Array, vertical: Array, sides: Sequence[str], weight: float) -> GroundPhases:
    events: list[Event] = []
    measures: list[Measure] = []
    known = [side for side in ("Right", "Left") if side in sides]
    for side in known or [""]:
        force = vertical[:, [i for i, other in enumerate(sides) if other == side]].sum(axis=1)
        touches = contacts(time, force, THRESHOLD * weight, SHORTEST_CONTACT)
        events += _foot_events(time, touches, side)
        if side:
            measures += _foot_times(time, touches, side)
    kind = ""
    if events:
        kind = "gait" if known else "contact"
    return GroundPhases(kind, tuple(sorted(events, key=lambda event: event.time)), tuple(measures))


def _foot_events(time: Array, touches: Sequence[tuple[int, int]], side: str) -> Iterator[Event]:
    """Yield where contacts begin and end within the recording."""
    for start, stop in touches:
        if start > 0:
            yield Event(float(time[start]), "Foot Strike" if side else "Contact", side)
        if stop < len(time) - 1:
            yield Event(float(time[stop]), "Foot Off" if side else "Release", side)


def _foot_times(time: Array, touches: Sequence[tuple[int, int]], side: str) -> Iterator[Measure]:
    """Yield the mean stance and stride time of one side, as far as they are seen whole."""
    stances = [
        time[stop] - time[start] for start, stop in touches if start > 0 and stop < len(time) - 1
    ]
    for name, times, plates in (
        ("stance", stances, ", from the plates"),
        ("stride", _stride_times(time, touches), ""),
    ):
        if len(times):
            yield Measure(
                name=f"{side} {name} time",
                value=float(np.mean(times)),
                unit="s",
                source=f"mean of {len(times)}{plates}",
            )


def _stride_times(time: Array, touches: Sequence[tuple[int, int]]) -> list[float]:
    """Measure times from strike to strike of a foot that is on plates in both stances.

    Who comes back over the same plate has taken strides between that nobody measured.

    Parameters
    ----------
    time : (samples,) [s]
    touches : first and last sample of each contact of the foot

    Returns
    -------
    [s]
    """
    lasting = np.array(
        [
            float(time[after] - time[start])
            for (start, stop), (after, _) in itertools.pairwise(touches)
            if start > 0 and time[after] - time[start] < MAX_STRIDE * (time[stop] - time[start])
        ]
    )
    if not len(lasting):
        return []
    # Who stops stands for longer, and one that was not measured makes two of one.
    return [float(one) for one in lasting[lasting < LONGEST * np.median(lasting)]]


def _jump(
    time: Array, total: Array, weight: float, com: Array | None, weighed: bool
) -> GroundPhases | None:
    """Phases of the first jump that starts from standing, None where there is none."""
    grounded = contacts(time, total, THRESHOLD * weight, SHORTEST_CONTACT)
    for (start, off), (land, last) in itertools.pairwise(grounded):
        if time[land] - time[off] < SHORTEST_FLIGHT:
            continue
        quiet = quiet_standing(time, total, (start, off), weight, weighed)
        if quiet is None:
            continue
        onset, standing = quiet
        # An unknown weight was a guess; quiet standing measures it.
        return _jump_phases(time, total, (onset, off, land, last), standing, com)
    return None


class QuietStanding(NamedTuple):
    """Standing still before a jump.

    Attributes
    ----------
    onset : sample at which the movement begins
    weight : that stood there [N]
    """

    onset: int
    weight: float


def quiet_standing(
    time: Array, total: Array, contact: tuple[int, int], weight: float, weighed: bool = True
) -> QuietStanding | None:
    """Find the onset of a jump, and the weight that stood still before it.

    Source: Owen et al. 2014.

    Parameters
    ----------
    time, total : (samples,) [s], vertical force [N]
    contact : first and last sample on the ground before take-off
    weight : of the body [N]
    weighed : whether that is known: who stands carries it then, and feet of one who sits do not

    Returns
    -------
    onset and weight; None where nobody stood still
    """
    start, off = contact
    step = float(np.median(np.diff(time)))
    width = max(3, round(QUIET_TIME / step))
    part = total[start : off + 1]
    if len(part) <= width:
        return None
    mean, spread = _moving(part, width, weight)
    stands = np.abs(mean - weight) < STANDING * weight if weighed else np.ones(len(mean), np.bool_)
    still = np.flatnonzero(stands & (spread < QUIET_SPREAD * mean))
    if not len(still):
        return None

    window = slice(int(still[-1]), int(still[-1]) + width)
    standing = float(np.median(part[window]))
    band = max(ONSET_SPREAD * float(np.std(part[window])), 0.01 * standing)
    end = _last_stay(np.abs(part - standing) < band, max(2, width // 3), window.stop - 1)
    lead = round(ONSET_LEAD / step)
    return QuietStanding(onset=start + max(end - lead, 0), weight=standing)


def _moving(force: Array, width: int, weight: float) -> tuple[Array, Array]:
    """Mean and standard deviation of every window of so many samples."""
    sums = np.concatenate([[0.0], np.cumsum(force)])
    squares = np.concatenate([[0.0], np.cumsum((force - weight) ** 2)])
    mean = (sums[width:] - sums[:-width]) / width
    variance = (squares[width:] - squares[:-width]) / width - (mean - weight) ** 2
    return mean, np.sqrt(np.maximum(variance, 0.0))


def _last_stay(inside: np.ndarray, shortest: int, default: int) -> int:
    """Return the last sample of a stay inside a band that lasts at least some samples.

    Parameters
    ----------
    inside : (samples,) whether the force is in the band
    shortest : samples of a stay
    default : where there is none
    """
    end = default
    run = 0
    for sample, still_inside in enumerate(inside):
        run = run + 1 if still_inside else 0
        if run >= shortest:
            end = sample
    return end


def _jump_phases(
    time: Array, total: Array, marks: tuple[int, int, int, int], weight: float, com: Array | None
) -> GroundPhases:
    onset, off, land, last = marks
    push = slice(onset, off + 1)
    speed = _rising_speed(time[push], total[push] / weight)
    flight = float(time[land] - time[off])
    events = [Event(float(time[onset]), "Onset")]
    measures = _jump_heights(flight, speed[-1], weight)
    slowest = int(np.argmin(speed))
    if speed[slowest] < -0.05 * max(speed.max(), 1e-9):
        turn = slowest + int(np.argmax(speed[slowest:] >= 0.0))
        if com is not None and np.isfinite(com[push]).any():
            turn = int(np.nanargmin(com[push]))
            depth = float(com[onset] - com[push][turn])
            measures.append(
                Measure(
                    name="Countermovement depth", value=depth, unit="m", source="center of mass"
                )
            )
        events.append(Event(float(time[onset + slowest]), "Braking"))
        events.append(Event(float(time[onset + turn]), "Lowest point"))
    events += [Event(float(time[off]), "Take-off"), Event(float(time[land]), "Landing")]
    settled = min(last, land + max(1, int(np.searchsorted(time[land:], time[land] + LANDING))))
    measures += [
        _peak(BEFORE_TAKE_OFF, float(total[push].max()), weight),
        _peak(OF_LANDING, float(total[land : settled + 1].max()), weight),
    ]
    return GroundPhases(
        "jump", tuple(sorted(events, key=lambda event: event.time)), tuple(measures)
    )


def _rising_speed(time: Array, force: Array) -> Array:
    """Vertical speed (samples,) [m/s] of a body at rest at first, by the force over its weight."""
    accelerating = (force - 1.0) * STANDARD_GRAVITY
    steps = np.diff(time)
    return np.concatenate([[0.0], np.cumsum(0.5 * (accelerating[1:] + accelerating[:-1]) * steps)])


def _jump_heights(flight: float, speed: float, weight: float) -> list[Measure]:
    """Weight, flight time [s], and the jump's height by it and by the speed at take-off [m/s]."""
    height = max(speed, 0.0) ** 2 / (2 * STANDARD_GRAVITY)
    return [
        Measure(name=ON_THE_PLATES, value=weight, unit="N", source="quiet standing"),
        Measure(
            name="Flight time",
            value=flight,
            unit="s",
            source=f"vertical force under {100 * THRESHOLD:.0f} % of body weight",
        ),
        Measure(
            name="Jump height from flight time",
            value=STANDARD_GRAVITY * flight**2 / 8.0,
            unit="m",
            source="g t² / 8",
        ),
        Measure(
            name="Jump height from take-off velocity",
            value=height,
            unit="m",
            source="v² / 2g, impulse",
        ),
    ]


def _peak(when: str, force: float, weight: float) -> Measure:
    """State a peak of the vertical force [N] of a jump of a body of some weight [N]."""
    text = f"{force / weight:.2f} body weights"
    return Measure(name=f"{PEAK_FORCE} {when}", value=force, unit="N", source=text)


def _peaks_of(jump: GroundPhases, measured: Series) -> tuple[Measure, ...]:
    """Replace the peaks of a jump by those of the forces as measured.

    Parameters
    ----------
    jump : as forces that may be filtered show it
    measured : (samples, bodies) vertical forces [N]

    Returns
    -------
    its measures in the same order
    """
    total = np.nan_to_num(measured.values).sum(axis=1)
    times = {event.label: event.time for event in jump.events}
    weight = next(measure.value for measure in jump.measures if measure.name == ON_THE_PLATES)
    spans = {
        BEFORE_TAKE_OFF: (times["Onset"], times["Take-off"]),
        OF_LANDING: (times["Landing"], times["Landing"] + LANDING),
    }
    peaks = {}
    for when, (start, stop) in spans.items():
        inside = (measured.time >= start) & (measured.time <= stop)
        if inside.any():
            peak = _peak(when, float(total[inside].max()), weight)
            peaks[peak.name] = peak
    return tuple(peaks.get(measure.name, measure) for measure in jump.measures)


@dataclass(frozen=True)
class Phase:
    """A part of a motion: its name, its start and its end [s]."""

    name: str
    start: float
    stop: float

    def __post_init__(self) -> None:
        if not self.start < self.stop:
            raise BadData(
                f"phase '{self.name}' lasts from {self.start:g} to {self.stop:g} s: expected a"
                " later end"
            )
