"""A session as the page shows it: what was found, how it is known, and what is missing."""

from __future__ import annotations

import os
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np

from myomorph.core.io.formats import model_format
from myomorph.core.model.errors import BadData
from myomorph.core.motion.protocols import SIDES, protocols
from myomorph.lab.analyze.analyze import STUDY, all_still, static_trial
from myomorph.lab.analyze.arms import have_arms
from myomorph.lab.analyze.proposed_protocol import MIDLINE, proposed_sites
from myomorph.lab.analyze.recorded_trial import AnalyzeRequest
from myomorph.lab.analyze.unfit_markers import missing_segments, shows_body, unfit_markers
from myomorph.lab.session.plate_cover import weighed
from myomorph.lab.session.read import looked_at, session_of
from myomorph.lab.session.recordings import Recording, by_what_shows, files_of, sites_of
from myomorph.lab.session.session import Person, Session, SessionTrial
from myomorph.lab.store.locks import MARK
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.plan.written_plan import is_unchanged
from myomorph.show.app.paths import documents_folder
from myomorph.show.app.words import in_page_words

Found = dict[str, Any]
"""Part of the page's data, as JSON has it."""
MAX_UNKNOWN = 200  # Labels that the page lists.


@dataclass(frozen=True, kw_only=True, eq=False)
class Look:
    """What was found in a folder.

    Attributes
    ----------
    folder : or file
    recordings : that can be read
    session : of these
    passed_over : why other files are not used, one line each
    """

    folder: Path
    recordings: tuple[Recording, ...]
    session: Session
    passed_over: tuple[str, ...]

    def of(self, person: Person) -> list[Recording]:
        """List the recordings of a person."""
        paths = {trial.path for trial in self.session.of(str(person.name))}
        return [recording for recording in self.recordings if recording.path in paths]


def look_into(folder: Path, begins: Callable[[int, int, str], None]) -> Look:
    """Read the recordings of a folder, those in folders of results left out.

    Parameters
    ----------
    folder : or file
    begins : called with number, count and name of each file before it is read

    Raises
    ------
    MyomorphError : there is nothing that can be read
    """
    files, passed_over = files_of([folder])
    files = [path for path in files if not _is_result(path, folder)]
    count = 0

    def begun(path: Path) -> None:
        nonlocal count
        count += 1
        begins(count, len(files), path.name)

    recordings, unread = looked_at(files, begins=begun)
    if not recordings:
        why = "; ".join(unread[:3]) or f"{folder}: holds recordings only in folders of results"
        raise BadData(why)
    session = session_of(recordings, str(folder))
    return Look(
        folder=folder,
        recordings=tuple(recordings),
        session=session,
        passed_over=(*passed_over, *unread),
    )


def _is_result(path: Path, folder: Path) -> bool:
    """Whether a file lies in a folder of results, below the folder that is looked at."""
    homes = [home for home in path.parents if home.is_relative_to(folder) and home != folder]
    return any((home / MARK).is_file() for home in homes)


def found_session(look: Look) -> Found:
    """Session as the page shows it."""
    session = look.session
    unresolved = [text for person in session.people for text in person.unresolved]
    return {
        "source": str(look.folder),
        "date": str(session.date) if session.date else "",
        "people": [_person(person, look) for person in session.people],
        "trials": [_trial(number, trial) for number, trial in enumerate(session.trials)],
        "labels": _labels(look),
        "arms": have_arms(sites_of(look.recordings)),
        "models": _models(look.folder),
        "passed_over": [in_page_words(text) for text in look.passed_over],
        "unresolved": unresolved,
    }


def results_folder(look: Look) -> Path:
    """Folder for results beside the recordings, one whose study file nobody has changed."""
    folder = look.folder if look.folder.is_dir() else look.folder.parent
    stem = look.folder.stem if look.folder.is_file() else look.folder.name
    name = f"{stem}_results"
    home = folder if os.access(folder, os.W_OK) else documents_folder()
    out = home / name
    number = 2
    while (out / STUDY).is_file() and not is_unchanged(_text(out / STUDY)):
        out = home / f"{name}_{number}"
        number += 1
    return out


def _text(path: Path) -> str:
    return path.read_text(encoding="utf-8", errors="replace")


