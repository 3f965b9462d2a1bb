"""Reflections of points, vectors, poses and functions, and a model's plane of symmetry."""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping
from dataclasses import dataclass, replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadModel, check_name
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import Function, PiecewisePolynomial, substituted
from myomorph.core.model.model import GROUND, Model
from myomorph.core.model.sides import mirror_names, other_side
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.surfaces.linear_maps import AffineMap

# A normal this near to an axis is that axis, a plane this near to the origin [m] goes through it.
SNAP = 1e-6


@read_only
class Reflection:
    """x -> x - 2 (n . x - d) n, in the plane n . x = d."""

    normal: Array  # (3,) n, a unit vector
    offset: float = 0.0  # d [m]

    def __post_init__(self) -> None:
        normal = np.asarray(self.normal, dtype=np.float64) / np.linalg.norm(self.normal)
        if np.abs(normal).max() > 1.0 - SNAP**2 / 2.0:
            normal = np.where(np.abs(normal) > 0.5, np.sign(normal), 0.0)
        object.__setattr__(self, "normal", frozen_array(normal, (3,)))
        object.__setattr__(self, "offset", 0.0 if abs(self.offset) < SNAP else float(self.offset))

    @property
    def matrix(self) -> Array:
        """(3, 3) of vectors, its own inverse."""
        return np.eye(3) - 2.0 * np.outer(self.normal, self.normal)

    @property
    def affine(self) -> AffineMap:
        """Of points, as a map."""
        return AffineMap(self.matrix, 2.0 * self.offset * self.normal)

    @property
    def axis(self) -> int:
        """The axis of the frame that is nearest to the normal."""
        return int(np.argmax(np.abs(self.normal)))

    def points(self, points: ArrayLike) -> Array:
        """Reflect points.

        Parameters
        ----------
        points : (..., 3) in the plane's frame [m]

        Returns
        -------
        (..., 3) on the other side [m]
        """
        array = np.asarray(points, dtype=np.float64)
        return array - 2.0 * (array @ self.normal - self.offset)[..., None] * self.normal

    def vectors(self, vectors: ArrayLike) -> Array:
        """Reflect directions, forces and velocities among them.

        Parameters
        ----------
        vectors : (..., 3) in the plane's frame

        Returns
        -------
        (..., 3) in the same unit
        """
        array = np.asarray(vectors, dtype=np.float64)
        return array - 2.0 * (array @ self.normal)[..., None] * self.normal

    def turns(self, turns: ArrayLike) -> Array:
        """Reflect axes of rotation, or moments: the same angle rotates the other way.

        Parameters
        ----------
        turns : (..., 3) in the plane's frame

        Returns
        -------
        (..., 3) in the same unit
        """
        return -self.vectors(turns)

    def pose(self, pose: Transform, inner: Reflection) -> Transform:
        """Reflect the pose of a frame.

        The frame itself is reflected by `inner`, so that it is right-handed again.
        """
        return Transform(self.matrix @ pose.rotation @ inner.matrix, self.points(pose.translation))

    def seen_from(self, pose: Transform) -> Reflection:
        """Return the same plane in the frame that has this pose."""
        return Reflection(
            pose.rotation.T @ self.normal, self.offset - float(self.normal @ pose.translation)
        )


def flip(axis: int) -> Reflection:
    """Return the reflection in the plane across an axis of the frame."""
    return Reflection(np.eye(3)[axis])


def backwards(function: Function, signs: tuple[float, ...], factor: float = 1.0) -> Function:
    """Return the function factor f(signs[0] x_1, ...), each sign 1 or -1."""
    if factor != 1.0:
        function = function.scaled(factor)
    if all(sign > 0.0 for sign in signs) or function.arity == 0:
        return function
    if not isinstance(function, PiecewisePolynomial):
        return replace(
            function, frequencies=function.frequencies * np.array(signs[: function.arity])
        )
    breaks = function.breaks
    rows = function.coefficients
    starts = np.concatenate([breaks[-1:], breaks[:0:-1]])
    pieces = zip(rows[::-1], breaks[::-1], starts, strict=True)
    return PiecewisePolynomial(
        -starts, np.array([substituted(row, at - begin, -1.0) for row, begin, at in pieces])
    )


