"""Contact states: whose limb a site is on, and which site touches what over which time."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from myomorph.core.model.arrays import Array, runs
from myomorph.core.model.contacts import ContactForces, Contacts, Touch
from myomorph.core.model.model import GROUND
from myomorph.core.model.series import Wrenches
from myomorph.core.model.sides import split_side
from myomorph.lab.analysis.phases import SHORTEST_CONTACT, THRESHOLD, contacts
from myomorph.lab.analysis.selection import Subject, printed

MIN_LINE = 0.03
_HAND = re.compile(r"hand|palm|finger|thumb|stick|arm|wrist|grip|sleeve|lapel", re.IGNORECASE)
_FOOT = re.compile(r"foot|feet|sole|heel|toe|ball|calcn|pedal|shoe|plate", re.IGNORECASE)
_SIDES = {"r": "right", "l": "left", "right": "right", "left": "left"}


@dataclass(frozen=True)
class Limb:
    """The limb that a site of contact belongs to.

    It says whose it is ("" for the only subject), "hand", "foot" or the site's own name, and its
    side.
    """

    subject: str
    part: str
    side: str

    @property
    def label(self) -> str:
        """In print."""
        return " ".join(word for word in (self.subject, self.side, self.part) if word)


@dataclass(frozen=True)
class Row:
    """One line of the graph: its label, its side and its touches."""

    label: str
    side: str
    touches: tuple[Touch, ...]


def limb_of(site: str, who: Sequence[Subject] = ()) -> Limb:
    """Whose limb a site is on, as its name tells."""
    owner, bare, side = _told(site, who)
    if _HAND.search(bare):
        part = "hand"
    elif _FOOT.search(bare):
        part = "foot"
    else:
        part = bare
    return Limb(owner, part, side)


def _told(name: str, who: Sequence[Subject]) -> tuple[str, str, str]:
    """Subject, words and side of a name: of "uke_foot_r_heel" uke, "foot heel" and right."""
    owner = next(
        (subject for subject in who if subject.prefix and name.startswith(subject.prefix)), None
    )
    base, side = split_side(name.removeprefix(owner.prefix) if owner else name)
    words = base.replace("_", " ").split()
    if not side:
        inner = next((word for word in words if word.lower() in _SIDES), "")
        side = _SIDES.get(inner.lower(), "")
        words = [word for word in words if word != inner]
    return owner.name if owner else "", " ".join(words), side


def measured_contacts(wrenches: Wrenches, up: Array, weight: float | None) -> Contacts:
    """Find contacts from measured forces: vertical force over 3 % of body weight.

    `phases.contacts` finds the intervals.

    Parameters
    ----------
    wrenches : measured forces of the ground [N]
    up : (3,) unit vector against gravity
    weight : of the body [N]; without it a third of the peak stands in

    Returns
    -------
    Contacts of the bodies that the forces act on, of source "plates"; none without a force or with
        fewer than three frames
    """
    vertical = np.nan_to_num(wrenches.forces @ up)
    scale = weight or float(vertical.sum(axis=1).max(initial=0.0)) / 3.0
    names = tuple(body or name for name, body in zip(wrenches.names, wrenches.bodies, strict=True))
    touches = []
    if scale > 0.0 and len(wrenches) > 2:
        for column, site in enumerate(names):
            intervals = contacts(
                wrenches.time, vertical[:, column], THRESHOLD * scale, SHORTEST_CONTACT
            )
            ends = wrenches.time[np.array(intervals, int).reshape(-1, 2)].tolist()
            touches += [Touch(site, start, stop, source="plates") for start, stop in ends]
    return Contacts(tuple(dict.fromkeys(names)), tuple(touches))


def solved_contacts(forces: ContactForces) -> Contacts:
    """Contacts that estimated forces were allowed at: runs of an activation above 0."""
    touches = []
    for index, site in enumerate(forces.sites):
        for start, stop in runs(forces.contact_activation[:, index] > 0.0):
            sure = min(float(forces.contact_activation[start:stop, index].max()), 1.0)
            touches.append(
                Touch(
                    site=site.name,
                    start=float(forces.time[start]),
                    stop=float(forces.time[stop - 1]),
                    surface=site.against,
                    confidence=sure,
                )
            )
    return Contacts(forces.names, tuple(touches))


def graph_rows(contacts: Contacts, who: Sequence[Subject] = ()) -> tuple[Row, ...]:
    """Make the rows of a graph of contacts.

    There is one row per site that touches the ground and one per surface that is struck, feet and
    hands of a side together.
    """
    rows: dict[tuple[str, str], list[Touch]] = {}
    for touch in contacts.intervals:
        struck = touch.surface != GROUND and is_stroke(touch)
        key = ("", touch.surface) if struck else (touch.site, touch.surface)
        rows.setdefault(key, []).append(touch)
    touched = {touch.site for touch in contacts.intervals}
    rows |= {(site, GROUND): [] for site in contacts.sites if site not in touched}
    limb_rows: list[tuple[Limb, int, Row]] = []
    for (site, surface), touches in rows.items():
        limb = limb_of(site, who) if site else Limb("", "", "")
        label = row_label(site, who) if site else printed(surface)
        if site and surface != GROUND:
            label += f" on {row_label(surface, who).lower()}"
        place = contacts.sites.index(site) if site else len(limb_rows)
        limb_rows.append((limb, place, Row(label, limb.side, tuple(touches))))
    order = {"right": 0, "left": 1, "": 2}
    limb_rows.sort(
        key=lambda entry: (
            entry[0].subject,
            entry[0].part == "foot",
            entry[0].part,
            order[entry[0].side],
            entry[1],
        )
    )
    return tuple(row for _, _, row in limb_rows)


def row_label(site: str, who: Sequence[Subject] = ()) -> str:
    """Write the name of a site for print: its subject, its side and its words.

    The bones of a foot are the foot.
    """
    owner, bare, side = _told(site, who)
    words = printed(bare).lower()
    words = "foot" if words in ("calcn", "calcaneus", "foot") else words
    text = " ".join(word for word in (owner, side, words) if word)
    return text[:1].upper() + text[1:]


def is_stroke(touch: Touch) -> bool:
    """Whether a contact is an impact: heard, or too short to be drawn as a line."""
    return touch.source == "sound" or touch.stop - touch.start < MIN_LINE


def limb_states(
    contacts: Contacts, time: Array, who: Sequence[Subject] = ()
) -> tuple[tuple[Limb, ...], np.ndarray]:
    """Find the limbs and the times at which any site of each is in contact.

    Parameters
    ----------
    contacts : of the sites
    time : (frames,) [s]
    who : subjects, whose names the sites' names begin with

    Returns
    -------
    The limbs, and (frames, limbs) whether any site of the limb touches anything
    """
    states = contacts.states(time)
    homes = [limb_of(site, who) for site in contacts.sites]
    limbs = tuple(dict.fromkeys(homes))
    touching = np.zeros((len(time), len(limbs)), dtype=bool)
    for index, home in enumerate(homes):
        touching[:, limbs.index(home)] |= states.values[:, index] >= 0.5
    return limbs, touching
