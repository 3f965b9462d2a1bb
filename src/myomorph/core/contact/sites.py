"""Contact sites by the bodies' names: corners of every sole, hands, seat and back."""

from __future__ import annotations

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace

import numpy as np

from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.contacts import Cone, Site
from myomorph.core.model.errors import BadData, check_name
from myomorph.core.model.model import Body, Model
from myomorph.core.model.segments import segments_of
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface, body_meshes, joined_surfaces
from myomorph.core.rigid.kinematics import standing_poses

OUTLINE = {
    "heel_medial": (0.00, -0.14),
    "heel_lateral": (0.00, 0.14),
    "ball_medial": (1.10, -0.22),
    "ball_lateral": (0.88, 0.32),
    "toe_medial": (1.42, -0.16),
    "toe_lateral": (1.30, 0.26),
}
"""Corners of a sole: along it from the heel, and outwards, over the distance from the heel to the
toes' joint.

Heads of the first and fifth metatarsal, tips of the great and of the fourth toe; after the bones
that models draw.
"""

HEEL = (r"calc|heel", r"(?<!fore)(?<!mid)foot")
"""Names of a heel's body, the surest first."""
BONE_DEPTH = 0.06
"""Depth of the bones of a foot below its origin, over the same distance."""
FOOT_SPREAD = 0.254
"""Root mean square distance of a foot's mass along it from its center, over the foot's length.

From radii of gyration of women and men (de Leva 1996, table 4), their mean.
"""
FOOT_CENTER = (0.42, 0.12)
"""Mass center of a foot ahead of the heel, and above the heel's origin, over the foot's length.

Ahead: the mean of women and men (de Leva 1996, table 4). Above: of the models by Rajagopal and
Delp, calcaneus and toes together, where the origin is 0.04 lengths above the lowest bone.
"""
JOINT_OF_TOES = 0.70
"""Toes' joint ahead of the heel, over the foot's length."""
FOOT_LENGTHS = (1.5, 10.0)
"""Lengths of a foot that are believed, over the distance from its body's origin to its mass
center: 2.4 where the origin is at the heel, 5 where it is at the ankle."""
SEGMENT_SITES = ("hand_r", "hand_l", "seat", "back")
"""Names that `body_sites` knows."""
MAX_SNAP = np.radians(20.0)
"""Angle between a direction and an axis of a body up to which the axis is taken [rad]."""


@dataclass(frozen=True)
class FootOptions:
    """Options of the sites under a foot.

    Attributes
    ----------
    sole : from the lowest bone to the floor: the heel's pad, and a shoe's sole [m]
    cone : which forces a site takes; its direction is the model's up
    """

    sole: float = 0.02
    cone: Cone = field(default_factory=Cone)


@read_only
class Foot:
    """One foot of a model in its default posture.

    Attributes
    ----------
    name : of the group of its sites, as "foot_r"
    heel, toes : bodies; the same one where the foot has no joint between
    axes : (3, 3) columns forwards, up and outwards, in ground
    origin : (3,) under which the heel stands, in ground [m]
    length : from the heel to the toes' joint [m]
    """

    name: str
    heel: str
    toes: str
    axes: Array
    origin: Array
    length: float


