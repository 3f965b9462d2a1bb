"""What to look at in a simulation."""

from __future__ import annotations

import numpy as np

from myomorph.core.model.errors import counted
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Model
from myomorph.forward.causes import ENERGY, LEFT_OUT, RANGES
from myomorph.forward.simulation import Simulation

MAX_SHARE = 1e-3  # Energy without a cause, by the energy exchanged
MAX_HALVED = 1e-2  # Difference of a run with half the tolerance [rad or m]
MIN_BEYOND = 0.02  # How far a coordinate must be beyond its range [rad or m]
MAX_NAMED = 5
FORCE_ROOMS = ("ForceSet", "force", "ConstraintSet")
"""Rooms of parts that would move or hold the body."""


def notes_on(simulation: Simulation) -> tuple[Message, ...]:
    """List what is doubtful: energy without a cause, coordinates out of their ranges, lost parts.

    Parameters
    ----------
    simulation : done
    """
    model = simulation.model
    return (*_of_energy(simulation), *_of_ranges(simulation), *_of_parts(model))


def _of_energy(simulation: Simulation) -> list[Message]:
    notes = []
    share = simulation.energy.largest_share
    if not share <= MAX_SHARE:
        notes.append(
            ENERGY.message(
                f"{100 * share:.2g} % of the energy exchanged is unexplained: expected at most"
                f" {100 * MAX_SHARE:g} %; lower --tolerance"
            )
        )
    if simulation.halved > MAX_HALVED:
        notes.append(
            ENERGY.message(
                f"with half the tolerance coordinates differ by up to {simulation.halved:.2g} rad"
                " or m: the motion depends on the steps; lower --tolerance"
            )
        )
    return notes


def _of_ranges(simulation: Simulation) -> list[Message]:
    """Name coordinates that leave their ranges, the farthest first."""
    beyond: dict[str, float] = {}
    for column, coordinate in enumerate(simulation.model.coordinates):
        if coordinate.name not in simulation.free or not coordinate.clamped:
            continue
        values = simulation.motion.values[:, column]
        low, high = coordinate.range
        most = float(np.max(np.maximum(low - values, values - high)))
        if most > MIN_BEYOND:
            beyond[coordinate.name] = most
    if not beyond:
        return []
    ordered = sorted(beyond, key=lambda name: -beyond[name])
    named = ", ".join(f"{name} by {beyond[name]:.2g}" for name in ordered[:MAX_NAMED])
    rest = f" and {len(ordered) - MAX_NAMED} more" if len(ordered) > MAX_NAMED else ""
    return [RANGES.message(f"beyond the model's ranges: {named} rad or m{rest}")]


def _of_parts(model: Model) -> list[Message]:
    """Name parts of the file that would move the body, and do not."""
    kinds: dict[str, int] = {}
    for part in model.kept:
        if part.room in FORCE_ROOMS or part.kind.startswith("joint "):
            kinds[part.kind] = kinds.get(part.kind, 0) + 1
    if not kinds:
        return []
    named = ", ".join(f"{kind} ({counted(count, 'part')})" for kind, count in kinds.items())
    return [LEFT_OUT.message(f"ignored by the simulation: {named}")]
