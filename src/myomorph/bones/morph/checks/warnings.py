"""Limits of the checks of a morphed model, and one line for each value beyond them.

A line names the muscle and has the number.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from myomorph.bones.causes import ATTACHMENTS, FIBERS, JOINTS, PATHS
from myomorph.bones.morph.checks.moment_arms import MomentArms
from myomorph.bones.morph.checks.penetration import Penetration
from myomorph.bones.morph.morphed import Morph
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData
from myomorph.core.model.findings import Finding
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Model
from myomorph.core.model.paths import WrapObject
from myomorph.core.model.shown import shown
from myomorph.core.muscles.kinematics import default_path_lengths

KINDS: Mapping[str, tuple[str, str, str]] = FrozenMap(
    {
        "bone": ("Path through bone", "path through a bone", "paths through a bone"),
        "sign": (
            "Moment arm of opposite sign",
            "moment arm of another sign",
            "moment arms of another sign",
        ),
        "jump": ("Moment arm jumps", "moment arm that jumps", "moment arms that jump"),
        "fold": (
            "Map inverted",
            "muscle point where a map folds",
            "muscle points where a map folds",
        ),
        "arm": (
            "Moment arm too large or small",
            "moment arm of another size",
            "moment arms of another size",
        ),
        "surface": (
            "Attachment off the surface",
            "attachment off its bone",
            "attachments off its bone",
        ),
        "fiber": (
            "Fiber length",
            "muscle with fibers outside the source's range",
            "muscles with fibers outside the source's range",
        ),
        "joint": ("Joint", "joint that does not meet", "joints that do not meet"),
        "order": (
            "Order of moment arms",
            "coordinate with moment arms in another order",
            "coordinates with moment arms in another order",
        ),
    }
)
"""Of warnings, the worst first: a title, and one of them and several in a sentence."""


@dataclass(frozen=True)
class CheckOptions:
    """Limits beyond which a check warns.

    Every limit is relative to size, so one serves man and mouse. Lengths are shares of the target's
    longest bone.

    Attributes
    ----------
    deeper : a path may run so much deeper through a bone than the source's; 1 mm of a femur of 0.4
        m
    arm : moment arms below this share of the muscle's path are none; 2 mm of 0.4 m
    weak : moment arms below this share of the muscle's largest about the coordinate do not tell a
        sign: an angle at which a muscle changes from flexor to extensor may move a little with the
        shape
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


@dataclass(frozen=True, eq=False)
class WrapInterval:
    """How surely a wrap object lies in its bone.

    Attributes
    ----------
    wrap : of the target
    within : distance from its middle within which it belongs with 90 % [m]
    size : the same of its first size, its radius [m]
    """

    wrap: WrapObject
    within: float
    size: float


@shown
@dataclass(frozen=True, eq=False)
class MorphChecks:
    """What the checks of a morphed model found.

    Attributes
    ----------
    options : limits of the checks
    penetrations : of muscles through bones, the largest increase first
    arms : moment arms over each coordinate's range
    order : rank correlation of the muscles' mean moment arms about each coordinate; NaN of fewer
        than four
    folded : muscle points where the map turns space inside out, (muscle, point, body)
    warnings : one line each, by kind, the worst first
    notes : what could not be looked at
    wraps : intervals of wrap objects, where points' intervals tell them
    """

    penetrations: tuple[Penetration, ...]
    arms: tuple[MomentArms, ...]
    order: Mapping[str, float]
    folded: tuple[tuple[str, str, str], ...]
    warnings: tuple[Finding, ...]
    options: CheckOptions
    notes: tuple[str, ...] = ()
    wraps: tuple[WrapInterval, ...] = ()

    def of(self, kind: str) -> tuple[Finding, ...]:
        """Warnings of one kind."""
        return tuple(warning for warning in self.warnings if warning.kind == kind)


def bone_warnings(
    deep: Iterable[Penetration],
    longest: float,
    options: CheckOptions,
    sliding: Collection[str] = (),
) -> Iterator[Finding]:
    """Yield paths that run deeper through a bone than in the source.

    `longest`: bone of the target [m]; `sliding`: in mm.
    """
    for penetration in deep:
        if penetration.increase > options.deeper * longest:
            value = (
                _mm(penetration.value)
                if penetration.coordinate in sliding
                else _value(penetration.value)
            )
            where = (
                f" at {penetration.coordinate} = {value}"
                if penetration.coordinate
                else " in the default pose"
            )
            depths = f"{_mm(penetration.target)} deep through {penetration.body}{where}"
            text = f"{penetration.muscle}: runs {depths}, source {_mm(penetration.source)}"
            size = penetration.increase / longest
            yield Finding("bone", penetration.muscle, PATHS.message(text), size=size)


def arm_warnings(
    source: Model, arms: Iterable[MomentArms], sizes: Mapping[str, float], options: CheckOptions
) -> Iterator[Finding]:
    """Yield moment arms of another sign, with jumps, or of a size that the bones do not explain.

    `sizes`: of the muscles.
    """
    lengths = dict(zip(source.muscle_names, default_path_lengths(source), strict=True))
    for arm in arms:
        for index, muscle in enumerate(arm.muscles if arm.kind == "rotational" else ()):
            yield from _one_arm(arm, index, sizes[muscle], options.arm * lengths[muscle], options)


