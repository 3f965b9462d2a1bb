"""Contact points of knees: the lowest places of the femur's condyles on the model's own bone, or usual distances."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np

from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.model import Joint, Model
from myomorph.model.segments import feet_of
from myomorph.model.series import Motion
from myomorph.model.sides import other_side, split_side
from myomorph.model.surface import Surface
from myomorph.rigid.kinematics import Poses, forward_kinematics
from myomorph.rigid.tree import compile_tree
from myomorph.tension.joint_contact import ContactPoint, JointPoints, long_axis

THIGH, SHANK = ("femur", "thigh"), ("tibia", "shank")
"""Words in the names of the bodies above and below a knee."""

FLEXIONS = np.radians([0.0, 15.0, 30.0, 45.0, 60.0])
"""At which the condyles' lowest places are looked for; the contact point is their mean [rad]."""

LOWEST = 0.0075
"""Depth of the part of a condyle whose middle is its lowest place, of the distance from hip to knee."""

CONDYLES = 0.1
"""Height of the condyles above their lowest place, of the distance from hip to knee."""

HALF_SPACING = 0.057
"""Distance of a contact point from the knee's center, of that from hip to knee, where there is no bone: half of the
46 mm between the lowest places of the condyles over the 406 mm of the femur of Rajagopal et al. (2016), a man's."""


def knee_points(model: Model, surfaces: Mapping[str, Surface]) -> JointPoints:
    """Medial and lateral contact point of every knee of a model, fixed to the tibia.

    Where a mesh of the femur is there, each is the mean of the lowest places of its condyle, seen along the tibia, at
    flexions of 0 to 60 degrees. The mesh of the other side serves mirrored. Without a mesh the points lie at 0.057 of
    the distance from hip to knee beside the joint's center. They push along the tibia, from knee to ankle.

    Source: Lerner et al. 2015; bones of Rajagopal et al. 2016.

    Parameters
    ----------
    model : whose knees are the joints between a body called femur or thigh and one called tibia or shank
    surfaces : meshes by `Mesh.file`, in their own units, as far as they are there

    Returns
    -------
    the points, and a note on each knee without a bone of its own

    Raises
    ------
    BadModel
        where the model has no knee, or a knee has no side, no hip or no ankle to tell its axes by

    Examples
    --------
    >>> import myomorph as mm
    >>> knee_points(mm.read_model("arm.osim"), {})
    Traceback (most recent call last):
    ...
    myomorph.model.errors.BadModel: model 'arm' has no knee: ...
    """
    knees = [one for one in model.joints if _is(one.parent, THIGH) and _is(one.child, SHANK)]
    if not knees:
        raise BadModel(
            f"model '{model.name}' has no knee: no joint between a body called {' or '.join(THIGH)} and one called "
            f"{' or '.join(SHANK)}; give the contact points in a file"
        )
    points: list[ContactPoint] = []
    notes: list[str] = []
    for knee in knees:
        found, note = _of_knee(model, knee, surfaces)
        points += found
        notes += [note] if note else []
    return JointPoints(tuple(points), tuple(notes))


def _is(body: str, words: tuple[str, ...]) -> bool:
    return any(word in body.lower() for word in words)


def _of_knee(model: Model, knee: Joint, surfaces: Mapping[str, Surface]) -> tuple[list[ContactPoint], str]:
    """Both points of a knee and a note, "" where its own bone told them."""
    side = split_side(knee.child)[1] or split_side(knee.name)[1]
    hip = next((one for one in model.joints if one.child == knee.parent), None)
    down = long_axis(model, knee)
    if not side or hip is None or down is None:
        lacking = "no side in its name" if not side else "no hip above it" if hip is None else "no ankle below it"
        raise BadModel(f"joint '{knee.name}': has {lacking}, so its contact points must be given in a file")
    center = knee.child_frame.translation
    length = float(np.linalg.norm(knee.parent_frame.translation - hip.child_frame.translation))
    lateral = _lateral(model, knee, down, side)
    bone, note = _bone(model, knee, surfaces)
    if bone is None:
        places = [center + sign * HALF_SPACING * length * lateral for sign in (-1.0, 1.0)]
        note = (
            f"{knee.name}: no mesh of '{knee.parent}' lies beside the model: its contact points are taken "
            f"{2000 * HALF_SPACING * length:.0f} mm apart around the joint's center, {2 * HALF_SPACING:.3f} of the "
            "distance from hip to knee; medial and lateral force are worth no more than that"
        )
    else:
        places = _lowest(model, knee, bone, down, lateral, length)
    normal = tuple(float(one) for one in down)
    return [
        ContactPoint(knee.name, name, knee.child, tuple(float(one) for one in place), normal)  # type: ignore[arg-type]
        for name, place in zip(("medial", "lateral"), places, strict=True)
    ], note


