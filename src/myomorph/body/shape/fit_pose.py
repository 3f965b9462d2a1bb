"""The pose in which a model's skeleton stands in a skin, by virtual markers, [D] 3.3."""

from __future__ import annotations

import re
from collections.abc import Mapping
from dataclasses import replace

import numpy as np

from myomorph.body.shape.points import links_of
from myomorph.body.shape.regions import Center, centers_of, regions_of
from myomorph.body.shape.shape import Shape
from myomorph.body.shape.skin import Skin, inside
from myomorph.core.model.arrays import Array, frozen_array, read_only
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import DEFAULT_POSE, Markers, Motion
from myomorph.core.motion.ik import InverseKinematicsOptions, inverse_kinematics
from myomorph.core.rigid.kinematics import marker_positions
from myomorph.core.rigid.tree import compile_tree

LANDMARK_WEIGHT = 0.1
"""Of a marker over a landmark, whose place on the model is that of some laboratory, and of the
spine's joint centers, which models place differently; the other joint centers weigh 1.
"""

SPINE = ("lumbar", "neck")
FAR = 0.03  # Root mean square of the errors above which the model is not of this body's size [m]
SHARE_INSIDE = 0.8
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
    notes: tuple[str, ...] = ()

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
    pairs, missed = _paired(model, centers, body, landmarks)
    if len(pairs) < 3:
        raise BadData(
            f"model '{model.name}' and the body share {len(pairs)} points: expected at least three"
            " markers or joint centers, as 'right knee'"
        )
    seen = np.array([point for point, _ in pairs.values()])
    virtual = replace(model, markers=tuple(marker for _, marker in pairs.values()))
    rotation, translation = _aligned(
        seen, marker_positions(virtual, DEFAULT_POSE).values[0], list(pairs)
    )
    recorded = Markers(np.zeros(1), tuple(pairs), (seen @ rotation.T + translation)[None])
    weights = {
        name: 1.0 if name in centers and name not in SPINE else LANDMARK_WEIGHT for name in pairs
    }
    if landmarks is not None:
        weights = dict.fromkeys(pairs, 1.0)
    pull = POSTURE if landmarks is None else InverseKinematicsOptions.posture_weight
    options = InverseKinematicsOptions(
        marker_weights=weights, iterations=ITERATIONS, posture_weight=pull
    )
    fit = inverse_kinematics(virtual, recorded, options)
    errors = frozen_array(fit.marker_error[0])
    notes = []
    if missed:
        notes.append(
            f"the model has no {', '.join(missed)}: what lies beyond belongs to the segment before"
        )
    counted = np.array([weights[name] == 1.0 for name in fit.marker_names])
    rms = float(np.sqrt(np.mean(np.square(errors[counted])))) if counted.any() else 0.0
    if rms > FAR:
        worst = int(np.argmax(np.where(counted, errors, 0.0)))
        notes.append(
            f"the model fits the skin within {1000 * rms:.0f} mm (root mean square;"
            f" '{fit.marker_names[worst]}' {1000 * errors[worst]:.0f} mm): it is not of this body's"
            " size; calibrate or scale it first"
        )
    if not fit.converged[0]:
        notes.append("the pose did not converge")
    motion = fit.motion
    return PoseFit(
        motion=motion,
        skin=skin.moved(rotation, translation),
        rotation=frozen_array(rotation),
        translation=frozen_array(translation),
        names=fit.marker_names,
        errors=errors,
        notes=tuple(notes),
    )


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


def _paired(
    model: Model,
    centers: Mapping[str, Center],
    body: Shape | Skin,
    landmarks: Mapping[str, Array] | None,
) -> tuple[dict[str, tuple[Array, Marker]], list[str]]:
    """Pair points of the body with virtual markers.

    Returns
    -------
    name to (3,) point and marker, and names of joint centers that the model lacks

    Raises
    ------
    UnknownName : a landmark is no marker or joint center of the model
    BadData : a landmark is no point
    """
    own = {marker.name: marker for marker in model.markers}
    at_centers = {
        name: Marker(name, center.joint.child, center.location) for name, center in centers.items()
    }
    pairs: dict[str, tuple[Array, Marker]] = {}
    if landmarks is not None:
        for name, point in landmarks.items():
            if name not in own and name not in centers:
                raise UnknownName(
                    "landmark", name, existing=(*own, *centers), where=f"model '{model.name}'"
                )
            if np.shape(point) != (3,) or not np.isfinite(point).all():
                raise BadData(
                    f"landmark '{name}': expected three finite coordinates, but got {point}"
                )
            pairs[name] = np.asarray(point, dtype=np.float64), (at_centers | own)[name]
        return pairs, []
    assert isinstance(body, Shape)
    pairs |= {
        name: (point, at_centers[name]) for name, point in body.centers.items() if name in centers
    }
    for name, marker in own.items():
        landmark = landmark_of_marker(name)
        if landmark in body.landmarks and name not in pairs:
            pairs[name] = body.landmarks[landmark], marker
    return pairs, [name for name in body.centers if name not in (*centers, "pelvis", "head top")]


def _aligned(points: Array, targets: Array, names: list[str]) -> tuple[Array, Array]:
    """Find the rotation and translation that bring points nearest to targets.

    By those of the trunk if there are enough (Kabsch 1976).

    Parameters
    ----------
    points, targets : (n, 3) [m]
    names : (n,)

    Returns
    -------
    (3, 3) and (3,) [m]

    Raises
    ------
    BadData : the points lie on one line
    """
    trunk = [
        i
        for i, name in enumerate(names)
        if any(part in f"{name} {landmark_of_marker(name)}" for part in TRUNK)
    ]
    for used in (trunk, list(range(len(names)))):
        if len(used) < 3:
            continue
        p = points[used]
        q = targets[used]
        u, size, vt = np.linalg.svd((q - q.mean(axis=0)).T @ (p - p.mean(axis=0)))
        if size[1] > 1e-3 * size[0]:
            break
    else:
        raise BadData(
            "the points that model and body share lie on one line: give a landmark beside it"
        )
    sign = np.diag([1.0, 1.0, np.sign(np.linalg.det(u @ vt))])
    rotation = u @ sign @ vt
    return rotation, q.mean(axis=0) - rotation @ p.mean(axis=0)


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
    outside = [links.names[i] for i, inside in zip(heavy, within, strict=True) if not inside]
    if within.mean() < SHARE_INSIDE:
        axes = f"; it stands along {skin.up}" if skin.up else ""
        raise BadData(
            f"the skin is not where model '{model.name}' stands in its default pose: {len(outside)}"
            f" of {len(heavy)} mass centers are outside of it, as that of '{outside[0]}'{axes};"
            " give landmarks on the skin, or move it into the model's ground and default pose"
        )
    notes = ["the skin was taken to be in the model's default pose and ground"]
    if outside:
        notes.append(f"mass centers outside of the skin: {', '.join(outside[:6])}")
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
    for form in (
        r"(?P<side>r|l|right|left)[._ -]?(?P<base>.+)",
        r"(?P<base>.+?)[._ -](?P<side>r|l|right|left)",
    ):
        match = re.fullmatch(form, name)
        if match is None:
            continue
        base = re.sub(r"[. -]", "_", match["base"])
        for landmark, pattern in _SIDED:
            if re.fullmatch(pattern, base):
                return f"{'right' if match['side'][0] == 'r' else 'left'} {landmark}"
    return ""
