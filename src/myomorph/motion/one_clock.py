"""Recordings of several subjects at the same times, where their systems ran at different rates."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.join import clock_difference
from myomorph.model.series import Motion, Series
from myomorph.motion.clocks import resample

SeriesKind = TypeVar("SeriesKind", bound=Series)


def on_one_clock(parts: Mapping[str, SeriesKind]) -> tuple[dict[str, SeriesKind], tuple[str, ...]]:
    """Motions or markers of several parts at the times of that with the highest rate, over what all of them cover.

    Times are taken as they are: clocks that count from different instants have to be brought together first
    (`estimate_clock`). A resampled motion has no velocities: differentiate it again.

    Returns
    -------
    parts : by the same names; themselves where their times are the same already
    notes : what was resampled or cut, one line each

    Raises
    ------
    BadData
        where two parts have no time in common, or a part has no frames
    """
    if not clock_difference(parts):
        return dict(parts), ()
    names = list(parts)
    start = max(names, key=lambda name: parts[name].time[0])
    end = min(names, key=lambda name: parts[name].time[-1])
    begin, stop = parts[start].time[0], parts[end].time[-1]
    if stop <= begin:
        raise BadData(
            f"'{end}' ends at {stop:g} s and '{start}' begins at {begin:g} s: no time in common; do their clocks count "
            "from the same instant?"
        )
    fastest = max(names, key=lambda name: parts[name].rate)
    times = parts[fastest].time
    slack = 0.01 * float(np.median(np.diff(times)))
    times = times[(times >= begin - slack) & (times <= stop + slack)]
    found, notes = {}, []
    for name, one in parts.items():
        found[name] = _at(one, times)
        if name != fastest:
            notes.append(
                f"'{name}' ({one.rate:.4g} Hz) is resampled to the times of '{fastest}' ({parts[fastest].rate:.4g} Hz)"
            )
        lost = len(one) - int(((one.time >= times[0] - slack) & (one.time <= times[-1] + slack)).sum())
        if lost:
            notes.append(f"'{name}' loses {lost} of {len(one)} frames, from before {begin:g} or after {stop:g} s")
    return found, tuple(notes)


def _at(series: SeriesKind, time: Array) -> SeriesKind:
    """Columns without gaps by splines, others by straight lines between neighbours that are both seen."""
    if isinstance(series, Motion):
        series = replace(series, velocities=None, accelerations=None)
    if np.isfinite(series.values).all():
        return resample(series, time)
    flat = series.values.reshape(len(series), -1)
    columns = [np.interp(time, series.time, column) for column in flat.T]
    return replace(series, time=time, values=np.array(columns).T.reshape(len(time), *series.values.shape[1:]))
