"""A part of a virtual limb that moves against its bones."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from myomorph.core.io.mjcf.write import text
from myomorph.core.model.arrays import Array

RADIUS = 0.03  # Of soft tissue, as a ball [m].


@dataclass(frozen=True)
class SoftTissue:
    """A part of a limb's mass on springs and dampers that are the same in every direction."""

    # (3,) of its center in the limb's frame while the limb hangs at rest [m]
    place: tuple[float, float, float]
    mass: float  # [kg]
    frequency: float  # at which it vibrates against a limb that is held [Hz]
    damping: float  # ratio to the critical one

    @property
    def parameters(self) -> Array:
        """(10,) of a ball of `RADIUS` about the joint's center."""
        x = np.array(self.place)
        inertia = self.mass * ((x @ x + 0.4 * RADIUS**2) * np.eye(3) - np.outer(x, x))
        off = (inertia[1, 2], inertia[2, 0], inertia[0, 1])
        return np.array([self.mass, *(self.mass * x), *np.diag(inertia), *off])

    def mjcf(self, down: Array) -> str:
        """Return a body on three slides that is at the position of `place` while gravity pulls.

        Parameters
        ----------
        down : (3,) gravity in the limb's frame [m/s^2]

        Returns
        -------
        MJCF of the body
        """
        angular = 2.0 * np.pi * self.frequency
        sag = down / angular**2
        slides = "".join(
            f'<joint type="slide" axis="{text(axis)}" stiffness="{self.mass * angular**2!r}" '
            f'damping="{2.0 * self.damping * self.mass * angular!r}" springref="{float(-drop)!r}"/>'
            for axis, drop in zip(np.eye(3), sag, strict=True)
        )
        size = text(np.full(3, 0.4 * self.mass * RADIUS**2))
        inertia = f'<inertial pos="0 0 0" mass="{self.mass!r}" diaginertia="{size}"/>'
        return f'<body name="tissue" pos="{text(self.place)}">{slides}{inertia}</body>'
