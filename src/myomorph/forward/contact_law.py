"""A compliant law of contact: spheres of feet on the ground."""

from __future__ import annotations

from dataclasses import dataclass
from typing import NamedTuple

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData


@dataclass(frozen=True, kw_only=True)
class ContactLaw:
    """How a sphere is pushed and dragged, as OpenSim's SmoothSphereHalfSpaceForce has it.

    Attributes
    ----------
    stiffness : of the material [N/m^2]
    dissipation : of the normal force [s/m]
    static, dynamic : coefficients of friction at rest and slipping
    viscous : coefficient of friction by speed [s/m]
    transition_velocity : at which friction is greatest [m/s]
    hertz_smoothing : steepness of the onset over depth [1/m]
    hunt_crossley_smoothing : steepness of the end where a sphere leaves fast [s/m]
    """

    stiffness: float = 1e6
    dissipation: float = 2.0
    static: float = 0.8
    dynamic: float = 0.8
    viscous: float = 0.5
    transition_velocity: float = 0.2
    hertz_smoothing: float = 300.0
    hunt_crossley_smoothing: float = 50.0

    @property
    def values(self) -> Array:
        """(8,) in the order of `contact_kernels`."""
        return np.array(
            [
                self.stiffness,
                self.dissipation,
                self.static,
                self.dynamic,
                self.viscous,
                self.transition_velocity,
                self.hertz_smoothing,
                self.hunt_crossley_smoothing,
            ]
        )


class ContactSphere(NamedTuple):
    """A sphere on a body: `center` (3,) in the body [m], `radius` [m]."""

    body: str
    center: Array
    radius: float


@dataclass(frozen=True, eq=False, kw_only=True)
class Ground:
    """A plane of the ground, and spheres that touch it.

    Attributes
    ----------
    spheres : on the model's bodies
    height : of the plane, along the direction against gravity [m]
    law : of their contact
    """

    spheres: tuple[ContactSphere, ...] = ()
    height: float = 0.0
    law: ContactLaw = ContactLaw()

    def __post_init__(self) -> None:
        wrong = [sphere for sphere in self.spheres if not sphere.radius > 0.0]
        if wrong:
            raise BadData(
                f"a sphere on '{wrong[0].body}' has the radius {wrong[0].radius:g} m: expected"
                " more than 0"
            )


NO_GROUND = Ground()
