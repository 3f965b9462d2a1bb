"""Intervals of moment arms and wrap objects that follow from those of attachments.

Models are drawn in which everything that is fixed to a matched bone is moved by a random smooth
displacement, of the size of the matched points' own radii: errors of a match go together over a
part of the bone. Points near the surface slide along it; wrap objects and mapped joints are
transferred as to another bone. The interval of a moment arm is that of a normal distribution with
the spread of the drawn ones about the model's own.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.bones.morph.checks.moment_arms import MomentArms, target_arms
from myomorph.bones.morph.checks.warnings import MorphChecks, WrapInterval
from myomorph.bones.morph.maps.fields import AROUND, BoneMap, FeaturePoints, radii_around
from myomorph.bones.morph.morphed import Morph
from myomorph.bones.morph.transfer.body_transfer import Transfer, scaled_map
from myomorph.bones.morph.transfer.joints import CenterFinder, transferred_joints
from myomorph.bones.morph.transfer.paths import transferred_wrap
from myomorph.bones.morph.transfer.points import combined, nearest_facing
from myomorph.core.fit.interval_rule import half_width
from myomorph.core.model.arrays import Array
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.paths import MovingPathPoint, Muscle, PathPoint, WrapObject
from myomorph.core.surfaces.linear_maps import Similarity, procrustes
from myomorph.core.surfaces.surface_points import Shape

DRAWS = 40  # Models; the width of an interval is known within some 11 %.
WIDTH = 0.1
"""Distance over which errors go together, as a share of the bone's length. Of 0.1, 0.2 and 0.35 the
first held best on deformed legs 200 and 201 (`benchmarks/accuracy/morph/deformed_legs.py`).
"""

WAVES = 100  # Cosines of which a displacement is made (Rahimi and Recht 2007).
NEAR = 0.02  # Points nearer to the surface than this share of the bone's length slide along it.
TILT = 1e-4  # Distance over which derivatives are taken, as a share of the bone's length.
ON_SURFACE = 2.146
IN_SPACE = 2.500
"""Standard deviations of an axis within which 90 % of values, points of a plane and points in space
lie.
"""


@dataclass(frozen=True, eq=False)
class _Known:
    """A bone of the target that was matched."""

    length: float  # [m]
    features: FeaturePoints  # points of it, with radii
    shape: Shape | None  # of its surface, None where there is none


class _Displacement:
    """A random smooth displacement of points on a target's bone, in its body's frame."""

    def __init__(self, known: _Known, random: np.random.Generator):
        self.known = known
        self._waves = random.normal(size=(WAVES, 3)) / (WIDTH * known.length)
        self._phases = random.uniform(0.0, 2.0 * np.pi, WAVES)
        self._heights = np.sqrt(2.0 / WAVES) * random.normal(size=(WAVES, 3))

    def _steps(self, points: Array) -> Array:
        """(n, 3) of standard deviation 1 along each axis."""
        return np.asarray(np.cos(points @ self._waves.T + self._phases) @ self._heights)

    def apply(self, points: ArrayLike) -> Array:
        """Displace points (..., 3) of the body's space [m].

        The displacement is that of the matched points around them.
        """
        places = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        # What a map adds beside a bone is left out: joint centers and wrap objects lie in it or
        # around it.
        within = radii_around(self.known.features.target, self.known.features.radii, places)
        moved = places + within[:, None] / IN_SPACE * self._steps(places)
        return np.asarray(moved.reshape(np.shape(points)))

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives (..., 3, 3) of the displaced points."""
        places = np.asarray(points, dtype=np.float64)
        step = TILT * self.known.length
        columns = [
            (self.apply(places + move) - self.apply(places - move)) / (2.0 * step)
            for move in step * np.eye(3)
        ]
        return np.stack(columns, axis=-1)

    def slid(self, points: Array, within: Array) -> Array:
        """Displace path points (n, 3), those near the surface along it [m].

        `within`: (n,) radii that hold 90 % of their errors [m].
        """
        steps = self._steps(points)
        shape = self.known.shape
        moved = np.asarray(points + within[:, None] / IN_SPACE * steps)
        if shape is None:
            return moved
        feet, faces = shape.closest(points)
        near = np.linalg.norm(points - feet, axis=1) <= NEAR * self.known.length
        normals = shape.normals[faces[near]]
        along = steps[near] - np.einsum("ij,ij->i", steps[near], normals)[:, None] * normals
        goals = nearest_facing(
            shape, feet[near] + within[near, None] / ON_SURFACE * along, normals
        )[0]
        moved[near] = points[near] + goals - feet[near]
        return moved

    def transfer(self, body: str) -> Transfer:
        """Return the same displacement as the transfer of everything that is fixed to the body."""
        known_features = self.known.features
        features = FeaturePoints(
            known_features.names, known_features.target, self.apply(known_features.target)
        )
        whole = procrustes(features.source, features.target, True)
        return Transfer(
            BoneMap(
                body=body, target_body=body, map=self, whole=whole, basis="given", features=features
            ),
            body,
        )


