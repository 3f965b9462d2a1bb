"""A folder of recordings read as a session."""

from __future__ import annotations

import os
from collections import Counter
from collections.abc import Callable, Iterable, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.core.io.c3d.emg import emg_channels
from myomorph.core.model.errors import BadFile, MyomorphError
from myomorph.core.model.known import Known
from myomorph.core.model.messages import Message
from myomorph.core.model.movement import Movement
from myomorph.core.model.series import Series
from myomorph.core.motion.protocols import ProtocolTable
from myomorph.lab.analysis.arm_labels import is_arm
from myomorph.lab.analysis.found_movement import found_movement
from myomorph.lab.analysis.seen_body import SeenBody
from myomorph.lab.causes import SESSION
from myomorph.lab.session.body_measures import BodyMeasures, measures_of
from myomorph.lab.session.evidence import Evidence
from myomorph.lab.session.names import (
    first_word,
    header_name,
    named_movement,
    stated_date,
    subject_code,
)
from myomorph.lab.session.people import Group, people_of
from myomorph.lab.session.plate_cover import mass_on_plates
from myomorph.lab.session.recorded_contacts import recorded_contacts
from myomorph.lab.session.recordings import Recording, bare, files_of, look_at
from myomorph.lab.session.session import Kind, Person, RecordedClock, Session, SessionTrial
from myomorph.lab.store.settings import ForceOptions

NOBODY = "subject"  # Name of a person whom nothing names.
TRUNK_DOWN = ("head", "trunk", "upper_arm", "forearm", "hand", "pelvis", "thigh", "shank", "foot")
NO_MARKERS = BodyMeasures(lengths={})


def read_session(
    paths: str | os.PathLike[str] | Sequence[str | os.PathLike[str]],
) -> Session:
    """Who was recorded, when, and in which movement, by files, names, segment lengths and weight.

    docs/analyze.md says what is looked at.

    Parameters
    ----------
    paths : recordings (.c3d, .trc, .mat, .sto of sensors, ...), or folders of them

    Returns
    -------
    people and trials, each statement with how it is known

    Raises
    ------
    BadFile
        where a path does not exist, or no recording can be read

    Examples
    --------
    >>> import myomorph as mm
    >>> squat = mm.demo_recording()
    >>> mm.write_trc(squat.markers, "squat.trc")
    >>> session = mm.session.read_session("squat.trc")
    >>> session
    Session(subject: 1 trials, 1 squatting)
    >>> session.trials[0].movement.origin
    'markers'
    """
    given = [paths] if isinstance(paths, str | os.PathLike) else list(paths)
    files, passed_over = files_of(map(Path, given))
    recordings, unread = looked_at(files)
    passed_over += unread
    if not recordings:
        raise BadFile(given[0], "holds no readable recording", "; ".join(passed_over[:3]))
    source = ", ".join(str(path) for path in given)
    return session_of(recordings, source, passed_over)


def looked_at(
    paths: Sequence[Path],
    table: ProtocolTable | None = None,
    begins: Callable[[Path], None] = lambda path: None,
) -> tuple[list[Recording], list[Message]]:
    """Look at recordings.

    Parameters
    ----------
    paths : of recordings
    table : of marker protocols, None for those of the package
    begins : called with each path before it is read

    Returns
    -------
    those that can be read, and why others cannot, one line each
    """
    recordings = []
    unread = []
    for path in paths:
        begins(path)
        try:
            recordings.append(look_at(path, table=table))
        except MyomorphError as error:
            unread.append(SESSION.message(" ".join(str(error).split())))
    return recordings, unread


def session_of(
    recordings: Sequence[Recording], source: str = "", passed_over: Iterable[Message] = ()
) -> Session:
    """Session of recordings that were looked at."""
    trials = [trial_of(recording) for recording in recordings]
    evidence = [
        evidence_of(recording, trial) for recording, trial in zip(recordings, trials, strict=True)
    ]
    groups = people_of(evidence)
    people = _people(groups, trials, evidence)
    persons = {
        member: str(person.name)
        for group, person in zip(groups, people, strict=True)
        for member in group.members
    }
    return Session(
        source=source,
        people=people,
        trials=tuple(replace(trial, person=persons[number]) for number, trial in enumerate(trials)),
        passed_over=tuple(passed_over),
    )


def trial_of(recording: Recording) -> SessionTrial:
    """Make a trial of a recording, of nobody yet."""
    trial = recording.trial
    body = _body(recording)
    seen = body is not None
    movement = _movement(recording, body)
    named = named_movement(recording.path)
    warnings = []
    contradicts = movement and named and movement.value != named.value
    if contradicts and not (recording.still and named.value == "standing"):
        warnings.append(
            SESSION.message(f"its name says {named}, its markers {movement} ({movement.sentence})")
        )
    markers = trial.markers
    analog = trial.analog
    return SessionTrial(
        name=recording.name,
        path=recording.path,
        person="",
        movement=movement or named,
        date=stated_date(trial, recording.path),
        still=recording.still,
        markers=0 if markers is None else _seen_count(markers),
        segments=() if body is None else _segments(body),
        clock=_clock(markers if markers is not None else recording.sensors),
        device_clock=_clock(analog),
        plates=_plates(recording),
        sensors=0 if recording.sensors is None else len(recording.sensors.names),
        emg=emg_channels(trial),
        up=_up(recording) if seen else Known(),
        unit=_unit(recording),
        measures=NO_MARKERS if body is None else measures_of(body, _standing_mass(recording)),
        warnings=tuple(warnings),
    )


