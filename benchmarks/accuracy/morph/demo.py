"""Muscles of a leg carried into bones whose deformation is known.

Compared are points, joint centers and moment arms.
"""

from __future__ import annotations

import tempfile
from collections.abc import Iterator
from functools import lru_cache
from pathlib import Path

import numpy as np

from myomorph.bones.demo import MorphDemo, run_morph_demo
from myomorph.bones.morph.morphed import Morph

Row = dict[str, object]


@lru_cache(maxsize=1)
def _demo() -> MorphDemo:
    with tempfile.TemporaryDirectory() as folder:
        return run_morph_demo(Path(folder))


def demo_morph() -> Morph:
    """Return the leg of the demo in its deformed bones."""
    return _demo().morphed.morph


def measure() -> Iterator[Row]:
    """Yield a row for each method."""
    errors = _demo().errors
    for name, distances in errors.distances.items():
        row: Row = {"method": name, "points": len(distances)} | _spread("point", distances)
        if name in errors.arms:
            row |= _spread("moment arm", errors.arms[name])
        yield row


def _spread(what: str, values: np.ndarray) -> Row:
    return {
        f"{what} error, median [mm]": 1e3 * float(np.median(values)),
        f"{what} 95 % [mm]": 1e3 * float(np.percentile(values, 95.0)),
        f"{what} worst [mm]": 1e3 * float(values.max()),
    }


def measure_joints() -> Iterator[Row]:
    """Yield a row for each joint."""
    found = _demo()
    methods = {one.name: one for one in found.morphed.morph.joints}
    for name, error in found.errors.joints.items():
        yield {
            "joint": name,
            "center": methods[name].method,
            "error [mm]": 1e3 * error,
            "moved from mapped [mm]": 1e3 * methods[name].moved,
        }
