"""Kinds of faults that are put into the files of a recording, each with what would name it.

A fault changes a `Job`, which is what a user has and types. Sizes are drawn.
"""

from __future__ import annotations

import re
from collections.abc import Callable
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from numpy.random import Generator

from benchmarks.accuracy.faults.captures import Capture
from myomorph.core.model.arrays import Array

POUND = 2.20462
"""Pounds of a kilogram."""
SMALLER = np.array([0.9, 0.86, 0.9])
"""Sizes of another person over those of the recorded one, along the axes of the laboratory."""
RUN = 0.3
"""Longest part of a recording that a fault of some frames lasts, as share of all frames."""
SIDES = (("Right", "Left"), ("RIGHT", "LEFT"), ("R", "L"))
"""What names of markers of the two sides begin with."""
ANALYZE = ("ik", "id")
"""Steps that see faults of markers, plates and persons."""
WITH_MUSCLES = (*ANALYZE, "muscles", "tension")
"""Steps that see faults of EMG."""


@dataclass(kw_only=True)
class Job:
    """Files that a user has, and what they type.

    Attributes
    ----------
    capture : the recording
    used : labels of markers that the model has
    emg : names of channels of EMG that take part
    mass : as typed [kg]
    frames : of the recording that are analyzed, first and last + 1
    steps : that are run; with "calibrate" the generic model is fitted anew
    second : capture of another trial that is typed besides
    static : capture of a static trial
    factor : size of the model over that of the person
    radians : whether `id` is typed, with a motion in radians whose head says degrees
    kept : share of the file that is left
    matters : whether the fault changes results that no torque shows, as those of muscles
    said : the fault and its size in words
    places : names of which a message has to hold one
    """

    capture: Capture
    used: tuple[str, ...]
    emg: tuple[str, ...]
    mass: float
    frames: slice
    steps: tuple[str, ...] = ANALYZE
    second: Capture | None = None
    static: Capture | None = None
    factor: float = 1.0
    radians: bool = False
    kept: float = 1.0
    matters: bool = False
    said: str = ""
    places: tuple[str, ...] = field(default=())

    def path(self, label: str) -> Array:
        """Return the path of a marker, as a view.

        Parameters
        ----------
        label : of the marker

        Returns
        -------
        (frames, 3) in the unit of the file
        """
        return self.capture.points[:, self.capture.labels.index(label)]

    @property
    def pairs(self) -> list[tuple[str, str]]:
        """Labels of the right side with those of the left."""
        found = []
        for label in self.used:
            for right, left in SIDES:
                other = left + label[len(right) :]
                if label.startswith(right) and other in self.used:
                    found.append((label, other))
                    break
        return found

    def some_frames(self, random: Generator, least: float, most: float) -> slice:
        """Draw a stretch of frames that lasts some seconds, away from both ends."""
        count = round(random.uniform(least, most) * self.capture.rate)
        whole = self.frames.stop - self.frames.start
        count = max(3, min(count, round(RUN * whole)))
        start = self.frames.start + int(random.integers(whole // 6, whole - whole // 6 - count))
        return slice(start, start + count)


Change = Callable[[Job, Generator], bool]


@dataclass(frozen=True, kw_only=True)
class Kind:
    """A kind of fault, and what names it.

    Attributes
    ----------
    name : of the kind
    causes : keys of the causes of messages that name it
    words : pattern that such a message, or an error, contains
    change : puts it into a job; false where the recording cannot have it
    """

    name: str
    causes: frozenset[str]
    words: str
    change: Change

    def is_named(self, text: str, job: Job) -> bool:
        """Whether a sentence says what the fault is, and where."""
        if not re.search(self.words, text, re.IGNORECASE):
            return False
        return not job.places or any(place in text for place in job.places)


def exchanged_sides(job: Job, random: Generator) -> bool:
    """All markers of the right side exchanged with those of the left."""
    for right, left in job.pairs:
        kept = job.path(right).copy()
        job.path(right)[:] = job.path(left)
        job.path(left)[:] = kept
    job.said = f"{len(job.pairs)} pairs"
    return len(job.pairs) > 2


def exchanged_part(job: Job, random: Generator) -> bool:
    """Labels of one pair exchanged for some frames."""
    if not job.pairs:
        return False
    right, left = job.pairs[random.integers(len(job.pairs))]
    part = job.some_frames(random, 0.15, 0.5)
    kept = job.path(right)[part].copy()
    job.path(right)[part] = job.path(left)[part]
    job.path(left)[part] = kept
    job.places = (right, left)
    job.said = f"{right} and {left}, {part.stop - part.start} frames"
    return True


def misspelled(job: Job, random: Generator) -> bool:
    """Write a letter of a marker's name twice."""
    label = _sided(job, random)
    place = int(random.integers(1, len(label)))
    wrong = label[:place] + label[place - 1] + label[place:]
    job.capture.labels[job.capture.labels.index(label)] = wrong
    job.places = (label, wrong)
    job.said = f"{wrong} for {label}"
    return True


def other_unit(job: Job, random: Generator) -> bool:
    """State another unit of lengths: m for mm, or mm for m."""
    was = job.capture.unit
    job.capture.unit = "m" if was.lower() == "mm" else "mm"
    job.said = f"{job.capture.unit} for {was}"
    return True


def other_axes(job: Job, random: Generator) -> bool:
    """Points with another axis up than the file's own, the forces as they were."""
    points = job.capture.points
    if job.capture.up == 1:
        job.capture.points = points[:, :, [0, 2, 1]] * [1.0, -1.0, 1.0]
    else:
        job.capture.points = points[:, :, [0, 2, 1]] * [1.0, 1.0, -1.0]
    job.said = "z up" if job.capture.up == 1 else "y up"
    return True


def straight_gap(job: Job, random: Generator) -> bool:
    """Fill a gap by a straight line."""
    label = _sided(job, random)
    part = job.some_frames(random, 0.25, 0.5)
    path = job.path(label)
    before = path[part.start - 1]
    share = np.linspace(0.0, 1.0, part.stop - part.start)[:, None]
    path[part] = (1.0 - share) * before + share * path[part.stop]
    job.places = (label,)
    job.said = f"{label}, {part.stop - part.start} frames"
    return True


def jump(job: Job, random: Generator) -> bool:
    """Move a marker off its path for some frames."""
    label = _sided(job, random)
    part = job.some_frames(random, 0.03, 0.12)
    size = random.uniform(0.04, 0.12)
    direction = random.normal(size=3)
    offset = size * direction / np.linalg.norm(direction)
    job.path(label)[part] += offset * _body_size(job) * _per_meter(job)
    job.places = (label,)
    job.said = f"{label}, {100.0 * size:.0f} cm, {part.stop - part.start} frames"
    return True


def frozen(job: Job, random: Generator) -> bool:
    """Keep a marker where it was."""
    label = _sided(job, random)
    part = job.some_frames(random, 0.25, 0.5)
    path = job.path(label)
    path[part] = path[part.start - 1]
    job.places = (label,)
    job.said = f"{label}, {part.stop - part.start} frames"
    return True


def mirrored_marker(job: Job, random: Generator) -> bool:
    """Move a marker to the other side of its two nearest ones."""
    label = _sided(job, random)
    labels = [other for other in job.used if other != label]
    paths = np.stack([job.path(other) for other in labels])
    with np.errstate(invalid="ignore"):
        apart = np.nanmean(np.linalg.norm(paths - job.path(label), axis=2), axis=1)
    nearest = np.argsort(np.nan_to_num(apart, nan=np.inf))[:2]
    middle = paths[nearest].mean(axis=0)
    job.path(label)[:] = 2.0 * middle - job.path(label)
    job.places = (label,)
    job.said = f"{label} about {labels[nearest[0]]} and {labels[nearest[1]]}"
    return True


def _sided(job: Job, random: Generator) -> str:
    """One of the markers of the two sides that is seen most of the time, else of all."""
    labels = [label for pair in job.pairs for label in pair] or list(job.used)
    seen = [
        label
        for label in labels
        if np.isfinite(job.path(label)[job.frames]).all(axis=1).mean() > 0.8
    ]
    choice = seen or labels
    return choice[int(random.integers(len(choice)))]


def _per_meter(job: Job) -> float:
    """Units of the file in a meter."""
    return 1000.0 if job.capture.unit.lower() == "mm" else 1.0


def _body_size(job: Job) -> float:
    """Size of the body over that of a person, which jumps grow with."""
    return 0.05 if job.mass < 1.0 else 1.0


def missing_plate(job: Job, random: Generator) -> bool:
    """Leave a plate out of the file."""
    if job.capture.plates < 2:
        return False
    plate = job.capture.used_plate()
    job.capture.drop_plate(plate)
    job.said = f"plate {plate + 1}"
    return True


def exchanged_plates(job: Job, random: Generator) -> bool:
    """Cables of two plates exchanged."""
    if job.capture.plates < 2:
        return False
    plate = job.capture.used_plate()
    other = (plate + 1) % job.capture.plates
    job.capture.exchange_plates(plate, other)
    job.said = f"plates {plate + 1} and {other + 1}"
    return True


def turned_plate(quarters: int) -> Change:
    """Make a fault that turns a plate about its vertical by some quarters."""

    def change(job: Job, random: Generator) -> bool:
        plate = job.capture.used_plate()
        job.capture.turn_plate(plate, quarters)
        job.said = f"plate {plate + 1}"
        return True

    return change


def other_sign(job: Job, random: Generator) -> bool:
    """Reverse forces and moments of a plate."""
    plate = job.capture.used_plate()
    job.capture.scale_plate(plate, -1.0)
    job.said = f"plate {plate + 1}"
    return True


def offset(job: Job, random: Generator) -> bool:
    """Add a force to a plate, as of one that was not set to zero."""
    plate = job.capture.used_plate()
    force = random.uniform(0.04, 0.12) * job.mass * 9.81
    job.capture.add_force(plate, (force, force))
    job.said = f"plate {plate + 1}, {force:.3g} N"
    return True


def drift(job: Job, random: Generator) -> bool:
    """Let the zero of a plate drift."""
    plate = job.capture.used_plate()
    force = random.uniform(0.08, 0.2) * job.mass * 9.81
    job.capture.add_force(plate, (0.0, force))
    job.said = f"plate {plate + 1}, up to {force:.3g} N"
    return True


def gain(job: Job, random: Generator) -> bool:
    """Multiply what a plate measures, as of another sensitivity."""
    plate = job.capture.used_plate()
    factor = float(random.choice([random.uniform(0.7, 0.85), random.uniform(1.15, 1.4)]))
    job.capture.scale_plate(plate, factor)
    job.said = f"plate {plate + 1}, times {factor:.2f}"
    return True


def places_in_other_unit(job: Job, random: Generator) -> bool:
    """Corners of plates, or centers of pressure, in another unit than lengths."""
    factor = float(random.choice([0.001, 0.01])) if job.capture.unit.lower() == "mm" else 1000.0
    # Tables of forces are in meters.
    factor = 1000.0 if hasattr(job.capture, "rows") else factor
    job.capture.scale_places(factor)
    job.said = f"times {factor:g}"
    return True


def late_forces(job: Job, random: Generator) -> bool:
    """Let forces come late or early."""
    seconds = float(random.choice([-1.0, 1.0])) * random.uniform(0.02, 0.1)
    job.capture.delay_forces(seconds)
    job.said = f"{1e3 * seconds:+.0f} ms"
    return True


def other_rate(job: Job, random: Generator) -> bool:
    """Another rate in the head of the file of forces."""
    factor = float(random.choice([0.5, 0.8, 1.2, 2.0]))
    job.capture.change_rate(factor)
    job.said = f"times {factor:g}"
    return True


def wrong_mass(job: Job, random: Generator) -> bool:
    """Mass of somebody else."""
    factor = float(random.choice([random.uniform(0.7, 0.88), random.uniform(1.12, 1.3)]))
    job.mass *= factor
    job.said = f"{job.mass:.3g} kg, times {factor:.2f}"
    return True


def mass_in_pounds(job: Job, random: Generator) -> bool:
    """Mass in pounds."""
    job.mass *= POUND
    job.said = f"{job.mass:.3g} kg"
    return True


def _smaller(capture: Capture, random: Generator) -> Array:
    """Points of a body of another size and build."""
    factors = SMALLER + random.uniform(-0.03, 0.03, 3)
    factors = factors if capture.up == 1 else factors[[0, 2, 1]]
    return np.asarray(capture.points * factors)


def second_trial(job: Job, random: Generator) -> bool:
    """Add a trial of another person to the recordings."""
    assert job.second is not None
    job.second.points = _smaller(job.second, random)
    job.said = "a trial of a smaller person"
    return True


def other_static(job: Job, random: Generator) -> bool:
    """Take the static trial of another person."""
    if job.static is None:
        return False
    job.static.points = _smaller(job.static, random)
    job.steps = ("calibrate", *ANALYZE)
    job.said = "static trial of a smaller person"
    return True


def other_model(job: Job, random: Generator) -> bool:
    """Take the model of another person."""
    job.factor = float(random.choice([random.uniform(0.84, 0.92), random.uniform(1.08, 1.16)]))
    job.said = f"size times {job.factor:.2f}"
    return True


def radians(job: Job, random: Generator) -> bool:
    """Write a motion in radians that says degrees."""
    job.radians = True
    job.said = "coordinates"
    return True


def exchanged_channels(job: Job, random: Generator) -> bool:
    """Names of two channels of EMG exchanged."""
    if len(job.emg) < 4:
        return False
    first, second = random.choice(job.emg, 2, replace=False).tolist()
    job.capture.rename_emg({first: second, second: first})
    job.places = (first, second)
    job.said = f"{first} and {second}"
    job.steps = WITH_MUSCLES
    job.matters = True
    return True


def saturated_channel(job: Job, random: Generator) -> bool:
    """Cut a channel of EMG off at a fraction of its peak."""
    return _on_channel(job, random, lambda values: np.clip(values, *_limits(values)))


def _limits(values: Array) -> tuple[float, float]:
    largest = 0.25 * float(np.abs(values).max())
    return -largest, largest


def mains(job: Job, random: Generator) -> bool:
    """Add mains hum to a channel of EMG."""

    def hum(values: Array) -> Array:
        time = np.arange(len(values)) * len(job.capture.points) / len(values) / job.capture.rate
        return np.asarray(values + 4.0 * values.std() * np.sin(2.0 * np.pi * 50.0 * time))

    return _on_channel(job, random, hum)


def millivolts(job: Job, random: Generator) -> bool:
    """Write a channel of EMG in mV that says V, though its envelope is scaled to its peak."""
    applies = _on_channel(job, random, lambda values: 1000.0 * values)
    job.matters = False
    return applies


def _on_channel(job: Job, random: Generator, change: Callable[[Array], Array]) -> bool:
    """Change a channel of EMG that takes part and has a signal."""
    channels = {
        name: values
        for name, values in job.capture.emg.items()
        if name in job.emg and values.std() > 0.0
    }
    if len(channels) < 4:
        return False
    name = list(channels)[int(random.integers(len(channels)))]
    channels[name][:] = change(channels[name].copy())
    job.places = (name, name.rpartition(".")[2])
    job.said = name
    job.steps = WITH_MUSCLES
    job.matters = True
    return True


def truncated(job: Job, random: Generator) -> bool:
    """Cut the file of markers off."""
    job.kept = random.uniform(0.4, 0.9)
    job.said = f"{100.0 * job.kept:.0f} % left"
    return True


def _kind(name: str, causes: str, words: str, change: Change) -> Kind:
    return Kind(name=name, causes=frozenset(causes.split()), words=words, change=change)


OF_PLATES = "plates feet_beside contacts"
TURNED = r"turn|axes|axis|mirror|corner|center of pressure|direction"
KINDS = (
    _kind("left and right exchanged", "markers", r"exchang|left and right", exchanged_sides),
    _kind("two labels exchanged for a part", "markers", r"exchang", exchanged_part),
    _kind("a marker's name misspelled", "labels reading", r".", misspelled),
    _kind("mm and m", "units sizes reading session", r"\bunit|\bmm\b|metre|meter", other_unit),
    _kind("another axis up", "poses plates session reading", r"axis|axes|vertical", other_axes),
    _kind("a gap filled by a line", "markers hidden_markers", r"line|filled|still", straight_gap),
    _kind("a marker that jumps", "markers", r"jump", jump),
    _kind("a frozen marker", "markers hidden_markers", r"still|frozen|line|repeat|stays", frozen),
    _kind("a marker mirrored", "markers sizes", r"lies|exchang|mirror|moved", mirrored_marker),
    _kind("a plate missing", OF_PLATES, r"no plate|carries|not determined|missing", missing_plate),
    _kind("two plates exchanged", OF_PLATES, r"exchang|foot|nearest|pressure", exchanged_plates),
    _kind("a plate turned by 180 degrees", OF_PLATES, TURNED, turned_plate(2)),
    _kind("a plate turned by 90 degrees", OF_PLATES, TURNED, turned_plate(1)),
    _kind("sign of a plate", "plates", r"pull|sign|revers|mirror", other_sign),
    _kind("a plate not set to zero", "plate_zero plates", r"zero|without load|offset", offset),
    _kind("a plate that drifts", "plate_zero plates", r"zero|without load|offset|drift", drift),
    _kind("gain of a plate", "weight plates", r"carr|weigh|gain|sensitiv", gain),
    _kind(
        "places of plates in another unit",
        "plates units force_files reading",
        r"\bunit|\bmm\b|metre|meter|m from the origin|corner",
        places_in_other_unit,
    ),
    _kind("forces late or early", "clocks", r"late|early|clock|shift", late_forces),
    _kind(
        "another rate in the head", "rates clocks session reading", r"rate|clock|\bHz\b", other_rate
    ),
    _kind("mass of somebody else", "weight", r"carr|weigh", wrong_mass),
    _kind("mass in pounds", "weight", r"carr|weigh|pound", mass_in_pounds),
    _kind("a trial of a second person", "session", r"people|person", second_trial),
    _kind("static trial of a second person", "session sizes", r"person|static", other_static),
    _kind(
        "model of another person", "sizes session model", r"size|scale|person|length", other_model
    ),
    _kind("radians called degrees", "units", r"radian", radians),
    _kind("EMG: two channels exchanged", "emg emg_conflicts", r"exchang", exchanged_channels),
    _kind("EMG: a saturated channel", "emg", r"saturat|cut off|clip", saturated_channel),
    _kind("EMG: mains", "emg", r"mains|hum|50 Hz|noise", mains),
    _kind("EMG: mV called V", "emg units", r"unit|mV|volt|\bV\b", millivolts),
    _kind(
        "a truncated file",
        "reading file_shape",
        r"cut off|truncat|frames|incomplete|announc|ends|short",
        truncated,
    ),
)


def truncate(path: Path, kept: float) -> None:
    """Cut a file off."""
    content = path.read_bytes()
    path.write_bytes(content[: round(kept * len(content))])
