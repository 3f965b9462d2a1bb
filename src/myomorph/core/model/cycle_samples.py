"""Values at even shares of spans of time, as of strides from 0 to 100 %."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData

SAMPLES = 101
MAX_GAP = 0.1  # Of a signal within a span, as a share of it, that a line may cross


def over_spans(
    time: Array, values: Array, spans: Sequence[tuple[float, float]], samples: int = SAMPLES
) -> Array:
    """Resample columns over spans by straight lines between frames.

    Parameters
    ----------
    time : (frames,) ascending [s]
    values : (frames, columns), NaN where not known
    spans : start and end of each [s]
    samples : of each span, the first at its start and the last at its end

    Returns
    -------
    (spans, samples, columns), NaN outside of the series and in long gaps

    Raises
    ------
    BadData : the values are vectors, or a span does not go forward
    """
    if values.ndim != 2:
        raise BadData(
            f"curves over the cycle are of single numbers, but these have shape {values.shape}"
        )
    for start, stop in spans:
        if not stop > start:
            raise BadData(f"a cycle from {start:g} to {stop:g} s does not go forward")
    starts, stops = np.array(spans, dtype=np.float64).reshape(-1, 2).T
    at = np.linspace(starts, stops, samples, axis=1)
    step = float(np.median(np.diff(time))) if len(time) > 1 else np.nan
    known = np.isfinite(values).all(axis=0)
    if known.all():
        return _between(time, values, at, step)
    sampled = np.full((len(spans), samples, values.shape[1]), np.nan)
    # Columns without gaps share their places in time, and are done together.
    sampled[..., known] = _between(time, values[:, known], at, step)
    for column in np.flatnonzero(~known):
        finite = np.isfinite(values[:, column])
        alone = values[finite, column, None]
        sampled[..., column] = _between(time[finite], alone, at, step)[..., 0]
    return sampled


def _between(time: Array, values: Array, at: Array, step: float) -> Array:
    """Interpolate columns without gaps by straight lines.

    Parameters
    ----------
    time : (frames,) [s]
    values : (frames, columns), all known
    at : (spans, samples) [s]
    step : usual time between frames [s]

    Returns
    -------
    (spans, samples, columns), NaN outside and in long gaps
    """
    if len(time) < 2:
        return np.full((*at.shape, values.shape[1]), np.nan)
    after = np.clip(np.searchsorted(time, at), 1, len(time) - 1)
    span = time[after] - time[after - 1]
    share = ((at - time[after - 1]) / span)[..., None]
    before = values[after - 1]
    result: Array = before + share * (values[after] - before)
    apart = np.where(time[after] == at, 0.0, span)
    longest = np.maximum(MAX_GAP * (at[:, -1:] - at[:, :1]), 1.5 * step)
    result[(apart > longest) | (at < time[0]) | (at > time[-1])] = np.nan
    return result
