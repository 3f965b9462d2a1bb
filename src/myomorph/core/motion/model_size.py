"""A recorded body whose segments are longer or shorter than the model's: of another person."""

from __future__ import annotations

from collections.abc import Iterator, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.causes import SIZES
from myomorph.core.model.findings import Finding
from myomorph.core.model.model import Model
from myomorph.core.model.severity import severity_of
from myomorph.core.motion.body_size import distance_ratios

ERROR = 0.03  # Of lengths between markers on skin, above those of a model that was fitted.
APART = 0.045  # Size from which on it is named.
MIN_COUNT = 8  # Distances that are compared.
AGREE = 0.5  # Quartiles of the ratios differ from 1 by at least this part of their median.


def size_findings(model: Model, names: Sequence[str], values: Array) -> Iterator[Finding]:
    """Find a model that is smaller or larger than the body, in all its segments.

    Parameters
    ----------
    model : that was fitted
    names : of the markers
    values : (frames, markers, 3) [m], NaN where hidden

    Yields
    ------
    one finding or none
    """
    ratios, weights = distance_ratios(model, names, [values])
    if len(ratios) < MIN_COUNT:
        return
    order = np.argsort(ratios)
    reached = np.cumsum(weights[order]) / weights.sum()
    low, size, high = ratios[order][np.searchsorted(reached, [0.25, 0.5, 0.75])].tolist()
    apart = size - 1.0
    nearest = min(abs(low - 1.0), abs(high - 1.0)) if (low - 1.0) * (high - 1.0) > 0.0 else 0.0
    if abs(apart) < APART or nearest < AGREE * abs(apart):
        return
    text = SIZES.message(
        f"the recorded markers lie {size:.2f} times as far apart as those of the model (half of"
        f" {len(ratios)} distances {low:.2f} to {high:.2f} times): is it the model of another"
        " person, or not scaled yet? Scale or calibrate the model to this person",
        size=100.0 * apart,
        severity=severity_of(apart, ERROR),
    )
    yield Finding("size of the model", "all markers", text)
