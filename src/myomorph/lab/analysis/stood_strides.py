"""Strides whose foot stood on plates: one rule for all that follows from the force under it.

A moment of a leg that stood beside the plates is that of a leg that nothing carries. So moments,
powers and forces of a stride count where the foot was on plates for its stance.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.model import Model
from myomorph.core.model.series import Series, Wrenches
from myomorph.lab.analysis.cycles import over_cycles
from myomorph.lab.analysis.strides import Stride
from myomorph.lab.analysis.walking import chains, walking_limbs

SAMPLES = 51  # Of a stride
LOADED = 0.05
STOOD = 0.8
"""Share of body weight, and of the stance, from which on a foot stood on plates."""
MIN_STANCE = 0.6
"""Share of a stride that is taken for its stance where no foot off was seen."""


def stood_strides(strides: Sequence[Stride], force: Array) -> np.ndarray:
    """Find the strides whose foot was on plates for its stance.

    Parameters
    ----------
    strides : of one foot
    force : (strides, samples) vertical force on it [body weights], NaN where not known

    Returns
    -------
    (strides,)
    """
    stood = np.zeros(len(strides), bool)
    for index, stride in enumerate(strides):
        duty = stride.duty if np.isfinite(stride.duty) else MIN_STANCE
        stance = force[index, : max(int(duty * len(force[index])), 1)]
        stood[index] = np.mean(np.nan_to_num(stance) > LOADED) >= STOOD
    return stood


def leg_force(
    model: Model, bodies: Collection[str], wrenches: Wrenches | None, measured: Series | None = None
) -> Series | None:
    """Vertical force on a leg over its own time.

    Parameters
    ----------
    model : of the body
    bodies : of the leg
    wrenches : external forces, maybe filtered
    measured : (samples, bodies) vertical force on each body as measured [N], which goes before them

    Returns
    -------
    (samples, 1) [body weights]; None without plates or weight
    """
    if not model.weight > 0.0:
        return None
    if measured is not None:
        columns = [index for index, name in enumerate(measured.names) if name in bodies]
        force = np.nan_to_num(measured.values[:, columns]).sum(axis=1)
        return Series(measured.time, ("force",), force[:, None] / model.weight)
    if wrenches is None:
        return None
    columns = [index for index, carrier in enumerate(wrenches.bodies) if carrier in bodies]
    force = np.nan_to_num(wrenches.forces[:, columns] @ np.asarray(model.up)).sum(axis=1)
    return Series(wrenches.time, ("force",), force[:, None] / model.weight)


def limbs_on_plates(
    model: Model,
    strides: Mapping[str, Sequence[Stride]],
    wrenches: Wrenches | None,
    measured: Series | None = None,
) -> Mapping[str, np.ndarray]:
    """Find the strides of every limb whose foot was on plates for its stance.

    Parameters
    ----------
    model : whose feet are found by their names
    strides : by limb
    wrenches, measured : as of `leg_force`

    Returns
    -------
    by limb, (strides,); {} where no leg was on a plate, or limbs are no feet
    """
    legs = chains(model, walking_limbs(model)) if walking_limbs(model) else {}
    if not set(strides) <= set(legs):
        return {}
    stood = {}
    for limb, own in strides.items():
        force = leg_force(model, legs[limb], wrenches, measured)
        if force is None or len(force) < 2:
            return {}
        spans = [(stride.start, stride.stop) for stride in own]
        stood[limb] = stood_strides(own, over_cycles(force, spans, SAMPLES).values[..., 0])
    return stood if any(flags.any() for flags in stood.values()) else {}
