"""Ways to match two bones point by point, from the same start.

Measured are errors along the surface, distance to it, and seconds. Bones are those of the persons
of LLP26, whose correspondence is the truth as far as their fitted meshes are, and real bones of
`myo-sim` in a known smooth deformation, whose truth is exact. Each way's points are put on the
surface after.
"""

from __future__ import annotations

import time
from collections.abc import Callable, Iterator

import numpy as np
import trimesh
from made_bones import deformed, errors, made_target, real_bone
from scipy.interpolate import RBFInterpolator

import myomorph as mm
from myomorph.bones.morph.registration.nonrigid import vertex_normals
from myomorph.bones.morph.registration.smooth import (
    MatchOptions,
    SurfacePair,
    fit_smoothly,
    onto,
    spread_points,
)
from myomorph.core.surfaces.linear_maps import AffineMap, Similarity, procrustes
from myomorph.core.surfaces.surface_points import Shape
from truths.leg_shapes import leg_shapes

POINTS = 4000
"""Of the target, in the ways that know points alone."""

PAIRS = ((0, 5), (3, 11), (14, 2))


def run() -> list[dict[str, object]]:
    """Return a row for each way and kind of case."""
    rows: list[dict[str, object]] = []
    for kind, cases in (("persons of LLP26", list(persons())), ("made deformations", list(made()))):
        for name, way in ways().items():
            found = np.array([judged(way, *case) for case in cases])
            rows.append(
                {
                    "bones": kind,
                    "way": name,
                    "pairs": len(cases),
                    "along the surface [mm]": float(np.mean(found[:, 0])),
                    "worst pair [mm]": float(np.max(found[:, 0])),
                    "left before the surface [mm]": float(np.mean(found[:, 1])),
                    "of the processor [s]": float(np.median(found[:, 2])),
                }
            )
    return rows


def persons() -> Iterator[tuple[mm.Surface, mm.Surface, np.ndarray]]:
    """Yield pairs of persons' bones, lengths in shares of the source's.

    Yields
    ------
    Source, target, and (vertices, 3) where the source's vertices belong
    """
    for bone in ("femur", "tibia"):
        shapes = leg_shapes()[bone]
        for i, j in PAIRS:
            yield (
                mm.Surface(shapes.nodes[i], shapes.faces),
                mm.Surface(shapes.nodes[j], shapes.faces),
                shapes.nodes[j],
            )


def made() -> Iterator[tuple[mm.Surface, mm.Surface, np.ndarray]]:
    """Yield the same of bones in a deformation that is known.

    Yields
    ------
    Source, target, and (vertices, 3) where the source's vertices belong
    """
    for name in ("humerus", "r_pelvis"):
        bone = real_bone(name, 0.012)
        yield bone, made_target(bone), deformed(bone.vertices, bone)


Way = Callable[[Shape, Shape, Similarity], Callable[[np.ndarray], np.ndarray]]


def ways() -> dict[str, Way]:
    """By name: what maps the source's points smoothly near the target's."""
    options = MatchOptions()
    return {
        "similarity alone": lambda ours, goal, start: start.apply,
        "smooth displacement, point to plane": lambda ours, goal, start: (
            fit_smoothly(SurfacePair(ours, goal), AffineMap.from_similarity(start), options).apply
        ),
        "trimesh nricp_amberg": lambda ours, goal, start: _trimesh(
            "nricp_amberg", ours, goal, start
        ),
        "trimesh nricp_sumner": lambda ours, goal, start: _trimesh(
            "nricp_sumner", ours, goal, start
        ),
    }


def judged(
    way: Way, source: mm.Surface, target: mm.Surface, truth: np.ndarray
) -> tuple[float, float, float]:
    """Measure one way to match two bones.

    Parameters
    ----------
    way : to match
    source : surface
    target : surface
    truth : (vertices, 3) where the source's vertices belong

    Returns
    -------
    Errors along the surface [mm], distance before it [mm], and seconds of the processor
    """
    size = 1.0 / float(np.ptp(source.vertices, axis=0).max())
    ours = Shape(mm.Surface(size * source.vertices, source.faces))
    goal = Shape(mm.Surface(size * target.vertices, target.faces))
    start = procrustes(ours.vertices, size * truth, scale=True)
    began = time.process_time()
    moved = way(ours, goal, start)(ours.vertices)
    seconds = time.process_time() - began
    on = onto(goal, moved, vertex_normals(Shape(mm.Surface(moved, source.faces)))).points
    left = float(np.sqrt(np.mean(np.sum((on - moved) ** 2, axis=1))))
    return 1e3 * errors(on / size, truth, target)[1], 1e3 * left / size, seconds


def _trimesh(
    name: str, ours: Shape, goal: Shape, start: Similarity
) -> Callable[[np.ndarray], np.ndarray]:
    mesh = trimesh.Trimesh(start.apply(ours.vertices), ours.faces, process=False)
    points = spread_points(goal, POINTS)
    found = getattr(trimesh.registration, name)(mesh, points, use_faces=False)
    field = RBFInterpolator(mesh.vertices, found - mesh.vertices, neighbors=50, kernel="linear")
    return lambda asked: start.apply(asked) + field(start.apply(asked))
