"""Non-rigid registration of a femur of 20,000 vertices: seconds and peak memory, placed and matched.

The femur is the man's of `bones-mri-two-adults`, onto the woman's, as scanned (a scan has more vertices than a model);
the model's bone has 456.
"""

from __future__ import annotations

import numpy as np
import trimesh

import myomorph as mm
from benchmarks.speed.timing import clocked, in_own_process
from data_collection import data_folder
from myomorph.morph.registration.nonrigid import match_surfaces, place_bone

VERTICES = 20_000


def run() -> list[dict[str, object]]:
    """A row in a process of its own, so that memory is its alone."""
    return [in_own_process(measure)]


def measure() -> dict[str, object]:
    """Both femurs at 20,000 vertices or more."""
    folder = data_folder() / "bones-mri-two-adults"
    source, target = (fine(folder / who / "femur_r.ply") for who in ("ICL_MRI", "MC22"))
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
    """A bone [m] with its longest edges cut until it has enough vertices."""
    bone = mm.read_mesh(path)
    vertices, faces, edge = 1e-3 * np.array(bone.vertices), np.array(bone.faces), 0.01
    while len(vertices) < VERTICES:
        edge *= 0.9
        vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, edge)
    return mm.Surface(vertices, faces)
