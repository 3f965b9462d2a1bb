"""The generic model: myo-sim's legs and trunk, with markers placed by landmark."""

from __future__ import annotations

import tomllib
from collections.abc import Collection, Mapping
from dataclasses import replace
from functools import cache
from importlib.resources import files

import numpy as np

from myomorph.core.model.arrays import Array
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.functions import linear
from myomorph.core.model.join import renamed_model
from myomorph.core.model.model import GROUND, Axis, Coordinate, Joint, Marker, Model
from myomorph.core.model.paths import Muscle, PathWrap, TendonWrap, WrapObject
from myomorph.core.model.scale import scale
from myomorph.core.model.sides import split_side
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.protocols import Site
from myomorph.core.muscles.kinematics import default_path_lengths
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.lab.analyze.anatomy import (
    HEIGHT,
    strength_of,
    with_abductors,
    with_anatomical_knees,
    with_architecture,
    with_cylinders,
    with_strength,
)
from myomorph.lab.analyze.arms import arms_alone, with_arms

NAME = "myolegs_abdomen"
COORDINATES = {
    "flex_extension": "lumbar_extension",
    "lat_bending": "lumbar_bending",
    "axial_rotation": "lumbar_rotation",
}
"""Those of the trunk as Rajagopal's model names them; their axes and signs are the same."""
JOINTS = {
    "lumbar5": "back",
    "femur": "hip",
    "tibia": "knee",
    "patella": "patellofemoral",
    "ankle_angle": "ankle",
    "subtalar_angle": "subtalar",
    "mtp_angle": "mtp",
}
"""Joints, which MuJoCo has no names for, by the body or coordinate that they are called after,
without the side.
"""
# Bodies of either side.
SIDED = (
    "femur",
    "patella",
    "tibia",
    "talus",
    "calcn",
    "scapula",
    "humerus",
    "ulna",
    "radius",
    "lunate",
)
LOCKED = ("mtp_angle_r", "mtp_angle_l")
FURTHER = 30.0
HYPEREXTENSION = 10.0
"""Of elbows beyond straight, three standard deviations of people (Boone and Azen 1979) [degrees].
Further on, an arm that is taken the wrong way round would fit, its elbow bent backwards.
"""
BEYOND: Mapping[str, tuple[float, float]] = FrozenMap(
    {
        f"{name}_{side}": (below, FURTHER)
        for name, below in (
            ("ankle_angle", FURTHER),
            ("subtalar_angle", FURTHER),
            ("hip_rotation", FURTHER),
            ("elbow_flexion", HYPEREXTENSION),
            ("deviation", FURTHER),
            ("flexion", FURTHER),
        )
        for side in "rl"
    }
)
"""People go beyond the model's ranges of these, by so much at most, below and above [degrees]:
free, ankle and subtalar joint turn over.
"""

LONG = 1.0  # Length of a cylinder that MuJoCo has without an end [m].
MUSCLE = "Millard2012EquilibriumMuscle"


def generic_model(
    sites: Mapping[str, Site],
    height: float | None = None,
    mass: float | None = None,
    arms: bool = False,
    alone: bool = False,
) -> tuple[Model, tuple[str, ...]]:
    """Give the legs and trunk of myo-sim a marker for every label that lies on one of their bones.

    Fibers, tendons and strengths of the muscles are anatomists' (`anatomy`), not those of myo-sim.

    Parameters
    ----------
    sites : label of a recording, and what it lies on
    height : of the body that its segments are those of [m], all stretched alike; None for 1.70
    mass : of the body that its muscles are as strong as [kg]; None for 75
    arms : with both arms
    alone : only those arms move that have markers, and the trunk; legs hang from it

    Returns
    -------
    the model, and labels that have no place on it (of arms and head)

    Raises
    ------
    BadData : myo-sim is not installed
    """
    markers, without = placed(sites, arms)
    model = _generic(arms)
    if alone:
        segments = {(site.side, site.segment) for site in sites.values()}
        sides = [side for side in ("right", "left") if (side, "upper_arm") in segments]
        model = arms_alone(model, sides, spine=any(segment == "pelvis" for _, segment in segments))
    model = model.with_markers(markers)
    if height is not None:
        factor = np.full(3, height / HEIGHT)
        model = scale(
            model,
            dict.fromkeys(model.body_names, factor),
            model.mass,
            path_lengths=default_path_lengths,
        )
    if mass is not None:
        model = with_strength(model, strength_of(mass, height or HEIGHT))
    return model, without


