"""Bones that find each other without landmarks.

They are affine copies and random smooth deformations of a model's own bones, so that what became
of every attachment is known. Deformed bones lie anywhere (random rotations), are stretched
differently along random axes, and bent by a random smooth displacement; their triangles are not
the source's.
"""

from __future__ import annotations

import time
from collections.abc import Iterator
from functools import cache

import numpy as np
import trimesh
from scipy.spatial.transform import Rotation

import myomorph as mm
from benchmarks.accuracy.morph.shapes import attachments, cases
from data_collection import data_folder
from myomorph.bones.morph.maps.fields import FeaturePoints
from myomorph.bones.morph.registration.bone_checks import repaired_bone
from myomorph.bones.morph.transfer.body_transfer import Transfer
from myomorph.bones.morph.transfer.points import place_of, put_on_surface
from myomorph.bones.study.morph_files import source_bones
from myomorph.core.surfaces.linear_maps import procrustes
from myomorph.core.surfaces.surface_points import Shape
from truths.leg_shapes import leg_shapes

MODEL = "rajagopal-walk-emg/subject_walk_scaled.osim"
GEOMETRY = "bones-opensim-rajagopal/Geometry"
BONES = ("pelvis", "femur_r", "tibia_r", "patella_r", "talus_r", "calcn_r", "toes_r")
SEEDS = range(22, 42)
"""Deformations that were not used to choose anything: some below 22 were."""

STRETCH = 0.06
SIZE = 0.08
"""Standard deviations of the logarithms of three stretches, and of the size."""

BEND = 0.02
WIDTH = 0.35
"""Standard deviation of the displacement along an axis, and the distance over which it goes
together, in shares of the bone's length.
"""

EDGE = 0.03
"""Longest edge of the target's triangles before they are deformed, in shares of the bone's length.
"""

WITHIN = 0.02
"""As `MorphOptions.surface_within`."""

AFFINE = (0.25, 0.05)
"""Largest logarithms of stretches of the affine copies along an axis: one longer, one shorter, one
between.
"""

HELD_OUT = 2
"""Of the persons of LLP26 those with an even number: settings were chosen on odd ones."""

Row = dict[str, object]


class Deformation:
    """A random map of space: rotated, stretched and, unless `bend` is 0, smoothly bent."""

    def __init__(self, surface: mm.Surface, seed: int, bend: float = BEND, width: float = WIDTH):
        random = np.random.default_rng(seed)
        self.middle = surface.vertices.mean(axis=0)
        axes = np.linalg.svd(surface.vertices - self.middle, full_matrices=False)[2]
        self.length = float(np.ptp((surface.vertices - self.middle) @ axes[0]))
        turn = Rotation.random(random_state=random).as_matrix()
        around = Rotation.random(random_state=random).as_matrix()
        logs = STRETCH * random.normal(size=3) + SIZE * random.normal()
        if not bend:
            logs = np.array([AFFINE[0], -AFFINE[0], AFFINE[1]]) * random.uniform(0.5, 1.0, 3)
        self.matrix = turn @ (around * np.exp(logs)) @ around.T
        self.offset = 0.3 * random.normal(size=3)
        self.waves = random.normal(size=(200, 3)) / width
        self.phases = random.uniform(0.0, 2.0 * np.pi, 200)
        self.heights = bend * np.sqrt(2.0 / 200) * random.normal(size=(200, 3))

    def __call__(self, points: np.ndarray) -> np.ndarray:
        """Where points (n, 3) go [m]."""
        unit = (points - self.middle) / self.length
        bent = unit + np.cos(unit @ self.waves.T + self.phases) @ self.heights
        moved: np.ndarray = (self.middle + self.length * bent) @ self.matrix.T + self.offset
        return moved


