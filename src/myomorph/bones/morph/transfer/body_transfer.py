"""A body on its way to other bones: its map, and how that changes positions, directions and sizes.

A body without a bone of its own is scaled with its neighbors. Mass, meshes, markers and points of
forces go with it.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import cached_property
from typing import TypeVar

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.bones.morph.maps.fields import BoneMap, neighbors_of, radii_around
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadData, quoted
from myomorph.core.model.model import GROUND, Actuator, Body, Loop, Marker, Mesh, Model
from myomorph.core.model.paths import Bushing
from myomorph.core.model.spatial import Transform
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity, fit_affine
from myomorph.core.surfaces.surface_points import Shape

NEIGHBORHOOD = 0.1
"""What a map does around a place is taken over this share of the bone's length: a blended map's
derivative at one point says more of the feature points nearby than of the bone.
"""

BESIDE = 0.13
"""What the map adds to the radius of a point, over its distance from the bone's surface. Beyond 1 %
of a bone's length 90 % of the muscle points of five bones were off by 0.12 to 0.16 of it, in the
deformations 100 to 109 of `benchmarks/accuracy/morph/correspondence.py`; bones of persons show
nothing of what is beside them.
"""

COVERED = 1.5
"""Surface further from matched points than so many times their spacing is missing in the target,
and may lie anywhere within that distance: a cut tibia may be laid on the whole at another size.
"""

SAMPLES = 150  # Of a bone's vertices or features tell what becomes of the bone as a whole.
UNKNOWN_LENGTH = 0.1
"""Of a body of which neither surface nor features tell a length [m]; its map is the same
everywhere.
"""

_SPHERE = np.vstack(
    [np.eye(3), -np.eye(3), np.array(np.meshgrid(*[[-1, 1]] * 3)).reshape(3, -1).T / np.sqrt(3.0)]
)


@dataclass(frozen=True, eq=False)
class Transfer:
    """What is fixed to a body of the source, transferred to the target."""

    bone: BoneMap  # the body's map
    body: str  # of the target, to which things are fixed afterwards

    def __post_init__(self) -> None:
        if np.linalg.det(self.bone.whole.rotation) < 0.0 or np.linalg.det(self.linear) <= 0.0:
            raise BadData(
                f"the map of '{self.bone.body}' turns right into left: mirror the model first, or"
                " give this side's bone"
            )

    def points(self, points: ArrayLike) -> Array:
        """Map points of the source body into the target body.

        Parameters
        ----------
        points : (..., 3) in the source body's frame [m]

        Returns
        -------
        (..., 3) in the target body's frame [m]
        """
        return self.bone.map.apply(points)

    @cached_property
    def samples(self) -> Array:
        """(n, 3) points that stand for the source's bone: of its surface, else its features [m]."""
        bone = self.bone
        points = UNKNOWN_LENGTH * _SPHERE
        if bone.source is not None and len(bone.source.vertices):
            points = bone.source.vertices
        elif bone.features is not None and len(bone.features) > 3:
            points = bone.features.source
        return points[:: max(1, len(points) // SAMPLES)]

    @cached_property
    def linear(self) -> Array:
        """(3, 3) of the affine map nearest to the map over the whole bone, or what it states."""
        if self.bone.overall is not None:
            return self.bone.overall
        return fit_affine(self.samples, self.points(self.samples)).matrix

    @cached_property
    def length(self) -> float:
        """Of the source's bone: its greatest extent along an axis of its frame [m]."""
        return float(np.ptp(self.samples, axis=0).max())

    @property
    def size(self) -> float:
        """Length of the target's bone over that of the source's."""
        return self.bone.whole.scale

    @cached_property
    def volume(self) -> float:
        """Volume of the target's bone over that of the source's."""
        return float(np.linalg.det(self.linear))

    def within(self, points: ArrayLike) -> Array:
        """Return the distances within which points of the source belong with 90 %.

        They are those of the matched points around them, and what the map adds beside the bone and
        where surface is missing.

        Parameters
        ----------
        points : (n, 3) in the source body's frame [m]

        Returns
        -------
        (n,) distances [m]; NaN where nothing is known
        """
        asked = np.asarray(points, dtype=np.float64).reshape(-1, 3)
        features = self.bone.features
        if features is None or features.radii is None or not len(asked):
            return np.full(len(asked), np.nan)
        around = scipy.spatial.cKDTree(features.source)
        feet = (
            features.source[around.query(asked)[1]]
            if self.shapes is None
            else self.shapes[0].closest(asked)[0]
        )
        spacing = float(np.median(around.query(features.source, 2)[0][:, 1]))
        unmatched = np.maximum(around.query(feet)[0] - COVERED * spacing, 0.0) * (
            self.bone.basis == "bone"
        )
        beside = np.hypot(BESIDE * np.linalg.norm(asked - feet, axis=1), unmatched)
        return np.hypot(radii_around(features.source, features.radii, asked), self.size * beside)

    def near(self, place: ArrayLike) -> Array:
        """Return the matrix of the affine map that comes nearest around a point.

        Parameters
        ----------
        place : (3,) in the source body's frame [m]

        Returns
        -------
        (3, 3) [m/m]; that of the whole bone where the map turns space inside out
        """
        radius = NEIGHBORHOOD * self.length
        moved = self.points(np.asarray(place) + radius * _SPHERE)
        matrix: Array = 3.0 / (len(_SPHERE) * radius) * moved.T @ _SPHERE
        return matrix if np.linalg.det(matrix) > 0.0 else self.linear

    @property
    def rotation(self) -> Array:
        """Rotation (3, 3) of directions fixed to the bone.

        It is that of the whole bone, so of a long one's shaft.
        """
        return self.bone.whole.rotation

    def turn(self, place: ArrayLike) -> Array:
        """Return the rotation of what is around a point: a condyle may turn against the shaft.

        Parameters
        ----------
        place : (3,) in the source body's frame [m]

        Returns
        -------
        (3, 3)
        """
        return nearest_rotation(self.near(place))

    def pose(self, pose: Transform) -> Transform:
        """Transfer a frame that is fixed to the source body to the target's."""
        return Transform(self.rotation @ pose.rotation, self.points(pose.translation))

    @cached_property
    def shapes(self) -> tuple[Shape, Shape] | None:
        """Surfaces of source and target, where both have one."""
        bone = self.bone
        if bone.source is None or bone.target is None:
            return None
        return Shape(bone.source), Shape(bone.target)


Transfers = Mapping[str, Transfer]


def nearest_rotation(matrix: Array) -> Array:
    """Return the rotation nearest to a matrix that keeps right right (its polar factor).

    Parameters
    ----------
    matrix : (3, 3) of positive determinant

    Returns
    -------
    (3, 3)
    """
    u, _, vt = np.linalg.svd(matrix)
    return (u * [1.0, 1.0, np.linalg.det(u @ vt)]) @ vt


def scaled_map(body: str, size: float) -> AffineMap:
    """Return the map of a body that keeps its frame and changes its size."""
    if not (np.isfinite(size) and size > 0.0):
        raise BadData(f"the size of '{body}' would be {size}: its neighbors' maps are not usable")
    return AffineMap(size * np.eye(3), np.zeros(3))


Tie = TypeVar("Tie", Loop, Bushing)


def transferred_body(body: Body, transfer: Transfer) -> Body:
    """Transfer a body, whose mass grows with its bone's volume.

    The mass is spread in it as the map of the whole bone spreads it. The second moments of mass
    P = tr(I) / 2 - I become A P A^T, where A is the affine map nearest over the bone.
    """
    A = transfer.linear
    mass = body.mass * transfer.volume
    second = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
    second = transfer.volume * A @ second @ A.T
    return replace(
        body,
        mass=mass,
        mass_center=transfer.points(body.mass_center),
        inertia=np.trace(second) * np.eye(3) - second,
        meshes=tuple(transferred_mesh(mesh, transfer) for mesh in body.meshes),
    )


def of_mass(bodies: tuple[Body, ...], mass: float | None) -> tuple[Body, ...]:
    """Scale the bodies' masses in proportion, to a total mass [kg]."""
    if mass is None:
        return bodies
    total = sum(body.mass for body in bodies)
    if not (np.isfinite(mass) and mass > 0.0 and total > 0.0):
        raise BadData(
            f"expected a positive mass and bodies that have some, but got {mass} for {total:g} kg"
        )
    share = mass / total
    return tuple(
        replace(body, mass=body.mass * share, inertia=body.inertia * share) for body in bodies
    )


def transferred_mesh(mesh: Mesh, transfer: Transfer) -> Mesh:
    """Stretch a mesh along its own axes as its bone is.

    It can be shown where the target's bone has no file.
    """
    matrix = transfer.linear @ mesh.pose.rotation
    pose = Transform(nearest_rotation(matrix), transfer.points(mesh.pose.translation))
    return replace(mesh, pose=pose, scale=np.asarray(mesh.scale) * np.linalg.norm(matrix, axis=0))


def transferred_marker(marker: Marker, transfers: Transfers) -> Marker:
    """Transfer a marker by its body's map."""
    transfer = transfers[marker.body]
    return replace(marker, body=transfer.body, location=transfer.points(marker.location))


def transferred_tie(tie: Tie, transfers: Transfers) -> Tie:
    """Transfer both frames of a closed loop or a bushing."""
    first = transfers[tie.body_1]
    second = transfers[tie.body_2]
    return replace(
        tie,
        body_1=first.body,
        body_2=second.body,
        pose_1=first.pose(tie.pose_1),
        pose_2=second.pose(tie.pose_2),
    )


def transferred_actuator(actuator: Actuator, transfers: Transfers) -> Actuator:
    """Points and directions of an ideal actuator that are fixed to bodies."""

    def there(body: str, point: Array) -> Array:
        return transfers[body].points(point) if body and not actuator.point_is_global else point

    direction = actuator.direction
    if actuator.body and actuator.body != GROUND and not actuator.direction_is_global:
        direction = transfers[actuator.body].rotation @ direction
    return replace(
        actuator,
        point=there(actuator.body, actuator.point),
        other_point=there(actuator.other_body, actuator.other_point),
        direction=direction,
    )


def not_transferred(model: Model) -> list[str]:
    """Return one line on each kind of part that stays as it is.

    A file stores these with geometry of their own.
    """
    placed = ("Contact", "Path", "Force")
    kinds: dict[str, int] = {}
    for part in model.kept:
        if any(word in part.kind for word in placed) and not part.kind.startswith(
            ("Coordinate", "Path", "SpringG")
        ):
            kinds[part.kind] = kinds.get(part.kind, 0) + 1
    return [
        f"{kind} ({count} of them) is kept as the file has it: it is not moved"
        for kind, count in kinds.items()
    ]


def with_neighbors(model: Model, bones: Mapping[str, BoneMap]) -> dict[str, BoneMap]:
    """Complete the maps to all bodies and the ground.

    A body without a map takes the size of its nearest neighbors. Such a body keeps its frame; its
    size is the geometric mean over the bodies nearest in the tree that have a bone. The ground
    neither turns nor moves, whatever hangs on it.
    """
    ties = neighbors_of(model)
    result = dict(bones)
    sizes = {name: bone.whole.scale for name, bone in bones.items()}
    while len(result) < len(ties):
        # The ground passes nothing on: what hangs on it beside a subject is not of its size.
        beside = {
            name: [
                sizes[tie]
                for tie in ties[name]
                if tie in sizes and (tie != GROUND or GROUND in bones)
            ]
            for name in ties
            if name not in result
        }
        near = {
            name: float(np.exp(np.mean(np.log(sizes)))) for name, sizes in beside.items() if sizes
        }
        for name, size in near.items() if near else [(name, 1.0) for name in beside]:
            whole = Similarity(np.eye(3), np.zeros(3), size)
            result[name] = BoneMap(
                body=name,
                target_body=name,
                map=scaled_map(name, size),
                whole=whole,
                basis="neighbors",
            )
            sizes[name] = size
    return {name: result[name] for name in ties}


def neighbor_notes(bones: Mapping[str, BoneMap]) -> list[str]:
    """One line on the bodies that were scaled with their neighbors."""
    scaled = {
        name: bone.whole.scale
        for name, bone in bones.items()
        if bone.basis == "neighbors" and name != GROUND
    }
    if not scaled:
        return []
    low = min(scaled.values())
    high = max(scaled.values())
    by = f"by {low:.3g}" if high - low < 5e-4 * high else f"by {low:.3g} to {high:.3g}"
    return [f"scaled with their neighbors {by}, as no bone is given: {quoted(scaled)}"]
