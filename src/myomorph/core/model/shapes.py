"""Arrays whose axes have names: the types of what rooms hand to each other.

An axis of the same name has the same length in all arguments and results of one call. Tests check
that at every call (`tests/shape_checks.py`); otherwise the names are there for readers and for type
checkers. Units stand in the docstring of the function.
"""

from __future__ import annotations

import sys
from typing import TYPE_CHECKING

from myomorph.core.model.arrays import Array

# jaxtyping takes longer to import than this package may, so only tests load it, before this file.
if TYPE_CHECKING or "jaxtyping" not in sys.modules:
    from typing import Annotated as Float
else:
    from jaxtyping import Float

FrameValues = Float[Array, "frames"]
FrameVectors = Float[Array, "frames 3"]
FrameMatrices = Float[Array, "frames 3 3"]

Coordinates = Float[Array, "frames coordinates"]
"""Values, rates or accelerations of all coordinates of a model, in its order."""
GeneralizedForces = Float[Array, "frames coordinates"]

BodyVectors = Float[Array, "frames bodies 3"]
"""A vector of each body, the ground first."""
BodyRotations = Float[Array, "frames bodies 3 3"]
BodyWrenches = Float[Array, "frames bodies 6"]
"""Force and its moment about the ground's origin on each body, the ground first."""
BodyJacobian = Float[Array, "frames 6 coordinates"]
"""Derivatives of a body's twist, angular before linear, in all coordinates."""
FixedPoints = Float[Array, "points 3"]
"""Points in the frames of their bodies."""
Points = Float[Array, "frames points 3"]

LoopRows = Float[Array, "frames rows"]
"""A value of each row of the equations that close loops."""
LoopJacobian = Float[Array, "frames rows coordinates"]

Wrenches6 = Float[Array, "frames 6"]
"""Moment about a reference point, then force."""
Regressor = Float[Array, "frames 6 parameters"]
"""Base wrench of unit inertial parameters, ten of each body."""

MuscleValues = Float[Array, "frames muscles"]
MomentArmTable = Float[Array, "frames muscles coordinates"]
ArmPairs = Float[Array, "frames arms"]
"""A value of each pair of a muscle and a coordinate that can move it."""
Pulls = Float[Array, "frames pairs 6"]
"""Force and moment about the ground's origin of each pair of a muscle and a body it touches."""
