"""Maps of 53 bones with 2,000 features each: fitting them, and carrying 3,000 points of 997 elements with Jacobians.

Synthetic: ellipsoids of bones' sizes, bent smoothly. The paper's model has 53 bones and 997 muscles; 2,000 features on
every bone are the harder reading of the task, 2,000 on all of them together the easier. Beside it the whole transfer of
a real model's 520 muscles into such bones: points, joints, wrap objects, fibers, checks.
"""

from __future__ import annotations

import statistics

import numpy as np

import myomorph as mm
from benchmarks.speed.timing import clocked
from data_collection import data_folder
from myomorph.model.arrays import Array
from myomorph.morph.maps.fields import BoneMap, FeaturePoints, MapKind, MapOptions, PointMap, fit_map, inverted
from myomorph.morph.maps.linear import procrustes

BONES, ELEMENTS, POINTS, FEATURES = 53, 997, 3000, 2000
REPEATS = 5
EACH, ALL = (FEATURES, "on each bone"), (FEATURES // BONES, "on all bones")


def run() -> list[dict[str, object]]:
    """A row a kind of map and number of features."""
    kinds: tuple[MapKind, ...] = ("ssd", "rbf", "affine")
    return [*(measure(kind, *features) for kind in kinds for features in (EACH, ALL)), measure_transfer()]


def measure(kind: MapKind, features: int, where: str) -> dict[str, object]:
    """Seconds by the clock and by the processor, the median of some runs."""
    bones = [made_bone(k, features) for k in range(BONES)]
    fitted = clocked(lambda: [fit_map(one, MapOptions(map=kind)) for one in bones])
    maps = fitted.result
    places = muscle_points(bones)
    moved = [clocked(lambda: apply(maps, places)) for _ in range(REPEATS)]
    whole = [clocked(lambda: carry(maps, places)) for _ in range(REPEATS)]
    return {
        "map": kind,
        "features": f"{FEATURES} {where}",
        "elements": ELEMENTS,
        "points": POINTS,
        "points carried [s]": statistics.median(one.seconds for one in moved),
        "with Jacobians and folds [s]": statistics.median(one.seconds for one in whole),
        "of the processor [s]": statistics.median(one.cpu for one in whole),
        "maps fitted [s]": fitted.seconds,
        "fitted, of the processor [s]": fitted.cpu,
    }


def measure_transfer() -> dict[str, object]:
    """`morph_model` on the full body of 520 muscles, its maps given."""
    model = mm.read_model(data_folder() / "fullbody-many-muscles" / "cyclistFullBodyMuscle.osim")
    bones = {}
    for number, body in enumerate(model.body_names):
        given = made_bone(number, FEATURES)
        whole = procrustes(given.source, given.target, True)
        bones[body] = BoneMap(body, body, fit_map(given), whole, "given", features=given)
    morph = mm.morph_model(model, bones)
    times = [clocked(lambda: mm.morph_model(model, bones)) for _ in range(REPEATS)]
    return {
        "transfer": "520 muscles (real model), ssd",
        "bodies": len(bones),
        "features": f"{FEATURES} {EACH[1]}",
        "points": len(morph.points),
        "all carried [s]": statistics.median(one.seconds for one in times),
        "of the processor [s]": statistics.median(one.cpu for one in times),
    }


def apply(maps: list[PointMap], places: list[Array]) -> list[Array]:
    """Points alone."""
    return [one.apply(points) for one, points in zip(maps, places, strict=True)]


def carry(maps: list[PointMap], places: list[Array]) -> list[tuple[Array, Array, np.ndarray]]:
    """Points, what turns directions there, and where space is inside out."""
    pairs = zip(maps, places, strict=True)
    return [(one.apply(points), one.jacobian(points), inverted(one, points)) for one, points in pairs]


def made_bone(seed: int, features: int) -> FeaturePoints:
    """Points over an ellipsoid, long and thin, and over the same, bent."""
    random = np.random.default_rng(seed)
    around = random.normal(size=(features, 3))
    radii = random.uniform([0.01, 0.05, 0.01], [0.05, 0.22, 0.05])
    source = radii * around / np.linalg.norm(around, axis=1, keepdims=True)
    target = source * random.uniform(0.8, 1.2, 3) + random.uniform(-0.5, 0.5, 3) * source[:, [1]] ** 2
    return FeaturePoints(tuple(str(k) for k in range(features)), source, target)


def muscle_points(bones: list[FeaturePoints]) -> list[Array]:
    """Points (k, 3) on and beside each bone, 3,000 in all."""
    random, places = np.random.default_rng(0), []
    for share, one in zip(np.array_split(np.arange(POINTS), BONES), bones, strict=True):
        near = one.source[random.integers(0, len(one), len(share))]
        places.append(near + 0.02 * random.normal(size=near.shape))
    return places