def _flexed(model: Model, knee: Joint) -> tuple[Poses, int, int]:
    """Poses of the model at `FLEXIONS` of a knee, and the numbers of its bodies."""
    tree = compile_tree(model)
    turning = next(
        (
            name
            for axis in knee.axes
            for name in axis.coordinates
            if model.coordinate(name).motion == "rotational" and not model.coordinate(name).locked
        ),
        "",
    )
    if not turning:
        raise BadModel(f"joint '{knee.name}' does not turn, so its contact points must be given in a file")
    low, high = model.coordinate(turning).range
    # A knee that bends towards negative angles has its range there.
    sign = -1.0 if abs(low) > abs(high) else 1.0
    motion = Motion(np.arange(len(FLEXIONS), dtype=np.float64), (turning,), sign * FLEXIONS[:, None])
    poses = forward_kinematics(tree, tree.coordinates_of(motion))
    return poses, tree.body_index[knee.parent], tree.body_index[knee.child]


def _lateral(model: Model, knee: Joint, down: Array, side: str) -> Array:
    """Unit vector on the tibia, across its length, that points away from the other leg."""
    poses, femur, tibia = _flexed(model, knee)
    turned = poses.rotations[:, tibia].transpose(0, 2, 1) @ poses.rotations[:, femur]
    change = turned[-1] @ turned[0].T
    axis = np.array([change[2, 1] - change[1, 2], change[0, 2] - change[2, 0], change[1, 0] - change[0, 1]])
    axis -= (axis @ down) * down
    axis /= np.linalg.norm(axis)
    up = np.asarray(model.up, dtype=np.float64)
    forward = _forward(model, poses, tibia)
    right = poses.rotations[0, tibia].T @ np.cross(forward, up)
    away = right if side == "right" else -right
    return np.asarray(axis if axis @ away > 0.0 else -axis)


def _forward(model: Model, poses: Poses, tibia: int) -> Array:
    """Where the body looks in its default pose: the way of the feet, else the x axis of the tibia, in ground."""
    index = {name: k for k, name in enumerate(compile_tree(model).body_index)}
    ahead = np.zeros(3)
    for foot in feet_of(model):
        ahead += poses.rotations[0, index[foot]] @ model.body(foot).mass_center
    up = np.asarray(model.up, dtype=np.float64)
    if np.linalg.norm(ahead) < 1e-6:
        ahead = poses.rotations[0, tibia] @ np.array([1.0, 0.0, 0.0])
    ahead -= (ahead @ up) * up
    return ahead / np.linalg.norm(ahead)


def _bone(model: Model, knee: Joint, surfaces: Mapping[str, Surface]) -> tuple[Array | None, str]:
    """Vertices of the femur in its own frame [m]; None without a mesh. With a note where it is the other side's."""
    own = _vertices(model, knee.parent, surfaces)
    if own is not None:
        return own, ""
    other = other_side(knee.parent)
    if other not in model.body_names:
        return None, ""
    mirrored = _vertices(model, other, surfaces)
    if mirrored is None:
        return None, ""
    # Both femurs have their axes the same way, with the plane of symmetry across the body's third axis.
    note = f"{knee.name}: no mesh of '{knee.parent}' lies beside the model: that of '{other}' is taken, mirrored"
    return mirrored * _mirror(model, knee.parent, other), note


def _mirror(model: Model, body: str, other: str) -> Array:
    """Signs that turn points of one side's body into those of the other: of the axis along which hips are apart."""
    hips = [next(one for one in model.joints if one.child == name).parent_frame.translation for name in (body, other)]
    across = int(np.argmax(np.abs(hips[0] - hips[1])))
    return np.where(np.arange(3) == across, -1.0, 1.0)


def _vertices(model: Model, body: str, surfaces: Mapping[str, Surface]) -> Array | None:
    """Those of the mesh that draws a body with most of them, scaled and placed as the model does."""
    found = [one for one in model.body(body).meshes if one.shape == "mesh" and one.file in surfaces]
    if not found:
        return None
    mesh = max(found, key=lambda one: len(surfaces[one.file].vertices))
    return surfaces[mesh.file].vertices * mesh.scale @ mesh.pose.rotation.T + mesh.pose.translation


def _lowest(model: Model, knee: Joint, bone: Array, down: Array, lateral: Array, length: float) -> list[Array]:
    """Mean lowest place of the medial and of the lateral condyle, on the tibia."""
    poses, femur, tibia = _flexed(model, knee)
    sums = [np.zeros(3), np.zeros(3)]
    for k in range(len(FLEXIONS)):
        ground = bone @ poses.rotations[k, femur].T + poses.origins[k, femur]
        seen = (ground - poses.origins[k, tibia]) @ poses.rotations[k, tibia]
        depth, across = seen @ down, seen @ lateral
        region = depth > depth.max() - CONDYLES * length
        middle = 0.5 * (across[region].min() + across[region].max())
        for i, half in enumerate((across < middle, across >= middle)):
            own = region & half
            weights = np.maximum(depth[own] - depth[own].max() + LOWEST * length, 0.0)
            sums[i] += weights @ seen[own] / weights.sum()
    return [one / len(FLEXIONS) for one in sums]
