"""A model of a person's body: its segments as bodies, joined where the skeleton of the skin bends.

Coordinates have the names and signs of the common OpenSim models of the whole body; all are 0 where
a person stands upright with arms and legs straight down. The default pose is that of the skin.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import NamedTuple

import numpy as np
import scipy

from myomorph.body.shape.body_segments import SegmentMass, skin_owners
from myomorph.body.shape.shape import LEGS_APART, RIGHT, Shape
from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import linear
from myomorph.core.model.model import (
    GROUND,
    STANDARD_GRAVITY,
    Axis,
    Body,
    Coordinate,
    Joint,
    Marker,
    Mesh,
    Model,
)
from myomorph.core.model.segments import Segment
from myomorph.core.model.spatial import Transform, axis_rotation
from myomorph.core.model.surface import Surface

FORWARD = np.eye(3)[0]


class Place(NamedTuple):
    """What a marker is called, without the side, and the segment that it lies on."""

    marker: str
    segment: str


MARKERS: Mapping[str, Place] = FrozenMap(
    {
        "C7": Place("C7", "upper_trunk"),
        "sternum": Place("Sternum", "upper_trunk"),
        "head top": Place("Top.Head", "head"),
        "ASIS": Place("ASIS", "lower_trunk"),
        "PSIS": Place("PSIS", "lower_trunk"),
        "acromion": Place("Acromion", "upper_trunk"),
        "lateral elbow": Place("Elbow.Lateral", "upper_arm"),
        "medial elbow": Place("Elbow.Medial", "upper_arm"),
        "lateral knee": Place("Knee.Lateral", "thigh"),
        "medial knee": Place("Knee.Medial", "thigh"),
        "lateral ankle": Place("Ankle.Lateral", "shank"),
        "medial ankle": Place("Ankle.Medial", "shank"),
        "heel": Place("Heel", "foot"),
        "toe tip": Place("Toe.Tip", "foot"),
    }
)
"""By the shape's landmarks, without the side."""


class Turn(NamedTuple):
    """A rotation of a joint.

    Attributes
    ----------
    coordinate : its name without the side
    axis : x, y or z as 0, 1 or 2
    sign : of the right side; about x and y the left one's is the other
    range : of the coordinate [degrees]
    """

    coordinate: str
    axis: int
    sign: int
    range: tuple[float, float]


class Link(NamedTuple):
    """A segment as a body, and its joint.

    Attributes
    ----------
    body : name without the side
    parent : name without the side
    joint : name without the side
    center : joint center of the shape, without the side
    turns : three of them in the order z, x, y, or one or two
    """

    body: str
    parent: str
    joint: str
    center: str
    turns: tuple[Turn, ...]


