"""Closed surfaces whose volume is known, as skins."""

from __future__ import annotations

import numpy as np
import trimesh

from myomorph.core.model.surface import Surface


def surface_of(mesh: trimesh.Trimesh) -> Surface:
    return Surface(np.array(mesh.vertices), np.array(mesh.faces))


def sphere(radius: float = 0.1) -> Surface:
    return surface_of(trimesh.creation.icosphere(subdivisions=4, radius=radius))


def box(x: float = 0.2, y: float = 0.3, z: float = 0.1) -> Surface:
    return surface_of(trimesh.creation.box(extents=(x, y, z)))


def capsule(length: float = 0.4, radius: float = 0.06) -> Surface:
    return surface_of(trimesh.creation.capsule(height=length, radius=radius, count=[48, 48]))
