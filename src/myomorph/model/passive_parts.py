"""What holds a joint besides muscles: torques of coordinates, and springs and dampers between frames."""

from __future__ import annotations

from dataclasses import dataclass, field

import numpy as np

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.functions import Function
from myomorph.model.spatial import Transform


@dataclass(frozen=True, eq=False)
class PassiveTorque:
    """What holds a coordinate besides muscles (ligaments, springs): tau = torque(q) - damping(q) qdot.

    It takes part in muscle tensions; inverse dynamics gives the torque of all that acts together.

    Attributes
    ----------
    torque : [N m or N] of the coordinate's value
    damping : [N m s or N s/m] of the coordinate's value
    """

    name: str
    coordinate: str
    torque: Function
    damping: Function

    def total(self, values: Array, rates: Array) -> Array:
        """(frames,) torque at values (frames,) and rates (frames,) of the coordinate [N m or N]."""
        total: Array = self.torque(values) - self.damping(values) * rates
        return total


@dataclass(frozen=True, eq=False)
class Bushing:
    """Springs and dampers that hold one frame at another, as OpenSim's BushingForce defines them.

    With q the body-fixed x-y-z angles and the origin of frame 2 seen from frame 1, the generalized forces on q are
    -stiffness q - damping qdot, along each of the six alone.

    Attributes
    ----------
    body_1, body_2 : the bodies held together
    pose_1, pose_2 : the frames in those bodies
    rotational_stiffness, rotational_damping : (3,) [N m/rad], [N m s/rad]
    translational_stiffness, translational_damping : (3,) [N/m], [N s/m]
    """

    name: str
    body_1: str
    body_2: str
    pose_1: Transform
    pose_2: Transform
    rotational_stiffness: Array = field(default_factory=lambda: np.zeros(3))
    rotational_damping: Array = field(default_factory=lambda: np.zeros(3))
    translational_stiffness: Array = field(default_factory=lambda: np.zeros(3))
    translational_damping: Array = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        for what in ("rotational", "translational"):
            for name in (f"{what}_stiffness", f"{what}_damping"):
                object.__setattr__(self, name, frozen_array(getattr(self, name), (3,)))