def foot_sites(
    model: Model, surfaces: Mapping[str, Surface] | None = None, options: FootOptions | None = None
) -> tuple[Site, ...]:
    """Make six sites at the corners of every sole: heel, ball and toes, in the foot's group.

    Names are `heel_medial_r`, `ball_lateral_l`, ...; groups are `foot_r` and `foot_l`. Where they
    lie comes from the bones' meshes where they are given, else from the joint of the toes, or from
    how the mass of a foot of one body is spread, in the model's default posture. How thick a sole
    is no model has: `rest_on_floor` fits that to a motion.

    Parameters
    ----------
    model : of a body with feet
    surfaces : meshes by the name the model gives them, as `read_surfaces` finds them
    options : thickness of the sole [m] and the cone of forces; see `FootOptions`

    Returns
    -------
    six sites per foot, points on their bodies [m]

    Raises
    ------
    BadData : the model has no foot that is found by its bodies' names

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> still = mm.model.Transform.identity()
    >>> ahead = mm.model.Transform(np.eye(3), np.array([0.18, 0.0, 0.0]))
    >>> inertia = 0.01 * np.eye(3)
    >>> names = ("calcn_r", "toes_r")
    >>> bodies = [mm.model.Body(name, 1.0, np.zeros(3), inertia) for name in names]
    >>> ankle = mm.model.Joint("ankle_r", "WeldJoint", "ground", "calcn_r", still, still)
    >>> toes = mm.model.Joint("mtp_r", "WeldJoint", "calcn_r", "toes_r", ahead, still)
    >>> model = mm.Model("foot", tuple(bodies), (ankle, toes), (), [0.0, -9.80665, 0.0])
    >>> [site.name for site in mm.contact.foot_sites(model)]
    ['heel_medial_r', 'heel_lateral_r', 'ball_medial_r', 'ball_lateral_r', 'toe_medial_r',
    'toe_lateral_r']
    """
    options = options or FootOptions()
    cone = replace(options.cone, direction=model.up)
    poses = standing_poses(model)
    sites = []
    for foot in feet_of(model):
        part = foot.name[:-6]
        side = foot.name[-2:]
        for label, point in _corners(model, foot, surfaces or {}, options).items():
            body = foot.toes if label.startswith("toe") else foot.heel
            local = poses[body].inverse().apply(point)
            sites.append(
                Site(
                    name=f"{part}{label}{side}",
                    body=body,
                    points=local[None],
                    cone=cone,
                    group=foot.name,
                )
            )
    return tuple(sites)


def feet_of(model: Model) -> tuple[Foot, ...]:
    """Find feet by the bodies' names, right before left.

    A foot's down is the floor's in the default posture; where that is within 20 degrees of an axis
    of the heel's body, it is that axis, as models draw feet flat on the ground of their own frame.
    In a joined model the feet of each part are named with what stands before its heel's name:
    `tori_foot_r`.

    Raises
    ------
    BadData : no foot is found
    """
    segments = segments_of(model)
    poses = standing_poses(model)
    by_name: dict[str, Foot] = {}
    for side, ending in (("right", "_r"), ("left", "_l")):
        bodies = [
            body
            for body in model.bodies
            if segments[body.name].name == "foot" and segments[body.name].side == side
        ]
        outwards = 1.0 if side == "right" else -1.0
        for part, heel in _heels(bodies).items():
            toes = [
                body for body in bodies if body.name.startswith(part) and "toe" in body.name.lower()
            ]
            name = f"{part}foot{ending}"
            by_name[name] = _foot(model, name, heel, toes, poses, outwards)
    if not by_name:
        raise BadData(
            f"no foot of model '{model.name}' is found by its bodies' names (calcn, heel, foot,"
            " toes, and a side): name contact sites and their points yourself"
        )
    return tuple(by_name.values())


def _heels(bodies: Sequence[Body]) -> dict[str, Body]:
    """Find the heel among the bodies of a foot, by what stands before its name."""
    heels: dict[str, Body] = {}
    for pattern in HEEL:
        for body in bodies:
            match = re.search(pattern, body.name, re.IGNORECASE)
            if match is not None:
                heels.setdefault(body.name[: match.start()], body)
    return heels


def _foot(
    model: Model,
    name: str,
    heel: Body,
    bodies: Sequence[Body],
    poses: dict[str, Transform],
    outwards: float,
) -> Foot:
    """Make a foot of a heel and the first of some bodies of toes, which may be none."""
    pose = poses[heel.name]
    up = _snapped(pose.rotation, model.up)
    if bodies:
        ahead = poses[bodies[0].name].translation - pose.translation
    else:
        ahead = pose.rotation @ heel.mass_center
    ahead = ahead - (ahead @ up) * up
    length = float(np.linalg.norm(ahead))
    if length <= 0.0:
        raise BadData(
            f"body '{heel.name}' has no toes and no mass center ahead of its origin: name its sites"
            " yourself"
        )
    forward = _snapped(pose.rotation, ahead / length)
    origin = pose.translation
    if not bodies:
        origin, length = _heel_of_one_body(heel, pose, forward, up)
    return Foot(
        name=name,
        heel=heel.name,
        toes=(*bodies, heel)[0].name,
        axes=np.stack([forward, up, outwards * np.cross(forward, up)], axis=1),
        origin=origin,
        length=length,
    )


