"""Marker errors of coordinates that come from a file: `ik` left them beside it, and a report shows them."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import MyomorphError
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.store import stored as store
from myomorph.store.results import STORED, ResultWriter, read_result
from myomorph.study.inputs.reading import read_motion

SAME = 1e-5
"""Coordinates of a table and of the result beside it differ by less: the table is rounded [rad or m]."""


def put_fit_beside(writer: ResultWriter, motion: Path, model: Model, time: Array) -> bool:
    """Write the marker errors of `ik` (`NAME_ik.nc` beside `NAME.mot`) at some times [s] into another result, where
    they belong to its coordinates; whether there were any.
    """
    beside = motion.with_name(f"{motion.stem}_ik{STORED}")
    if not beside.is_file():
        return False
    try:
        stored = read_result(beside)
        fit, given = store.get_fit(stored), read_motion(motion, model)
    except (MyomorphError, OSError, KeyError, ValueError):
        return False
    if fit is None or len(fit.motion) != len(given) or set(fit.motion.names) != set(given.names):
        return False
    columns = [fit.motion.names.index(name) for name in given.names]
    if not np.allclose(fit.motion.values[:, columns], given.values, atol=SAME, equal_nan=True):
        # The table was changed, or is of another recording.
        return False
    frames = np.searchsorted(fit.motion.time, time - 1e-6)
    if len(frames) == 0 or frames[-1] >= len(fit.motion) or not np.allclose(fit.motion.time[frames], time, atol=1e-6):
        return False
    order = [fit.motion.names.index(name) for name in model.coordinate_names]
    coordinates = Motion(time, model.coordinate_names, fit.motion.values[frames][:, order])
    shown = replace(
        fit,
        motion=coordinates,
        errors=fit.errors[frames],
        converged=fit.converged[frames],
        iterations=fit.iterations[frames],
        closure=None if fit.closure is None else fit.closure[frames],
    )
    store.put_fit(writer, shown, model)
    markers = store.get_markers(stored)
    if markers is not None:
        store.put_markers(writer, replace(markers, time=time, values=markers.values[frames]))
    return True
