"""Tables of a morphed model.

They are of points, muscles, joints, bones, moment arms, paths through bones, and warnings.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping

import numpy as np

from myomorph.bones.morph.checks.moment_arms import MomentArms
from myomorph.bones.morph.checks.warnings import MorphChecks
from myomorph.bones.morph.maps.fields import muscle_sizes
from myomorph.bones.morph.morphed import Morph
from myomorph.core.model.arrays import Array
from myomorph.lab.report.page.parts import Cell, Sheet


def morphing_tables(morph: Morph, checks: MorphChecks) -> Mapping[str, Sheet]:
    """Return every table that has rows, by the name of its file.

    Values are in SI and radians, NaN where nothing is known.
    """
    warnings = [(warning.kind, warning.place, warning.text) for warning in checks.warnings]
    tables: dict[str, Sheet] = {
        "bones.csv": bone_rows(morph),
        "points.csv": point_rows(morph),
        "muscles.csv": muscle_rows(morph),
        "joints.csv": joint_rows(morph),
        "masses.csv": mass_rows(morph),
        "moment_arms.csv": arm_rows(checks),
        "moment_arm_summary.csv": arm_summary_rows(morph, checks),
        "wrap_objects.csv": wrap_rows(checks),
        "penetration.csv": penetration_rows(checks),
        "warnings.csv": Sheet(("kind", "name", "warning"), warnings),
        "not_transferred.csv": Sheet(("part", "reason"), tuple(morph.left_out.items())),
    }
    return {name: sheet for name, sheet in tables.items() if sheet.rows}


def bone_rows(morph: Morph) -> Sheet:
    """Tabulate the basis of each bone's map, and how well it fits."""
    named = dict.fromkeys(name for bone in morph.bones.values() for name in bone.measures)
    measures = [name for name in named if name != "features"]
    header = ("body", "target body", "basis", "size", "features", *measures, "notes")
    rows: list[tuple[Cell, ...]] = []
    for bone in morph.bones.values():
        known = [float(bone.measures.get(name, np.nan)) for name in measures]
        count = 0 if bone.features is None else len(bone.features)
        rows.append(
            (
                bone.body,
                bone.target_body,
                bone.basis,
                bone.whole.scale,
                count,
                *known,
                "; ".join(bone.notes),
            )
        )
    return Sheet(header, rows)


def point_rows(morph: Morph) -> Sheet:
    """Every path point before and after."""
    header = (
        "owner",
        "point",
        "body",
        "target body",
        *_axes("source {} [m]"),
        *_axes("target {} [m]"),
        "moved onto surface [m]",
        "source height over surface [m]",
        "target height over surface [m]",
        "half-width of 90 % interval [m]",
        "moved out of bone [m]",
    )
    return Sheet(
        header,
        [
            (
                point.owner,
                point.name,
                point.body,
                point.target_body,
                *_xyz(point.source),
                *_xyz(point.target),
                point.lifted,
                point.depth_source,
                point.depth_target,
                point.within,
                point.cleared,
            )
            for point in morph.points
        ],
    )


def mass_rows(morph: Morph) -> Sheet:
    """Masses, and mass centers in the bodies' frames."""
    header = (
        "body",
        "source mass [kg]",
        "target mass [kg]",
        *_axes("source center {} [m]"),
        *_axes("target center {} [m]"),
        *_axes("target moment {} [kg m^2]", "123"),
    )
    before = {body.name: body for body in morph.source.bodies}
    rows: list[tuple[Cell, ...]] = []
    for body in morph.model.bodies:
        source = before.get(body.name)
        center = (float("nan"),) * 3 if source is None else _xyz(source.mass_center)
        moments = _xyz(np.linalg.eigvalsh(body.inertia))
        mass = float("nan") if source is None else source.mass
        rows.append((body.name, mass, body.mass, *center, *_xyz(body.mass_center), *moments))
    return Sheet(header, rows)


def _axes(title: str, axes: str = "xyz") -> tuple[str, ...]:
    return tuple(map(title.format, axes))


def _xyz(point: Iterable[float]) -> tuple[float, ...]:
    return tuple(float(coordinate) for coordinate in point)


def muscle_rows(morph: Morph) -> Sheet:
    """Tabulate each muscle's parameters, target over source.

    90 % intervals are there where species' tables gave them.
    """
    header = (
        "muscle",
        "path",
        "optimal fiber length [ratio]",
        "tendon slack length [ratio]",
        "maximum isometric force [ratio]",
        "pennation [rad]",
        "source min. normalized fiber length",
        "source max. normalized fiber length",
        "target min. normalized fiber length",
        "target max. normalized fiber length",
        "fiber and force from",
        "optimal fiber length, 90 % low [ratio]",
        "optimal fiber length, 90 % high [ratio]",
        "maximum isometric force, 90 % low [ratio]",
        "maximum isometric force, 90 % high [ratio]",
    )
    return Sheet(
        header,
        [
            (
                muscle.name,
                muscle.path,
                muscle.fiber,
                muscle.tendon,
                muscle.force,
                muscle.pennation,
                *muscle.range_source,
                *muscle.range_target,
                muscle.basis or "bones",
                *muscle.fiber_interval,
                *muscle.force_interval,
            )
            for muscle in morph.muscles
        ],
    )


