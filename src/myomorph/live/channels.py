"""What the channels of a stream mean: markers, plates, units."""

from __future__ import annotations

import re
from collections.abc import Callable, Mapping, Sequence

import numpy as np

from myomorph.identify.online import total_wrench
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData

_AXIS = re.compile(r"^(.*?)[ _.:-]?([xyz])$", re.IGNORECASE)
_FORCE = re.compile(r"^(.*?)[ _.:-]?([fptm])[ _.:-]?([xyz])$", re.IGNORECASE)
_UNITS: Mapping[str, float] = {
    "m": 1.0, "meter": 1.0, "meters": 1.0, "metre": 1.0, "metres": 1.0, "": 1.0,
    "mm": 1e-3, "millimeter": 1e-3, "millimeters": 1e-3, "millimetre": 1e-3, "millimetres": 1e-3,
    "cm": 1e-2, "centimeter": 1e-2, "centimeters": 1e-2,
}  # fmt: skip


def marker_channels(labels: Sequence[str], units: Sequence[str]) -> tuple[tuple[str, ...], np.ndarray, float]:
    """Names of markers, (markers, 3) their channels, and the factor to metres.

    Raises
    ------
    BadData : a marker without all three axes, no marker at all, or an unknown unit
    """
    found: dict[str, dict[str, int]] = {}
    for i, label in enumerate(labels):
        match = _AXIS.match(label)
        if match and match[1]:
            found.setdefault(match[1], {})[match[2].lower()] = i
    if not found:
        raise BadData(
            f"the markers' stream has channels {', '.join(labels[:6]) or 'without labels'}: expected NAME_x, NAME_y, "
            "NAME_z for every marker"
        )
    for name, axes in found.items():
        if set(axes) != set("xyz"):
            raise BadData(f"marker '{name}' of the stream has only {', '.join(sorted(axes))}: expected x, y and z")
    used = {units[i].strip().lower() for axes in found.values() for i in axes.values()}
    if len(used) != 1 or not used <= set(_UNITS):
        raise BadData(f"the markers' stream is in '{', '.join(sorted(used))}': expected one of m, mm, cm")
    columns = np.array([[axes[axis] for axis in "xyz"] for axes in found.values()])
    return tuple(found), columns, _UNITS[used.pop()]


def force_channels(labels: Sequence[str], units: Sequence[str]) -> tuple[tuple[str, ...], Callable[[Array], Array]]:
    """Names of plates, and a function from samples (samples, channels) to their wrenches (samples, plates, 6).

    Wrenches are moments about the ground's origin [N m] and forces [N].

    Raises
    ------
    BadData : a plate with neither F, P, T nor F, M in all three axes, or points in an unknown unit
    """
    found: dict[str, dict[str, int]] = {}
    for i, label in enumerate(labels):
        match = _FORCE.match(label)
        if match:
            found.setdefault(match[1], {})[match[2].lower() + match[3].lower()] = i
    wanted = {"fpt": {a + b for a in "fpt" for b in "xyz"}, "fm": {a + b for a in "fm" for b in "xyz"}}
    plates: list[tuple[str, np.ndarray, float]] = []
    for name, channels in found.items():
        kind = next((kind for kind, needed in wanted.items() if needed <= set(channels)), "")
        if not kind:
            raise BadData(
                f"plate '{name}' of the forces' stream has {', '.join(sorted(channels))}: expected Fx..Fz, Px..Pz, "
                "Tx..Tz, or Fx..Fz, Mx..Mz"
            )
        unit = units[channels["px"]].strip().lower() if kind == "fpt" else ""
        if unit not in _UNITS:
            raise BadData(f"the points of plate '{name}' are in '{unit}': expected m, mm or cm")
        plates.append((kind, np.array([[channels[a + b] for b in "xyz"] for a in kind]), _UNITS[unit]))
    if not plates:
        raise BadData(
            f"the forces' stream has channels {', '.join(labels[:6]) or 'without labels'}: expected NAME_Fx ... NAME_Tz"
        )

    def each(samples: Array) -> Array:
        result = np.empty((len(samples), len(plates), 6))
        for plate, (kind, columns, scale) in enumerate(plates):
            parts = samples[:, columns]
            if kind == "fm":
                result[:, plate] = np.concatenate([parts[:, 1], parts[:, 0]], axis=1)
            else:
                result[:, plate] = total_wrench(parts[:, None, 0], scale * parts[:, None, 1], parts[:, None, 2])
        return result

    return tuple(found), each
