"""Forces of plates with a correction made, as far as it is one of forces, points and clocks."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.core.contact.consistency.corrections import Correction
from myomorph.core.model.arrays import Array
from myomorph.core.model.series import Wrenches


def corrected_plates(wrenches: Wrenches, correction: Correction) -> Wrenches:
    """Correct forces, points and clocks of plates.

    Parameters
    ----------
    wrenches : (samples, plates, 3) [N], [m], [N m]
    correction : for which `of_plates` holds

    Returns
    -------
    on the clock of before, without gaps
    """
    on_time = _on_time(wrenches, correction.lag)
    return replace(
        on_time,
        forces=np.einsum("pij,npj->npi", correction.force, on_time.forces) + correction.offset,
        points=np.einsum("pij,npj->npi", correction.point, on_time.points) + correction.shift,
    )


def _on_time(wrenches: Wrenches, lag: Array) -> Wrenches:
    """Take the clocks of plates back by what they are late, (plates,) [s]."""
    steps = np.arange(len(wrenches))
    rate = 1.0 / float(np.median(np.diff(wrenches.time)))
    numbers = np.clip(steps[:, None] + np.round(rate * lag).astype(int), 0, len(wrenches) - 1)
    plates = np.arange(len(lag))
    return replace(
        wrenches,
        forces=np.nan_to_num(wrenches.forces)[numbers, plates],
        points=np.nan_to_num(wrenches.points)[numbers, plates],
        torques=np.nan_to_num(wrenches.torques)[numbers, plates],
    )
