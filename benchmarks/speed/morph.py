"""Maps of 53 synthetic bones with 2,000 features, and a real model's muscles through them.

A scanned femur and a mouse are mapped too. 3,000 points of 997 elements are carried with Jacobians.
The femur is a man's of `bones-mri-two-adults` onto a woman's.
"""

from __future__ import annotations

import statistics
import tempfile
from pathlib import Path

import numpy as np
import trimesh

import myomorph as mm
from benchmarks.species_cases import BONES, MAN, MOUSE, man, mouse
from benchmarks.speed.timing import clocked, in_own_process
from data_collection import data_folder
from myomorph.bones.morph.maps.fields import (
    BoneMap,
    FeaturePoints,
    MapKind,
    MapOptions,
    PointMap,
    fit_map,
    inverted,
)
from myomorph.bones.morph.registration.nonrigid import match_surfaces, place_bone
from myomorph.bones.morph.registration.smooth import MatchOptions
from myomorph.bones.morph.species.counterparts import Skeleton
from myomorph.bones.morph.species.maps import SpeciesOptions, species_bones, species_morph
from myomorph.bones.study.morphing import MorphSettings, write_morphed
from myomorph.bones.study.species_morphing import SpeciesFiles, read_species, species_files
from myomorph.core.model.arrays import Array
from myomorph.core.surfaces.linear_maps import procrustes

SYNTHETIC_BONES = 53
ELEMENTS = 997
POINTS = 3000
FEATURES = 2000
REPEATS = 5
EACH = (FEATURES, "on each bone")
ALL = (FEATURES // SYNTHETIC_BONES, "on all bones")


def run() -> list[dict[str, object]]:
    """Return a row for each kind of map and number of features."""
    kinds: tuple[MapKind, ...] = ("ssd", "rbf", "affine")
    return [
        *(measure(kind, *features) for kind in kinds for features in (EACH, ALL)),
        measure_transfer(),
    ]


def measure(kind: MapKind, features: int, where: str) -> dict[str, object]:
    """Seconds by the clock and by the processor, the median of some runs."""
    bones = [made_bone(k, features) for k in range(SYNTHETIC_BONES)]
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
        bones[body] = BoneMap(
            body=body,
            target_body=body,
            map=fit_map(given),
            whole=whole,
            basis="given",
            features=given,
        )
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
    """Map points alone.

    Parameters
    ----------
    maps : one per bone
    places : (k, 3) points of each bone [m]

    Returns
    -------
    (k, 3) of each bone [m]
    """
    return [one.apply(points) for one, points in zip(maps, places, strict=True)]


def carry(maps: list[PointMap], places: list[Array]) -> list[tuple[Array, Array, np.ndarray]]:
    """Map points with all that a transfer of muscles needs there.

    Parameters
    ----------
    maps : one per bone
    places : (k, 3) points of each bone [m]

    Returns
    -------
    Of each bone (k, 3) points [m], (k, 3, 3) Jacobians, and (k,) where the map is inverted
    """
    pairs = zip(maps, places, strict=True)
    return [
        (one.apply(points), one.jacobian(points), inverted(one, points)) for one, points in pairs
    ]


def made_bone(seed: int, features: int) -> FeaturePoints:
    """Points over an ellipsoid, long and thin, and over the same, bent."""
    random = np.random.default_rng(seed)
    around = random.normal(size=(features, 3))
    radii = random.uniform([0.01, 0.05, 0.01], [0.05, 0.22, 0.05])
    source = radii * around / np.linalg.norm(around, axis=1, keepdims=True)
    target = (
        source * random.uniform(0.8, 1.2, 3) + random.uniform(-0.5, 0.5, 3) * source[:, [1]] ** 2
    )
    return FeaturePoints(tuple(str(k) for k in range(features)), source, target)


def muscle_points(bones: list[FeaturePoints]) -> list[Array]:
    """Draw points on and beside each bone, 3,000 in all.

    Parameters
    ----------
    bones : feature points of each

    Returns
    -------
    (k, 3) of each bone [m]
    """
    random = np.random.default_rng(0)
    places = []
    for share, one in zip(np.array_split(np.arange(POINTS), SYNTHETIC_BONES), bones, strict=True):
        near = one.source[random.integers(0, len(one), len(share))]
        places.append(near + 0.02 * random.normal(size=near.shape))
    return places


VERTICES = 20_000


def run_registration() -> list[dict[str, object]]:
    """Return a row in a process of its own, so that memory is its alone."""
    return [in_own_process(measure_registration)]


def measure_registration() -> dict[str, object]:
    """Both femurs at 20,000 vertices or more."""
    folder = data_folder() / "bones-mri-two-adults"
    source = fine(folder / "ICL_MRI" / "femur_r.ply")
    target = fine(folder / "MC22" / "femur_r.ply")
    placed = clocked(lambda: place_bone(source, target))
    matched = clocked(lambda: match_surfaces(source, target, None, None, placed.result))
    mapped = clocked(lambda: mm.map_bone("femur_r", source, target))
    quality = matched.result.quality
    return {
        "source vertices": len(source.vertices),
        "target vertices": len(target.vertices),
        "placed [s]": placed.seconds,
        "placed and matched [s]": placed.seconds + matched.seconds,
        "of the processor [s]": placed.cpu + matched.cpu,
        "checked, matched and mapped [s]": mapped.seconds,
        "peak [MB]": max(part.before + part.peak for part in (placed, matched, mapped)),
        "of it before [MB]": placed.before,
        "residual before the surface [mm]": 1e3 * quality.residual * matched.result.length,
        "coverage": quality.coverage,
    }


def fine(path) -> mm.Surface:
    """Read a bone [m] with its longest edges cut until it has enough vertices."""
    bone = mm.read_mesh(path)
    vertices = 1e-3 * np.array(bone.vertices)
    faces = np.array(bone.faces)
    edge = 0.01
    while len(vertices) < VERTICES:
        edge *= 0.9
        vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, edge)
    return mm.Surface(vertices, faces)


ALLOWED = 300.0


def run_species() -> list[dict[str, object]]:
    """Return a row for the maps of the bones, and one for bones and muscles.

    A third is for the whole way from files to files.
    """
    data = data_folder()
    table = read_species("human-mouse")
    source = man(data)
    target = mouse(data)
    given = (
        Skeleton(source.model, source.surfaces),
        Skeleton(target.model, target.surfaces),
        table,
    )
    # Kernels compile first, with the few features of landmarks.
    species_morph(*given, SpeciesOptions(match=MatchOptions(features="landmarks")))
    parts = {
        "maps of five bones": lambda: species_bones(*given),
        "and 40 muscles": lambda: species_morph(*given),
        "from files to model, tables and report": lambda: _files(data),
    }
    return [
        {
            "what": name,
            "seconds": taken.seconds,
            "CPU seconds": taken.cpu,
            "of the 5 min allowed": taken.seconds / ALLOWED,
            "peak [MB]": taken.before + taken.peak,
        }
        for name, taken in ((name, clocked(work)) for name, work in parts.items())
    ]


def _files(data: Path) -> None:
    files = SpeciesFiles(data / MAN, data / MOUSE, geometry=data / BONES)
    morphed, bones = species_files(files, MorphSettings())
    with tempfile.TemporaryDirectory() as folder:
        write_morphed(morphed, Path(folder) / "mouse.osim", Path(folder) / "mouse_morph", bones)