AXES = {"x": 0, "y": 1, "z": 2}
# A body whose origin lies nearer to the plane than this share of the model's extent is in the
# middle.
ON_PLANE = 0.005
# A marker whose name begins with R or L is a side's from this share of the model's extent on.
OFF_PLANE = 0.02


@dataclass(frozen=True, eq=False)
class OtherSide:
    """How the names and places of a model become those of the other side."""

    # of every body (and the ground) in its frame: that of symmetry for those in the middle, one
    # across an axis of the frame for the others
    planes: Mapping[str, Reflection]
    middle: frozenset[str]  # bodies that are their own other side
    # of coordinates whose axes in the middle turn round, -1 (pelvis list); all others have 1
    signs: Mapping[str, float]
    # from a kind ("bodies") and a name to the name on the other side
    named: Callable[[str, str], str]

    def of(self, names: Iterable[str]) -> tuple[float, ...]:
        """Signs of coordinates."""
        return tuple(self.signs.get(name, 1.0) for name in names)


def other_side_of(
    model: Model,
    axis: str | ArrayLike = "z",
    point: ArrayLike = (0.0, 0.0, 0.0),
    middle: Collection[str] | None = None,
    suffix: str = "",
) -> OtherSide:
    """Find out which parts of a model are in the middle and which belong to a side.

    `axis`: of ground across the plane of symmetry; `point`: of the plane, with all coordinates at
    zero [m]; `middle`: by default bodies whose name has no side, on the plane and on no body of a
    side (where no name has a side, their center of mass must lie on the plane too).
    """
    known = {name: np.eye(3)[index] for name, index in AXES.items()}
    normal = (
        known.get(axis, np.zeros(3))
        if isinstance(axis, str)
        else np.asarray(axis, dtype=np.float64)
    )
    if normal.shape != (3,) or not np.linalg.norm(normal) > 0.0:
        raise BadModel(
            f"the axis across the plane of symmetry is {axis!r}: expected 'x', 'y', 'z' or a vector"
        )
    for name in middle or ():
        check_name("body", name, model.body_names)
    resting = standing_poses(model, dict.fromkeys(model.coordinate_names, 0.0))
    ground = Reflection(
        normal, float(Reflection(normal).normal @ np.asarray(point, dtype=np.float64))
    )
    origins = np.array([pose.translation for pose in resting.values()])
    extent = float(np.linalg.norm(np.ptp(origins, axis=0)))
    _check_axis(model, resting, ground)
    planes, inside = _planes(model, resting, ground, extent, middle)
    named = _names(model, planes, inside, extent, suffix)
    return OtherSide(
        planes=planes, middle=frozenset(inside), signs=_signs(model, planes, inside), named=named
    )


def _check_axis(model: Model, resting: Mapping[str, Transform], ground: Reflection) -> None:
    pairs = mirror_names(model.body_names)
    apart = [
        resting[name].translation - resting[other].translation
        for name, other in pairs.items()
        if name < other
        and np.linalg.norm(resting[name].translation - resting[other].translation) > 0.0
    ]
    if not apart:
        return
    along = [
        float(np.median([abs(difference @ n) for difference in apart]))
        for n in (ground.normal, *np.eye(3))
    ]
    best = int(np.argmax(along[1:]))
    if along[0] < 0.5 * along[1 + best]:
        raise BadModel(
            f"model '{model.name}': right and left bodies face each other along {'xyz'[best]}, not"
            f" along {ground.normal.tolist()}: mirror across axis '{'xyz'[best]}'"
        )


def _planes(
    model: Model,
    resting: Mapping[str, Transform],
    ground: Reflection,
    extent: float,
    stated: Collection[str] | None,
) -> tuple[dict[str, Reflection], set[str]]:
    joints = {joint.child: joint for joint in model.joints}
    sided = any(
        other_side(name)
        for name in (*model.body_names, *model.coordinate_names, *model.muscle_names)
    )
    planes = {GROUND: ground}
    inside = {GROUND}
    inner = {GROUND: ground.axis}
    for body in model.bodies:
        parent = joints[body.name].parent
        plane = ground.seen_from(resting[body.name])
        near = extent * ON_PLANE
        if stated is None:
            lies = abs(plane.offset) <= near and (
                sided or abs(body.mass_center @ plane.normal - plane.offset) <= near
            )
            is_middle = parent in inside and not other_side(body.name) and lies
        else:
            is_middle = body.name in stated
        if is_middle:
            inside.add(body.name)
            planes[body.name] = plane
            inner[body.name] = plane.axis
            continue
        across = np.abs(planes[parent].normal).max() == 1.0
        inner[body.name] = inner[parent] if across else plane.axis
        planes[body.name] = flip(inner[body.name])
    return planes, inside


