"""Both arms of myo-sim on the trunk of its legs: girdles, 45 muscles a side, hands of one body."""

from __future__ import annotations

from collections.abc import Collection, Mapping
from dataclasses import replace

import numpy as np

from myomorph.core.model.model import Body, Model
from myomorph.core.model.paths import Muscle, PathPoint, TendonWrap, WrapObject
from myomorph.core.model.sides import split_side
from myomorph.core.model.spatial import Transform
from myomorph.core.motion.protocols import Site
from myomorph.core.rigid.kinematics import standing_poses

WHOLE = "myofullbody"
# The body that arms hang on, which the legs' model has too, in the same place.
SHOULDERS = "cervical_spine"
HAND = "lunate"  # The body that carries the hand: fingers do not move.
PHANTOM = 0.01  # Bodies lighter than this carry no soft tissue, only axes between others [kg].
LUMBAR = ("lumbar_extension", "lumbar_bending", "lumbar_rotation")
ARM_SEGMENTS = ("upper_arm", "forearm", "hand")
MIN_SEGMENTS = 2  # So many segments of an arm must have a marker for it to move.


def have_arms(sites: Mapping[str, Site]) -> bool:
    """Whether markers show how an arm moves."""
    seen = {(site.side, site.segment) for site in sites.values() if site.segment in ARM_SEGMENTS}
    return any(
        sum(side == other for other, _ in seen) >= MIN_SEGMENTS for side in ("right", "left")
    )


def with_arms(model: Model) -> Model:
    """Give the legs and trunk of myo-sim both arms; shoulder blades follow the arm's elevation.

    Source: MyoSuite (Caggiano et al. 2022), after Saul et al. 2015.
    """
    from myomorph.core.io.mjcf.composed import composed_model

    whole = composed_model(WHOLE)
    bodies = _below(whole, (SHOULDERS,))
    arms = _with_one_hand(whole, "r", bodies)
    arms = _with_one_hand(arms, "l", bodies)
    kept = [_without_made_up_inertia(body) for body in arms.bodies if body.name in bodies]
    joints = [joint for joint in arms.joints if joint.child in bodies]
    named = {name for joint in joints for name in joint.coordinates}
    coordinates = [each for each in arms.coordinates if each.name in named]
    couplers = [each for each in arms.couplers if each.dependent in named]
    muscles = _muscles_on(arms, bodies)
    return replace(
        model,
        bodies=(*model.bodies, *kept),
        joints=(*model.joints, *joints),
        coordinates=(*model.coordinates, *coordinates),
        couplers=(*model.couplers, *couplers),
        muscles=(*model.muscles, *muscles),
        wrap_objects=(*model.wrap_objects, *_new_surfaces(arms, muscles, model)),
    )


def _muscles_on(model: Model, bodies: Collection[str]) -> list[Muscle]:
    """Muscles between bodies of which some are among these, each with a side in its name."""
    muscles = []
    for muscle in model.muscles:
        ends = {point.body for point in muscle.path.points}
        if ends.isdisjoint(bodies) or len(ends) == 1:
            continue
        sided = split_side(muscle.name)[1]
        muscles.append(replace(muscle, name=muscle.name if sided else f"{muscle.name}_r"))
    return muscles


