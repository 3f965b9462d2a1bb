"""The pose in which a model's skeleton stands in a skin, by virtual markers, [D] 3.3."""

from __future__ import annotations

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from typing import NamedTuple

import numpy as np

from myomorph.body.causes import SKIN
from myomorph.body.shape.points import links_of
from myomorph.body.shape.regions import Center, centers_of, regions_of
from myomorph.body.shape.shape import Shape
from myomorph.body.shape.skin import Skin, inside
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.messages import Message
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import DEFAULT_POSE, Markers, Motion
from myomorph.core.motion.ik import (
    InverseKinematicsOptions,
    KinematicsFit,
    inverse_kinematics,
)
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.tree import compile_tree

LANDMARK_WEIGHT = 0.1
"""Of a marker over a landmark, whose place on the model is that of some laboratory, and of the
spine's joint centers, which models place differently; the other joint centers weigh 1.
"""

SPINE = ("lumbar", "neck")
FAR = 0.03  # Root mean square of the errors above which the model is not of this body's size [m]
SHARE_INSIDE = 0.8
MIN_POINTS = 3
# Of points across their longest direction, squared, below which they lie on a line
MIN_WIDTH = 1e-3
ITERATIONS = 300
POSTURE = 1e-3
"""Pull towards the default pose in a statistical body, which keeps spines of many joints from
buckling; a user's landmarks are followed without it.
"""

TRUNK = ("hip", "lumbar", "neck", "shoulder", "pelvis", "ASIS", "PSIS", "C7", "sternum", "acromion")
_SIDED = (
    ("ASIS", r"asis?|asi"),
    ("PSIS", r"psis?|psi"),
    ("acromion", r"acr(omi(on|um))?|ac|sho|shoulder|sh"),
    ("lateral elbow", r"lel|lelb|elb(ow)?(_?lat(eral)?)?|lhe|humlatepi|elblat"),
    ("medial elbow", r"mel|melb|elb(ow)?_?med(ial)?|mhe"),
    ("lateral knee", r"kne|knee(_?lat(eral)?)?|lfc|lknee|lfe|latknee"),
    ("medial knee", r"knee?_?med(ial)?|mfc|mknee|mfe|kneemed"),
    ("lateral ankle", r"ank|ankle(_?lat(eral)?)?|lmal|lankle|latmal"),
    ("medial ankle", r"ank(le)?_?med(ial)?|mmal|mankle|anklemed"),
    ("heel", r"hee(l)?|cal(c)?(aneus)?"),
    ("toe tip", r"toe_?tip|hallux"),
)
_MIDDLE = (
    ("C7", r"c7"),
    ("head top", r"top[._ ]?head|head[._ ]?top|vertex"),
    ("sternum", r"sternum|clav|jugular|ij|sjn"),
)

_FORMS = (
    r"(?P<side>r|l|right|left)[._ -]?(?P<base>.+)",
    r"(?P<base>.+?)[._ -](?P<side>r|l|right|left)",
)
"""Names of markers with a side, before or behind the rest."""


@read_only
class PoseFit:
    """A model's pose in a skin, both in the model's ground.

    Attributes
    ----------
    motion : one frame
    skin : moved to where the model is
    rotation, translation : (3, 3), (3,) by which it was moved [m]
    names : of the virtual markers: joint centers ("right hip") and the model's own markers
    errors : (markers,) distances of model and skin's virtual markers [m]
    notes : what looks wrong, one line each
    """

    motion: Motion
    skin: Skin
    rotation: Array
    translation: Array
    names: tuple[str, ...]
    errors: Array
    notes: tuple[Message, ...] = ()

    @property
    def rms(self) -> float:
        """Root mean square of the errors [m]; NaN without virtual markers."""
        return float(np.sqrt(np.mean(np.square(self.errors)))) if len(self.errors) else float("nan")


