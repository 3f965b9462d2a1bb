"""Units of a load cell's channels, as the recording names them or as sizes show them."""

from __future__ import annotations

from collections.abc import Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.force_units import force_factor, moment_factor, unit_in_name
from myomorph.core.model.series import Analog, Series

MAX_LEVERS = 10.0
"""Moments over forces so many times longer than the way to a corner of the tread are not in N m."""


def cell_units(names: Sequence[str], channels: Series) -> tuple[str, ...]:
    """Return the unit of each channel, "" where it is not known.

    It is the recording's (C3D), or stands in brackets at the end of the channel's name.

    Parameters
    ----------
    names : of the channels
    channels : as recorded (samples, channels)
    """
    units = channels.units if isinstance(channels, Analog) else ()
    of_file = {} if not units else dict(zip(channels.names, units, strict=True))
    return tuple(of_file.get(name, "").strip() or unit_in_name(name) for name in names)


def component_factor(measure: str, unit: str) -> float | None:
    """Return the factor from a unit to that of a component, None where it is another kind of unit.

    Parameters
    ----------
    measure : the component, "fx" to "mz"
    unit : of its channel; "" is taken as N or N m

    Examples
    --------
    >>> component_factor("mx", "Nmm"), component_factor("fz", ""), component_factor("fz", "V")
    (0.001, 1.0, None)
    """
    if not unit:
        return 1.0
    return force_factor(unit) if measure.startswith("f") else moment_factor(unit)


def moments_in_millimeters(
    measures: Sequence[str], components: Array, loaded: np.ndarray, corner: float
) -> bool:
    """Judge by sizes whether moments are in N mm although nothing says so.

    The force then acts many treads away, and near the tread in N mm.

    Parameters
    ----------
    measures : name of each component
    components : (samples, components) [N], [N m as stated]
    loaded : (samples,) whether the step carries a load
    corner : from the point of the moments to a corner of the tread, at most [m]

    Returns
    -------
    whether they are
    """
    across = [index for index, name in enumerate(measures) if name in ("mx", "my")]
    if not across or not loaded.any():
        return False
    normal = np.abs(components[loaded, list(measures).index("fz")])
    moment = np.linalg.norm(components[loaded][:, across], axis=1)
    lever = float(np.nanmedian(moment[normal > 0.0] / normal[normal > 0.0]))
    return MAX_LEVERS * corner < lever < 1e3 * MAX_LEVERS * corner
