"""The other side of a body: a left leg from a right one.

A reflection Q (its matrix S, S S = 1) carries points x of a body to Q x; the frames stay right-handed, so a joint
between bodies of reflections Q_p and Q_c with a reflection S_j of its own frame becomes

    parent frame Q_p P S_j,  child frame Q_c C S_j,  rotation about -S_j u,  translation along S_j u

by the same amounts. So equal coordinates are equal anatomical movements on both sides, as on OpenSim's left legs: what
turns about the axis across the plane stays, the other axes turn round. Bodies in the plane are their own other side;
coordinates of theirs that move the body out of the plane keep their axes and change their sign.
"""

from __future__ import annotations

from collections.abc import Callable, Collection
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.arrays import Array
from myomorph.model.errors import BadModel
from myomorph.model.model import Body, Model
from myomorph.model.series import Motion
from myomorph.model.sides import other_side
from myomorph.morph.mirrored_parts import mirrored_parts
from myomorph.morph.other_side import other_side_of

PARTS = (
    "bodies", "joints", "coordinates", "markers", "muscles", "wrap_objects", "actuators", "couplers", "loops", "frames",
    "passive_torques", "bushings",
)  # fmt: skip


def mirrored(
    model: Model,
    axis: str | ArrayLike = "z",
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    middle: Collection[str] | None = None,
) -> Model:
    """The model with right and left exchanged: muscles of `femur_r` become those of `femur_l`.

    Parameters
    ----------
    axis : of ground across the plane of symmetry ("z" in OpenSim's models, often "y" in MuJoCo's), or a (3,) vector
    point : (3,) of the plane, in ground with all coordinates at zero [m]
    middle : bodies that are their own other side; found by name and place where it is None

    Returns
    -------
    model whose muscles have the lengths and moment arms of the given one's when it moves as `mirrored_motion` says.
    Where all names have their counterparts everything keeps its order. Parts of a file that are only carried along
    (`Model.kept`) stay behind, but for the file's head, and ligaments with them.

    Raises
    ------
    BadModel : where right and left bodies do not face each other along `axis`
    """
    side = other_side_of(model, axis, point, middle)
    copied = mirrored_parts(model, side)
    kept = tuple(one for one in model.kept if one.room == "Model")
    return _in_order_of(model, replace(copied, kept=kept, ligaments=()))


def mirrored_motion(
    model: Model,
    motion: Motion,
    axis: str | ArrayLike = "z",
    *,
    point: ArrayLike = (0.0, 0.0, 0.0),
    middle: Collection[str] | None = None,
) -> Motion:
    """A motion of `model` as its mirrored model moves: names exchanged, signs of the middle's turns changed.

    Columns keep their order where all names have their counterparts, as in the mirrored model.
    """
    side = other_side_of(model, axis, point, middle)
    signs = np.array(side.of(motion.names))
    names = [side.named("coordinates", name) for name in motion.names]
    order = [names.index(name) for name in motion.names] if set(names) == set(motion.names) else list(range(len(names)))

    def turned(values: Array) -> Array:
        moved: Array = (values * signs)[:, order]
        return moved

    return replace(
        motion,
        names=tuple(names[k] for k in order),
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
    """A one-sided model with the missing side: what has no counterpart gets one, bodies in the middle stay.

    Masses in the middle stay as they are: a pelvis is taken to be whole.

    Parameters
    ----------
    axis, point, middle : as of `mirrored`
    suffix : put behind names that tell no side, for their counterparts

    Raises
    ------
    BadModel : as of `mirrored`, or where there is nothing to add
    """
    side = other_side_of(model, axis, point, middle, suffix)
    copy = mirrored_parts(model, side)
    pairs = list(zip(model.bodies, copy.bodies, strict=True))
    bodies = {new.name for old, new in pairs if old.name not in side.middle} - set(model.body_names)
    if not bodies:
        raise BadModel(f"model '{model.name}' has both sides, or no body away from the plane: there is nothing to add")

    def added(what: str, wanted: Callable[[Any], bool]) -> tuple[Any, ...]:
        old, new = getattr(model, what), getattr(copy, what)
        names = {one.name for one in old}
        told = [other.name not in (one.name, one.name + suffix) for one, other in zip(old, new, strict=True)]
        return tuple(
            one for one, tells in zip(new, told, strict=True) if one.name not in names and (tells or wanted(one))
        )

    def on_added(one: Any) -> bool:
        return one.body in bodies

    def ties_added(one: Any) -> bool:
        return one.body_1 in bodies or one.body_2 in bodies

    joints = tuple(one for one in copy.joints if one.child in bodies)
    own = {name for joint in joints for name in joint.coordinates}
    muscles = added("muscles", lambda one: any(point.body in bodies for point in one.path.points))
    used = {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
    more: dict[str, Any] = {
        "bodies": tuple(one for one in copy.bodies if one.name in bodies),
        "joints": joints,
        "coordinates": tuple(one for one in copy.coordinates if one.name in own),
        "markers": added("markers", on_added),
        "muscles": muscles,
        "wrap_objects": added("wrap_objects", lambda one: one.body in bodies or one.name in used),
        "actuators": added("actuators", lambda one: one.coordinate in own or one.body in bodies),
        "couplers": added("couplers", lambda one: one.dependent in own),
        "loops": added("loops", ties_added),
        "frames": added("frames", on_added),
        "passive_torques": added("passive_torques", lambda one: one.coordinate in own),
        "bushings": added("bushings", ties_added),
    }
    whole: dict[str, Any] = {what: getattr(model, what) + parts for what, parts in more.items()}
    drawn = tuple(_with_meshes(old, new) if old.name in side.middle else old for old, new in pairs)
    return replace(model, **(whole | {"bodies": drawn + more["bodies"]}))


def _with_meshes(body: Body, other: Body) -> Body:
    """A body of the middle with the other half of bones that are drawn one-sided, as a pelvis of two."""
    files = {mesh.file for mesh in body.meshes}
    missing = tuple(
        new
        for old, new in zip(body.meshes, other.meshes, strict=True)
        if other_side(_stem(old.file)) and old.file.replace(_stem(old.file), other_side(_stem(old.file))) not in files
    )
    return replace(body, meshes=body.meshes + missing)


def _stem(file: str) -> str:
    return file.replace("\\", "/").rpartition("/")[2].partition(".")[0]


def _in_order_of(model: Model, other: Model) -> Model:
    """The other model with everything in the given one's order, where it has the same names."""
    ordered: dict[str, Any] = {}
    for what in PARTS:
        place = {one.name: k for k, one in enumerate(getattr(model, what))}
        parts = getattr(other, what)
        if {one.name for one in parts} == set(place) and len(place) == len(parts):
            ordered[what] = tuple(sorted(parts, key=lambda one: place[one.name]))
    parents = {joint.child: joint.parent for joint in other.joints}
    names = [body.name for body in ordered.get("bodies", ())]
    if any(parents[name] in names[k:] for k, name in enumerate(names)):
        del ordered["bodies"]
    return replace(other, **ordered)
