"""Bones travel with a model: its meshes are put beside the file that it is written to."""

from __future__ import annotations

import shutil
from pathlib import Path

from myomorph.core.io.mesh import find_mesh, mesh_files, mesh_folders
from myomorph.core.io.parsing.door import MAX_SIZES
from myomorph.core.model.model import Model

GEOMETRY = "Geometry"
"""Folder beside a model where OpenSim looks for its meshes too."""


def carry_meshes(model: Model, folder: Path) -> None:
    """Copy the meshes that a model draws its bodies with to `Geometry` in a folder.

    Files keep the names that the model has for them. What is there already stays as it is, and a
    mesh that is found nowhere beside the model that was read is left out: pictures draw a stick.

    Parameters
    ----------
    model : with the path of the file that it was read from, beside which its meshes lie
    folder : where the model is written to
    """
    beside = mesh_folders(model)
    there = [folder, folder / GEOMETRY]
    for name in mesh_files(model):
        found = find_mesh(name, beside)
        if found is None or find_mesh(name, there) is not None:
            continue
        if found.stat().st_size > MAX_SIZES["a mesh"]:
            continue
        path = folder / GEOMETRY / name.replace("\\", "/")
        path.parent.mkdir(parents=True, exist_ok=True)
        shutil.copyfile(found, path)