def _heel_of_one_body(
    foot: Body, pose: Transform, forward: Array, up: Array
) -> tuple[Array, float]:
    """Find heel and toes' joint of a foot of one body, whose origin may be at heel or ankle.

    How long it is follows from how its mass is spread, which does not depend on the origin. Where
    that cannot be (a body of a made-up inertia), the origin is taken for the heel.

    Parameters
    ----------
    foot : the body
    pose : of it in ground, default posture
    forward, up : (3,) in ground

    Returns
    -------
    under what the heel stands, (3,) in ground [m], and the distance to the toes' joint [m]
    """
    center = pose.apply(foot.mass_center)
    ahead = float((center - pose.translation) @ forward)
    spread = 0.5 * np.trace(foot.inertia) * np.eye(3) - foot.inertia
    along = pose.rotation.T @ forward
    variance = float(along @ spread @ along) / foot.mass if foot.mass > 0.0 else 0.0
    whole = np.sqrt(max(variance, 0.0)) / FOOT_SPREAD
    least, most = FOOT_LENGTHS
    if not least * ahead <= whole <= most * ahead:
        return pose.translation, JOINT_OF_TOES * ahead / FOOT_CENTER[0]
    heel = center - whole * (FOOT_CENTER[0] * forward + FOOT_CENTER[1] * up)
    return heel, JOINT_OF_TOES * whole


def _snapped(rotation: Array, direction: Array) -> Array:
    """Take the axis of a body that lies within 20 degrees of a direction, or the direction itself.

    Parameters
    ----------
    rotation : (3, 3) of the body
    direction : (3,) in ground

    Returns
    -------
    (3,) in ground
    """
    along = rotation.T @ direction
    index = int(np.argmax(np.abs(along)))
    if abs(along[index]) > np.cos(MAX_SNAP):
        return np.sign(along[index]) * rotation[:, index]
    return direction


def _corners(
    model: Model, foot: Foot, surfaces: Mapping[str, Surface], options: FootOptions
) -> dict[str, Array]:
    """Corners of a sole in ground, in the default posture, by label.

    Returns
    -------
    (3,) each [m]
    """
    outline = {label: np.array(corners) * foot.length for label, corners in OUTLINE.items()}
    depth = BONE_DEPTH * foot.length
    bones = {
        name: _vertices(model.body(name), surfaces, foot, standing_poses(model))
        for name in (foot.heel, foot.toes)
    }
    known = [bone for bone in bones.values() if len(bone)]
    if len(known) == len(bones) and known:
        outline = _outline_of(np.concatenate(known), foot.length)
        depth = -float(min(value[:, 1].min() for value in known))
    forward, up, out = foot.axes.T
    low = foot.origin - (depth + options.sole) * up
    return {label: low + x * forward + z * out for label, (x, z) in outline.items()}


def _vertices(
    body: Body, surfaces: Mapping[str, Surface], foot: Foot, poses: dict[str, Transform]
) -> Array:
    """Vertices of a body's meshes along the foot's axes.

    Returns
    -------
    (vertices, 3) from the foot's origin [m]
    """
    meshes = body_meshes(body, surfaces)
    if not meshes:
        return np.zeros((0, 3))
    return (poses[body.name].apply(joined_surfaces(meshes).vertices) - foot.origin) @ foot.axes


def _outline_of(vertices: Array, length: float) -> dict[str, Array]:
    """Corners of the bones of a foot: of its rear, at the ball, and of the foremost part.

    Parameters
    ----------
    vertices : (vertices, 3) along the foot's axes [m]
    length : of the foot [m]

    Returns
    -------
    (2,) each, along the foot and outwards [m]
    """
    x = vertices[:, 0]
    z = vertices[:, 2]
    back = float(x.min())
    tip = float(x.max())
    heel = x < back + 0.2 * length
    middle = 0.5 * (z[heel].min() + z[heel].max())
    half = 0.35 * np.ptp(z[heel])
    ball = (x > 0.8 * length) & (x < 1.2 * length)
    toes = x > length + 0.5 * (tip - length)
    inner = float(z[ball].min())
    outer = float(z[ball].max())
    great = float(z[toes].min())
    return {
        "heel_medial": np.array([back, middle - half]),
        "heel_lateral": np.array([back, middle + half]),
        "ball_medial": np.array([OUTLINE["ball_medial"][0] * length, inner]),
        "ball_lateral": np.array([OUTLINE["ball_lateral"][0] * length, outer]),
        "toe_medial": np.array([tip, great]),
        "toe_lateral": np.array([tip - 0.12 * length, outer]),
    }