def joint_rows(morph: Morph) -> Sheet:
    """Where each joint's center is in the target's bones, and how it was found."""
    places = *_axes("in parent {} [m]"), *_axes("in child {} [m]")
    return Sheet(
        (
            "joint",
            "method",
            *places,
            "distance from mapped center [m]",
            "gap between parent's and child's [m]",
        ),
        [
            (
                joint.name,
                joint.method,
                *_xyz(joint.in_parent),
                *_xyz(joint.in_child),
                joint.moved,
                joint.gap,
            )
            for joint in morph.joints
        ],
    )


def arm_rows(checks: MorphChecks) -> Sheet:
    """Moment arms of every muscle over every coordinate's range, in source and target."""
    header = (
        "coordinate",
        "target coordinate",
        "muscle",
        "source value [rad or m]",
        "target value [rad or m]",
        "source moment arm [m or 1]",
        "target moment arm [m or 1]",
        "half-width of 90 % interval [m or 1]",
    )
    rows: list[tuple[Cell, ...]] = []
    for arm in checks.arms:
        within = _within(arm)
        for index, muscle in enumerate(arm.muscles):
            columns = (
                arm.source_values,
                arm.target_values,
                arm.source[:, index],
                arm.target[:, index],
                within[:, index],
            )
            values = zip(*columns, strict=True)
            rows += [(arm.pair.source, arm.pair.target, muscle, *map(float, row)) for row in values]
    return Sheet(header, rows)


def arm_summary_rows(morph: Morph, checks: MorphChecks) -> Sheet:
    """Tabulate mean, minimum and maximum moment arm of every muscle about every coordinate.

    A column reports what becomes of its sign.
    """
    header = (
        "coordinate",
        "muscle",
        "source mean [m or 1]",
        "source min. [m or 1]",
        "source max. [m or 1]",
        "target mean [m or 1]",
        "target min. [m or 1]",
        "target max. [m or 1]",
        "target over scaled source, RMS ratio",
        "same sign [share of range]",
        "source jump [m or 1]",
        "target jump [m or 1]",
        "half-width of 90 % interval, RMS [m or 1]",
    )
    sizes = muscle_sizes(morph.source, morph.bones)
    rows: list[tuple[Cell, ...]] = []
    for arm in checks.arms:
        for index, muscle in enumerate(arm.muscles):
            r = arm.source[:, index]
            t = arm.target[:, index]
            grown = float(np.sqrt(np.mean(r**2))) * sizes.get(muscle, 1.0)
            ratio = float(np.sqrt(np.mean(t**2))) / grown if grown > 0.0 else float("nan")
            same = float(np.mean(r * t >= 0.0))
            jumps = float(arm.source_jumps[index]), float(arm.target_jumps[index])
            within = float(np.sqrt(np.mean(_within(arm)[:, index] ** 2)))
            rows.append(
                (arm.pair.target, muscle, *_spread(r), *_spread(t), ratio, same, *jumps, within)
            )
    return Sheet(header, rows)


def _within(moment_arms: MomentArms) -> Array:
    """Return intervals (samples, muscles) of moment arms; NaN where nothing is known."""
    return (
        np.full_like(moment_arms.target, np.nan)
        if moment_arms.within is None
        else moment_arms.within
    )


def wrap_rows(checks: MorphChecks) -> Sheet:
    """Where wrap objects lie in the target's bones, their sizes, and how surely."""
    sizes = (
        "radius or first size [m]",
        "half-width of 90 % interval of center [m]",
        "half-width of 90 % interval of size [m]",
    )
    return Sheet(
        ("wrap object", "body", "kind", *_axes("center {} [m]"), *sizes),
        [
            (
                wrap.wrap.name,
                wrap.wrap.body,
                wrap.wrap.kind,
                *_xyz(wrap.wrap.pose.translation),
                wrap.wrap.size[0],
                wrap.within,
                wrap.size,
            )
            for wrap in checks.wraps
        ],
    )


def _spread(values: np.ndarray) -> tuple[float, float, float]:
    return float(values.mean()), float(values.min()), float(values.max())


def penetration_rows(checks: MorphChecks) -> Sheet:
    """Muscles that run under the surface of a bone, and where they are deepest."""
    header = (
        "muscle",
        "bone",
        "source depth [m]",
        "target depth [m]",
        "increase over scaled source [m]",
        "coordinate",
        "value [rad or m]",
    )
    return Sheet(
        header,
        [
            (
                fault.muscle,
                fault.body,
                fault.source,
                fault.target,
                fault.increase,
                fault.coordinate,
                fault.value,
            )
            for fault in checks.penetrations
        ],
    )
