"""The other side of a body: a left leg from a right one.

A reflection Q (its matrix S, S S = 1) takes points x of a body to Q x; the frames stay
right-handed, so a joint between bodies of reflections Q_p and Q_c with a reflection S_j of its own
frame becomes

    parent frame Q_p P S_j,  child frame Q_c C S_j,  rotation about -S_j u,  translation along S_j u

by the same amounts. So equal coordinates are equal anatomical movements on both sides, as on
OpenSim's left legs: what turns about the axis across the plane stays, the other axes turn round.
Bodies in the plane are their own other side; coordinates of theirs that move the body out of the
plane keep their axes and change their sign.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

import numpy as np
import scipy
from numpy.typing import ArrayLike

from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, PlacedMap
from myomorph.bones.morph.mirror.parts import mirrored_parts
from myomorph.bones.morph.mirror.sides import OtherSide, Reflection, flip, other_side_of
from myomorph.core.model.arrays import Array
from myomorph.core.model.errors import BadModel
from myomorph.core.model.model import GROUND, Body, Model
from myomorph.core.model.paths import (
    MovingPathPoint,
    Muscle,
    PathPoint,
    TendonWrap,
    refuse_path_functions,
)
from myomorph.core.model.series import Motion
from myomorph.core.model.sides import other_side, split_side
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.kinematics import standing_poses
from myomorph.core.surfaces.linear_maps import Similarity

PARTS = (
    "bodies",
    "joints",
    "coordinates",
    "markers",
    "muscles",
    "wrap_objects",
    "actuators",
    "couplers",
    "loops",
    "frames",
    "passive_torques",
    "bushings",
)


def mirrored(
    model: Model,
    axis: str | ArrayLike = "z",
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    middle: Collection[str] | None = None,
) -> Model:
    """Exchange right and left of a model: muscles of `femur_r` become those of `femur_l`.

    Source: ours, described in docs/morphing.md.

    Parameters
    ----------
    model : of one side, or of both
    axis : of ground across the plane of symmetry ("z" in OpenSim's models, often "y" in MuJoCo's),
        or a (3,) vector
    point : (3,) of the plane, in ground with all coordinates at zero [m]
    middle : bodies that are their own other side; found by name and place where it is None

    Returns
    -------
    model whose muscles have the lengths and moment arms of the given one's when it moves as
    `mirrored_motion` says. Where all names have their counterparts everything keeps its order.
    Parts of a file that are only copied (`Model.kept`) stay behind, but for the file's head, and
    ligaments with them.

    Raises
    ------
    BadModel : where right and left bodies do not face each other along `axis`

    Examples
    --------
    >>> import myomorph as mm
    >>> model = mm.read_model("arm.osim")
    >>> found = mm.mirrored(model)
    >>> model.markers[1].location.tolist(), found.markers[1].location.tolist()
    ([-0.05, -0.2, 0.03], [-0.05, -0.2, -0.03])
    """
    refuse_path_functions(model.muscles, "the mirror image")
    side = other_side_of(model, axis, point, middle)
    copied = mirrored_parts(model, side)
    kept = tuple(part for part in model.kept if part.room == "Model")
    return _in_order_of(model, replace(copied, kept=kept, ligaments=()))


def mirrored_motion(
    model: Model,
    motion: Motion,
    axis: str | ArrayLike = "z",
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    middle: Collection[str] | None = None,
) -> Motion:
    """Mirror a motion of `model` to the motion of its mirrored model.

    Names are exchanged, and the signs of rotations in the middle changed. Columns keep their order
    where all names have their counterparts, as in the mirrored model.
    """
    side = other_side_of(model, axis, point, middle)
    signs = np.array(side.of(motion.names))
    names = [side.named("coordinates", name) for name in motion.names]
    order = (
        [names.index(name) for name in motion.names]
        if set(names) == set(motion.names)
        else list(range(len(names)))
    )

    def turned(values: Array) -> Array:
        return (values * signs)[:, order]

    return replace(
        motion,
        names=tuple(names[index] for index in order),
        values=turned(motion.values),
        velocities=None if motion.velocities is None else turned(motion.velocities),
        accelerations=None if motion.accelerations is None else turned(motion.accelerations),
    )


def with_other_side(
    model: Model,
    axis: str | ArrayLike = "z",
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    middle: Collection[str] | None = None,
    suffix: str = "_l",
) -> Model:
    """Add the missing side to a one-sided model.

    What has no counterpart gets one (`suffix` behind names without a side). Bodies in the middle
    keep their masses: a pelvis is assumed to be whole. The rest as of `mirrored`.
    """
    side = other_side_of(model, axis, point, middle, suffix)
    copy = mirrored_parts(model, side)
    pairs = list(zip(model.bodies, copy.bodies, strict=True))
    bodies = {new.name for old, new in pairs if old.name not in side.middle} - set(model.body_names)
    if not bodies:
        raise BadModel(
            f"model '{model.name}' has both sides, or no body away from the plane: there is nothing"
            " to add"
        )
    more = _added_parts(model, copy, bodies, suffix)
    whole = {what: getattr(model, what) + parts for what, parts in more.items()}
    drawn = tuple(_with_meshes(old, new) if old.name in side.middle else old for old, new in pairs)
    return replace(model, **(whole | {"bodies": drawn + more["bodies"]}))


def _added_parts(
    model: Model, copy: Model, bodies: Collection[str], suffix: str
) -> dict[str, tuple[Any, ...]]:
    """Return the parts of a mirrored copy that a model lacks, by the model's field.

    `bodies`: those that are added; `suffix`: behind names without a side.
    """

    def added(what: str, belongs: Callable[[Any], bool]) -> tuple[Any, ...]:
        """Return new parts that belong to the other side, by their names or otherwise."""
        before = getattr(model, what)
        names = {part.name for part in before}
        return tuple(
            new
            for old, new in zip(before, getattr(copy, what), strict=True)
            if new.name not in names
            and (new.name not in (old.name, old.name + suffix) or belongs(new))
        )

    def on_added(part: Any) -> bool:
        return part.body in bodies

    def ties_added(part: Any) -> bool:
        return part.body_1 in bodies or part.body_2 in bodies

    joints = tuple(joint for joint in copy.joints if joint.child in bodies)
    coordinates = {name for joint in joints for name in joint.coordinates}

    def moved(part: Any) -> bool:
        return part.coordinate in coordinates

    muscles = added("muscles", lambda muscle: any(map(on_added, muscle.path.points)))
    used = _used_wraps(muscles)
    return {
        "bodies": _named(copy.bodies, bodies),
        "joints": joints,
        "coordinates": _named(copy.coordinates, coordinates),
        "markers": added("markers", on_added),
        "muscles": muscles,
        "wrap_objects": added("wrap_objects", lambda wrap: on_added(wrap) or wrap.name in used),
        "actuators": added("actuators", lambda actuator: moved(actuator) or on_added(actuator)),
        "couplers": added("couplers", lambda coupler: coupler.dependent in coordinates),
        "loops": added("loops", ties_added),
        "frames": added("frames", on_added),
        "passive_torques": added("passive_torques", moved),
        "bushings": added("bushings", ties_added),
    }


def _named(parts: Iterable[Any], names: Collection[str]) -> tuple[Any, ...]:
    """Return the parts that have one of these names."""
    return tuple(part for part in parts if part.name in names)


def _used_wraps(muscles: Iterable[Muscle]) -> set[str]:
    """Return the names of wrap objects that muscles run around."""
    return {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}


def _with_meshes(body: Body, other: Body) -> Body:
    """Add the other half of bones that are drawn one-sided to a body of the middle.

    A pelvis of two halves is one.
    """
    files = {mesh.file for mesh in body.meshes}
    missing = tuple(
        new
        for old, new in zip(body.meshes, other.meshes, strict=True)
        if other_side(_stem(old.file))
        and old.file.replace(_stem(old.file), other_side(_stem(old.file))) not in files
    )
    return replace(body, meshes=body.meshes + missing)


def _stem(file: str) -> str:
    return file.replace("\\", "/").rpartition("/")[2].partition(".")[0]


def _in_order_of(model: Model, other: Model) -> Model:
    """Return the other model with everything in the given one's order, where names are the same."""
    ordered: dict[str, Any] = {}
    for what in PARTS:
        place = {part.name: index for index, part in enumerate(getattr(model, what))}
        parts = getattr(other, what)
        if {part.name for part in parts} == set(place) and len(place) == len(parts):
            ordered[what] = tuple(sorted(parts, key=lambda part: place[part.name]))
    parents = {joint.child: joint.parent for joint in other.joints}
    names = [body.name for body in ordered.get("bodies", ())]
    if any(parents[name] in names[index:] for index, name in enumerate(names)):
        del ordered["bodies"]
    return replace(other, **ordered)