X = 0
Y = 1
Z = 2
ROOT = (
    Turn(coordinate="pelvis_tilt", axis=Z, sign=1, range=(-90.0, 90.0)),
    Turn(coordinate="pelvis_list", axis=X, sign=1, range=(-90.0, 90.0)),
    Turn(coordinate="pelvis_rotation", axis=Y, sign=1, range=(-180.0, 180.0)),
)
SLIDES = ("pelvis_tx", "pelvis_ty", "pelvis_tz")
LINKS: Mapping[str, Link] = FrozenMap(
    {
        "upper_trunk": Link(
            body="torso",
            parent="lower_trunk",
            joint="back",
            center="lumbar",
            turns=(
                Turn(coordinate="lumbar_extension", axis=Z, sign=1, range=(-90.0, 45.0)),
                Turn(coordinate="lumbar_bending", axis=X, sign=1, range=(-45.0, 45.0)),
                Turn(coordinate="lumbar_rotation", axis=Y, sign=1, range=(-60.0, 60.0)),
            ),
        ),
        "head": Link(
            body="head",
            parent="upper_trunk",
            joint="neck",
            center="neck",
            turns=(
                Turn(coordinate="neck_extension", axis=Z, sign=1, range=(-70.0, 70.0)),
                Turn(coordinate="neck_bending", axis=X, sign=1, range=(-45.0, 45.0)),
                Turn(coordinate="neck_rotation", axis=Y, sign=1, range=(-85.0, 85.0)),
            ),
        ),
        "thigh": Link(
            body="femur",
            parent="lower_trunk",
            joint="hip",
            center="hip",
            turns=(
                Turn(coordinate="hip_flexion", axis=Z, sign=1, range=(-40.0, 140.0)),
                Turn(coordinate="hip_adduction", axis=X, sign=1, range=(-60.0, 45.0)),
                Turn(coordinate="hip_rotation", axis=Y, sign=1, range=(-60.0, 60.0)),
            ),
        ),
        "shank": Link(
            body="tibia",
            parent="thigh",
            joint="knee",
            center="knee",
            turns=(Turn(coordinate="knee_angle", axis=Z, sign=-1, range=(-10.0, 150.0)),),
        ),
        "foot": Link(
            body="calcn",
            parent="shank",
            joint="ankle",
            center="ankle",
            turns=(
                Turn(coordinate="ankle_angle", axis=Z, sign=1, range=(-60.0, 40.0)),
                Turn(coordinate="subtalar_angle", axis=X, sign=1, range=(-40.0, 40.0)),
            ),
        ),
        "upper_arm": Link(
            body="humerus",
            parent="upper_trunk",
            joint="acromial",
            center="shoulder",
            turns=(
                Turn(coordinate="arm_flex", axis=Z, sign=1, range=(-90.0, 180.0)),
                Turn(coordinate="arm_add", axis=X, sign=1, range=(-180.0, 90.0)),
                Turn(coordinate="arm_rot", axis=Y, sign=1, range=(-120.0, 120.0)),
            ),
        ),
        "lower_arm": Link(
            body="forearm",
            parent="upper_arm",
            joint="elbow",
            center="elbow",
            turns=(
                Turn(coordinate="elbow_flex", axis=Z, sign=1, range=(-10.0, 150.0)),
                Turn(coordinate="pro_sup", axis=Y, sign=1, range=(-90.0, 90.0)),
            ),
        ),
        "hand": Link(
            body="hand",
            parent="lower_arm",
            joint="wrist",
            center="wrist",
            turns=(
                Turn(coordinate="wrist_dev", axis=Z, sign=-1, range=(-30.0, 45.0)),
                Turn(coordinate="wrist_flex", axis=X, sign=1, range=(-80.0, 80.0)),
            ),
        ),
    }
)
"""By the segments of the shape. Pronation and the wrist are 0 as the skin holds them: palms in."""


def body_model(shape: Shape, segments: Sequence[SegmentMass], name: str = "body") -> Model:
    """Build a model of a body whose segments were weighed.

    Frames of bodies lie at joint centers, y along the limb upwards and z to the right; an elbow's
    z is its axis. A joint with fewer than three rotations leaves the rest of the skin's pose to
    its frame, so that mass centers and inertias in the default pose are those of the segments.

    Parameters
    ----------
    shape : of the person
    segments : its masses, of `segment_masses`
    name : of the model

    Returns
    -------
    bodies, joints and markers; each body draws `mesh_name` of its segment
    """
    frames = segment_frames(shape)
    order = sorted(segments, key=lambda part: _depth(part.segment))
    bodies = [_body(part, frames[part.segment], name) for part in order]
    joints = [_root(frames[order[0].segment])]
    coordinates = _root_coordinates(frames[order[0].segment])
    for part in order[1:]:
        joint, own = _joint(part.segment, frames)
        joints.append(joint)
        coordinates += own
    return Model(
        name=name,
        bodies=tuple(bodies),
        joints=tuple(joints),
        coordinates=tuple(coordinates),
        gravity=np.array([0.0, -STANDARD_GRAVITY, 0.0]),
        markers=_markers(shape, frames),
    )


def body_name(segment: Segment) -> str:
    """Return the name of a segment's body: "femur_r", "torso"."""
    if segment.name == "lower_trunk":
        return "pelvis"
    return _sided(LINKS[segment.name].body, segment.side)


def mesh_name(name: str, segment: Segment) -> str:
    """Return the name of the file that draws a segment's body in the model of a name."""
    return f"{name}_{body_name(segment)}.obj"