def _new_surfaces(arms: Model, muscles: Collection[Muscle], model: Model) -> list[WrapObject]:
    """Surfaces that muscles go around and a model does not have."""
    used = {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
    used -= {surface.name for surface in model.wrap_objects}
    return [surface for surface in arms.wrap_objects if surface.name in used]


def arms_alone(model: Model, sides: Collection[str], spine: bool) -> Model:
    """Let only arms of some sides move, on a trunk that goes where its markers are.

    What else there is keeps its mass and hangs as it does by default, without muscles.

    Parameters
    ----------
    model : of `with_arms`
    sides : "right", "left"
    spine : it bends
    """
    moving = _below(model, [f"myoarm_{side[0]}_root" for side in sides])
    free = {name for joint in model.joints if joint.child in moving for name in joint.coordinates}
    free |= {*model.joints[0].coordinates, *(LUMBAR if spine else ())}
    held = {*model.coordinate_names} - free - {*model.dependent_coordinates}
    return replace(
        model,
        coordinates=tuple(
            replace(coordinate, locked=True) if coordinate.name in held else coordinate
            for coordinate in model.coordinates
        ),
        muscles=tuple(
            muscle
            for muscle in model.muscles
            if moving & {point.body for point in muscle.path.points}
        ),
    )


def _without_made_up_inertia(body: Body) -> Body:
    """Let a body that only carries axes turn as its gram does, a centimeter across.

    In myo-sim it has 1 kg m^2.
    """
    return replace(body, inertia=1e-4 * body.mass * np.eye(3)) if body.mass < PHANTOM else body


def _below(model: Model, roots: Collection[str]) -> set[str]:
    """Bodies that hang on some."""
    found = set(roots)
    for joint in model.joints:
        if joint.parent in found:
            found.add(joint.child)
    return found - set(roots)


def _with_one_hand(model: Model, side: str, bodies: set[str]) -> Model:
    """Join all bodies of a hand in the default pose; `bodies` loses them."""
    hand = f"{HAND}_{side}"
    fingers = _below(model, (hand,))
    bodies -= fingers
    poses = standing_poses(model)
    moved = {name: poses[hand].inverse() @ poses[name] for name in (hand, *fingers)}
    parts = [body for body in model.bodies if body.name in moved]
    lost = {name for joint in model.joints if joint.child in fingers for name in joint.coordinates}
    bodies_now = [
        _joined(hand, parts, moved) if body.name == hand else body
        for body in model.bodies
        if body.name not in fingers
    ]
    return replace(
        _without_coordinates(model, lost),
        bodies=tuple(bodies_now),
        joints=tuple(joint for joint in model.joints if joint.child not in fingers),
        muscles=tuple(_on_hand(muscle, hand, moved) for muscle in model.muscles),
        wrap_objects=tuple(_wrap_on_hand(wrap, hand, moved) for wrap in model.wrap_objects),
    )


def _without_coordinates(model: Model, lost: Collection[str]) -> Model:
    """Take coordinates, and couplers that determine one, away."""
    return replace(
        model,
        coordinates=tuple(each for each in model.coordinates if each.name not in lost),
        couplers=tuple(each for each in model.couplers if each.dependent not in lost),
    )


def _joined(name: str, parts: Collection[Body], moved: Mapping[str, Transform]) -> Body:
    """Bodies as one, in the frame that `moved` leads to."""
    mass = sum(part.mass for part in parts)
    centers = [moved[part.name].apply(part.mass_center) for part in parts]
    center = (
        sum((part.mass * own for part, own in zip(parts, centers, strict=True)), np.zeros(3)) / mass
    )
    inertia = np.zeros((3, 3))
    for part, own in zip(parts, centers, strict=True):
        turn = moved[part.name].rotation
        away = own - center
        inertia += turn @ part.inertia @ turn.T + part.mass * (
            away @ away * np.eye(3) - np.outer(away, away)
        )
    meshes = (
        replace(mesh, pose=moved[part.name] @ mesh.pose) for part in parts for mesh in part.meshes
    )
    return Body(name=name, mass=mass, mass_center=center, inertia=inertia, meshes=tuple(meshes))


def _on_hand(muscle: Muscle, hand: str, moved: Mapping[str, Transform]) -> Muscle:
    points = tuple(
        replace(point, body=hand, location=moved[point.body].apply(point.location))
        if isinstance(point, PathPoint) and point.body in moved
        else point
        for point in muscle.path.points
    )
    wraps = tuple(
        replace(wrap, side_body=hand, side=moved[wrap.side_body].apply(wrap.side))
        if wrap.side is not None and wrap.side_body in moved
        else wrap
        for wrap in muscle.path.wraps
        if isinstance(wrap, TendonWrap)
    )
    return replace(muscle, path=replace(muscle.path, points=points, wraps=wraps))


def _wrap_on_hand(wrap: WrapObject, hand: str, moved: Mapping[str, Transform]) -> WrapObject:
    return (
        replace(wrap, body=hand, pose=moved[wrap.body] @ wrap.pose) if wrap.body in moved else wrap
    )
