"""Clocks of plates under swinging limbs, where the plate's axes are off too.

What is corrected of a clock that is off, or that is right, and what is left.
"""

from __future__ import annotations

from collections.abc import Iterable
from typing import NamedTuple

import numpy as np

from benchmarks.accuracy.viscosity.faulty_limbs import Faults, faulty_limb
from myomorph.core.model.arrays import Array
from myomorph.swings.viscosity.tracking.track import track

Row = dict[str, object]

SEEDS = range(20000, 20010)
"""Limbs on which nothing was chosen."""
TILT = (0.02, 0.0, -0.02)
"""Turn of the plate's axes [rad]."""
CLOCKS = (0.0, 0.002, 0.012)
"""By which the plate's clock is late [s]."""
NINETY = 1.645
"""Standard deviations on either side that hold 90 %."""


class Clocks(NamedTuple):
    """Clocks that were found, one a swing.

    Attributes
    ----------
    offset, sd : (swings,) with its standard deviation, 0 where the clock was left as it is [s]
    """

    offset: Array
    sd: Array


def measure() -> Iterable[Row]:
    """Describe clocks by a row for each offset and tilt."""
    for tilt in ((0.0, 0.0, 0.0), TILT):
        for late in CLOCKS:
            found = _clocks(Faults(turn=tilt, clock=late))
            left = found.offset + late
            corrected = found.sd > 0.0
            inside = np.abs(left[corrected]) < NINETY * found.sd[corrected]
            yield {
                "plate": "tilted by 1.6 degrees" if any(tilt) else "level",
                "clock late by [ms]": 1e3 * late,
                "swings": len(left),
                "corrected": int(corrected.sum()),
                "inside 90 % intervals": int(inside.sum()),
                "left, median [ms]": 1e3 * float(np.median(np.abs(left))),
                "left, most [ms]": 1e3 * float(np.abs(left).max()),
            }


def _clocks(faults: Faults) -> Clocks:
    """Find the clocks of every swing of the limbs."""
    offsets = []
    errors = []
    for seed in SEEDS:
        limb = faulty_limb(seed, faults, None)
        for trials in limb.trials.values():
            clocks = [trial.clock for trial in track(limb.known, trials).trials]
            offsets += [clock.offset for clock in clocks]
            errors += [clock.offset_sd for clock in clocks]
    return Clocks(offset=np.array(offsets), sd=np.array(errors))
