"""What the checks of a morphed model are told and what they find."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass

from myomorph.model.errors import BadData
from myomorph.morph.moment_arm_table import MomentArms
from myomorph.morph.penetration import Penetration


@dataclass(frozen=True)
class CheckOptions:
    """From where on something is worth a warning; every limit is relative to size, so one serves man and mouse.

    Lengths are shares of the target's longest bone.

    Attributes
    ----------
    deeper : a path may run so much deeper through a bone than the source's; 1 mm of a femur of 0.4 m
    arm : moment arms below this share of the muscle's path are none; 2 mm of 0.4 m
    weak : moment arms below this share of the muscle's largest about the coordinate do not tell a sign: an angle at
        which a muscle changes from flexor to extensor may move a little with the shape
    ratio : moment arms may be so many times what the size of the bones explains, or its inverse
    off_surface : an attachment may lie so much further from its bone's surface than the source's
    near_surface : points of the source so near to the surface belong to it
    fiber : normalized fiber lengths may leave the source's range by this
    gap : parent and child may put a joint's center so far apart
    order : rank correlation of the muscles' moment arms about a coordinate, at least
    poses : of each coordinate's range at which paths are held against bones
    """

    deeper: float = 0.0025
    arm: float = 0.005
    weak: float = 0.25
    ratio: float = 2.0
    off_surface: float = 0.005
    near_surface: float = 0.02
    fiber: float = 0.1
    gap: float = 0.01
    order: float = 0.9
    poses: int = 9

    def __post_init__(self) -> None:
        if self.ratio <= 1.0:
            raise BadData(f"ratio of moment arms is {self.ratio:g}: expected more than 1")
        if self.poses < 2:
            raise BadData(f"{self.poses} poses of a range: expected 2 or more")


@dataclass(frozen=True)
class Warned:
    """One thing that looks wrong.

    Attributes
    ----------
    kind : "bone" (path through it), "sign", "jump", "arm", "order", "surface", "fold", "fiber", "joint"
    name : of the muscle, joint, coordinate or body
    text : one line with its number
    size : how bad, to sort by within a kind
    """

    kind: str
    name: str
    text: str
    size: float = 0.0


@dataclass(frozen=True, eq=False)
class MorphChecks:
    """What the checks of a morphed model found.

    Attributes
    ----------
    penetrations : of muscles through bones, the largest increase first
    arms : moment arms over each coordinate's range
    order : rank correlation of the muscles' mean moment arms about each coordinate; NaN of fewer than four
    folded : muscle points where the map turns space inside out, (muscle, point, body)
    warnings : one line each, by kind, the worst first
    notes : what could not be looked at
    """

    penetrations: tuple[Penetration, ...]
    arms: tuple[MomentArms, ...]
    order: Mapping[str, float]
    folded: tuple[tuple[str, str, str], ...]
    warnings: tuple[Warned, ...]
    options: CheckOptions
    notes: tuple[str, ...] = ()

    def of(self, kind: str) -> tuple[Warned, ...]:
        """Warnings of one kind."""
        return tuple(one for one in self.warnings if one.kind == kind)
