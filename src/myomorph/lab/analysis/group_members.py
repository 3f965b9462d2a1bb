"""A subject of a group, from its curves over strides."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.stride_curves import StrideCurves
from myomorph.lab.analysis.cycles import Cycles
from myomorph.lab.analysis.groups import Animal


def member(
    name: str, curves: Mapping[str, StrideCurves], values: Mapping[str, float] | None = None
) -> Animal:
    """Make a subject of a group from its curves over strides.

    Parameters
    ----------
    name : of the subject
    curves : over its strides, by what they are: "angle", "torque", ...
    values : further numbers of the subject, by name

    Returns
    -------
    the subject, for a `Group`

    Raises
    ------
    UnknownName : a curve has no strides

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> time = np.linspace(0.0, 2.0, 201)
    >>> knee = mm.Series(time, ("knee_angle_r",), np.sin(np.pi * time)[:, None])
    >>> mm.groups.member("s01", {"angle": knee.strides({"right": [0.0, 1.0, 2.0]})}).strides
    2
    """
    given = {key: np.array([value]) for key, value in (values or {}).items()}
    return Animal(
        name=name,
        scalars=FrozenMap(given),
        curves=FrozenMap({family: _cycles(one) for family, one in curves.items()}),
        strides=max((len(one) for one in curves.values()), default=0),
    )


def _cycles(curves: StrideCurves) -> Cycles:
    """Put each name over the strides of its own foot, NaN where that has fewer than another."""
    own = [curves[name] for name in curves.names]
    most = max(len(strides) for strides in own)
    values = np.full((most, len(curves.percent), len(own)), np.nan)
    for column, strides in enumerate(own):
        values[: len(strides), :, column] = strides
    return Cycles(curves.names, values)
