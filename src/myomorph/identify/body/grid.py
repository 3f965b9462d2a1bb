"""Mass points on a regular grid inside a body's skin, and what each weighs before anything is measured."""

from __future__ import annotations

from collections.abc import Mapping, Sequence

import numpy as np

from myomorph.identify.body.skin import Skin, inside
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData, UnknownName

SPACING = 0.005
"""That of [D] [m]."""

BLOCK = 4
MOST = 60_000_000
"""Grid points in the box around a body; more would not fit into a laptop."""


def fill(skin: Skin, spacing: float = SPACING) -> Array:
    """Points (points, 3) of the grid `spacing` (i + 1/2, j + 1/2, k + 1/2) that are inside the skin [m].

    The grid hangs on the origin of the skin's frame, so that a skin moved by a whole number of spacings
    has the same points, moved. Blocks of 4 x 4 x 4 points that no face passes are inside or outside as a whole.

    Raises
    ------
    BadData : a spacing that leaves no point inside, or too many to hold
    """
    if not spacing > 0.0:
        raise BadData(f"a spacing of {spacing:g} m: expected above 0")
    vertices, faces = skin.surface.vertices, skin.surface.faces
    low = np.floor(vertices.min(axis=0) / spacing - 0.5).astype(np.int64)
    high = np.ceil(vertices.max(axis=0) / spacing - 0.5).astype(np.int64)
    blocks = (high - low) // BLOCK + 1
    if blocks.prod() * BLOCK**3 > MOST:
        extent = np.ptp(vertices, axis=0)
        raise BadData(
            f"a grid of {1000 * spacing:g} mm in a box of {' x '.join(f'{x:.3g}' for x in extent)} m is more than "
            f"{MOST:,} points: give a wider spacing"
        )
    passed = _passed(vertices / spacing - 0.5 - low, faces, blocks)
    if not skin.watertight:
        passed[:] = True
    within = np.zeros((*blocks, BLOCK, BLOCK, BLOCK), np.bool_)
    whole = np.argwhere(~passed)
    within[tuple(whole[inside(skin, (whole * BLOCK + low + 0.5) * spacing)].T)] = True
    cut = np.argwhere(passed)
    offsets = np.argwhere(np.ones((BLOCK, BLOCK, BLOCK)))
    for part in np.array_split(cut, max(1, len(cut) // 4096)):
        index = part[:, None] * BLOCK + offsets
        within[tuple(part.T)] = inside(skin, (index.reshape(-1, 3) + low + 0.5) * spacing).reshape(-1, *(BLOCK,) * 3)
    found = np.argwhere(within.transpose(0, 3, 1, 4, 2, 5).reshape(blocks * BLOCK))
    if not len(found):
        raise BadData(f"no point of a grid of {1000 * spacing:g} mm is inside the skin: give a finer spacing")
    points: Array = (found + low + 0.5) * spacing
    return points


def _passed(corners: Array, faces: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """(blocks) whether the box around a face reaches into a block; corners in grid steps."""
    index = np.floor((corners + 0.5) / BLOCK).astype(np.int64)[faces]
    spans = np.unique(np.concatenate([index.min(axis=1), index.max(axis=1) + 1], axis=1), axis=0)
    passed = np.zeros(blocks, np.bool_)
    for a, b, c, d, e, f in np.maximum(spans, 0).tolist():
        passed[a:d, b:e, c:f] = True
    return passed


def reference_masses(
    points: Array,
    mass: float,
    regions: Sequence[str] | np.ndarray | None = None,
    densities: Mapping[str, float] | None = None,
) -> Array:
    """Masses (points,) that points on a regular grid have before anything is measured, rho_ref [kg].

    M / N of [D], or in proportion to the density of each point's region, scaled to the whole mass.

    Parameters
    ----------
    mass : of the whole body [kg]
    regions : (points,) name of the region of each point
    densities : by region [kg/m^3], such as `DENSITIES`

    Raises
    ------
    UnknownName : a region without a density
    """
    if not mass > 0.0:
        raise BadData(f"a mass of {mass:g} kg: expected above 0")
    if regions is None:
        return np.full(len(points), mass / len(points))
    densities = DENSITIES if densities is None else densities
    names, owner = np.unique(np.asarray(regions), return_inverse=True)
    for name in names:
        if name not in densities:
            raise UnknownName("region", str(name), tuple(densities), "the table of densities")
    density = np.array([densities[name] for name in names])
    if not (density > 0.0).all():
        raise BadData("a region's density is not above 0")
    result: Array = density[owner]
    return result * (mass / result.sum())


DENSITIES: Mapping[str, float] = {
    "head": 1110.0, "upper_trunk": 920.0, "lower_trunk": 1010.0, "upper_arm": 1070.0, "lower_arm": 1130.0,
    "hand": 1160.0, "thigh": 1050.0, "shank": 1090.0, "foot": 1100.0,
}  # fmt: skip
"""Dempster 1955 as tabulated by Winter 2009, table 4.1 [kg/m^3]; the lungs are part of the upper trunk."""
