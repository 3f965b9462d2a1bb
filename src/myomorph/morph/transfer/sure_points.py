"""What is said of transferred points that may belong elsewhere, and which landmarks would tell where."""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from myomorph.morph.morphed import TransferredPoint
from myomorph.morph.shapes.articular import mm
from myomorph.morph.transfer.body_transfer import Transfers

LARGE = 0.03
"""Share of the bone's length: a point that is known less surely is named."""

APART = 0.2
"""Share of the bone's length between places that are asked for."""

ASKED = 3
"""Places that are asked for, at most."""


def uncertain_notes(points: Iterable[TransferredPoint], transfers: Transfers) -> list[str]:
    """A line for each bone with points that may belong far from where they were put, with landmarks to give."""
    notes = []
    by_body: dict[str, list[TransferredPoint]] = {}
    for point in points:
        by_body.setdefault(point.body, []).append(point)
    for body, here in by_body.items():
        length = transfers[body].length
        unsure = sorted((item for item in here if item.within > LARGE * length), key=lambda item: -item.within)
        if not unsure:
            continue
        asked: list[TransferredPoint] = []
        for point in unsure:
            if all(np.linalg.norm(point.source - other.source) > APART * length for other in asked):
                asked.append(point)
        places = ", ".join(f"'{item.owner}' ({item.name})" for item in asked[:ASKED])
        notes.append(
            f"{len(unsure)} of {len(here)} points on '{body}' may belong up to {mm(unsure[0].within)} away along the "
            f"bone (90 %): landmarks where these attach would tell: {places}"
        )
    return notes
