"""Non-rigid registration of a femur of 20,000 vertices: seconds and peak memory, placed and matched.

The femur is the man's of `bones-mri-two-adults`, onto the woman's, as scanned (a scan has more vertices than a model);
the model's bone has 456.
"""

from __future__ import annotations

import multiprocessing
import time

import numpy as np
import trimesh

from benchmarks.cases import data_folder
from benchmarks.speed.size import MEGABYTE, peak, resident
from myomorph.io.mesh import read_mesh
from myomorph.model.surface import Surface
from myomorph.morph.registration.map_bone import map_bone
from myomorph.morph.registration.nonrigid import match_surfaces, place_bone

VERTICES = 20_000


def run() -> list[dict[str, object]]:
    """A row in a process of its own, so that memory is its alone."""
    with multiprocessing.get_context("spawn").Pool(1) as pool:
        return [pool.apply(measure)]


def measure() -> dict[str, object]:
    """Both femurs at 20,000 vertices or more."""
    folder = data_folder() / "bones-mri-two-adults"
    source, target = (fine(folder / who / "femur_r.ply") for who in ("ICL_MRI", "MC22"))
    before = resident()
    began, used = time.perf_counter(), time.process_time()
    placed = place_bone(source, target)
    laid = time.perf_counter() - began
    found = match_surfaces(source, target, None, None, placed)
    seconds, cpu = time.perf_counter() - began, time.process_time() - used
    began = time.perf_counter()
    map_bone("femur_r", source, target)
    return {
        "source vertices": len(source.vertices),
        "target vertices": len(target.vertices),
        "placed [s]": laid,
        "placed and matched [s]": seconds,
        "of the processor [s]": cpu,
        "checked, matched and mapped [s]": time.perf_counter() - began,
        "peak [MB]": peak() / MEGABYTE,
        "of it before [MB]": before / MEGABYTE,
        "residual before the surface [mm]": 1e3 * found.quality.residual * found.length,
        "coverage": found.quality.coverage,
    }


def fine(path) -> Surface:
    """A bone [m] with its longest edges cut until it has enough vertices."""
    bone = read_mesh(path)
    vertices, faces, edge = 1e-3 * np.array(bone.vertices), np.array(bone.faces), 0.01
    while len(vertices) < VERTICES:
        edge *= 0.9
        vertices, faces = trimesh.remesh.subdivide_to_size(vertices, faces, edge)
    return Surface(vertices, faces)
