"""Mass points on a grid inside a body.

What each weighs before anything is measured, and the links they belong to.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field
from functools import cached_property

import numpy as np
import scipy

from myomorph.body.shape.skin import Skin, inside
from myomorph.core.model.arrays import Array, freeze, frozen_array, read_only
from myomorph.core.model.errors import BadData, UnknownName
from myomorph.core.model.model import Model
from myomorph.core.model.series import Motion
from myomorph.core.rigid.kinematics import forward_kinematics
from myomorph.core.rigid.tree import compile_tree

SPACING = 0.005  # That of [D] [m]
BLOCK = 4
# Grid points in the box around a body; more would not fit into a laptop
MAX_GRID_POINTS = 60_000_000
DENSITIES: Mapping[str, float] = {
    "head": 1110.0,
    "upper_trunk": 920.0,
    "lower_trunk": 1010.0,
    "upper_arm": 1070.0,
    "lower_arm": 1130.0,
    "hand": 1160.0,
    "thigh": 1050.0,
    "shank": 1090.0,
    "foot": 1100.0,
}
"""Dempster 1955 as tabulated by Winter 2009, table 4.1 [kg/m^3]; the lungs are part of the upper
trunk.
"""


@read_only
class Links:
    """The bodies of a model in one pose, in ground.

    Attributes
    ----------
    names : of the bodies, in the model's order
    rotations, origins : (links, 3, 3), (links, 3) of the bodies' frames [m]
    centers : (links, 3) mass centers of the model that mass points are for [m]
    bones : (bones, 2, 3) straight pieces between joint centers (and to mass centers and markers at
        the ends of limbs), for distances to a bone [m]
    bone_links : (bones,) link of each
    """

    names: tuple[str, ...]
    rotations: Array
    origins: Array
    centers: Array
    bones: Array = field(default_factory=lambda: np.zeros((0, 2, 3)))
    bone_links: np.ndarray = field(default_factory=lambda: np.zeros(0, np.int64))


@read_only
class MassPoints:
    """Points that a body's mass is thought to sit in, [D] eq. 3.5-3.9.

    Attributes
    ----------
    points : (points, 3) in ground [m]
    reference : (points,) masses before anything is identified, rho_ref [kg]
    weights : (points, links) share of each point in each link, w_ij; rows sum to 1
    links : the links in the same pose
    spacing : of the grid [m]
    source : what the points fill, in words: the user's skin, a statistical shape, envelopes
    spread : (links,) relative standard deviations of the links' masses among people with the same
        measurements; None where no survey says it
    """

    points: Array
    reference: Array
    weights: scipy.sparse.csr_array
    links: Links
    spacing: float
    source: str = ""
    spread: Array | None = None

    def __post_init__(self) -> None:
        freeze(self, points=(-1, 3), reference=(len(self.points),))
        if self.spread is not None:
            freeze(self, spread=(len(self.links.names),))
        if self.weights.shape != (len(self.points), len(self.links.names)):
            raise BadData(
                f"expected weights ({len(self.points)}, {len(self.links.names)}), got"
                f" {self.weights.shape}"
            )

    @cached_property
    def typical_spread(self) -> float | None:
        """Root mean square of `spread` over links that have a mass."""
        if self.spread is None:
            return None
        heavy = np.asarray(self.weights.T @ self.reference) > 0.0
        return float(np.sqrt(np.mean(np.square(self.spread[heavy]))))

    @cached_property
    def relative_spread(self) -> Array:
        """(links,) `spread` over its typical size; 1 where no survey says it."""
        if self.spread is None or self.typical_spread is None:
            return np.ones(len(self.links.names))
        return self.spread / self.typical_spread

    @cached_property
    def places(self) -> Array:
        """(links, 10, 10) from moments of a link's points to its parameters.

        The moments are 1, x, y, z, xx, yy, zz, yz, zx, xy.
        """
        return np.stack(
            [
                _from_moments(R, p)
                for R, p in zip(self.links.rotations, self.links.origins, strict=True)
            ]
        )

    def parameters(self, masses: Array) -> Array:
        """Compute the inertial parameters of the links, phi = W rho of [D] eq. 3.5.

        Parameters
        ----------
        masses : (points,) rho [kg]

        Returns
        -------
        (links, 10) in the order of [D] eq. 3.4
        """
        moments = self.weights.T @ (point_moments(self.points) * np.asarray(masses)[:, None])
        return np.einsum("lij,lj->li", self.places, moments)


def point_moments(points: Array) -> Array:
    """Compute the products 1, x, y, z, xx, yy, zz, yz, zx, xy of coordinates.

    Parameters
    ----------
    points : (points, 3) [m]

    Returns
    -------
    (points, 10)
    """
    x, y, z = np.asarray(points).T
    return np.stack([np.ones_like(x), x, y, z, x * x, y * y, z * z, y * z, z * x, x * y], axis=1)


def _from_moments(rotation: Array, origin: Array) -> Array:
    """Build the matrix from moments of a unit mass in ground to a link's parameters.

    [D] eq. 3.9, as a matrix on the moments of a point.

    Parameters
    ----------
    rotation, origin : (3, 3), (3,) of the link in ground [m]

    Returns
    -------
    (10, 10): a unit mass at x gives `result @ point_moments(x)`
    """
    # Coordinates in the link are r = R^T (x - p); as polynomials in x each r_a is `linear[a] . (1,
    # x, y, z)`.
    linear = np.hstack([-(rotation.T @ origin)[:, None], rotation.T])
    pairs = ((1, 1), (2, 2), (3, 3), (2, 3), (3, 1), (1, 2))

    def product(a: int, b: int) -> Array:
        square = np.outer(linear[a], linear[b])
        square = square + square.T
        quadratic = [square[i, j] * (0.5 if i == j else 1.0) for i, j in pairs]
        return np.concatenate([[0.5 * square[0, 0]], square[0, 1:], quadratic])

    second = {(a, b): product(a, b) for a in range(3) for b in range(a, 3)}
    xx = second[0, 0]
    yy = second[1, 1]
    zz = second[2, 2]
    first = np.hstack([linear, np.zeros((3, 6))])
    rows = [
        np.eye(10)[0],
        *first,
        yy + zz,
        zz + xx,
        xx + yy,
        -second[1, 2],
        -second[0, 2],
        -second[0, 1],
    ]
    return np.stack(rows)


def links_of(model: Model, pose: Motion) -> Links:
    """Place a model's bodies in the first frame of a motion, with bones between joint centers.

    A link's bones go from its own joint to the joints of its children, and from its joint through
    its mass center as far again beyond it, which is where a trunk holds a head that is no link of
    its own.

    Parameters
    ----------
    model : whose bodies are the links
    pose : its first frame counts

    Returns
    -------
    frames, mass centers and bones in ground [m]
    """
    frames = frames_in_ground(model, pose)
    rotations = frames[:, :3, :3]
    origins = frames[:, :3, 3]
    number = {name: i for i, name in enumerate(model.body_names)}
    centers = np.array(
        [origins[i] + rotations[i] @ body.mass_center for i, body in enumerate(model.bodies)]
    )
    joints = {}
    for joint in model.joints:
        i = number[joint.child]
        joints[joint.child] = origins[i] + rotations[i] @ joint.child_frame.translation
    pieces: list[tuple[int, Array, Array]] = []
    for i, name in enumerate(model.body_names):
        ends = [joints[joint.child] for joint in model.joints if joint.parent == name]
        ends.append(2.0 * centers[i] - joints[name])
        pieces += [(i, joints[name], end) for end in ends]
    return Links(
        names=model.body_names,
        rotations=frozen_array(rotations),
        origins=frozen_array(origins),
        centers=frozen_array(centers.reshape(-1, 3)),
        bones=frozen_array(np.array([(start, end) for _, start, end in pieces]).reshape(-1, 2, 3)),
        bone_links=np.array([i for i, _, _ in pieces], np.int64),
    )


def fill(skin: Skin, spacing: float = SPACING) -> Array:
    """Fill a skin with the points of a grid.

    They are those of `spacing` (i + 1/2, j + 1/2, k + 1/2) that are inside. The grid hangs on the
    origin of the skin's frame, so that a skin moved by a whole number of spacings has the same
    points, moved. Blocks of 4 x 4 x 4 points that no face passes are inside or outside as a whole.

    Parameters
    ----------
    skin : a body's surface [m]
    spacing : of the grid [m]

    Returns
    -------
    (points, 3) in the skin's frame [m]

    Raises
    ------
    BadData : the spacing is not above 0, or the grid has too many points, or none
    """
    if not spacing > 0.0:
        raise BadData(f"a spacing of {spacing:g} m: expected above 0")
    vertices = skin.surface.vertices
    faces = skin.surface.faces
    low = np.floor(vertices.min(axis=0) / spacing - 0.5).astype(np.int64)
    high = np.ceil(vertices.max(axis=0) / spacing - 0.5).astype(np.int64)
    blocks = (high - low) // BLOCK + 1
    if blocks.prod() * BLOCK**3 > MAX_GRID_POINTS:
        box = " x ".join(f"{length:.3g}" for length in np.ptp(vertices, axis=0))
        raise BadData(
            f"a grid of {1000 * spacing:g} mm in a box of {box} m is more than"
            f" {MAX_GRID_POINTS:,} points: give a wider spacing"
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
        within[tuple(part.T)] = inside(skin, (index.reshape(-1, 3) + low + 0.5) * spacing).reshape(
            -1, *(BLOCK,) * 3
        )
    cells = np.argwhere(within.transpose(0, 3, 1, 4, 2, 5).reshape(blocks * BLOCK))
    if not len(cells):
        raise BadData(
            f"no point of a grid of {1000 * spacing:g} mm is inside the skin: give a finer spacing"
        )
    return (cells + low + 0.5) * spacing


def _passed(corners: Array, faces: np.ndarray, blocks: np.ndarray) -> np.ndarray:
    """Find blocks into which the box around a face reaches.

    Parameters
    ----------
    corners : (vertices, 3) in grid steps
    faces : (faces, 3)
    blocks : (3,) number of blocks along each axis

    Returns
    -------
    (blocks) of three axes
    """
    index = np.floor((corners + 0.5) / BLOCK).astype(np.int64)[faces]
    spans = np.unique(np.concatenate([index.min(axis=1), index.max(axis=1) + 1], axis=1), axis=0)
    passed = np.zeros(blocks, np.bool_)
    for a, b, c, d, e, f in np.maximum(spans, 0).tolist():
        passed[a:d, b:e, c:f] = True
    return passed


def reference_masses(
    points: Array, mass: float, regions: Sequence[str] | np.ndarray | None = None
) -> Array:
    """Compute masses of points on a regular grid before anything is measured, rho_ref.

    M / N of [D], or in proportion to the density of each point's region, scaled to the whole mass.

    Parameters
    ----------
    points : (points, 3)
    mass : of the whole body [kg]
    regions : (points,) name of the region of each point, one of `DENSITIES`

    Returns
    -------
    (points,) [kg]

    Raises
    ------
    BadData : the mass is not above 0
    UnknownName : a region has no density
    """
    if not mass > 0.0:
        raise BadData(f"a mass of {mass:g} kg: expected above 0")
    if regions is None:
        return np.full(len(points), mass / len(points))
    names, owner = np.unique(np.asarray(regions), return_inverse=True)
    for name in names:
        if name not in DENSITIES:
            raise UnknownName(
                "region", str(name), existing=tuple(DENSITIES), where="the table of densities"
            )
    density = np.array([DENSITIES[name] for name in names])[owner]
    return density * (mass / density.sum())


def frames_in_ground(model: Model, pose: Motion) -> Array:
    """Compute poses of the bodies' frames in the first frame of a motion.

    Parameters
    ----------
    model : whose bodies they are
    pose : its first frame counts

    Returns
    -------
    (bodies, 4, 4) [m]
    """
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(pose)[:1])
    frames = np.tile(np.eye(4), (len(model.bodies), 1, 1))
    frames[:, :3, :3] = poses.rotations[0, 1:]
    frames[:, :3, 3] = poses.origins[0, 1:]
    return frames