def _signs(
    model: Model, planes: Mapping[str, Reflection], middle: Collection[str]
) -> Mapping[str, float]:
    """-1 for coordinates of the middle all of whose axes turn round in its plane."""
    votes = _votes(model, planes, middle)
    followers = {coupler.dependent for coupler in model.couplers}
    odd = {name for name, seen in votes.items() if seen == {True} and name not in followers}
    for coupler in model.couplers:
        if votes.get(coupler.dependent) == {True} and odd.issuperset(coupler.independents):
            odd.add(coupler.dependent)
    return FrozenMap({name: -1.0 if name in odd else 1.0 for name in model.coordinate_names})


def _votes(
    model: Model, planes: Mapping[str, Reflection], middle: Collection[str]
) -> dict[str, set[bool]]:
    """Return by coordinate of the middle whether each of its axes turns round in its plane."""
    votes: dict[str, set[bool]] = {}
    for joint in model.joints:
        if joint.child not in middle or joint.parent not in middle:
            continue
        plane = planes[joint.parent].seen_from(joint.parent_frame)
        for axis in joint.axes:
            still = isinstance(axis.function, PiecewisePolynomial) and axis.function.arity == 0
            if still or not axis.coordinates or other_side(axis.coordinates[0]):
                continue
            image: Array = (
                plane.turns(axis.vector) if axis.kind == "rotation" else plane.vectors(axis.vector)
            )
            round_ = bool(np.linalg.norm(image + axis.vector) < 1e-6)
            votes.setdefault(axis.coordinates[0], set()).add(round_)
    return votes


def _names(
    model: Model,
    planes: Mapping[str, Reflection],
    middle: Collection[str],
    extent: float,
    suffix: str,
) -> Callable[[str, str], str]:
    capitals = _markers_of_sides(model, planes, middle, extent)
    tables = {
        "bodies": model.body_names,
        "joints": tuple(joint.name for joint in model.joints),
        "coordinates": model.coordinate_names,
        "markers": model.marker_names,
        "muscles": model.muscle_names,
        "wraps": tuple(item.name for item in model.wrap_objects),
    }
    known = {
        kind: _counterparts(names, capitals if kind == "markers" else ())
        for kind, names in tables.items()
    }
    stays = {
        "bodies": middle,
        "coordinates": {
            name for joint in model.joints if joint.child in middle for name in joint.coordinates
        },
    }

    def named(kind: str, name: str) -> str:
        other = known.get(kind, {}).get(name, "") or other_side(name)
        if other or not suffix or not name or name in stays.get(kind, ()):
            return other or name
        return name + suffix

    return named


def _markers_of_sides(
    model: Model, planes: Mapping[str, Reflection], middle: Collection[str], extent: float
) -> set[str]:
    """Return markers off the plane of symmetry, or on a body of a side."""
    return {
        marker.name
        for marker in model.markers
        if abs(planes[marker.body].normal @ marker.location - planes[marker.body].offset)
        > OFF_PLANE * extent
        or marker.body not in middle
    }


def _counterparts(names: tuple[str, ...], capitals: Collection[str]) -> dict[str, str]:
    """Names on the other side; `soleus` and `soleus_l` are a pair where there is no `soleus_r`."""
    known = mirror_names(names)
    counterparts = {name: other_side(name, capitals=name in capitals) for name in names}
    for name, other in counterparts.items():
        back = known.get(name, "")
        if (
            other not in counterparts
            and back
            and counterparts[back] in ("", name)
            and known.get(back) == name
        ):
            counterparts[name] = back
        base = next((name.removesuffix(end) for end in ("_r", "_l") if name.endswith(end)), name)
        if base != name and other not in counterparts and counterparts.get(base) == "":
            counterparts[name] = base
            counterparts[base] = name
    return {
        name: other
        for name, other in counterparts.items()
        if other and counterparts.get(other, name) == name
    }
