"""Simulated case of `demo --study morph`: the bones of a leg, deformed by a known smooth field.

The bones are the left ones of `myo-sim`, mirrored to the right and deformed, with landmarks picked
on both; nobody was scanned.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import ArrayLike
from scipy.spatial import cKDTree

from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.study.morph_files import source_bones
from myomorph.core.model.arrays import Array, read_only
from myomorph.core.model.model import GROUND, Joint, Model
from myomorph.core.model.paths import Muscle, TendonWrap
from myomorph.core.model.spatial import Transform
from myomorph.core.model.surface import Surface
from myomorph.core.rigid.kinematics import forward_kinematics, standing_poses
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.analyze.leg_model import leg_model

BODIES = ("pelvis", "femur", "patella", "tibia", "talus", "calcn", "toes")
LANDMARKS = 12
PICKED = 0.001
"""Landmarks of each bone, and the standard deviation with which they are picked in the target [m].
"""

STRETCH = (1.06, 0.95, 1.09)
WAVES = (
    ((2.0, 9.0, -4.0), (0.9, 0.1, 0.4), 0.3),
    ((-7.0, 14.0, 3.0), (0.2, 0.3, -0.9), 1.9),
    ((11.0, -5.0, 12.0), (-0.5, 0.8, 0.3), 4.1),
)
"""Of the deformation: wave vector [rad/m], direction, phase [rad]."""

AMPLITUDE = 0.006  # Of each wave [m].
MIRROR = np.array([1.0, 1.0, -1.0])  # The left side's frames are the right side's mirrored in z.


@read_only
class Deformation:
    """A smooth field over the ground: a stretch of each axis and a sum of waves.

    y = diag(stretch) x + the sum over waves of amplitude direction sin(k x + phase).
    """

    stretch: Array
    waves: tuple[tuple[Array, Array, float], ...]
    amplitude: float

    def apply(self, points: ArrayLike) -> Array:
        """Deform points.

        Parameters
        ----------
        points : (..., 3) in ground [m]

        Returns
        -------
        (..., 3) deformed, in ground [m]
        """
        x = np.asarray(points, dtype=np.float64)
        moved: Array = x * self.stretch
        for wave, direction, phase in self.waves:
            moved = moved + self.amplitude * np.sin(x @ wave + phase)[..., None] * direction
        return moved

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives of the deformed points with the points.

        Parameters
        ----------
        points : (..., 3) in ground [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]
        """
        x = np.asarray(points, dtype=np.float64)
        slopes: Array = np.broadcast_to(np.diag(self.stretch), (*x.shape[:-1], 3, 3)).copy()
        for wave, direction, phase in self.waves:
            slopes += (
                self.amplitude
                * np.cos(x @ wave + phase)[..., None, None]
                * np.outer(direction, wave)
            )
        return slopes


@read_only
class BodyTruth:
    """The deformation in a body's frames, from its frame in the source to that in the target."""

    field: Deformation
    pose: Transform  # of the body in the source's default pose
    origin: Array  # of its frame in the target, in ground; its axes keep their directions [m]

    def apply(self, points: ArrayLike) -> Array:
        """Map points of the source's frame into the target's.

        Parameters
        ----------
        points : (..., 3) in the source's frame of the body [m]

        Returns
        -------
        (..., 3) in the target's frame of the body [m]
        """
        placed = self.field.apply(self.pose.apply(np.asarray(points, dtype=np.float64)))
        return (placed - self.origin) @ self.pose.rotation

    def jacobian(self, points: ArrayLike) -> Array:
        """Return the derivatives of the deformed points with the points.

        Parameters
        ----------
        points : (..., 3) in the source's frame of the body [m]

        Returns
        -------
        (..., 3, 3) derivatives [m/m]
        """
        R = self.pose.rotation
        return R.T @ self.field.jacobian(self.pose.apply(np.asarray(points, dtype=np.float64))) @ R


def demo_case() -> tuple[Model, dict[str, Surface], dict[str, Surface], dict[str, BodyTruth]]:
    """Return the right leg, its bones, the deformed bones, and the true maps, by body."""
    whole = leg_model()
    model = right_leg(whole)
    surfaces = source_bones(whole)
    names = {body: body if body == "pelvis" else f"{body}_r" for body in BODIES}
    left = {names[body]: surfaces[body if body == "pelvis" else f"{body}_l"] for body in BODIES}
    truth = truths(model)
    right = {
        body: Surface(surface.vertices * MIRROR, surface.faces[:, ::-1])
        for body, surface in left.items()
    }
    theirs = {body: _deformed(surface, truth[body]) for body, surface in right.items()}
    return model, {body: surfaces[body] for body in truth}, theirs, truth


