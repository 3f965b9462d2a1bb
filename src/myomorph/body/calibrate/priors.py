"""Prior knowledge of lengths, marker positions and the overall size."""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from myomorph.body.calibrate.calibration import CalibrationOptions, Distances
from myomorph.body.calibrate.shared_problem import BLOCKS
from myomorph.core.fit.residuals import LinearPrior
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.motion.lengths import Length, mirrored_lengths

SIZE_SD = 0.5  # Of the overall size about the one that the markers show at first
# Of the difference of two sides that the data show to differ, as a share of the length
ASYMMETRIC_SD = 0.1


def usual_shifts(model: Model, names: Sequence[str], distances: Distances) -> Array:
    """Look up how far each marker usually lies from its position on the model.

    Parameters
    ----------
    model : says which markers are fixed, as on bony landmarks
    names : of the markers
    distances : of fixed and of other markers [m]

    Returns
    -------
    (markers,) standard deviation along one axis [m]
    """
    return np.array(
        [distances.fixed if model.marker(name).fixed else distances.marker for name in names]
    )


def calibration_prior(
    lengths: Sequence[Length],
    shift_sd: Array,
    options: CalibrationOptions,
    size: float,
    differing: Collection[tuple[str, str]] = (),
) -> LinearPrior:
    """Build the prior over lengths, shifts and overall size.

    Parameters
    ----------
    lengths : whose factors are the first unknowns
    shift_sd : (markers,) standard deviation of each marker's shift along one axis [m]
    options : standard deviations of lengths, of stretch across, and of differences between sides
    size : overall size, whose standard deviation is `SIZE_SD`
    differing : names of pairs of lengths whose sides are not held alike

    Returns
    -------
    rows over (lengths, 3 markers, size), each of unit standard deviation; those of sides are last
    """
    sd_by_axis = np.repeat(shift_sd, 3)
    first_shift = len(lengths)
    overall = first_shift + len(sd_by_axis)
    longest = {length.segment: i for i, length in enumerate(lengths) if length.along}

    rows = _Rows(overall + 1)
    rows.add({overall: 1.0}, value=size, sd=SIZE_SD)
    for i, length in enumerate(lengths):
        if length.along:
            rows.add({i: 1.0, overall: -1.0}, value=0.0, sd=options.length_sd)
        else:
            rows.add({i: 1.0, longest[length.segment]: -1.0}, value=0.0, sd=options.shape_sd)
    for i, sd in enumerate(sd_by_axis.tolist()):
        rows.add({first_shift + i: 1.0}, value=0.0, sd=sd)
    for i, j in mirrored_lengths(lengths):
        free = (lengths[i].name, lengths[j].name) in differing
        rows.add({i: 1.0, j: -1.0}, value=0.0, sd=ASYMMETRIC_SD if free else options.side_sd)
    return LinearPrior(
        name="usual bodies",
        blocks=BLOCKS,
        rows=np.array(rows.slopes),
        right=np.array(rows.right),
    )


class _Rows:
    """Rows of a linear prior, slopes . x ~ N(right, 1), one added after the other."""

    def __init__(self, unknowns: int):
        self.unknowns = unknowns
        self.slopes: list[Array] = []
        self.right: list[float] = []

    def add(self, factors: Mapping[int, float], value: float, sd: float) -> None:
        """Add that a sum of unknowns, each times its factor, is `value` but for `sd`."""
        row = np.zeros(self.unknowns)
        for unknown, factor in factors.items():
            row[unknown] += factor / sd
        self.slopes.append(row)
        self.right.append(value / sd)
