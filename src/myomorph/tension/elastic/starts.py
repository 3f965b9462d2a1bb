"""Where the solver begins: activations whose rates are possible, and the forces that they lead to."""

from __future__ import annotations

import numpy as np

from myomorph.model.arrays import Array
from myomorph.tension.elastic.elements import integrate
from myomorph.tension.elastic.program import MAX_FORCE, MIN_FORCE, Program

START_ROOM = 0.02
"""How far from its bounds an activation begins at least, in shares of their distance."""


def possible(program: Program, a: Array) -> Array:
    """Activations (frames - 1, muscles) well inside their bounds, and with rates that are possible."""
    low, high = program.activation.lower, program.activation.upper
    room = START_ROOM * (high - low)
    a = np.clip(a, low + room, high - room)
    if program.rates is None:
        return a
    between = 0.5 * (program.steps[1:] + program.steps[:-1])
    for index, dt in enumerate(between):
        up, _, _, down, _, _ = program.rates.bounds(a[index])
        # Half of the rate at the beginning of the step, so that at its middle it is possible too.
        a[index + 1] = np.clip(
            a[index + 1],
            a[index] + 0.5 * np.maximum(dt * down, -a[index]),
            a[index] + 0.5 * np.minimum(dt * up, 1.0 - a[index]),
        )
    return a


def integrated(program: Program, a: Array) -> Array:
    """Normalized tendon forces (frames, muscles) that activations lead to."""
    f = np.empty((len(a) + 1, a.shape[1]))
    inputs = (program.lengths, program.speeds, program.steps)
    integrate(program.arrays, program.own, a, *inputs, 2.0 * MIN_FORCE, 0.5 * MAX_FORCE, f)
    return f
