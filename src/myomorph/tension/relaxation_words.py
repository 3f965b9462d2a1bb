"""Words for contacts that cannot carry the motion, and for what would have to be allowed."""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Literal

import numpy as np

from myomorph.model.arrays import Array

Kind = Literal["contact", "friction", "most", "pull", "residual"]


@dataclass(frozen=True)
class Allowance:
    """One thing that would have to be allowed.

    Attributes
    ----------
    kind : "contact": sites that do not touch; "friction": more than the cones'; "most": more than the sites' greatest
        force; "pull": force the other way; "residual": a force or moment from nowhere
    where : the group of the sites, or the body that floats
    force : its size, of a "friction" across the cone beyond what was allowed [N], 0 for a moment alone
    moment : of a residual [N m]
    needed : of a "friction" the coefficient that would do, of a "contact" how far the nearest of its sites is above
        where they touch at other times [m]
    """

    kind: Kind
    where: str
    force: float
    moment: float = 0.0
    needed: float = 0.0

    @property
    def size(self) -> float:
        """The greater of force [N] and moment [N m]."""
        return max(self.force, self.moment)


def what_lacks(touching: Sequence[str], force: Array, moment: Array, up: Array) -> str:
    """What is wrong, as a clause: who may touch, and what is left over.

    Parameters
    ----------
    force, moment : (3,) that contacts leave [N], [N m]
    up : (3,) unit vector against gravity
    """
    upward, size, turn = float(force @ up), float(np.linalg.norm(force)), float(np.linalg.norm(moment))
    way = "upward" if upward > 0.7 * size else "downward" if upward < -0.7 * size else "sideways"
    needed = f"{size:.0f} N {way} are needed" if size >= turn else f"a moment of {turn:.0f} N m is needed"
    if not touching:
        return f"no site may touch, but {needed}"
    return f"sites that touch cannot carry the motion, {needed} beside them"


def what_would_do(allowances: Sequence[Allowance]) -> str:
    """What would have to be allowed, as a clause."""
    return " and ".join(_words(one) for one in allowances) + " would do"


def _words(one: Allowance) -> str:
    if one.kind == "contact":
        return f"contact of '{one.where}' ({1000.0 * one.needed:.0f} mm above its support)"
    if one.kind == "friction" and np.isfinite(one.needed):
        return f"friction of {one.needed:.2f} at '{one.where}'"
    if one.kind == "friction":
        return f"{one.force:.0f} N across the cone of '{one.where}'"
    if one.kind == "most":
        return f"{one.force:.0f} N more at '{one.where}' than its greatest force"
    if one.kind == "pull":
        return f"a pull of {one.force:.0f} N at '{one.where}'"
    if one.force >= one.moment:
        return f"{one.force:.0f} N at '{one.where}' from nowhere"
    return f"{one.moment:.0f} N m at '{one.where}' from nowhere"