# The source's own bones must be mirror images of each other within this share of their length.
ALIKE = 0.02


def with_mirrored_bones(
    model: Model,
    bones: Mapping[str, BoneMap],
    surfaces: Mapping[str, Surface],
    together: bool = False,
    axis: str = "z",
) -> dict[str, BoneMap]:
    """Add mirrored maps to bodies that have none while their other side has one.

    `together`: the target's bones share one frame, in which the plane of symmetry is that of a
    mapped bone in the middle.
    """
    side = other_side_of(model, axis)
    middle = _shared_plane(bones, side.planes, side.middle) if together else None
    result = dict(bones)
    for body in model.body_names:
        twin = side.named("bodies", body)
        if body in bones or twin == body or twin not in bones:
            continue
        plane = side.planes[twin]
        goal = middle or flip(int(np.argmax(np.abs(bones[twin].whole.rotation @ plane.normal))))
        result[body] = _mirrored(bones[twin], body, plane, goal, surfaces)
    return result


def _shared_plane(
    bones: Mapping[str, BoneMap], planes: Mapping[str, Reflection], middle: frozenset[str]
) -> Reflection | None:
    for body, bone in bones.items():
        if body in middle:
            normal = bone.whole.rotation @ planes[body].normal
            through = bone.whole.apply(planes[body].offset * planes[body].normal)
            return Reflection(normal, float(normal @ through))
    return None