def body_sites(model: Model, names: Sequence[str]) -> tuple[Site, ...]:
    """Make sites by name: `hand_r`, `hand_l`, `seat` and `back`.

    Hands are grips that take force any way, seat and back are patches. A hand's site is its body's
    mass center. The seat is four points about the ischial tuberosities, placed from the hip joints;
    the back, four points behind the thorax' mass center. Both are pushed along the body's own axes,
    up and forwards in the default posture.

    Parameters
    ----------
    model : of a human body
    names : of the sites

    Returns
    -------
    the sites in that order, points on their bodies [m]

    Raises
    ------
    UnknownName : a name that is none of these
    BadData : the model has no such part

    Examples
    --------
    >>> import numpy as np
    >>> import myomorph as mm
    >>> body = mm.model.Body("hand_r", 0.5, np.array([0.0, -0.05, 0.0]), 0.001 * np.eye(3))
    >>> still = mm.model.Transform.identity()
    >>> wrist = mm.model.Joint("wrist", "WeldJoint", "ground", "hand_r", still, still)
    >>> model = mm.Model("hand", (body,), (wrist,), (), [0.0, -9.80665, 0.0])
    >>> (hand,) = mm.contact.body_sites(model, ["hand_r"])
    >>> hand.body, hand.points.tolist()
    ('hand_r', [[0.0, -0.05, 0.0]])
    """
    sites = []
    for name in names:
        check_name("contact site", name, SEGMENT_SITES, "body_sites")
        if name == "seat":
            sites.append(_seat(model))
        elif name == "back":
            sites.append(_back(model))
        else:
            sites.append(_hand(model, name))
    return tuple(sites)


def _hand(model: Model, name: str) -> Site:
    """Site at the mass center of a hand, a grip."""
    side = {"r": "right", "l": "left"}.get(name[-1], "")
    segments = segments_of(model)
    bodies = [
        body
        for body in model.bodies
        if segments[body.name].name == "hand" and segments[body.name].side == side
    ]
    if not bodies:
        raise BadData(
            f"model '{model.name}' has no {side} hand for site '{name}': name a body and a point"
            " yourself"
        )
    body = max(bodies, key=lambda body: body.mass)
    return Site(
        name=name,
        body=body.name,
        points=body.mass_center[None],
        cone=Cone(direction=None, grip=0.05),
    )


def _seat(model: Model) -> Site:
    """Four points about the ischial tuberosities, placed from the hip joints."""
    poses = standing_poses(model)
    up = model.up
    segments = segments_of(model)
    hips = {
        segments[joint.child].side: (joint.parent, poses[joint.child].translation)
        for joint in model.joints
        if segments[joint.child].name == "thigh"
        and segments.get(joint.parent)
        and segments[joint.parent].name != "thigh"
    }
    body, right = hips.get("right", ("", np.zeros(3)))
    _, left = hips.get("left", ("", np.zeros(3)))
    out = right - left
    width = float(np.linalg.norm(out))
    # Models of animals may have both hips in one point.
    if set(hips) != {"right", "left"} or width <= 0.0:
        raise BadData(
            f"model '{model.name}' has no two hips to find its seat from: name a body and points"
            " yourself"
        )
    out = out / width
    forward = np.cross(up, out)
    middle = 0.5 * (right + left) - 0.45 * width * up - 0.1 * width * forward
    points = np.array(
        [middle + width * (0.35 * s * out + 0.15 * t * forward) for s in (1, -1) for t in (1, -1)]
    )
    pose = poses[body]
    return Site(
        name="seat", body=body, points=pose.inverse().apply(points), cone=Cone(direction=up)
    )


def _back(model: Model) -> Site:
    """Four points behind the mass center of the thorax."""
    segments = segments_of(model)
    poses = standing_poses(model)
    up = model.up
    bodies = [body for body in model.bodies if segments[body.name].name == "upper_trunk"]
    if not bodies:
        raise BadData(
            f"model '{model.name}' has no thorax for site 'back': name a body and points yourself"
        )
    body = max(bodies, key=lambda body: body.mass)
    foot = feet_of(model)[0]
    forward = foot.axes[:, 0] - (foot.axes[:, 0] @ up) * up
    forward = forward / np.linalg.norm(forward)
    out = np.cross(forward, up)
    pose = poses[body.name]
    middle = pose.apply(body.mass_center) - 0.1 * forward
    points = np.array([middle + 0.12 * s * out + 0.12 * t * up for s in (1, -1) for t in (1, -1)])
    return Site(
        name="back",
        body=body.name,
        points=pose.inverse().apply(points),
        cone=Cone(pose.rotation.T @ forward, body.name),
    )