def pose_model_to_skin(
    model: Model, body: Shape | Skin, landmarks: Mapping[str, Array] | None = None
) -> PoseFit:
    """Find the pose in which a model's joint centers and markers are where a body has them.

    The skin is first moved to the model's default pose (Kabsch 1976, over the points of the trunk),
    whatever its axes are, then inverse kinematics runs over virtual markers ([D] 3.3). A skin
    without landmarks is taken to be in the model's default pose and ground already, which is
    checked.

    Parameters
    ----------
    model : scaled to the body
    body : a shape with joint centers and landmarks, or a user's skin
    landmarks : (3,) on a user's skin by the name of a model marker or a joint center ("right knee",
        "neck") [m]; in the place of a shape's own

    Returns
    -------
    one frame, and the skin where the model is

    Raises
    ------
    BadData : model and body share fewer than three points, or these lie on one line; or the skin is
        not where the model stands
    UnknownName : a landmark is no marker or joint center of the model
    """
    skin = body.skin if isinstance(body, Shape) else body
    if landmarks is None and isinstance(body, Skin):
        return _default_pose(model, skin)
    centers = _centers(model)
    shared = _SharedPoints(pairs={})
    if landmarks is not None:
        shared = _of_landmarks(model, centers, landmarks)
    elif isinstance(body, Shape):
        shared = _of_shape(model, centers, body)
    if len(shared.pairs) < MIN_POINTS:
        raise BadData(
            f"model '{model.name}' and the body share {len(shared.pairs)} points: expected at least"
            " three markers or joint centers, as 'right knee'"
        )
    virtual = replace(model, markers=tuple(pair.marker for pair in shared.pairs.values()))
    seen = np.array([pair.point for pair in shared.pairs.values()])
    names = tuple(shared.pairs)
    placed = _aligned(seen, marker_positions(virtual, DEFAULT_POSE).values[0], names)
    weights = dict.fromkeys(names, 1.0)
    if landmarks is None:
        weights = {
            name: 1.0 if name in centers and name not in SPINE else LANDMARK_WEIGHT
            for name in names
        }
    options = InverseKinematicsOptions(
        marker_weights=weights,
        iterations=ITERATIONS,
        posture_weight=POSTURE if landmarks is None else InverseKinematicsOptions.posture_weight,
    )
    recorded = Markers(np.zeros(1), names, placed.moved(seen)[None])
    fit = inverse_kinematics(virtual, recorded, options)
    return PoseFit(
        motion=fit.motion,
        skin=skin.moved(placed.rotation, placed.translation),
        rotation=frozen_array(placed.rotation),
        translation=frozen_array(placed.translation),
        names=fit.marker_names,
        errors=frozen_array(fit.marker_error[0]),
        notes=tuple(_notes(fit, weights, shared.missed)),
    )


def _notes(
    fit: KinematicsFit, weights: Mapping[str, float], missed: tuple[str, ...]
) -> Iterator[Message]:
    """Report joint centers that the model lacks, another body's size, and a pose that moves on."""
    if missed:
        names = ", ".join(missed)
        yield SKIN.message(
            f"the model has no {names}: what lies beyond belongs to the segment before"
        )
    errors = fit.marker_error[0]
    counted = np.array([weights[name] == 1.0 for name in fit.marker_names])
    rms = float(np.sqrt(np.mean(np.square(errors[counted])))) if counted.any() else 0.0
    if rms > FAR:
        worst = int(np.argmax(np.where(counted, errors, 0.0)))
        yield (
            SKIN.message(
                f"the model fits the skin within {1000 * rms:.0f} mm (root mean square;"
                f" '{fit.marker_names[worst]}' {1000 * errors[worst]:.0f} mm): it is not of this"
                " body's size; calibrate or scale it first"
            )
        )
    if not fit.converged[0]:
        yield SKIN.message("the pose did not converge")


class _Pair(NamedTuple):
    """A point of the body, and where the model has it.

    Attributes
    ----------
    point : (3,) [m]
    marker : of the model, virtual at a joint center
    """

    point: Array
    marker: Marker


class _SharedPoints(NamedTuple):
    """Points that model and body share.

    Attributes
    ----------
    pairs : by name
    missed : joint centers of the body that the model lacks
    """

    pairs: Mapping[str, _Pair]
    missed: tuple[str, ...] = ()


class _Placed(NamedTuple):
    """A rigid movement.

    Attributes
    ----------
    rotation : (3, 3)
    translation : (3,) [m]
    """

    rotation: Array
    translation: Array

    def moved(self, points: Array) -> Array:
        """Move points (points, 3) [m]."""
        return points @ self.rotation.T + self.translation


def _centers(model: Model) -> dict[str, Center]:
    """Find the joint centers of a human model by name, none of others.

    Where nothing moves in the spine, the frame of the joint may be anywhere.
    """
    try:
        centers = centers_of(model, regions_of(model))
    except BadData:
        return {}
    moving = {
        name
        for name, center in centers.items()
        if any(axis.function.arity for axis in center.joint.axes)
    }
    return {name: center for name, center in centers.items() if name not in SPINE or name in moving}


def _at_centers(centers: Mapping[str, Center]) -> dict[str, Marker]:
    """Put a virtual marker at every joint center."""
    return {
        name: Marker(name, center.joint.child, center.location) for name, center in centers.items()
    }


def _of_landmarks(
    model: Model, centers: Mapping[str, Center], landmarks: Mapping[str, Array]
) -> _SharedPoints:
    """Pair a user's landmarks with markers and joint centers of the model.

    Raises
    ------
    UnknownName : a landmark is no marker or joint center of the model
    BadData : a landmark is no point
    """
    known = _at_centers(centers) | {marker.name: marker for marker in model.markers}
    pairs = {}
    for name, point in landmarks.items():
        if name not in known:
            existing = (*model.marker_names, *centers)
            raise UnknownName("landmark", name, existing=existing, where=f"model '{model.name}'")
        if np.shape(point) != (3,) or not np.isfinite(point).all():
            raise BadData(f"landmark '{name}': expected three finite coordinates, but got {point}")
        pairs[name] = _Pair(point=np.asarray(point, dtype=np.float64), marker=known[name])
    return _SharedPoints(pairs=pairs)