def segment_skins(shape: Shape) -> dict[Segment, Surface]:
    """Cut the skin into the surfaces of segments, in the frames of their bodies.

    Parameters
    ----------
    shape : of the person

    Returns
    -------
    surface by segment [m], open where segments meet
    """
    frames = segment_frames(shape)
    owners = skin_owners(shape)
    surface = shape.skin.surface
    result = {}
    for i, segment in enumerate(shape.segments):
        faces = surface.faces[owners[surface.faces[:, 0]] == i]
        used, compact = np.unique(faces, return_inverse=True)
        into = frames[segment].inverse()
        places = surface.vertices[used] @ into.rotation.T + into.translation
        result[segment] = Surface(places, compact.reshape(-1, 3))
    return result


def segment_frames(shape: Shape) -> dict[Segment, Transform]:
    """Lay a frame into every segment of the standing skin.

    Parameters
    ----------
    shape : with joint centers

    Returns
    -------
    pose of the frame in ground by segment [m]
    """
    upright = np.eye(3)
    result = {
        Segment("lower_trunk"): Transform(upright, shape.centers["pelvis"]),
        Segment("upper_trunk"): Transform(upright, shape.centers["lumbar"]),
        Segment("head"): Transform(upright, shape.centers["neck"]),
    }
    for side, out in (("right", 1.0), ("left", -1.0)):
        place = {
            name: shape.centers[f"{side} {name}"]
            for name in ("hip", "knee", "ankle", "shoulder", "elbow", "wrist")
        }
        upper = _unit(place["shoulder"] - place["elbow"])
        lower = _unit(place["elbow"] - place["wrist"])
        hinge = np.cross(upper, lower)
        forearm = _frame(lower, hinge)
        turns = {
            "thigh": _frame(place["hip"] - place["knee"], RIGHT),
            "shank": _frame(place["knee"] - place["ankle"], RIGHT),
            "foot": axis_rotation(FORWARD, -out * LEGS_APART),
            "upper_arm": _frame(upper, hinge),
            "lower_arm": forearm,
            "hand": forearm,
        }
        for name, rotation in turns.items():
            center = place[LINKS[name].center]
            result[Segment(name, side)] = Transform(rotation, center)
    return result


def _frame(along: Array, right: Array) -> Array:
    """Lay axes (3, 3) as columns: y along a vector, z as near to `right` as that allows."""
    y = _unit(along)
    z = _unit(right - (right @ y) * y)
    return np.stack([np.cross(y, z), y, z], axis=1)


def _unit(vector: Array) -> Array:
    """Scale a vector (3,) to length 1."""
    return np.asarray(vector / np.linalg.norm(vector))


def _sided(name: str, side: str) -> str:
    """Add the side to a name."""
    return f"{name}_{side[0]}" if side else name


def _parent(segment: Segment) -> Segment:
    """Return the segment that another hangs from."""
    parent = LINKS[segment.name].parent
    return Segment(parent, "" if "trunk" in parent else segment.side)


def _depth(segment: Segment) -> int:
    """Count the joints between a segment and the pelvis."""
    return 0 if segment.name == "lower_trunk" else 1 + _depth(_parent(segment))


def _body(part: SegmentMass, frame: Transform, name: str) -> Body:
    """Bring a segment's mass center and inertia [m, kg m^2] into the frame of its body."""
    into = frame.inverse()
    mesh = Mesh(file=mesh_name(name, part.segment), pose=Transform.identity(), scale=np.ones(3))
    return Body(
        name=body_name(part.segment),
        mass=part.mass,
        mass_center=into.rotation @ part.center + into.translation,
        inertia=into.rotation @ part.inertia @ into.rotation.T,
        meshes=(mesh,),
    )


