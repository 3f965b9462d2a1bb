"""Contact points of knees: lowest places of condyles on the bone, or usual distances."""

from __future__ import annotations

from collections.abc import Mapping

import numpy as np
from numpy.typing import NDArray

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.causes import JOINT_POINTS
from myomorph.core.model.errors import BadModel
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Body, Joint, Model
from myomorph.core.model.segments import feet_of
from myomorph.core.model.sides import other_side, split_side
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface, body_meshes
from myomorph.core.rigid.kinematics import Poses
from myomorph.core.rigid.knees import (
    FLEXIONS,
    SHANK,
    THIGH,
    flexed,
    hinge_axis,
    joint_above,
    knee_joints,
    long_axis,
)
from myomorph.core.rigid.tree import compile_tree
from myomorph.core.tension.joint_contact import ContactPoint, JointPoints

LOWEST = 0.0075
"""Depth of the part of a condyle whose middle is its lowest place, as a share of the distance from
hip to knee.
"""
CONDYLES = 0.1
"""Height of the condyles above their lowest place, of the distance from hip to knee."""
HALF_SPACING = 0.057
"""Distance of a contact point from the knee's center, of that from hip to knee, where there is no
bone: half of the 46 mm between the lowest places of the condyles over the 406 mm of the femur of
Rajagopal et al. (2016), a man's.
"""


def knee_points(model: Model, surfaces: Mapping[str, Surface]) -> JointPoints:
    """Medial and lateral contact point of every knee of a model, fixed to the tibia.

    Where a mesh of the femur is there, each is the mean of the lowest places of its condyle, seen
    along the tibia, at flexions of 0 to 60 degrees. The mesh of the other side serves mirrored.
    Without a mesh the points lie at 0.057 of the distance from hip to knee beside the joint's
    center. They push along the tibia, from knee to ankle.

    Source: Lerner et al. 2015; bones of Rajagopal et al. 2016.

    Parameters
    ----------
    model : whose knees are the joints between a body called femur or thigh and one called tibia or
        shank
    surfaces : meshes by `Mesh.file`, in their own units, as far as they are there

    Returns
    -------
    the points, and a note on each knee without a bone of its own

    Raises
    ------
    BadModel : the model has no knee, or a knee has no side, hip or ankle

    Examples
    --------
    >>> import myomorph as mm
    >>> knee_points(mm.read_model("arm.osim"), {})
    Traceback (most recent call last):
    ...
    myomorph.core.model.errors.BadModel: model 'arm' has no knee: ...
    """
    knees = knee_joints(model)
    if not knees:
        raise BadModel(
            f"model '{model.name}' has no knee: no joint between a body called {' or '.join(THIGH)}"
            f" and one called {' or '.join(SHANK)}; give the contact points in a file"
        )
    points: list[ContactPoint] = []
    notes: list[Message] = []
    for knee in knees:
        of_knee, of_bone = _of_knee(model, knee, surfaces)
        points += of_knee
        notes += of_bone
    return JointPoints(tuple(points), tuple(notes))


def _of_knee(
    model: Model, knee: Joint, surfaces: Mapping[str, Surface]
) -> tuple[list[ContactPoint], list[Message]]:
    """Both points of a knee, with notes where its own bone did not tell them."""
    axes = _axes(model, knee)
    center = knee.child_frame.translation
    bone, notes = _bone(model, knee, surfaces)
    if bone is None:
        offset = HALF_SPACING * axes.length
        places = [center + sign * offset * axes.lateral for sign in (-1.0, 1.0)]
        notes = [
            JOINT_POINTS.message(
                f"{knee.name}: no mesh of '{knee.parent}' lies beside the model: its contact points"
                f" are taken {2000 * offset:.0f} mm apart around the joint's center,"
                f" {2 * HALF_SPACING:.3f} of the distance from hip to knee; medial and lateral"
                " force are worth no more than that"
            )
        ]
    else:
        places = _lowest(model, knee, axes, bone)
    points = [
        ContactPoint(
            joint=knee.name,
            name=name,
            frame=knee.child,
            point=_triple(place),
            normal=_triple(axes.down),
        )
        for name, place in zip(("medial", "lateral"), places, strict=True)
    ]
    return points, notes


def _triple(vector: Array) -> tuple[float, float, float]:
    """Take the components of a vector (3,)."""
    x, y, z = vector
    return float(x), float(y), float(z)


@read_only
class KneeAxes:
    """Directions on the tibia, and the size of the thigh.

    Attributes
    ----------
    poses : of the bodies at flexions of the knee
    down, lateral : (3,) along the tibia, and across it away from the other leg
    length : distance from hip to knee [m]
    """

    poses: Poses
    down: Array
    lateral: Array
    length: float


def _axes(model: Model, knee: Joint) -> KneeAxes:
    """Find the directions of a knee.

    Raises
    ------
    BadModel : the knee has no side in its name, no hip, no ankle, or does not turn
    """
    side = _side(model, knee)
    hip = joint_above(model, knee.parent)
    down = long_axis(model, knee)
    poses = flexed(model, knee)
    if not side:
        raise _unfit(knee, "has no side in its name")
    if hip is None:
        raise _unfit(knee, "has no hip above it")
    if down is None:
        raise _unfit(knee, "has no ankle below it")
    if poses is None or not hinge_axis(model, knee, poses, down).any():
        raise BadModel(
            f"joint '{knee.name}' does not rotate, so its contact points must be given in a file"
        )
    # By the knee's child: some models move the knee down the thigh by its coordinates.
    thigh = _place(poses, knee.child, knee.child_frame) - _place(poses, hip.child, hip.child_frame)
    return KneeAxes(
        poses=poses,
        down=down,
        lateral=_lateral(model, knee, poses, down, side),
        length=float(np.linalg.norm(thigh)),
    )


