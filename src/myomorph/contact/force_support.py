"""Frames in which the plates carry all that the body stands on, by the feet's motion and not by the forces' clock."""

from __future__ import annotations

import numpy as np
from numpy.typing import NDArray

from myomorph.contact.foot_stance import standing
from myomorph.contact.force_inspection import Inspection
from myomorph.model.arrays import runs

PAUSE = 0.06
"""A foot that moves for a shorter time goes on standing [s]."""

CARRIED = 0.6
"""Share of a stance during which a plate has to carry its foot."""

EDGE = 0.05
"""Uncertainty of the time at which a foot is put down or lifted, by its motion [s]."""


def supported(inspection: Inspection) -> NDArray[np.bool_]:
    """Frames (frames,) in which every foot that stands does so on a plate, and one does.

    A stance counts as a whole, so that the frames hardly depend on the clock of the forces; where one begins or ends
    that no plate carries, frames around are left out.
    """
    feet = inspection.feet
    step = float(np.median(np.diff(feet.time)))
    edge, pause = max(1, round(EDGE / step)), max(1, round(PAUSE / step))
    stands = standing(inspection)
    carries = _carries(inspection)
    on_plate = np.zeros(len(feet.time), bool)
    elsewhere = np.zeros(len(feet.time), bool)
    for foot in range(len(feet.feet)):
        for start, stop in _joined(list(runs(stands[:, foot])), pause):
            if carries[start:stop, foot].mean() > CARRIED:
                on_plate[start:stop] = True
            elif stop - start > pause:
                elsewhere[max(0, start - edge) : stop + edge] = True
    return np.asarray(on_plate & ~elsewhere)


def _carries(inspection: Inspection) -> NDArray[np.bool_]:
    """(frames, feet) whether a plate carries each foot."""
    feet = inspection.feet
    found = np.zeros((len(feet.time), len(feet.feet)), bool)
    distances = feet.distances(inspection.samples.centers(feet.up)[:, inspection.numbers])
    nearest = np.argmin(np.nan_to_num(distances, nan=9.0), axis=2)
    for column, k in enumerate(map(int, inspection.numbers)):
        own = feet.owners.get(inspection.wrenches.bodies[k])
        loaded = inspection.samples.loaded[:, k]
        for foot in range(len(feet.feet)):
            found[:, foot] |= loaded & (nearest[:, column] == foot if own is None else own == foot)
    return found


def _joined(parts: list[tuple[int, int]], pause: int) -> list[tuple[int, int]]:
    """Runs with short gaps between them closed."""
    found: list[tuple[int, int]] = []
    for start, stop in parts:
        if found and start - found[-1][1] <= pause:
            found[-1] = (found[-1][0], stop)
        else:
            found.append((start, stop))
    return found