def right_leg(whole: Model) -> Model:
    """Pelvis and right leg of the legs of `myo-sim`, the pelvis held where it stands."""
    kept = {"pelvis"} | {f"{body}_r" for body in BODIES if body != "pelvis"}
    root = Joint(
        name="ground_pelvis",
        kind="WeldJoint",
        parent=GROUND,
        child="pelvis",
        parent_frame=standing_poses(whole)["pelvis"],
        child_frame=Transform.identity(),
    )
    joints = [joint for joint in whole.joints if joint.child in kept and joint.child != "pelvis"]
    moved = {name for joint in joints for name in joint.coordinates}
    muscles = tuple(
        _led(muscle)
        for muscle in whole.muscles
        if {point.body for point in muscle.path.points} <= kept
    )
    used = {wrap.wrap_object for muscle in muscles for wrap in muscle.path.wraps}
    return replace(
        whole,
        name="right leg",
        bodies=_named(whole.bodies, kept),
        joints=(root, *joints),
        coordinates=_named(whole.coordinates, moved),
        muscles=muscles,
        wrap_objects=_named(whole.wrap_objects, used),
        couplers=tuple(coupler for coupler in whole.couplers if coupler.dependent in moved),
        markers=(),
        actuators=(),
        frames=(),
        kept=(),
        ground_meshes=(),
    )


def _named(parts: Iterable[Any], names: Collection[str]) -> tuple[Any, ...]:
    """Return the parts that have one of these names."""
    return tuple(part for part in parts if part.name in names)


def _led(muscle: Muscle) -> Muscle:
    """Lead a muscle past its side sites by the rule of MuJoCo 4.0, whichever version is installed.

    By the rule before, the iliacus changes the side of its surface in bones that are bent a little.
    """
    wraps = tuple(
        replace(wrap, version=4) for wrap in muscle.path.wraps if isinstance(wrap, TendonWrap)
    )
    return replace(muscle, path=replace(muscle.path, wraps=wraps)) if wraps else muscle


def truths(model: Model) -> dict[str, BodyTruth]:
    """Return the one deformation as each body sees it.

    Each frame moves with its origin and keeps its directions.
    """
    waves = tuple(
        (np.array(wave), np.array(d) / np.linalg.norm(d), phase) for wave, d, phase in WAVES
    )
    field = Deformation(np.array(STRETCH), waves, AMPLITUDE)
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.defaults[None]).transforms()
    return {
        body: BodyTruth(field, poses[body], field.apply(poses[body].translation))
        for body in model.body_names
    }


def _deformed(surface: Surface, truth: BodyTruth) -> Surface:
    """Deform a surface, and cut each triangle into four.

    Its triangles then differ from the source's.
    """
    # Brings SciPy and trimesh: loaded only where it is needed.
    import trimesh

    vertices, faces = trimesh.remesh.subdivide(np.array(surface.vertices), np.array(surface.faces))
    return Surface(truth.apply(vertices), faces)


def picked_landmarks(
    ours: Mapping[str, Surface], truth: Mapping[str, BodyTruth]
) -> dict[str, FeaturePoints]:
    """Spread landmarks over each bone, picked in the target with an error of `PICKED`.

    The errors are the same in every call.
    """
    random = np.random.default_rng(0)
    result = {}
    for body, surface in ours.items():
        points = surface.vertices[spread_vertices(surface, LANDMARKS)]
        seen = truth[body].apply(points) + PICKED * random.standard_normal(points.shape)
        result[body] = FeaturePoints(
            tuple(f"{body} {i + 1}" for i in range(len(points))), points, seen
        )
    return result


def spread_vertices(surface: Surface, count: int) -> np.ndarray:
    """Choose vertices that are as far from each other as can be.

    The first is the one furthest from the middle, each next one the furthest from those chosen.

    Parameters
    ----------
    surface : vertices to choose from
    count : number of vertices; all where the surface has fewer

    Returns
    -------
    (count,) indices of vertices
    """
    vertices = surface.vertices
    chosen = [int(np.argmax(np.linalg.norm(vertices - vertices.mean(axis=0), axis=1)))]
    while len(chosen) < min(count, len(vertices)):
        chosen.append(int(np.argmax(cKDTree(vertices[chosen]).query(vertices)[0])))
    return np.array(chosen)