def _of_shape(model: Model, centers: Mapping[str, Center], shape: Shape) -> _SharedPoints:
    """Pair joint centers and landmarks of a shape with those of the model."""
    at_centers = _at_centers(centers)
    pairs = {
        name: _Pair(point=point, marker=at_centers[name])
        for name, point in shape.centers.items()
        if name in centers
    }
    for marker in model.markers:
        landmark = landmark_of_marker(marker.name)
        if landmark in shape.landmarks and marker.name not in pairs:
            pairs[marker.name] = _Pair(point=shape.landmarks[landmark], marker=marker)
    known = (*centers, "pelvis", "head top")
    missed = tuple(name for name in shape.centers if name not in known)
    return _SharedPoints(pairs=pairs, missed=missed)


def _aligned(points: Array, targets: Array, names: Sequence[str]) -> _Placed:
    """Find the rotation and translation that bring points nearest to targets.

    By those of the trunk if there are enough. With the singular values of the covariance of targets
    q and points p about their means,

        sum (q - q_mean)(p - p_mean)^T = U S V^T,   R = U diag(1, 1, det(U V^T)) V^T

    Source: Kabsch 1976.

    Parameters
    ----------
    points, targets : (n, 3) [m]
    names : (n,)

    Returns
    -------
    the movement

    Raises
    ------
    BadData : the points lie on one line
    """
    trunk = [i for i, name in enumerate(names) if _is_of_trunk(name)]
    for used in (trunk, list(range(len(names)))):
        if len(used) < MIN_POINTS:
            continue
        p = points[used]
        q = targets[used]
        u, sizes, vt = np.linalg.svd((q - q.mean(axis=0)).T @ (p - p.mean(axis=0)))
        if sizes[1] > MIN_WIDTH * sizes[0]:
            sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
            rotation = u @ sign @ vt
            translation = q.mean(axis=0) - rotation @ p.mean(axis=0)
            return _Placed(rotation=rotation, translation=translation)
    raise BadData("the points that model and body share lie on one line: give a landmark beside it")


def _is_of_trunk(name: str) -> bool:
    """Whether a marker, a landmark or a joint center moves with the trunk."""
    title = f"{name} {landmark_of_marker(name)}"
    return any(part in title for part in TRUNK)


def _default_pose(model: Model, skin: Skin) -> PoseFit:
    """Take the model's default pose, once the skin is seen to be around it.

    Raises
    ------
    BadData : less than `SHARE_INSIDE` of the mass centers are inside the skin
    """
    tree = compile_tree(model)
    values = tree.coordinates_of(DEFAULT_POSE)
    pose = Motion(np.zeros(1), model.coordinate_names, values[:1])
    links = links_of(model, pose)
    heavy = [i for i, body in enumerate(model.bodies) if body.mass > 0.0]
    within = inside(skin, links.centers[heavy])
    outside = [links.names[i] for i, is_inside in zip(heavy, within, strict=True) if not is_inside]
    if within.mean() < SHARE_INSIDE:
        axes = f"; it stands along {skin.up}" if skin.up else ""
        raise BadData(
            f"the skin is not where model '{model.name}' stands in its default pose: {len(outside)}"
            f" of {len(heavy)} mass centers are outside of it, as that of '{outside[0]}'{axes};"
            " give landmarks on the skin, or move it into the model's ground and default pose"
        )
    notes = [
        SKIN.message(
            "the skin was taken to be in the model's default pose and ground",
            severity="good to know",
        )
    ]
    if outside:
        notes.append(SKIN.message(f"mass centers outside of the skin: {', '.join(outside[:6])}"))
    return PoseFit(
        motion=pose,
        skin=skin,
        rotation=np.eye(3),
        translation=np.zeros(3),
        names=(),
        errors=np.zeros(0),
        notes=tuple(notes),
    )


def landmark_of_marker(marker: str) -> str:
    """Find the landmark that a marker's name means: "right ASIS" for `R.ASIS`.

    Returns
    -------
    name of the landmark, "" where there is none
    """
    name = marker.strip().lower()
    for landmark, pattern in _MIDDLE:
        if re.fullmatch(pattern, name):
            return landmark
    for form in _FORMS:
        match = re.fullmatch(form, name)
        if match is None:
            continue
        base = re.sub(r"[. -]", "_", match["base"])
        side = "right" if match["side"][0] == "r" else "left"
        for landmark, pattern in _SIDED:
            if re.fullmatch(pattern, base):
                return f"{side} {landmark}"
    return ""
