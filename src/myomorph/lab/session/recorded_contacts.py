"""Contacts of the feet of a recording, by its events, else by plates that carry the body."""

from __future__ import annotations

import numpy as np

from myomorph.lab.analysis.seen_contacts import (
    SeenContacts,
    contacts_of_events,
    contacts_of_force,
)
from myomorph.lab.session.plate_cover import LASTS, total_force, uncovered_share
from myomorph.lab.session.recordings import Recording
from myomorph.lab.store.settings import ForceOptions


def recorded_contacts(recording: Recording) -> SeenContacts | None:
    """Contacts by recorded events, else by plates under all steps; None where neither shows them.

    Parameters
    ----------
    recording : with events, plates, or a table of forces beside it
    """
    by_events = contacts_of_events(recording.trial.events)
    if by_events is not None and by_events.tells_flight:
        return by_events
    measured = total_force(recording, ForceOptions())
    if measured is None:
        return by_events
    time, force, _ = measured
    by_plates = contacts_of_force(time, force)
    if by_plates is None:
        return by_events
    # A foot that stands where no plate is would look like one in the air.
    uncovered = uncovered_share(recording, float(np.mean(force)))
    return by_plates if uncovered < LASTS else by_events
