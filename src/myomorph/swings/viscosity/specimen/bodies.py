"""The bones of a specimen out of a larger model.

These are who hangs on whom, and what else moves with each of them.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from myomorph.body.identify.null_space import parameters_in_parent
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.functions import linear
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.model import GROUND, Axis, Body, Coordinate, Joint, Model, index_of
from myomorph.core.model.series import DEFAULT_POSE
from myomorph.core.model.spatial import Transform
from myomorph.core.rigid.kinematics import Poses, forward_kinematics
from myomorph.core.rigid.tree import ROTATION, compile_tree

# Distance of a joint's axes from its center from which it is told that they do not meet [m].
ASTRAY = 1e-3


@dataclass(frozen=True, eq=False)
class Anatomy:
    """A source model in its default pose.

    `homes` has, of bodies that move with a bone, that bone and their pose in it.
    """

    model: Model
    bones: tuple[str, ...]
    poses: Poses
    homes: dict[str, tuple[str, Transform]]

    def pose(self, body: str) -> Transform:
        """Return the default pose of a body in ground."""
        b = self.poses.tree.body_index[body]
        return Transform(self.poses.rotations[0, b], self.poses.origins[0, b])


def anatomy(model: Model, base: str, first: str, bones: Sequence[str]) -> Anatomy:
    """Find where every body of a model belongs.

    Bodies beyond a bone, and between two, move with the nearer bone. Bodies between base and limb
    (phantoms of a joint) and all that does not hang on the limb belong nowhere.

    Parameters
    ----------
    model : with the bodies
    base, first : the base, and the limb's first body
    bones : of the limb
    """
    for name in (base, first, *bones):
        index_of("body", name, model.body_names)
    parents = {joint.child: joint.parent for joint in model.joints}
    if base not in ancestors(parents, first):
        hangs = f"'{first}' is not attached to '{base}', but to {_chain(parents, first)}"
        raise BadModel(f"model '{model.name}': {hangs}: name the base that carries the joint")
    for name in bones:
        if name not in (base, first) and first not in ancestors(parents, name):
            raise BadModel(
                f"model '{model.name}': bone '{name}' is not attached to '{first}':"
                f" {_chain(parents, name)}"
            )
    named = {base, first, *bones}
    kept = tuple(name for name in model.body_names if name in named)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE))
    bare = Anatomy(model=model, bones=kept, poses=poses, homes={})
    for body in model.body_names:
        home = _home(model, parents, body, base, first, kept)
        if home:
            bare.homes[body] = home, bare.pose(home).inverse() @ bare.pose(body)
    return bare


def ancestors(parents: dict[str, str], body: str) -> list[str]:
    """List the bodies between a body and the ground, the nearest first."""
    result = []
    while body in parents and parents[body] != GROUND:
        body = parents[body]
        result.append(body)
    return result


def _chain(parents: dict[str, str], body: str) -> str:
    return ", ".join(f"'{name}'" for name in ancestors(parents, body)[:6]) or "the ground"


def _home(
    model: Model, parents: dict[str, str], body: str, base: str, first: str, kept: tuple[str, ...]
) -> str:
    if body in kept:
        return body
    above = ancestors(parents, body)
    if first not in above:
        return ""
    below = [name for name in kept if body in ancestors(parents, name)]
    return below[0] if below else next(name for name in above if name in kept)


def joint_center(source: Anatomy, base: str, first: str) -> tuple[Array, Array, float]:
    """Find the point that all axes of rotation between two bodies go through.

    Where they are parallel, it is the point nearest to the first body's origin.

    Parameters
    ----------
    source : in its default pose
    base, first : the bodies

    Returns
    -------
    (3,) the point in ground; (axes, 3) directions; distance of the axis farthest from it [m]
    """
    poses = source.poses
    tree = source.poses.tree
    between = tree.supports[tree.body_index[first]] & ~tree.supports[tree.body_index[base]]
    axes = np.flatnonzero(between & (tree.arrays.axis_kind == ROTATION))
    if not len(axes):
        raise BadModel(f"model '{source.model.name}': no joint turns '{first}' against '{base}'")
    directions = poses.axis_directions[0, axes]
    points = poses.axis_points[0, axes]
    away = np.eye(3) - np.einsum("ai,aj->aij", directions, directions)
    origin = source.pose(first).translation
    # The shortest way from the origin, where parallel axes leave a direction open.
    miss = np.einsum("aij,aj->ai", away, points - origin)
    center = origin + np.linalg.lstsq(away.reshape(-1, 3), miss.ravel(), rcond=1e-6)[0]
    distance = np.linalg.norm(np.einsum("aij,aj->ai", away, center - points), axis=1).max()
    return center, directions, float(distance)


def lumped_bodies(source: Anatomy) -> tuple[Body, ...]:
    """Make the bones, each with the mass and the meshes of what moves with it."""
    table = inertial_parameters(source.model)
    totals = {name: np.zeros(10) for name in source.bones}
    meshes: dict[str, list] = {name: [] for name in source.bones}
    for body, row in zip(source.model.bodies, table, strict=True):
        if body.name in source.homes:
            home, pose = source.homes[body.name]
            totals[home] += moved_parameters(row, pose)
            meshes[home] += [replace(mesh, pose=pose @ mesh.pose) for mesh in body.meshes]
    bones = tuple(
        replace(source.model.body(name), meshes=tuple(meshes[name])) for name in source.bones
    )
    loose = tuple(
        Joint(
            name=name,
            kind="weld",
            parent=GROUND,
            child=name,
            parent_frame=Transform.identity(),
            child_frame=Transform.identity(),
        )
        for name in source.bones
    )
    carrier = Model(
        name="bones", bodies=bones, joints=loose, coordinates=(), gravity=source.model.gravity
    )
    return with_inertial_parameters(
        carrier, np.array([totals[name] for name in source.bones])
    ).bodies


def moved_parameters(parameters: Array, pose: Transform) -> Array:
    """Express a body's inertial parameters in another frame.

    Parameters
    ----------
    parameters : (10,) [D] order
    pose : of the body in the other frame

    Returns
    -------
    (10,)
    """
    return parameters_in_parent(pose.rotation, pose.translation) @ parameters


def held_joint(source: Anatomy, bone: str) -> tuple[Joint, tuple[Coordinate, ...]]:
    """Make the joint that holds a bone on the bone before it.

    Joints of bodies between them are one chain of axes. A bone that the source welds gets three
    rotations, because the wires may hold it at another angle than the model.

    Parameters
    ----------
    source : with the joints
    bone : that is held
    """
    model = source.model
    by_child = {joint.child: joint for joint in model.joints}
    chain = [by_child[bone]]
    while chain[0].parent not in source.bones:
        chain.insert(0, by_child[chain[0].parent])
    joint = joined(chain)
    used = {name for axis in joint.axes if axis.function.arity for name in axis.coordinates}
    owned = [name for joint in chain for name in joint.coordinates]
    names = tuple(name for name in model.coordinate_names if name in used or name in owned)
    if names:
        coordinates = tuple(
            replace(model.coordinate(name), locked=False, clamped=False) for name in names
        )
        return replace(joint, coordinates=names), coordinates
    names = tuple(f"{bone}_r{axis}" for axis in "xyz")
    return replace(joint, kind="ball", axes=joint.axes + turns(names), coordinates=names), free(
        names
    )


def joined(chain: Sequence[Joint]) -> Joint:
    """Join several joints in a row: later axes are seen from the frame of the first."""
    first = chain[0]
    last = chain[-1]
    axes = list(first.axes)
    behind = first.child_frame.inverse()
    for joint in chain[1:]:
        middle = behind @ joint.parent_frame
        axes += [
            replace(axis, vector=middle.rotation @ axis.vector, origin=middle.apply(axis.origin))
            for axis in joint.axes
        ]
        behind = middle @ joint.child_frame.inverse()
    return Joint(
        name=last.name,
        kind=last.kind,
        parent=first.parent,
        child=last.child,
        parent_frame=first.parent_frame,
        child_frame=behind.inverse(),
        axes=tuple(axes),
    )


def turns(names: Sequence[str], order: Sequence[int] = (0, 1, 2)) -> tuple[Axis, ...]:
    """Make body-fixed rotations about x, y, z axes in an order, one coordinate each."""
    return tuple(
        Axis(kind="rotation", vector=np.eye(3)[axis], function=linear(1.0), coordinates=(name,))
        for axis, name in zip(order, names, strict=True)
    )


def shifts(names: Sequence[str]) -> tuple[Axis, ...]:
    """Make translations along x, y, z, one coordinate each."""
    return tuple(
        Axis(kind="translation", vector=axis, function=linear(1.0), coordinates=(name,))
        for axis, name in zip(np.eye(3), names, strict=True)
    )


def free(names: Sequence[str], motion: str = "rotational") -> tuple[Coordinate, ...]:
    """Make coordinates without bounds."""
    return tuple(Coordinate(name, motion) for name in names)  # type: ignore[arg-type]
