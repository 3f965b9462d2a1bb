"""Fibers and tendons of muscles on elastic tendons over time: what a `Tension` tells of them."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.model.arrays import Array, read_only
from myomorph.model.labelled import Variable


@dataclass(frozen=True)
class Unreachable:
    """A muscle whose fibers cannot reach, so that its tendon was taken as rigid."""

    muscle: str
    frame: int  # the first in which they cannot
    worst: float  # the normalized fiber length furthest out: below 0 where the path is shorter than the slack tendon


@dataclass(frozen=True)
class Certificate:
    """How sure the solution of the elastic problem is, over all its windows.

    Attributes
    ----------
    residual : greatest residual of the optimality conditions
    equilibrium : greatest difference of tendon and fiber force, normalized by the maximum isometric force
    steps : most iterations of a window
    second_activations, second_forces : root mean square distance of activations, and of normalized tendon forces, of
        the solution from another start; NaN where none was asked for
    """

    residual: float
    equilibrium: float
    steps: int
    second_activations: float = np.nan
    second_forces: float = np.nan


@read_only
class Fibers:
    """Fibers and tendons, every array (frames, muscles), NaN where a frame was not solved.

    Attributes
    ----------
    certificate : how near the solution is to an optimum
    lengths : of the fibers [m]
    velocities : lengthening of the fibers [m/s]
    tendon_strains : length over slack length less 1, 0 of a rigid tendon
    fiber_powers, tendon_powers : positive where force does work on the outside [W]
    transient : (frames,) whether a frame is so near to the beginning or to the end that what was before it or comes
        after it, which nobody knows, can be felt
    bridged : (frames,) whether torques or coordinates were missing, so that they were interpolated
    rigid : muscles that were solved with rigid tendons: their class has no other, the model calls them so, or their
        fibers cannot reach
    unreachable : those whose fibers cannot reach
    """

    lengths: Array
    velocities: Array
    tendon_strains: Array
    fiber_powers: Array
    tendon_powers: Array
    transient: np.ndarray
    bridged: np.ndarray
    rigid: tuple[str, ...]
    unreachable: tuple[Unreachable, ...]
    certificate: Certificate

    def variables(self) -> dict[str, Variable]:
        """Lengths, velocities, strains and powers, and which frames are at an end or bridged: joined by `Tension`'s."""
        two = ("time", "muscle")
        return {
            "fiber_length": Variable(two, self.lengths, "m"),
            "fiber_velocity": Variable(two, self.velocities, "m/s"),
            "tendon_strain": Variable(two, self.tendon_strains, "1"),
            "fiber_power": Variable(two, self.fiber_powers, "W"),
            "tendon_power": Variable(two, self.tendon_powers, "W"),
            "transient": Variable(("time",), self.transient, "1"),
            "bridged": Variable(("time",), self.bridged, "1"),
        }
