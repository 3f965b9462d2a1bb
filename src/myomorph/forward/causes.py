"""Causes of what may be wrong with a simulation."""

from __future__ import annotations

from myomorph.core.model.messages import Cause

ENERGY = Cause(
    key="energy",
    title="Energy error",
    severity="changes results",
    effect="The motion gains or loses energy without a force.",
    remedy="Lower --tolerance, and compare with --certify.",
)
RANGES = Cause(
    key="ranges",
    title="Coordinates out of their ranges",
    severity="may change results",
    effect="Nothing in the model stops a joint at the end of its range.",
    remedy="Give the model limit forces, or simulate less time.",
)
LEFT_OUT = Cause(
    key="left_out",
    title="Parts of the model that the simulation ignores",
    severity="may change results",
    effect="The body moves without them.",
    remedy="Compare with a model without them.",
)
FLOOR = Cause(
    key="floor",
    title="Feet in the floor",
    severity="may change results",
    effect="The body is thrown up at the start.",
    remedy="Give the height of the floor, or a start in which the feet stand on it.",
)
