"""Surfaces to files."""

from __future__ import annotations

import os
from pathlib import Path

import numpy as np

from myomorph.model.errors import BadFile
from myomorph.model.surface import Surface


def write_obj(surface: Surface, path: str | os.PathLike[str]) -> None:
    """Write a surface as Wavefront OBJ, in metres with eight digits; OpenSim and MuJoCo read it.

    Raises
    ------
    BadFile : the file cannot be written
    """
    path = Path(path)
    vertices = "\n".join(f"v {x:.8g} {y:.8g} {z:.8g}" for x, y, z in surface.vertices.tolist())
    faces = "\n".join(f"f {a} {b} {c}" for a, b, c in (np.asarray(surface.faces) + 1).tolist())
    try:
        path.write_text(f"{vertices}\n{faces}\n", encoding="ascii")
    except OSError as error:
        raise BadFile(path, f"cannot be written ({error.strerror or error})") from None