def _models(folder: Path) -> dict[str, str]:
    """OpenSim models of the folder itself, by name."""
    if not folder.is_dir():
        return {}
    files = [path for path in sorted(folder.iterdir()) if path.suffix.lower() == ".osim"]
    return {path.name: str(path) for path in files if model_format(path)}


def _person(person: Person, look: Look) -> Found:
    """Person with mass, and the recording of standing still."""
    marked, sensed = by_what_shows(look.of(person))
    of_file = {trial.path: trial for trial in look.session.trials}
    static: Recording | None = None
    moving = [*marked, *sensed]
    sentence = ""
    if marked:
        request = AnalyzeRequest(recordings=())
        static, still_moving, sentence = static_trial(marked, of_file, request)
        moving = [*still_moving, *sensed]
    paths = [recording.path for recording in look.recordings]
    inside = static is not None and static.path in paths
    mass, of_mass = _mass(static, moving)
    return {
        "name": str(person.name),
        "known": person.name.explained,
        "named": person.name.origin != "not known",
        "kind": person.kind.value or "",
        "why": person.why,
        "mass": mass,
        "of_mass": of_mass,
        "static": paths.index(static.path) if static is not None and inside else None,
        "of_static": sentence,
    }


def _mass(static: Recording | None, moving: Sequence[Recording]) -> tuple[float | None, str]:
    """Mass by plates [kg], None where none weighs the person; and a sentence."""
    try:
        return weighed(static, moving, ForceOptions())
    except BadData as error:
        return None, str(error)


def _trial(number: int, trial: SessionTrial) -> Found:
    clock = trial.clock
    rate = 0.0 if clock is None or not np.isfinite(clock.rate) else clock.rate
    return {
        "id": number,
        "path": str(trial.path),
        "file": trial.path.name,
        "name": trial.name,
        "person": trial.person,
        "movement": trial.movement.value or "",
        "how": trial.movement.explained,
        "seconds": 0.0 if clock is None else round(clock.duration, 2),
        "rate": round(rate),
        "markers": trial.markers,
        "plates": 0 if trial.plates.sentence else trial.plates.value or 0,
        "table": trial.plates.sentence,
        "emg": len(trial.emg),
        "sensors": trial.sensors,
        "still": trial.still,
        "warnings": list(trial.warnings),
    }


def needs_places(look: Look) -> bool:
    """Whether somebody must say what markers lie on, for the generic model."""
    return bool(_unfit(look))


def _unfit(look: Look) -> list[Recording]:
    """List recordings whose known markers do not move the generic model."""
    return [
        one
        for one in look.recordings
        if one.trial.markers is not None and not shows_body(one.found)
    ]


def _labels(look: Look) -> Found:
    """Labels of markers that nothing knows; where too few are known, what they may lie on."""
    marked = [one for one in look.recordings if one.trial.markers is not None]
    unfit = _unfit(look)
    unknown = list(dict.fromkeys(label for one in marked for label in one.found.unknown))
    known = dict.fromkeys(label for one in marked for label in one.found.sites)
    title = next((one.found.protocol.title for one in marked if one.found.protocol), "")
    return {
        "known": len(known),
        "protocol": title,
        "unknown": [label for label in unknown if "#" not in label][:MAX_UNKNOWN],
        "count": len(unknown),
        "needed": bool(unfit),
        "why": in_page_words(_why_unfit(unfit[0])) if unfit else "",
        "proposed": _proposed(marked) if unfit else {},
        "landmarks": list(landmark_words()),
    }


def _why_unfit(recording: Recording) -> str:
    return unfit_markers(recording.found, missing_segments(recording.found))


def _proposed(marked: Sequence[Recording]) -> dict[str, Found]:
    """Landmarks that markers of somebody who stands may lie on, by label."""
    standing = next(filter(all_still, marked), None)
    if standing is None or standing.trial.markers is None:
        return {}
    proposals = proposed_sites(standing.trial.markers)
    return {
        proposal.label: {"place": str(proposal.site), "apart": round(100.0 * proposal.distance)}
        for proposal in proposals
    }


def landmark_words() -> Mapping[str, str]:
    """Keys of a table of protocols by the words that the page shows: "right lateral malleolus"."""
    words = {}
    for key, (landmark, _) in protocols().landmarks.items():
        middle = key.split(".")[1] in MIDLINE
        for side in ("",) if middle else SIDES.values():
            words[f"{side} {landmark}".strip()] = f"{side} {key}".strip()
    return words
