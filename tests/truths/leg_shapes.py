"""The 26 persons of the shape model LLP26: nodes in correspondence, and triangles over them.

The elements of GIAS "fieldwork" meshes are squares and triangles with rows of nodes; a triangle
mesh over the nodes themselves needs no shape functions.
"""

from __future__ import annotations

import json
from dataclasses import dataclass
from functools import cache
from pathlib import Path

import numpy as np

from data_collection import data_folder

BONES = {
    "pelvis": ("pelvis_combined_cubic_flat", 1946),
    "femur": ("femur_left_quartic_flat", 634),
    "patella": ("patella_11_left", 74),
    "tibia": ("tibia_fibula_left_cubic_flat", 571),
}
"""Mesh and number of nodes, in the order of the model's nodes."""

ROWS = {
    "quad44": [4] * 4,
    "quad54": [5] * 4,
    "quad55": [5] * 5,
    "tri10": [4, 3, 2, 1],
    "tri15": [5, 4, 3, 2, 1],
}
"""Nodes in each row of an element."""


@dataclass(frozen=True, eq=False)
class Shapes:
    """One bone of all persons.

    Attributes
    ----------
    nodes : (26, n, 3) in the frame of the model: x to the left, z up [m]
    faces : (m, 3)
    """

    nodes: np.ndarray
    faces: np.ndarray


@cache
def leg_shapes() -> dict[str, Shapes]:
    """Every bone of every person, from the model's modes and the persons' scores."""
    folder = data_folder() / "bones-shape-model-llp26"
    model = np.load(folder / "shape_models" / "LLP26_rigid.npz")
    persons = (model["mean"][:, None] + model["modes"] @ model["projectedWeights"]).T
    nodes = 1e-3 * persons.reshape(len(persons), 3, -1).transpose(0, 2, 1)
    first = 0
    shapes = {}
    for bone, (mesh, count) in BONES.items():
        shapes[bone] = Shapes(
            nodes[:, first : first + count], mesh_faces(folder / "atlas_meshes", mesh)
        )
        first += count
    return shapes


def mesh_faces(folder: Path, name: str) -> np.ndarray:
    """Return triangles over a mesh's nodes: elements share nodes, numbered as first met.

    Parameters
    ----------
    folder : of the data set
    name : of the mesh

    Returns
    -------
    (m, 3) node numbers; triangles with two equal corners are left out
    """
    mesh = json.loads((folder / f"{name}.mesh").read_text())
    order = json.loads((folder / f"{name}.ens").read_text())["custom_map"]
    shared = {
        _pair(one): [_pair(other) for other in text.split()]
        for one, text in mesh["connectivity"].items()
    }
    number: dict[tuple[int, int], int] = {}
    count = 0
    for place in sorted(shared):
        if place in number:
            continue
        for one in (place, *shared[place]):
            number[one] = count if order is None else order[str(count)]
        count += 1
    faces = []
    for element, kind in sorted(
        (int(one), text.split()[1]) for one, text in mesh["elements"].items()
    ):
        faces += [[number[element, node] for node in corner] for corner in _corners(ROWS[kind])]
    found = np.array(faces)
    return found[
        (found[:, 0] != found[:, 1]) & (found[:, 1] != found[:, 2]) & (found[:, 2] != found[:, 0])
    ]


def _pair(text: str) -> tuple[int, int]:
    element, node = text.split("_")
    return int(element), int(node)


def _corners(rows: list[int]) -> list[tuple[int, int, int]]:
    """Triangles between rows of nodes, all turning the same way."""
    start = np.concatenate([[0], np.cumsum(rows)])
    found = []
    for k in range(len(rows) - 1):
        low = start[k]
        high = start[k + 1]
        for i in range(rows[k] - 1):
            if i < rows[k + 1]:
                found.append((low + i, low + i + 1, high + i))
            if i + 1 < rows[k + 1]:
                found.append((low + i + 1, high + i + 1, high + i))
    return found