def evidence_of(recording: Recording, trial: SessionTrial) -> Evidence:
    """Collect what a recording says of who it is of."""
    return Evidence(
        path=recording.path,
        header=header_name(recording.trial),
        code=subject_code(recording.path),
        measures=trial.measures,
        word=first_word(recording.path),
        day=trial.date.value,
        labels=frozenset(map(bare, recording.found.sites)),
    )


def _body(recording: Recording) -> SeenBody | None:
    """Body that markers show, None for sensors alone."""
    markers = recording.trial.markers
    if markers is None:
        return None
    return SeenBody.of(markers, recording.found.sites, recording.laboratory.rotation)


def _movement(recording: Recording, body: SeenBody | None) -> Known[Movement]:
    """Movement by markers, events and plates, else by sensors that do not move."""
    if body is not None:
        return found_movement(body, is_arm(recording.found), recorded_contacts(recording))
    if recording.still:
        return Known(value="standing", origin="sensors", sentence="no sensor turns")
    return Known(sentence="sensors alone do not show where the feet are")


def _seen_count(markers: Series) -> int:
    return int(np.isfinite(markers.values).all(axis=2).any(axis=0).sum())


def _segments(body: SeenBody) -> tuple[str, ...]:
    """Segments that markers are seen on, with their sides, from the head down."""
    found = {
        (TRUNK_DOWN.index(site.segment), f"{site.side} {site.segment}".strip().replace("_", " "))
        for label, site in body.sites.items()
        if site.segment in TRUNK_DOWN and np.isfinite(body.places[label]).any()
    }
    # Markers of trunk and pelvis have sides, the segments none.
    middle = {"head", "trunk", "pelvis"}
    names = [name.split()[-1] if name.split()[-1] in middle else name for _, name in sorted(found)]
    return tuple(dict.fromkeys(names))


def _clock(series: object) -> RecordedClock | None:
    time = getattr(series, "time", None)
    if time is None or not len(time):
        return None
    rate = (len(time) - 1) / float(time[-1] - time[0]) if len(time) > 1 else float("nan")
    return RecordedClock(count=len(time), rate=rate, start=float(time[0]), stop=float(time[-1]))


def _plates(recording: Recording) -> Known[int]:
    """Force plates of the file, or a table of forces beside it."""
    loads = recording.near.get("loads")
    count = len(recording.trial.plates)
    if count:
        return Known(value=count, origin="file header")
    if loads is not None:
        return Known(value=1, origin="file name", sentence=f"forces in {loads.name}")
    return Known(value=0, origin="file header")


def _up(recording: Recording) -> Known[str]:
    why = recording.why_up or "the trunk is above the feet along y"
    return Known(value=f"{recording.laboratory.up or 'y'} up", origin="markers", sentence=why)


def _unit(recording: Recording) -> Known[str]:
    facts = recording.trial.facts
    unit = facts.get("unit of length", "") or facts.get("Units", "")
    return Known(value=unit, origin="file header") if unit else Known()


def _standing_mass(recording: Recording) -> float | None:
    """Mass by plates of somebody who stands still [kg]."""
    return mass_on_plates(recording, ForceOptions()) if recording.still else None


def _people(
    groups: Sequence[Group], trials: Sequence[SessionTrial], evidence: Sequence[Evidence]
) -> tuple[Person, ...]:
    """Person of each group; of two with one name in headers, codes of files name them."""
    headers = [_shared_header([evidence[member] for member in group.members]) for group in groups]
    counts = Counter(header.value for header in headers)
    people: list[Person] = []
    taken: set[str] = set()
    for group, header in zip(groups, headers, strict=True):
        own = [trials[member] for member in group.members]
        code = _code_of([evidence[member] for member in group.members])
        name = header if header and (counts[header.value] == 1 or not code) else code
        if not name:
            name = Known(value=NOBODY, sentence="no name or header identifies the person")
        name = replace(name, value=_free(str(name.value), taken))
        taken.add(str(name.value))
        people.append(
            Person(
                name=name,
                kind=kind_of(own),
                mass=mass_of(own),
                why=group.why,
                unresolved=group.unresolved,
            )
        )
    return tuple(people)


def _shared_header(own: Sequence[Evidence]) -> Known[str]:
    return next((one.header for one in own if one.header), Known())


def _code_of(own: Sequence[Evidence]) -> Known[str]:
    code = next((one.code for one in own if one.code.text), None)
    return Known() if code is None else Known(value=code.text, origin=code.origin)


def _free(name: str, taken: set[str]) -> str:
    """Name that nobody else has."""
    number = 2
    free = name
    while free in taken:
        free = f"{name}_{number}"
        number += 1
    return free


def kind_of(trials: Sequence[SessionTrial]) -> Known[Kind]:
    """Person or an animal, by the lengths of shanks and pelvis."""
    lengths = [one.mean for trial in trials for one in trial.measures.lengths.values()]
    animal = [trial for trial in trials if "animal" in trial.movement.sentence]
    if animal:
        return Known(value="animal", origin="segment lengths", sentence="legs shorter than 15 cm")
    if lengths:
        return Known(value="person", origin="segment lengths")
    return Known()


def mass_of(trials: Sequence[SessionTrial]) -> Known[float]:
    """Mass of a person by plates that carry somebody who stands still."""
    weighed = [trial for trial in trials if trial.measures.mass is not None]
    if not weighed:
        return Known(sentence="no quiet standing on plates")
    first = weighed[0]
    assert first.measures.mass is not None
    sentence = f"{first.name}, standing still"
    return Known(value=round(first.measures.mass.mean, 1), origin="plates", sentence=sentence)