def placed(
    sites: Mapping[str, Site], arms: bool = False
) -> tuple[tuple[Marker, ...], tuple[str, ...]]:
    """Markers on the generic model's bones, and labels that have no place on them."""
    table = _places("legs") | (_places("arms") if arms else {})
    markers = []
    without = []
    for label, site in sites.items():
        if site.key not in table:
            without.append(label)
            continue
        body, place = table[site.key]
        if body in SIDED:
            body = f"{body}_{site.side[:1]}"
        side = np.array([1.0, 1.0, -1.0 if site.side == "left" else 1.0])
        markers.append(Marker(label, body, place * side))
    return tuple(markers), tuple(without)


@cache
def _places(table: str) -> dict[str, tuple[str, Array]]:
    """Body and place (3,) of every landmark of the right side, by `segment.key`."""
    raw = tomllib.loads(
        (files("myomorph.lab.analyze") / "data" / f"{table}.toml").read_text("utf-8")
    )
    return {
        f"{segment}.{key}": (str(one["body"]), np.array(one["place"], dtype=np.float64))
        for segment, own in raw.items()
        for key, one in own.items()
    }


@cache
def _generic(arms: bool) -> Model:
    model = with_arms(legs_and_trunk()) if arms else legs_and_trunk()
    model = with_architecture(with_cylinders(with_abductors(in_opensim_form(model))))
    dependent = model.dependent_coordinates
    coordinates = tuple(_held(coordinate, dependent) for coordinate in model.coordinates)
    return replace(model, coordinates=coordinates, kept=())


def _held(coordinate: Coordinate, dependent: Collection[str]) -> Coordinate:
    """Lock a coordinate, or give it the bounds that a recording needs."""
    if coordinate.name in LOCKED:
        return replace(coordinate, locked=True, default=0.0)
    # A bound of what follows a knee at the end of the knee's range is one that OpenSim cannot keep
    # to.
    if coordinate.name in dependent:
        return replace(coordinate, clamped=False)
    if coordinate.name in BEYOND:
        low, high = coordinate.range
        below, above = np.radians(BEYOND[coordinate.name])
        return replace(coordinate, range=(low - below, high + above), clamped=True)
    return coordinate


def legs_and_trunk() -> Model:
    """Model of myo-sim's legs (80 muscles) under a trunk that bends (6 muscles).

    In the ground x is forward, y up, z right. Joints and coordinates have the names of the field
    and of OpenSim's gait models (`knee_r`, `pelvis_tilt`); knees and patellae move as anatomists
    measured (`anatomy`).

    Raises
    ------
    BadData : myo-sim is not installed
    """
    from myomorph.core.io.mjcf.composed import composed_model

    model = renamed_model(composed_model(NAME), lambda name: COORDINATES.get(name, name))
    poses = standing_poses(model)
    root = model.joints[0]
    start = (poses[root.child].inverse() @ poses["pelvis"]).rotation
    joint, coordinates = _pelvis_joint(root.child, start)
    return with_anatomical_knees(
        replace(
            model,
            name="myolegs",
            joints=(
                joint,
                *(replace(other, name=_joint_name(other.name)) for other in model.joints[1:]),
            ),
            coordinates=(*coordinates, *model.coordinates[6:]),
            gravity=np.array([0.0, float(model.gravity[2]), 0.0]),
        )
    )


def _joint_name(name: str) -> str:
    stem, side = split_side(name)
    return JOINTS.get(stem, stem) + (f"_{side[0]}" if side else "")