@cache
def bone(body: str) -> tuple[mm.Surface, np.ndarray, np.ndarray]:
    """Return a bone of the model and the muscle points fixed to it.

    On a bone are the ends of paths, and what is nearer to the surface than `WITHIN`. The rest are
    points in soft tissue beside it. Of the talus, which has no muscle points, they are points of
    its surface.

    Parameters
    ----------
    body : of the bone

    Returns
    -------
    The surface; (n, 3) the points in the body's frame [m]; (n,) which of them are on the bone
    """
    model = mm.read_model(data_folder() / MODEL)
    surface = repaired_bone(source_bones(model, data_folder() / GEOMETRY)[body], body, [])
    coordinates = {one.name: one for one in model.coordinates}
    paths = [muscle.path.points for muscle in model.muscles]
    owned = [
        (point, point in (path[0], path[-1]))
        for path in paths
        for point in path
        if point.body == body
    ]
    if not owned:
        places = surface.vertices[::8]
        return surface, places, np.ones(len(places), dtype=bool)
    places = np.array([place_of(point, coordinates) for point, _ in owned])
    away = np.linalg.norm(places - Shape(surface).closest(places)[0], axis=1)
    ends = np.array([end for _, end in owned])
    return surface, places, ends | (away <= WITHIN * np.ptp(surface.vertices, axis=0).max())


def deformed(surface: mm.Surface, deformation: Deformation) -> mm.Surface:
    """Return the bone after a deformation, cut into smaller triangles before."""
    edge = EDGE * deformation.length
    vertices, faces = trimesh.remesh.subdivide_to_size(surface.vertices, surface.faces, edge)
    return mm.Surface(deformation(vertices), faces)


def three_landmarks(surface: mm.Surface) -> np.ndarray:
    """Return vertices as far from each other as they go: ends of the bone.

    Parameters
    ----------
    surface : of the bone

    Returns
    -------
    (3, 3) [m]
    """
    vertices = surface.vertices
    chosen = [int(np.argmax(np.linalg.norm(vertices - vertices.mean(axis=0), axis=1)))]
    away = np.linalg.norm(vertices - vertices[chosen[0]], axis=1)
    for _ in range(2):
        chosen.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(vertices - vertices[chosen[-1]], axis=1))
    return vertices[chosen]


def carried(
    body: str,
    source: mm.Surface,
    target: mm.Surface,
    points: np.ndarray,
    landmarks: FeaturePoints | None = None,
) -> tuple[np.ndarray, np.ndarray]:
    """Return where points of a bone go without manual landmarks, and within which distance.

    Parameters
    ----------
    body : of the bone
    source : surface of the bone
    target : surface of the bone in the other body
    points : (n, 3) on or near the source [m]
    landmarks : pairs, None for none

    Returns
    -------
    (n, 3) positions [m], and (n,) the distance within which they belong with 90 % [m]
    """
    carrier = Transfer(mm.map_bone(body, source, target, landmarks), body)
    return put_on_surface(carrier, points, WITHIN).points, carrier.within(points)


def measure(what: str, seeds: range = SEEDS, bones: tuple[str, ...] = BONES) -> Iterator[Row]:
    """Yield a row for each bone, and one for all.

    `what`: "affine", "smooth", or "landmarks": smooth with three landmarks.
    """
    every: list[tuple[np.ndarray, ...]] = []
    beside: list[tuple[np.ndarray, ...]] = []
    for body in bones:
        _, _, on = bone(body)
        found = []
        flesh = []
        began = time.process_time()
        for seed in seeds:
            values = _target_errors(body, what, seed)
            found.append(tuple(one[on] for one in values))
            flesh.append(tuple(one[~on] for one in values))
        every += found
        beside += flesh
        spent = {"processor, a bone [s]": (time.process_time() - began) / len(found)}
        yield {"bone": body} | errors(found) | in_flesh(flesh) | spent
    yield {"bone": "all"} | errors(every) | in_flesh(beside) | {"processor, a bone [s]": ""}


