"""The coordinates by which a body floats in the laboratory, whose bounds say nothing about the body."""

from __future__ import annotations

from collections.abc import Iterator

import numpy as np

from myomorph.model.arrays import Array, runs
from myomorph.model.model import GROUND, Joint, Model

SLACK = 1e-9
"""Of an angle, that counts as none [rad]."""
MASSLESS = 1e-6
"""A body lighter than this share of the whole is a link on the way from the ground."""


def floating_coordinates(model: Model) -> tuple[str, ...]:
    """Coordinates of the joints that let a body float: at least two translations and one rotation against the ground.

    A joint to the ground that only turns (an arm fixed at the shoulder) or only slides (a sled) is part of the
    body or of a rig, and its bounds count. Massless links between ground and body belong to the root joint.
    """
    result: list[str] = []
    for chain in _root_chains(model):
        axes = [(axis.kind, name) for joint in chain for axis in joint.axes for name in axis.coordinates]
        turns = {name for kind, name in axes if kind == "rotation"}
        # Old files call the translations of a custom joint coupled; a rotation may bring a translation along.
        slides = {name for kind, name in axes if kind == "translation"} - turns
        if len(slides) >= 2 and turns:
            result += dict.fromkeys(name for _, name in axes)
    return tuple(result)


def of_one_turn(model: Model, values: Array) -> Array:
    """Coordinates whose floating angles begin, and go on after every gap, on the turn that is nearest.

    Parameters
    ----------
    values : (frames, coordinates) [rad or m], NaN in gaps; from frame to frame angles change by less than half a turn

    Returns
    -------
    the same poses
    """
    values = values.copy()
    for name in _whole_turns(model):
        column, last = model.coordinate_names.index(name), model.coordinate(name).default
        for start, stop in runs(np.isfinite(values[:, column])):
            values[start:stop, column] = np.unwrap(values[start:stop, column])
            values[start:stop, column] -= 2.0 * np.pi * np.round((values[start, column] - last) / (2.0 * np.pi))
            last = values[stop - 1, column]
    return values


def _whole_turns(model: Model) -> Iterator[str]:
    """Floating angles that give the same pose a turn later: those that an axis turns by, one to one."""
    axes = [axis for joint in model.joints for axis in joint.axes]
    for name in floating_coordinates(model):
        turning = [axis for axis in axes if name in axis.coordinates]
        if len(turning) != 1 or turning[0].kind != "rotation" or turning[0].function.arity != 1:
            continue
        turned = float(turning[0].function(np.array(2.0 * np.pi))) - float(turning[0].function(np.array(0.0)))
        if abs(abs(turned) - 2.0 * np.pi) < SLACK:
            yield name


def _root_chains(model: Model) -> Iterator[list[Joint]]:
    """Joints between the ground and each body that hangs on it."""
    light = MASSLESS * max(model.mass, 1e-12)
    for joint in model.joints:
        if joint.parent != GROUND:
            continue
        chain = [joint]
        while model.body(chain[-1].child).mass < light:
            after = [following for following in model.joints if following.parent == chain[-1].child]
            if len(after) != 1:
                break
            chain += after
        yield chain