def _side(model: Model, knee: Joint) -> str:
    """Tell the side of a knee: its name, else the one that the other knee's name leaves."""
    named = {
        one.name: split_side(one.child)[1] or split_side(one.name)[1] for one in knee_joints(model)
    }
    own = named.pop(knee.name)
    others = tuple(named.values())
    left: Mapping[tuple[str, ...], str] = {("left",): "right", ("right",): "left"}
    return own or left.get(others, "")


def _place(poses: Poses, body: str, frame: Transform) -> Array:
    """(3,) origin of a body's frame in ground in the first pose [m]."""
    number = poses.tree.body_index[body]
    place = poses.origins[0, number] + poses.rotations[0, number] @ frame.translation
    return np.asarray(place)


def _unfit(knee: Joint, reason: str) -> BadModel:
    """Error of a knee whose contact points cannot be found."""
    return BadModel(f"joint '{knee.name}': {reason}, so its contact points must be given in a file")


def _lateral(model: Model, knee: Joint, poses: Poses, down: Array, side: str) -> Array:
    """Direction on the tibia, across its length, that points away from the other leg.

    Parameters
    ----------
    poses : of the bodies at flexions of the knee
    down : (3,) along the tibia
    side : "right" or "left"

    Returns
    -------
    (3,)
    """
    index = compile_tree(model).body_index
    up = model.up
    tibia = poses.rotations[0, index[knee.child]]
    # Where the body looks in its default pose: the way of the feet, else the x axis of the tibia.
    ahead = np.zeros(3)
    for foot in feet_of(model):
        ahead += poses.rotations[0, index[foot]] @ model.body(foot).mass_center
    if np.linalg.norm(ahead) < 1e-6:
        ahead = tibia @ np.array([1.0, 0.0, 0.0])
    ahead -= (ahead @ up) * up
    right = tibia.T @ np.cross(ahead / np.linalg.norm(ahead), up)
    away = right if side == "right" else -right
    axis = hinge_axis(model, knee, poses, down)
    return np.asarray(axis if axis @ away > 0.0 else -axis)


def _bone(
    model: Model, knee: Joint, surfaces: Mapping[str, Surface]
) -> tuple[Array | None, list[Message]]:
    """Vertices of the femur in its own frame, with a note where they are the other side's.

    Returns
    -------
    (vertices, 3) [m], None without a mesh
    """
    vertices = _vertices(model.body(knee.parent), surfaces)
    if vertices is not None:
        return vertices, []
    other = other_side(knee.parent)
    mirrored = _vertices(model.body(other), surfaces) if other in model.body_names else None
    if mirrored is None:
        return None, []
    # Both femurs have their axes the same way; the plane of symmetry is across the axis along which
    # hips are apart.
    hips = {joint.child: joint.parent_frame.translation for joint in model.joints}
    across = int(np.argmax(np.abs(hips[knee.parent] - hips[other])))
    notes = [
        JOINT_POINTS.message(
            f"{knee.name}: no mesh of '{knee.parent}' lies beside the model: that of '{other}' is"
            " taken, mirrored",
            severity="good to know",
        )
    ]
    return mirrored * np.where(np.arange(3) == across, -1.0, 1.0), notes


def _vertices(body: Body, surfaces: Mapping[str, Surface]) -> Array | None:
    """Vertices (vertices, 3) of the mesh that draws a body with most of them."""
    return max((surface.vertices for surface in body_meshes(body, surfaces)), key=len, default=None)


def _lowest(model: Model, knee: Joint, axes: KneeAxes, bone: Array) -> list[Array]:
    """Mean lowest place of the medial and of the lateral condyle, on the tibia.

    Parameters
    ----------
    bone : (vertices, 3) of the femur in its frame [m]

    Returns
    -------
    two of (3,) [m]
    """
    index = compile_tree(model).body_index
    femur = index[knee.parent]
    tibia = index[knee.child]
    origins = axes.poses.origins
    rotations = axes.poses.rotations
    medial = np.zeros(3)
    lateral = np.zeros(3)
    for flexion in range(len(FLEXIONS)):
        ground = bone @ rotations[flexion, femur].T + origins[flexion, femur]
        seen = (ground - origins[flexion, tibia]) @ rotations[flexion, tibia]
        depth = seen @ axes.down
        across = seen @ axes.lateral
        condyles = depth > depth.max() - CONDYLES * axes.length
        middle = 0.5 * (across[condyles].min() + across[condyles].max())
        medial += _deepest(seen, depth, condyles & (across < middle), axes.length)
        lateral += _deepest(seen, depth, condyles & (across >= middle), axes.length)
    return [medial / len(FLEXIONS), lateral / len(FLEXIONS)]


def _deepest(places: Array, depth: Array, region: NDArray[np.bool_], length: float) -> Array:
    """Mean of the deepest places of a region, the deeper the more.

    Parameters
    ----------
    places, depth : (vertices, 3) and (vertices,) [m]
    region : (vertices,)
    length : of the thigh [m]

    Returns
    -------
    (3,) [m]
    """
    weights = np.maximum(depth[region] - depth[region].max() + LOWEST * length, 0.0)
    return weights @ places[region] / weights.sum()