def _mirrored(
    bone: BoneMap, body: str, plane: Reflection, goal: Reflection, surfaces: Mapping[str, Surface]
) -> BoneMap:
    turned = goal.matrix @ bone.whole.rotation @ plane.matrix
    origin = goal.points(bone.whole.apply(plane.points(np.zeros(3))))
    features = bone.features
    notes = [
        f"{body}: the mirrored bone of {bone.body}",
        *_unlike(body, bone.body, plane, surfaces),
    ]
    return replace(
        bone,
        body=body,
        target_body=body,
        map=PlacedMap(plane.affine, bone.map, goal.affine),
        overall=None if bone.overall is None else goal.matrix @ bone.overall @ plane.matrix,
        whole=Similarity(turned, origin, bone.whole.scale),
        source=surfaces.get(body) or _reflected(bone.source, plane),
        target=_reflected(bone.target, goal),
        features=(
            None
            if features is None
            else FeaturePoints(
                names=features.names,
                source=plane.points(features.source),
                target=goal.points(features.target),
                weights=features.weights,
            )
        ),
        notes=tuple(notes),
    )


def _reflected(surface: Surface | None, plane: Reflection) -> Surface | None:
    return (
        None if surface is None else Surface(plane.points(surface.vertices), surface.faces[:, ::-1])
    )


def _unlike(body: str, twin: str, plane: Reflection, surfaces: Mapping[str, Surface]) -> list[str]:
    """Report a bone that is no mirror image of its other side in their bodies' frames.

    Both bones are the source's own.
    """
    if body not in surfaces or twin not in surfaces:
        return []
    image = plane.points(surfaces[twin].vertices)
    vertices = surfaces[body].vertices
    apart = float(np.sqrt(np.mean(scipy.spatial.cKDTree(vertices).query(image)[0] ** 2)))
    length = float(np.ptp(vertices, axis=0).max())
    if apart <= ALIKE * length:
        return []
    return [
        f"{body}: the source's bone lies {1e3 * apart:.1f} mm from {twin} mirrored: give the bone"
        " itself"
    ]


SEATED = 1e-6  # Frames that differ by less are the same [m or rad].


