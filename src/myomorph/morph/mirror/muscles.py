"""Muscles of one side put on the other side of a skeleton that has both: a left leg's muscles from the right one's."""

from __future__ import annotations

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
from numpy.typing import ArrayLike

from myomorph.model.errors import BadModel
from myomorph.model.model import GROUND, Model
from myomorph.model.paths import MovingPathPoint, Muscle, PathPoint, TendonWrap
from myomorph.model.sides import split_side
from myomorph.model.spatial import Transform
from myomorph.morph.mirror.parts import mirrored_parts
from myomorph.morph.mirror.sides import OtherSide, other_side_of
from myomorph.rigid.kinematics import standing_poses

SEATED = 1e-6  # Frames that differ by less are the same [m or rad].


def with_other_muscles(model: Model, axis: str | ArrayLike = "z") -> tuple[Model, tuple[str, ...]]:
    """The model with the mirror image of each muscle and marker that has no counterpart on the other side, and what
    looks wrong. Where they lie is mirrored in ground with all coordinates at zero; bodies of the other side are the
    model's own, in whatever frames it has them. Of a muscle whose name has no side, its bodies tell it: `DELT1` on
    the right arm gets the counterpart `DELT1_l`.
    """
    copy = mirrored_parts(model, _naming_by_bodies(model, other_side_of(model, axis)))
    new = [muscle for muscle in copy.muscles if muscle.name not in model.muscle_names]
    if not new:
        raise BadModel(f"model '{model.name}': every muscle has its counterpart, or has no side: nothing to mirror")
    known = {GROUND, *model.body_names}
    missing = {point.body for muscle in new for point in muscle.path.points} - known
    if missing:
        raise BadModel(f"model '{model.name}': no body of the other side: {', '.join(sorted(missing))}")
    seats = _seats(model, copy)
    wraps = {item.name: item for item in copy.wrap_objects}
    used = {wrap.wrap_object for muscle in new for wrap in muscle.path.wraps}
    present = {wrap.wrap_object for muscle in model.muscles for wrap in muscle.path.wraps}
    both = sorted(used & present)
    if both:
        raise BadModel(f"model '{model.name}': both sides go around {', '.join(both)}: name one for each side")
    placed = tuple(
        replace(wraps[name], pose=seats[wraps[name].body] @ wraps[name].pose) for name in wraps if name in used
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
    return result, (f"{len(new)} muscles are the mirror images of the other side's", *_unlike(model, seats, new))


def _naming_by_bodies(model: Model, side: OtherSide) -> OtherSide:
    """The other side, with names for muscles and wrap objects that have no side but lie on bodies that do."""
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


def _seats(model: Model, copy: Model) -> Mapping[str, Transform]:
    """From each body of the mirrored model to the model's own body of that name."""
    ours, theirs = (standing_poses(posed, dict.fromkeys(posed.coordinate_names, 0.0)) for posed in (model, copy))
    return {name: ours[name].inverse() @ theirs[name] for name in ours if name in theirs}


def _seated(muscle: Muscle, seats: Mapping[str, Transform]) -> Muscle:
    points = tuple(_seated_point(point, seats[point.body]) for point in muscle.path.points)
    tendon = tuple(
        wrap if wrap.side is None else replace(wrap, side=seats[wrap.side_body].apply(wrap.side))
        for wrap in muscle.path.wraps
        if isinstance(wrap, TendonWrap)
    )
    return replace(muscle, path=replace(muscle.path, points=points, wraps=tendon or muscle.path.wraps))


def _seated_point(point: PathPoint | MovingPathPoint, seat: Transform) -> PathPoint | MovingPathPoint:
    if isinstance(point, PathPoint):
        return replace(point, location=seat.apply(point.location))
    if _away(seat) > SEATED:
        raise BadModel(f"moving point '{point.name}': the frames of '{point.body}' are not mirrored in the skeleton")
    return point


def _away(seat: Transform) -> float:
    return float(max(np.abs(seat.translation).max(), np.abs(seat.rotation - np.eye(3)).max()))


def _unlike(model: Model, seats: Mapping[str, Transform], muscles: list[Muscle]) -> tuple[str, ...]:
    """One line on bodies that lie elsewhere than the mirrored ones of the other side."""
    used = dict.fromkeys(point.body for muscle in muscles for point in muscle.path.points)
    away = {name: float(np.linalg.norm(seats[name].translation)) for name in used if _away(seats[name]) > SEATED}
    if not away:
        return ()
    worst = max(away, key=lambda name: away[name])
    return (
        f"the skeleton's two sides differ: frames of {len(away)} bodies are not those of the other side mirrored, "
        f"{worst} by {1e3 * away[worst]:.1f} mm; muscles lie where the mirror puts them",
    )