def with_arm_intervals(
    morph: Morph, checks: MorphChecks, progress: Callable[[int], None] | None = None
) -> MorphChecks:
    """Add the intervals of moment arms (`MomentArms.within`) and of wrap objects to the checks.

    Muscles with a point whose interval is not known, or on a bone that was not matched, have none,
    as where a bone was scaled with its neighbors or mapped by landmarks alone. `progress`: called
    with 1 after each of `DRAWS` models.
    """
    known = _matched(morph)
    if not known or not checks.arms:
        return checks
    random = np.random.default_rng(0)
    wraps = [item for item in morph.model.wrap_objects if item.body in known]
    squares = _Squares(
        arms=[np.zeros_like(arms.target) for arms in checks.arms],
        centers=np.zeros(len(wraps)),
        sizes=np.zeros(len(wraps)),
    )
    for _ in range(DRAWS):
        drawn = _drawn(morph, {body: _Displacement(bone, random) for body, bone in known.items()})
        squares.add(drawn, checks.arms, wraps)
        if progress is not None:
            progress(1)
    unknown = {
        point.owner
        for point in morph.points
        if not np.isfinite(point.within) or point.target_body not in known
    }
    return replace(
        checks,
        arms=tuple(
            _with_interval(arm, sums, unknown)
            for arm, sums in zip(checks.arms, squares.arms, strict=True)
        ),
        wraps=squares.wrap_intervals(wraps),
    )


@dataclass(eq=False, kw_only=True)
class _Squares:
    """Sums of squared deviations over drawn models.

    Attributes
    ----------
    arms : (samples, muscles) of the moment arms of each table [m^2]
    centers : (wrap objects,) of their centers [m^2]
    sizes : (wrap objects,) of their first sizes [m^2]
    """

    arms: list[Array]
    centers: Array
    sizes: Array

    def add(self, drawn: Model, tables: Sequence[MomentArms], wraps: Sequence[WrapObject]) -> None:
        """Add the deviations of a drawn model."""
        for sums, arm, arms in zip(self.arms, tables, target_arms(drawn, tables), strict=True):
            sums += (arms - arm.target) ** 2
        moved = {item.name: item for item in drawn.wrap_objects}
        self.centers += [
            np.sum((moved[wrap.name].pose.translation - wrap.pose.translation) ** 2)
            for wrap in wraps
        ]
        self.sizes += [(moved[wrap.name].size[0] - wrap.size[0]) ** 2 for wrap in wraps]

    def wrap_intervals(self, wraps: Sequence[WrapObject]) -> tuple[WrapInterval, ...]:
        """Return the intervals of wrap objects after `DRAWS` models."""
        return tuple(
            WrapInterval(
                wrap,
                IN_SPACE * float(np.sqrt(center / (3.0 * DRAWS))),
                float(half_width(np.sqrt(size / DRAWS))),
            )
            for wrap, center, size in zip(wraps, self.centers, self.sizes, strict=True)
        )


