"""Two labels of one marker: columns of a recording that hold the same positions."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import LABELS
from myomorph.core.model.findings import Finding
from myomorph.core.model.series import Markers

DOUBLED = "doubled marker"
"""Kind of a finding."""
SHARE = 0.5
"""Share of the frames with both labels in which they lie at one place."""
FEWEST = 5
"""Frames in which they do."""
CLOSE = 1e-6
"""Distance of labels of one marker, over the length unit."""


def doubled_findings(markers: Markers, names: Sequence[str], unit: float) -> Iterator[Finding]:
    """Find pairs of labels that lie at one place.

    Parameters
    ----------
    markers : as recorded (frames, markers, 3) [m], NaN where hidden
    names : of the markers that count
    unit : what stands for one metre, see `length_unit` [m]

    Yields
    ------
    a finding for each pair
    """
    values = markers.values[:, [markers.names.index(name) for name in names]]
    for later in range(len(names)):
        for first in np.flatnonzero(_together(values[:, :later], values[:, later], CLOSE * unit)):
            pair = names[int(first)], names[later]
            text = LABELS.message(
                f"labels '{pair[0]}' and '{pair[1]}' have the same positions: one marker was given"
                " both; label the recording again, or leave one out",
                severity="changes results",
            )
            yield Finding(kind=DOUBLED, place=", ".join(pair), text=text)


def _together(others: Array, one: Array, close: float) -> np.ndarray:
    """Flag which of other markers lie where one does.

    Parameters
    ----------
    others : (frames, others, 3) [m]
    one : (frames, 3) [m]
    close : distance of two labels of one marker [m]

    Returns
    -------
    (others,)
    """
    distance = np.linalg.norm(others - one[:, None], axis=2)
    both = np.isfinite(distance).sum(axis=0)
    same = (distance < close).sum(axis=0)
    return np.asarray((same >= FEWEST) & (same >= SHARE * both))
