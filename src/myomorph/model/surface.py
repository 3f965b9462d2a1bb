"""A triangulated surface as a value: a bone's mesh, a skin."""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from myomorph.model.arrays import Array, frozen_array
from myomorph.model.errors import BadData


@dataclass(frozen=True, eq=False)
class Surface:
    """Triangles over points.

    Attributes
    ----------
    vertices : (n, 3) in the surface's own frame [m]
    faces : (m, 3) indices of the vertices

    Raises
    ------
    BadData
        where a face names a vertex that does not exist, or a vertex is not finite
    """

    vertices: Array
    faces: NDArray[np.int64]

    def __post_init__(self) -> None:
        object.__setattr__(self, "vertices", frozen_array(self.vertices, (-1, 3)))
        faces = np.array(self.faces, dtype=np.int64).reshape(-1, 3)
        faces.setflags(write=False)
        object.__setattr__(self, "faces", faces)
        if len(faces) and (faces.min() < 0 or faces.max() >= len(self.vertices)):
            raise BadData(f"a face names vertex {int(faces.max())}, but there are {len(self.vertices)}")
        if not np.isfinite(self.vertices).all():
            raise BadData("a surface has vertices that are not finite")