def with_other_muscles(model: Model, axis: str | ArrayLike = "z") -> tuple[Model, tuple[str, ...]]:
    """Add the mirror image of each muscle and marker that has no counterpart on the other side.

    Returns the model, and a line for whatever looks wrong. Positions are mirrored in ground with
    all coordinates at zero; bodies of the other side are the model's own, in whatever frames it has
    them. Of a muscle whose name has no side, its bodies define it: `DELT1` on the right arm gets
    the counterpart `DELT1_l`.
    """
    copy = mirrored_parts(model, _naming_by_bodies(model, other_side_of(model, axis)))
    new = [muscle for muscle in copy.muscles if muscle.name not in model.muscle_names]
    _check_new_muscles(model, new)
    # From each body of the mirrored model to the model's own body of that name.
    ours = standing_poses(model, dict.fromkeys(model.coordinate_names, 0.0))
    theirs = standing_poses(copy, dict.fromkeys(copy.coordinate_names, 0.0))
    seats = {name: ours[name].inverse() @ theirs[name] for name in ours if name in theirs}
    used = _used_wraps(new)
    both = sorted(used & _used_wraps(model.muscles))
    if both:
        raise BadModel(
            f"model '{model.name}': both sides go around {', '.join(both)}: name one for each side"
        )
    wraps = {item.name: item for item in copy.wrap_objects}
    placed = tuple(
        replace(item, pose=seats[item.body] @ item.pose)
        for name, item in wraps.items()
        if name in used
    )
    markers = tuple(
        replace(marker, location=seats[marker.body].apply(marker.location))
        for marker in copy.markers
        if marker.name not in model.marker_names
    )
    result = replace(
        model,
        muscles=(*model.muscles, *(_seated(muscle, seats) for muscle in new)),
        wrap_objects=(*(item for item in model.wrap_objects if item.name not in used), *placed),
        markers=(*model.markers, *markers),
    )
    return result, (
        f"{len(new)} muscles are the mirror images of the other side's",
        *_sides_differ(model, seats, new),
    )


def _check_new_muscles(model: Model, new: Sequence[Muscle]) -> None:
    """Refuse a model that no muscle can be added to, or that lacks a body of one."""
    if not new:
        raise BadModel(
            f"model '{model.name}': every muscle has its counterpart, or has no side: nothing to"
            " mirror"
        )
    known = {GROUND, *model.body_names}
    missing = {point.body for muscle in new for point in muscle.path.points} - known
    if missing:
        raise BadModel(
            f"model '{model.name}': no body of the other side: {', '.join(sorted(missing))}"
        )


def _naming_by_bodies(model: Model, side: OtherSide) -> OtherSide:
    """Return the other side, with names for muscles and wrap objects that have no side.

    The bodies on which they lie have one.
    """
    ends: dict[tuple[str, str], str] = {}
    for muscle in model.muscles:
        sides = {split_side(point.body)[1] for point in muscle.path.points} - {""}
        if len(sides) == 1 and side.named("muscles", muscle.name) == muscle.name:
            end = "_l" if sides == {"right"} else "_r"
            ends["muscles", muscle.name] = end
            ends |= {("wraps", wrap.wrap_object): end for wrap in muscle.path.wraps}

    def named(kind: str, name: str) -> str:
        other = side.named(kind, name)
        return other if other != name else name + ends.get((kind, name), "")

    return replace(side, named=named)


def _seated(muscle: Muscle, seats: Mapping[str, Transform]) -> Muscle:
    points = tuple(_seated_point(point, seats[point.body]) for point in muscle.path.points)
    tendon = tuple(
        wrap if wrap.side is None else replace(wrap, side=seats[wrap.side_body].apply(wrap.side))
        for wrap in muscle.path.wraps
        if isinstance(wrap, TendonWrap)
    )
    return replace(
        muscle, path=replace(muscle.path, points=points, wraps=tendon or muscle.path.wraps)
    )


def _seated_point(
    point: PathPoint | MovingPathPoint, seat: Transform
) -> PathPoint | MovingPathPoint:
    if isinstance(point, PathPoint):
        return replace(point, location=seat.apply(point.location))
    if _away(seat) > SEATED:
        raise BadModel(
            f"moving point '{point.name}': the frames of '{point.body}' are not mirrored in the"
            " skeleton"
        )
    return point


def _away(seat: Transform) -> float:
    return float(max(np.abs(seat.translation).max(), np.abs(seat.rotation - np.eye(3)).max()))


def _sides_differ(
    model: Model, seats: Mapping[str, Transform], muscles: list[Muscle]
) -> tuple[str, ...]:
    """One line on bodies that lie elsewhere than the mirrored ones of the other side."""
    used = dict.fromkeys(point.body for muscle in muscles for point in muscle.path.points)
    away = {
        name: float(np.linalg.norm(seats[name].translation))
        for name in used
        if _away(seats[name]) > SEATED
    }
    if not away:
        return ()
    worst = max(away, key=lambda name: away[name])
    return (
        (
            f"the skeleton's two sides differ: frames of {len(away)} bodies are not those of the"
            f" other side mirrored, {worst} by {1e3 * away[worst]:.1f} mm; muscles lie where the"
            " mirror puts them"
        ),
    )