def _root(frame: Transform) -> Joint:
    """Let the pelvis move freely, its translations measured from the ground."""
    slides = [
        Axis(kind="translation", vector=np.eye(3)[i], function=linear(1.0), coordinates=(name,))
        for i, name in enumerate(SLIDES)
    ]
    turns = [_axis(turn, turn.coordinate, 1) for turn in ROOT]
    return Joint(
        name="ground_pelvis",
        kind="CustomJoint",
        parent=GROUND,
        child="pelvis",
        parent_frame=Transform.identity(),
        child_frame=Transform(frame.rotation, np.zeros(3)),
        axes=(*slides, *turns),
        coordinates=(*(turn.coordinate for turn in ROOT), *SLIDES),
    )


def _root_coordinates(frame: Transform) -> list[Coordinate]:
    """Make the six coordinates of the pelvis, standing where the skin stands."""
    turns = [_coordinate(turn, turn.coordinate, 0.0) for turn in ROOT]
    slides = [
        Coordinate(
            name=name,
            motion="translational",
            default=float(frame.translation[i]),
            range=(-50.0, 50.0),
        )
        for i, name in enumerate(SLIDES)
    ]
    return [*turns, *slides]


def _joint(segment: Segment, frames: Mapping[Segment, Transform]) -> tuple[Joint, list[Coordinate]]:
    """Join a segment to the one that it hangs from."""
    link = LINKS[segment.name]
    parent = _parent(segment)
    between = frames[parent].inverse() @ frames[segment]
    signs = [_sign(turn, segment.side) for turn in link.turns]
    names = [_sided(turn.coordinate, segment.side) for turn in link.turns]
    angles = _angles(between.rotation, link.turns, signs)
    axes = [
        _axis(turn, name, sign) for turn, name, sign in zip(link.turns, names, signs, strict=True)
    ]
    made = np.eye(3)
    for axis, angle in zip(axes, angles, strict=True):
        made = made @ axis_rotation(axis.vector, angle)
    joint = Joint(
        name=_sided(link.joint, segment.side),
        kind="CustomJoint",
        parent=body_name(parent),
        child=body_name(segment),
        parent_frame=Transform(between.rotation @ made.T, between.translation),
        child_frame=Transform.identity(),
        axes=tuple(axes),
        coordinates=tuple(names),
    )
    own = [
        _coordinate(turn, name, angle)
        for turn, name, angle in zip(link.turns, names, angles, strict=True)
    ]
    return joint, own


def _angles(rotation: Array, turns: Sequence[Turn], signs: Sequence[int]) -> list[float]:
    """Read the angles of a pose: about z, x and y in turn, of those that the joint has [rad]."""
    zxy = scipy.spatial.transform.Rotation.from_matrix(rotation).as_euler("ZXY")
    by_axis = dict(zip((Z, X, Y), zxy.tolist(), strict=True))
    return [sign * by_axis[turn.axis] for turn, sign in zip(turns, signs, strict=True)]


def _sign(turn: Turn, side: str) -> int:
    """Mirror a rotation about x or y for the left side."""
    return -turn.sign if side == "left" and turn.axis != Z else turn.sign


def _axis(turn: Turn, name: str, sign: int) -> Axis:
    """Make the axis of a rotation."""
    return Axis(
        kind="rotation",
        vector=sign * np.eye(3)[turn.axis],
        function=linear(1.0),
        coordinates=(name,),
    )


def _coordinate(turn: Turn, name: str, default: float) -> Coordinate:
    """Make the coordinate of a rotation, its range wide enough for the skin's pose [rad]."""
    low, high = np.radians(turn.range)
    return Coordinate(
        name=name,
        motion="rotational",
        default=default,
        range=(min(float(low), default), max(float(high), default)),
    )


def _markers(shape: Shape, frames: Mapping[Segment, Transform]) -> tuple[Marker, ...]:
    """Put a marker on each landmark."""
    result = []
    for landmark, point in shape.landmarks.items():
        side, _, rest = landmark.partition(" ")
        sided = side in ("right", "left")
        place = MARKERS[rest if sided else landmark]
        limb = sided and "trunk" not in place.segment
        segment = Segment(place.segment, side if limb else "")
        into = frames[segment].inverse()
        result.append(
            Marker(
                name=f"{side[0].upper()}.{place.marker}" if sided else place.marker,
                body=body_name(segment),
                location=into.rotation @ point + into.translation,
            )
        )
    return tuple(result)