def _target_errors(body: str, what: str, seed: int) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Carry a bone's points into one deformed copy.

    The results are (n,) errors, intervals, and errors of a whole-bone similarity [m].
    """
    surface, points, _ = bone(body)
    change = Deformation(surface, seed, 0.0 if what == "affine" else BEND)
    marks = None
    if what == "landmarks":
        ends = three_landmarks(surface)
        marks = FeaturePoints(("a", "b", "c"), ends, change(ends))
    places, within = carried(body, surface, deformed(surface, change), points, marks)
    truth = change(points)
    whole = procrustes(surface.vertices, change(surface.vertices), True)
    scaled = np.linalg.norm(whole.apply(points) - truth, axis=1)
    return np.linalg.norm(places - truth, axis=1), within, scaled


def errors(found: list[tuple[np.ndarray, ...]]) -> Row:
    """Return errors of attachments of several targets.

    The row has those of a whole-bone similarity too, and how often intervals hold.

    Parameters
    ----------
    found : of each target (n,) errors, intervals, and errors of a similarity [m]

    Returns
    -------
    The row
    """
    away, within, scaled = map(np.concatenate, zip(*found, strict=True))
    return {
        "targets": len(found),
        "scaling, median [mm]": 1e3 * float(np.median(scaled)),
        "median [mm]": 1e3 * float(np.median(away)),
        "95 % [mm]": 1e3 * float(np.percentile(away, 95)),
        "largest [mm]": 1e3 * float(away.max()),
        "interval, median [mm]": 1e3 * float(np.median(within)),
        "intervals hold [%]": 100.0 * float(np.mean(away <= within)),
    }


def in_flesh(found: list[tuple[np.ndarray, ...]]) -> Row:
    """Return errors of points beside the bones, and how often intervals hold.

    Parameters
    ----------
    found : of each target (n,) errors, intervals, and errors of a similarity [m]

    Returns
    -------
    The row, with the number of points of a target
    """
    away, within, _ = map(np.concatenate, zip(*found, strict=True))
    known = len(away) > 0
    return {
        "beside the bone: points": len(away) // len(found),
        "95 % of them [mm]": 1e3 * float(np.percentile(away, 95)) if known else "",
        "the largest [mm]": 1e3 * float(away.max()) if known else "",
        "their intervals hold [%]": 100.0 * float(np.mean(away <= within)) if known else "",
    }


def measure_affine() -> Iterator[Row]:
    """Bones that are only stretched and sheared."""
    return measure("affine", range(20, 23))


def measure_smooth() -> Iterator[Row]:
    """Bones that are bent too."""
    return measure("smooth")


def measure_landmarks() -> Iterator[Row]:
    """Bent bones with three landmarks."""
    return measure("landmarks", range(20, 25))


def measure_persons() -> Iterator[Row]:
    """Carry the mean of the 25 others of LLP26 into the bone of a person.

    Each row is of a bone and method, by held-out persons alone.
    """
    for name in leg_shapes():
        some = [
            case
            for k, case in enumerate(c for c in cases("mean") if c.bone == name)
            if k % HELD_OUT == 0
        ]
        faces = leg_shapes()[name].faces
        points = attachments()[name]
        ways: dict[str, list[tuple[np.ndarray, ...]]] = {}
        for case in some:
            source = mm.Surface(case.template, faces)
            target = mm.Surface(case.person, faces)
            here = points.on(case.template)
            truth = points.on(case.person)
            whole = procrustes(case.template, case.person, True)
            scaled = np.linalg.norm(whole.apply(here) - truth, axis=1)
            for way, count in (("no landmarks", 0), ("three landmarks", 3)):
                ends = three_landmarks(source)
                index = [
                    int(np.argmin(np.linalg.norm(case.template - one, axis=1))) for one in ends
                ]
                marks = FeaturePoints(("a", "b", "c"), ends, case.person[index]) if count else None
                places, within = carried(name, source, target, here, marks)
                ways.setdefault(way, []).append(
                    (np.linalg.norm(places - truth, axis=1), within, scaled)
                )
        for way, found in ways.items():
            yield {"bone": name, "way": way} | errors(found)