def _one_arm(
    moment_arms: MomentArms, index: int, size: float, least: float, options: CheckOptions
) -> Iterator[Finding]:
    """Yield warnings on one muscle and coordinate.

    Its moment arms in the target are brought to the source's size.
    """
    source = moment_arms.source[:, index]
    target = moment_arms.target[:, index] / size
    muscle = moment_arms.muscles[index]
    about = f"{muscle}: moment arm about {moment_arms.pair.target}"
    jump = moment_arms.target_jumps[index] / size
    before = moment_arms.source_jumps[index]
    if jump > before + least:
        where = (
            f"{_mm(moment_arms.target_jumps[index])} at {_value(moment_arms.target_jump_at[index])}"
        )
        yield Finding(
            "jump",
            muscle,
            PATHS.message(f"{about} jumps by {where}, source by {_mm(before)}"),
            size=jump / least,
        )
    against = _against(source, target, least, options.weak)
    if against.any():
        worst = int(np.argmax(np.where(against, np.abs(target), 0.0)))
        where = (
            f"{_mm(size * target[worst])} at {_value(moment_arms.target_values[worst])}, source"
            f" {_mm(source[worst])}"
        )
        share = f"{100 * against.mean():.0f} % of the range"
        yield Finding(
            "sign",
            muscle,
            PATHS.message(f"{about} is {where}: the other sign in {share}"),
            size=float(against.mean()),
        )
    else:
        yield from _odd_size(muscle, about, (source, target), size, least, options.ratio)


def _against(source: Array, target: Array, least: float, weak: float) -> np.ndarray:
    """Return where moment arms (samples,) have opposite signs, and are large enough to have one.

    `least`: moment arms below it are none [m]; `weak`: as `CheckOptions.weak`.
    """
    floor = max(least, weak * float(np.abs(source).max()))
    floor_target = max(least, weak * float(np.abs(target).max()))
    large = (np.abs(source) > floor) & (np.abs(target) > floor_target)
    return np.asarray(large & (source * target < 0.0))


def _odd_size(
    muscle: str, about: str, arms: tuple[Array, Array], size: float, least: float, limit: float
) -> Iterator[Finding]:
    """Yield a warning where moment arms have another size than that of the bones explains.

    `arms`: (samples,) of the source, and of the target in the source's size [m]; `size`: of the
    target over the source; `least`: moment arms below it are none [m]; `limit`: as
    `CheckOptions.ratio`.
    """
    source, target = arms
    rms = float(np.sqrt(np.mean(source**2)))
    rms_target = float(np.sqrt(np.mean(target**2)))
    ratio = rms_target / max(rms, 1e-12)
    unlike = not 1.0 / limit <= ratio <= limit and abs(rms_target - rms) > least
    if max(rms, rms_target) > 2.0 * least and unlike:
        both = f"{_mm(size * rms_target)} root mean square, source {_mm(rms)}"
        text = f"{about} is {ratio:.2g} times what the size of the bones explains ({both})"
        yield Finding("arm", muscle, PATHS.message(text), size=abs(float(np.log(max(ratio, 1e-6)))))


def order_warnings(
    arms: Iterable[MomentArms], order: Mapping[str, float], options: CheckOptions
) -> Iterator[Finding]:
    """Coordinates whose muscles changed places."""
    for arm in arms:
        correlation = order[arm.pair.source]
        name = arm.pair.target
        if correlation < options.order:
            text = (
                f"{name}: the {len(arm.muscles)} muscles' moment arms are in another order than in"
                f" the source, rank correlation {correlation:.2f}"
            )
            yield Finding("order", name, PATHS.message(text), size=1.0 - correlation)


def surface_warnings(morph: Morph, longest: float, options: CheckOptions) -> Iterator[Finding]:
    """Attachments further from their surface than in the source; `longest` target bone [m]."""
    for point in morph.points:
        if not np.isfinite(point.depth_source + point.depth_target):
            continue
        size = morph.bones[point.body].whole.scale
        depth = abs(point.depth_target)
        near = abs(point.depth_source) * size <= options.near_surface * longest
        off = depth - size * abs(point.depth_source)
        if near and off > options.off_surface * longest:
            side = "outside" if point.depth_target > 0.0 else "inside"
            where = f"{_mm(depth)} {side} the bone of {point.target_body}"
            text = (
                f"{point.owner}: {point.name} lies {where}, source {_mm(abs(point.depth_source))}"
            )
            yield Finding("surface", point.owner, ATTACHMENTS.message(text), size=off / longest)


def fiber_warnings(morph: Morph, options: CheckOptions) -> Iterator[Finding]:
    """Fibers that leave the range in which the source's work."""
    for muscle in morph.muscles:
        low, high = muscle.range_source
        low_target, high_target = muscle.range_target
        off = max(low - low_target, high_target - high)
        if off > options.fiber:
            work = (
                f"{low_target:.2f} to {high_target:.2f} of their optimal length, source from"
                f" {low:.2f} to {high:.2f}"
            )
            yield Finding(
                "fiber",
                muscle.name,
                FIBERS.message(f"{muscle.name}: fibers work from {work}"),
                size=off,
            )


def joint_warnings(morph: Morph, longest: float, options: CheckOptions) -> Iterator[Finding]:
    """Yield joints whose center parent and child put in different positions.

    `longest`: bone of the target [m].
    """
    for joint in morph.joints:
        if joint.gap > options.gap * longest:
            text = f"{joint.name}: its parent and its child put the center {_mm(joint.gap)} apart"
            yield Finding("joint", joint.name, JOINTS.message(text), size=joint.gap / longest)


def _mm(meters: float) -> str:
    """Millimeters, to a hundredth below one."""
    millimeters = 1e3 * meters
    if millimeters == 0.0:
        return f"{millimeters:.0f} mm"
    return f"{millimeters:.1f} mm" if abs(millimeters) >= 1.0 else f"{millimeters:.2f} mm"


def _value(radians: float) -> str:
    return f"{round(float(np.degrees(radians)))}°"
