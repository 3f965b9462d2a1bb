"""What is believed of lengths and markers before anything is recorded, as rows of a least-squares problem."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.motion.calibration import CalibrationOptions, Distances
from myomorph.motion.lengths import Length, mirrored_lengths
from myomorph.motion.shared_fit import Prior


def usual_shifts(model: Model, names: Sequence[str], distances: Distances) -> Array:
    """(markers,) how far each lies from its place on the model, as a standard deviation along one axis [m]."""
    return np.array([distances.fixed if model.marker(name).fixed else distances.marker for name in names])


def calibration_prior(lengths: Sequence[Length], shift_sd: Array, options: CalibrationOptions, size: float) -> Prior:
    """Rows of the prior over lengths, shifts (markers,) and the overall size."""
    n, shifts = len(lengths), 3 * len(shift_sd)
    main = {one.segment: i for i, one in enumerate(lengths) if one.along}
    rows, right = [], []

    def add(entries: Mapping[int, float], value: float, sd: float) -> None:
        row = np.zeros(n + shifts + 1)
        for i, factor in entries.items():
            row[i] += factor / sd
        rows.append(row)
        right.append(value / sd)

    add({n + shifts: 1.0}, size, 0.5)
    for i, one in enumerate(lengths):
        if one.along:
            add({i: 1.0, n + shifts: -1.0}, 0.0, options.length_sd)
        else:
            add({i: 1.0, main[one.segment]: -1.0}, 0.0, options.shape_sd)
    for i, j in mirrored_lengths(lengths):
        add({i: 1.0, j: -1.0}, 0.0, options.side_sd)
    for i in range(shifts):
        add({n + i: 1.0}, 0.0, float(shift_sd[i // 3]))
    return Prior(np.array(rows), np.array(right))
