"""What a study assumes of its session: who was recorded, and which movement each trial is of."""

from __future__ import annotations

from dataclasses import replace

from myomorph.lab.session.read import session_of
from myomorph.lab.session.recordings import Recording
from myomorph.lab.session.session import Session, SessionTrial
from myomorph.lab.study.inputs.session import TrialSession


def people_sentences(session: Session) -> list[str]:
    """Sentences on who was recorded, and on what cannot be told of it."""
    unresolved = [
        f"{text[0].upper()}{text[1:]}." for person in session.people for text in person.unresolved
    ]
    return [*_who(session), *unresolved]


def _who(session: Session) -> list[str]:
    """Name who was recorded; none where nothing names the only one."""
    if len(session.people) == 1:
        (person,) = session.people
        if person.name.origin == "not known":
            return []
        if person.name.origin == "user":
            return [f"Subject: {person.name}, as stated."]
        return [f"Subject: {person.name}, from the {person.name.origin}."]
    texts = [
        f"{person.name} ({person.why})" if person.why else str(person.name)
        for person in session.people
    ]
    return [f"The recordings are of {len(texts)} people: {'; '.join(texts)}."]


def other_person_sentences(static: Recording, moving: Recording) -> list[str]:
    """Warn of a static trial that is of another person than a motion; none where it need not be.

    Parameters
    ----------
    static, moving : recordings of markers
    """
    people = session_of([moving, static]).people
    if len(people) == 1:
        return []
    return [
        f"WARNING: {static.path.name} seems to be of another person than {moving.path.name}"
        f" ({people[1].why}): lengths of segments are taken from both, so give the static trial of"
        " the person who moves (--static), or leave it out."
    ]


def stated_session(trial: SessionTrial, stated: TrialSession) -> tuple[TrialSession, list[str]]:
    """Movement and day of a trial as a study file has them, and sentences on them.

    Parameters
    ----------
    trial : of the session
    stated : by the user, which goes before what was found
    """
    movement = stated.movement or trial.movement.value or ""
    day = stated.date or (str(trial.date) if trial.date else "")
    texts = []
    if trial.movement.origin == "user":
        texts.append(f"{str(trial.movement).capitalize()}, as stated.")
    elif not stated.movement and trial.movement:
        texts.append(
            f"{str(trial.movement).capitalize()}, by {trial.movement.origin}"
            f" ({trial.movement.sentence})."
        )
    texts += [f"WARNING: {text}." for text in trial.warnings]
    return replace(stated, movement=movement, date=day), texts
