"""Bodies in other bones: with a bone of their own, or scaled with their neighbors.

What is fixed to a body beside muscles goes with it: mass, meshes, markers, points of forces.
"""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace
from typing import TypeVar

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, quoted
from myomorph.model.model import GROUND, Actuator, Body, Loop, Marker, Mesh, Model
from myomorph.model.paths import Bushing
from myomorph.model.spatial import Transform
from myomorph.morph.maps.fields import BoneMap, neighbors_of
from myomorph.morph.maps.linear import Similarity
from myomorph.morph.transfer.body_transfer import Transfer, Transfers, nearest_rotation, scaled_map

Tie = TypeVar("Tie", Loop, Bushing)


def transferred_body(body: Body, transfer: Transfer) -> Body:
    """A body whose mass grows with its bone's volume, spread in it as the map of the whole bone spreads it. The second
    moments of mass P = tr(I) / 2 - I become A P A^T, where A is the affine map nearest over the bone.
    """
    A, mass = transfer.linear, body.mass * transfer.volume
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
    """The bodies with their masses in proportion, of a total mass [kg]."""
    if mass is None:
        return bodies
    total = sum(body.mass for body in bodies)
    if not (np.isfinite(mass) and mass > 0.0 and total > 0.0):
        raise BadData(f"expected a positive mass and bodies that have some, but got {mass} for {total:g} kg")
    share = mass / total
    return tuple(replace(body, mass=body.mass * share, inertia=body.inertia * share) for body in bodies)


def transferred_mesh(mesh: Mesh, transfer: Transfer) -> Mesh:
    """A mesh stretched along its own axes as its bone is: what can be shown where the target's bone has no file."""
    matrix = transfer.linear @ mesh.pose.rotation
    pose = Transform(nearest_rotation(matrix), transfer.points(mesh.pose.translation))
    return replace(mesh, pose=pose, scale=np.asarray(mesh.scale) * np.linalg.norm(matrix, axis=0))


def transferred_marker(marker: Marker, transfers: Transfers) -> Marker:
    """A marker, by its body's map."""
    transfer = transfers[marker.body]
    return replace(marker, body=transfer.body, location=transfer.points(marker.location))


def transferred_tie(tie: Tie, transfers: Transfers) -> Tie:
    """A closed loop or a bushing: both of its frames."""
    first, second = transfers[tie.body_1], transfers[tie.body_2]
    return replace(
        tie, body_1=first.body, body_2=second.body, pose_1=first.pose(tie.pose_1), pose_2=second.pose(tie.pose_2)
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
    """One line on each kind of thing that a file keeps with geometry of its own, and that stays as it is."""
    placed = ("Contact", "Path", "Force")
    kinds: dict[str, int] = {}
    for part in model.kept:
        if any(word in part.kind for word in placed) and not part.kind.startswith(("Coordinate", "Path", "SpringG")):
            kinds[part.kind] = kinds.get(part.kind, 0) + 1
    return [f"{kind} ({count} of them) is kept as the file has it: it is not moved" for kind, count in kinds.items()]


def with_neighbors(model: Model, bones: Mapping[str, BoneMap]) -> dict[str, BoneMap]:
    """Maps of all bodies and of the ground, in which a body without one takes the size of its nearest neighbors. Such a
    body keeps its frame; its size is the geometric mean over the bodies nearest in the tree that have a bone. The
    ground neither turns nor moves, whatever hangs on it.
    """
    ties = neighbors_of(model)
    result = dict(bones)
    sizes = {name: bone.whole.scale for name, bone in bones.items()}
    while len(result) < len(ties):
        # The ground passes nothing on: what hangs on it beside a subject is not of its size.
        beside = {
            name: [sizes[tie] for tie in ties[name] if tie in sizes and (tie != GROUND or GROUND in bones)]
            for name in ties
            if name not in result
        }
        near = {name: float(np.exp(np.mean(np.log(sizes)))) for name, sizes in beside.items() if sizes}
        for name, size in near.items() if near else [(name, 1.0) for name in beside]:
            result[name] = _resized(name, size)
            sizes[name] = size
    return {name: result[name] for name in ties}


def _resized(body: str, size: float) -> BoneMap:
    whole = Similarity(np.eye(3), np.zeros(3), size)
    return BoneMap(body, body, scaled_map(body, size), whole, "neighbors")


def neighbor_notes(bones: Mapping[str, BoneMap]) -> list[str]:
    """One line on the bodies that were scaled with their neighbors."""
    scaled = {name: bone.whole.scale for name, bone in bones.items() if bone.basis == "neighbors" and name != GROUND}
    if not scaled:
        return []
    low, high = min(scaled.values()), max(scaled.values())
    by = f"by {low:.3g}" if high - low < 5e-4 * high else f"by {low:.3g} to {high:.3g}"
    return [f"scaled with their neighbors {by}, as no bone is given: {quoted(scaled)}"]