def _pelvis_joint(child: str, start: Array) -> tuple[Joint, tuple[Coordinate, ...]]:
    x, y, z = np.eye(3)
    turns = (("pelvis_tilt", z), ("pelvis_list", x), ("pelvis_rotation", y))
    shifts = (("pelvis_tx", x), ("pelvis_ty", y), ("pelvis_tz", z))
    axes = [
        Axis(kind="translation", vector=vector, function=linear(1.0), coordinates=(name,))
        for name, vector in shifts
    ]
    axes += [
        Axis(kind="rotation", vector=vector, function=linear(1.0), coordinates=(name,))
        for name, vector in turns
    ]
    coordinates = [Coordinate(name, "rotational") for name, _ in turns]
    coordinates += [
        Coordinate(name, "translational", default=float(name == "pelvis_ty")) for name, _ in shifts
    ]
    names = tuple(coordinate.name for coordinate in coordinates)
    frame = Transform(start, np.zeros(3))
    joint = Joint(
        name="ground_pelvis",
        kind="CustomJoint",
        parent=GROUND,
        child=child,
        parent_frame=Transform.identity(),
        child_frame=frame,
        axes=tuple(axes),
        coordinates=names,
    )
    return joint, tuple(coordinates)


def in_opensim_form(model: Model) -> Model:
    """Make muscles Millard2012EquilibriumMuscle whose paths wrap as OpenSim's do.

    A tendon of MuJoCo goes around a surface on the side of a site. OpenSim's surfaces have a
    constrained half instead: each becomes one whose x axis points to the site, and whose positive
    half counts, once for every site that it is used with.
    """
    poses = standing_poses(model)
    objects = {item.name: item for item in model.wrap_objects}
    made: dict[str, WrapObject] = {}
    muscles = tuple(_muscle(muscle, objects, made, poses) for muscle in model.muscles)
    used = {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
    kept = tuple(item for item in model.wrap_objects if item.name in used and item.name not in made)
    return replace(model, muscles=muscles, wrap_objects=(*kept, *made.values()))


def _muscle(
    muscle: Muscle,
    objects: dict[str, WrapObject],
    made: dict[str, WrapObject],
    poses: dict[str, Transform],
) -> Muscle:
    wraps = []
    for wrap in muscle.path.wraps:
        if not isinstance(wrap, TendonWrap):
            return muscle
        own = objects[wrap.wrap_object]
        toward = None
        if wrap.side is not None:
            place = poses[own.body].inverse().apply(poses[wrap.side_body].apply(wrap.side))
            toward = place - own.pose.translation
        name = (
            own.name if wrap.side is None else f"{own.name}_{wrap.side_body}_{_digits(wrap.side)}"
        )
        made.setdefault(name, _sided(own, name, toward))
        wraps.append(PathWrap(name, first=wrap.after + 1, last=wrap.after + 2))
    kind = MUSCLE if muscle.kind == "mujoco" else muscle.kind
    return replace(muscle, kind=kind, path=replace(muscle.path, wraps=tuple(wraps)))


def _sided(wrap_object: WrapObject, name: str, toward: Array | None) -> WrapObject:
    """Turn a surface so that its positive x half is on the side of a point.

    Parameters
    ----------
    toward : (3,) from its center, in its body's axes, None for all of it
    """
    size = (wrap_object.size[0], LONG) if wrap_object.kind == "cylinder" else wrap_object.size
    named = replace(wrap_object, name=name, size=size)
    if toward is None:
        return named
    R = wrap_object.pose.rotation
    z = R[:, 2]
    x = toward - (toward @ z) * z if wrap_object.kind == "cylinder" else toward
    length = float(np.linalg.norm(x))
    if length < 1e-9:
        return named
    x = x / length
    if wrap_object.kind != "cylinder":
        other = R[:, int(np.argmin(np.abs(R.T @ x)))]
        z = np.cross(x, other) / np.linalg.norm(np.cross(x, other))
    turned = np.column_stack([x, np.cross(z, x), z])
    return replace(named, pose=Transform(turned, wrap_object.pose.translation), quadrant="+x")


def _digits(place: Array) -> str:
    return "_".join(
        f"{round(1e4 * float(one)):+d}".replace("+", "p").replace("-", "m") for one in place
    )