def _with_interval(arm: MomentArms, sums: Array, unknown: Collection[str]) -> MomentArms:
    """Add intervals to moment arms, NaN for muscles of which they are `unknown`.

    `sums`: (samples, muscles) squared deviations after `DRAWS` models [m^2].
    """
    within = half_width(np.sqrt(sums / DRAWS))
    within[:, [muscle in unknown for muscle in arm.muscles]] = np.nan
    return replace(arm, within=within)


def _matched(morph: Morph) -> dict[str, _Known]:
    """Radii by target body, of bones whose points have them; the first of those joined into one."""
    result: dict[str, _Known] = {}
    for bone in morph.bones.values():
        features = bone.features
        body = bone.target_body
        if body in result or features is None or features.radii is None:
            continue
        if np.isfinite(features.radii).sum() >= AROUND:
            length = bone.whole.scale * Transfer(bone, body).length
            result[body] = _Known(
                length, features, None if bone.target is None else Shape(bone.target)
            )
    return result


def _drawn(morph: Morph, moves: Mapping[str, _Displacement]) -> Model:
    """Displace everything on the bones of the morphed model."""
    model = morph.model
    shifts = _shifts(morph, moves)
    transfers = {body: _still(body) for body in (GROUND, *model.body_names) if body not in moves}
    transfers |= {body: move.transfer(body) for body, move in moves.items()}
    mapped = {joint.name for joint in morph.joints if joint.method == "mapped"}
    skeleton = model
    if mapped:
        finder = CenterFinder(transfers, False, False)
        skeleton = transferred_joints(model, transfers, finder).skeleton
    return replace(
        model,
        muscles=tuple(_with_points(muscle, shifts) for muscle in model.muscles),
        wrap_objects=tuple(
            transferred_wrap(item, transfers[item.body]) if item.body in moves else item
            for item in model.wrap_objects
        ),
        joints=tuple(
            new if new.name in mapped else old
            for old, new in zip(model.joints, skeleton.joints, strict=True)
        ),
    )


def _shifts(morph: Morph, moves: Mapping[str, _Displacement]) -> dict[tuple[str, str], Array]:
    """Return the displacement (3,) of each path point whose interval is known [m].

    Keys are the names of its muscle and its own.
    """
    shifts: dict[tuple[str, str], Array] = {}
    for body, move in moves.items():
        members = [
            point
            for point in morph.points
            if point.target_body == body and np.isfinite(point.within)
        ]
        if members:
            places = np.array([point.target for point in members])
            within = np.array([point.within for point in members])
            moved = zip(members, move.slid(places, within) - places, strict=True)
            shifts |= {(point.owner, point.name): by for point, by in moved}
    return shifts


def _still(body: str) -> Transfer:
    """Return the transfer of a body that is not displaced."""
    bone = BoneMap(
        body=body,
        target_body=body,
        map=scaled_map(body, 1.0),
        whole=Similarity(np.eye(3), np.zeros(3)),
        basis="neighbors",
    )
    return Transfer(bone, body)


def _with_points(muscle: Muscle, shifts: Mapping[tuple[str, str], Array]) -> Muscle:
    """Displace a muscle's points."""
    points: list[PathPoint | MovingPathPoint] = []
    for point in muscle.path.points:
        by = shifts.get((muscle.name, point.name))
        if by is None:
            points.append(point)
        elif isinstance(point, PathPoint):
            points.append(replace(point, location=point.location + by))
        else:
            x, y, z = point.functions
            shifted = (
                combined([x], np.ones(1), float(by[0])),
                combined([y], np.ones(1), float(by[1])),
                combined([z], np.ones(1), float(by[2])),
            )
            points.append(replace(point, functions=shifted))
    return replace(muscle, path=replace(muscle.path, points=tuple(points)))
