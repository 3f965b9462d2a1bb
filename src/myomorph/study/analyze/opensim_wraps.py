"""Muscle paths of MuJoCo in OpenSim's form, so that a file of OpenSim can hold them."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.model import Model
from myomorph.model.paths import Muscle, PathWrap, TendonWrap, WrapObject
from myomorph.model.spatial import Transform
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import Tree, compile_tree

LONG = 1.0
"""Length of a cylinder that MuJoCo has without an end [m]."""
MUSCLE = "Millard2012EquilibriumMuscle"


def in_opensim_form(model: Model) -> Model:
    """The model with Millard2012EquilibriumMuscle whose paths wrap as OpenSim's do. A tendon of MuJoCo goes around a
    surface on the side of a site. OpenSim's surfaces have a constrained half instead: each becomes one whose x axis
    points to the site, and whose positive half counts, once for every site that it is used with.
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None])
    objects = {item.name: item for item in model.wrap_objects}
    made: dict[str, WrapObject] = {}
    muscles = tuple(
        _muscle(muscle, objects, made, tree, poses.rotations[0], poses.origins[0]) for muscle in model.muscles
    )
    used = {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
    kept = tuple(item for item in model.wrap_objects if item.name in used and item.name not in made)
    return replace(model, muscles=muscles, wrap_objects=(*kept, *made.values()))


def _muscle(
    muscle: Muscle, objects: dict[str, WrapObject], made: dict[str, WrapObject], tree: Tree, R: Array, origins: Array
) -> Muscle:
    wraps = []
    for wrap in muscle.path.wraps:
        if not isinstance(wrap, TendonWrap):
            return muscle
        own = objects[wrap.wrap_object]
        body = tree.body_index[own.body]
        toward = None
        if wrap.side is not None:
            other = tree.body_index[wrap.side_body]
            place = R[body].T @ (origins[other] + R[other] @ wrap.side - origins[body])
            toward = place - own.pose.translation
        name = own.name if wrap.side is None else f"{own.name}_{wrap.side_body}_{_digits(wrap.side)}"
        made.setdefault(name, _sided(own, name, toward))
        wraps.append(PathWrap(name, first=wrap.after + 1, last=wrap.after + 2))
    kind = MUSCLE if muscle.kind == "mujoco" else muscle.kind
    return replace(muscle, kind=kind, path=replace(muscle.path, wraps=tuple(wraps)))


def _sided(wrap_object: WrapObject, name: str, toward: Array | None) -> WrapObject:
    """A surface whose positive x half is on the side of a point (3,) from its center, in its body's axes."""
    size = (wrap_object.size[0], LONG) if wrap_object.kind == "cylinder" else wrap_object.size
    if toward is None:
        return replace(wrap_object, name=name, size=size)
    R = wrap_object.pose.rotation
    z = R[:, 2]
    x = toward - (toward @ z) * z if wrap_object.kind == "cylinder" else toward
    length = float(np.linalg.norm(x))
    if length < 1e-9:
        return replace(wrap_object, name=name, size=size)
    x = x / length
    if wrap_object.kind != "cylinder":
        other = R[:, int(np.argmin(np.abs(R.T @ x)))]
        z = np.cross(x, other) / np.linalg.norm(np.cross(x, other))
    turned = np.column_stack([x, np.cross(z, x), z])
    return replace(
        wrap_object, name=name, size=size, pose=Transform(turned, wrap_object.pose.translation), quadrant="+x"
    )


def _digits(place: Array) -> str:
    return "_".join(f"{round(1e4 * float(one)):+d}".replace("+", "p").replace("-", "m") for one in place)
