"""A body's envelope grown around its skeleton, where nobody has a skin: every bone under soft tissue in its proportion.

Around each body of length L lies what is no further than c k L from the convex hull of its bones: k is the body's, or
the same for all, c is 1 or follows from the volume that the whole shall have. It is no skin: it knows nothing of a
belly, of fat, or of a person's training.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import field

import numpy as np
from scipy.spatial import ConvexHull, QhullError

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData, check_name, from_extra
from myomorph.model.frozen_map import FrozenMap
from myomorph.model.model import Model
from myomorph.model.series import DEFAULT_POSE, Motion
from myomorph.model.surface import Surface, hull_faces, signed_volume
from myomorph.morph.shapes.surface_points import Boxes
from myomorph.rigid.kinematics import forward_kinematics
from myomorph.rigid.tree import compile_tree

SOFT_TISSUE = 0.1  # Thickness of the soft tissue over a bone as a share of its length, where nothing else is known.
THINNEST, THICKEST = 0.002, 1.0  # Shares of bone length between which soft tissue is looked for.
WIDEST = 4.0  # Soft tissue grows to no more than so many times what it is at first, to reach a volume.
CELLS, COARSE = 128, 48  # Cells along the longest side of the skeleton; of a first look.
ROUNDS = 60


@read_only
class Envelope:
    """The space in and around a skeleton, as points on a regular grid."""

    points: Array  # (points, 3) in ground, each the middle of a cube [m]
    bodies: tuple[str, ...]  # names
    owner: np.ndarray  # (points,) body of each
    spacing: float  # edge of the cubes [m]
    surface: Surface  # of the whole, closed, in ground
    # thickness over each body's bones, as a share of its length
    soft_tissue: Mapping[str, float] = field(default_factory=lambda: FrozenMap({}))

    @property
    def volume(self) -> float:
        """[m^3]."""
        return len(self.points) * self.spacing**3

    @property
    def volumes(self) -> Mapping[str, float]:
        """Of each body [m^3]."""
        counts = np.bincount(self.owner, minlength=len(self.bodies)) * self.spacing**3
        return dict(zip(self.bodies, map(float, counts), strict=True))


@read_only
class Grid:
    """Points origin + spacing (i, j, k)."""

    origin: Array
    spacing: float
    counts: np.ndarray

    @property
    def size(self) -> int:
        """Number of its points."""
        return int(self.counts.prod())

    def places(self, index: np.ndarray) -> Array:
        """(n, 3) of points by their numbers."""
        return self.origin + self.spacing * np.stack(np.unravel_index(index, self.counts), axis=1)

    def box(self, low: Array, high: Array) -> np.ndarray:
        """Numbers of the points in a box."""
        first = np.maximum(np.floor((low - self.origin) / self.spacing).astype(np.int64), 0)
        last = np.minimum(np.ceil((high - self.origin) / self.spacing).astype(np.int64) + 1, self.counts)
        axes = [np.arange(a, b) for a, b in zip(first, last, strict=True)]
        return np.ravel_multi_index(np.meshgrid(*axes, indexing="ij"), self.counts).reshape(-1)


class Skeleton:
    """Convex hulls of a model's bones in one pose. `hulls`: corners in ground, by body [m]; `lengths`: greatest extent
    of each body's bones along an axis of the ground [m]; `groups`: of bodies with a common hull.
    """

    def __init__(
        self, model: Model, bones: Mapping[str, Surface], pose: Motion | None, together: Sequence[Sequence[str]]
    ):
        self.hulls = _posed_hulls(model, bones, pose)
        self.lengths = {name: float(np.ptp(bones[name].vertices, axis=0).max()) for name in self.hulls}
        for name in (body for group in together for body in group):
            check_name("body", name, model.body_names)
        groups = [[body for body in group if body in self.hulls] for group in together]
        self.groups = [group for group in groups if len(group) > 1]

    def grid(self, cells: int, reach: Mapping[str, float]) -> Grid:
        """A grid around all bones and what is within reach of each [m]."""
        low = np.min([points.min(axis=0) - reach[name] for name, points in self.hulls.items()], axis=0)
        high = np.max([points.max(axis=0) + reach[name] for name, points in self.hulls.items()], axis=0)
        bare = np.ptp(np.concatenate(list(self.hulls.values())), axis=0).max()
        spacing = float(bare) / cells
        counts = np.ceil((high - low) / spacing).astype(np.int64) + 3
        return Grid(0.5 * (low + high) - 0.5 * spacing * (counts - 1), spacing, counts)

    def near(self, name: str, grid: Grid, reach: float) -> tuple[np.ndarray, Array]:
        """Numbers of grid points near a body's bones, and their distances from its hull over bone length."""
        points = self.hulls[name]
        index = grid.box(points.min(axis=0) - reach, points.max(axis=0) + reach)
        return index, _outside(points, grid.places(index)) / self.lengths[name]

    def between(self, group: Sequence[str], grid: Grid) -> tuple[np.ndarray, np.ndarray]:
        """Numbers of grid points inside the common hull of a group, and the nearest of its bodies, relative to size."""
        points = np.concatenate([self.hulls[body] for body in group])
        index = grid.box(points.min(axis=0), points.max(axis=0))
        index = index[_outside(points, grid.places(index)) <= 0.0]
        apart = np.stack([_outside(self.hulls[body], grid.places(index)) / self.lengths[body] for body in group])
        names = list(self.hulls)
        return index, np.array([names.index(body) for body in group])[apart.argmin(axis=0)]


def grow_envelope(
    model: Model,
    bones: Mapping[str, Surface],
    pose: Motion | None = None,
    *,
    volume: float | None = None,
    soft_tissue: float | Mapping[str, float] = SOFT_TISSUE,
    together: Sequence[Sequence[str]] = (),
    cells: int = CELLS,
) -> Envelope:
    """Soft tissue around the bones of a model, in one pose (the first frame; by default the model's). `volume`: of the
    whole [m^3]; the soft tissue grows or shrinks everywhere in proportion; `soft_tissue`: thickness as a share of bone
    length, for all or by body; `together`: groups of bodies with a common hull, as those around a belly; `cells`: of
    the grid along the longest side.
    """
    skeleton = Skeleton(model, bones, pose, together)
    share = {
        name: soft_tissue if isinstance(soft_tissue, float) else soft_tissue.get(name, SOFT_TISSUE)
        for name in skeleton.hulls
    }
    level = 1.0
    if volume is not None:
        level = _level(*_fields(skeleton, share, COARSE, WIDEST)[::2], volume)
    values, owner, grid = _fields(skeleton, share, cells, 1.2 * level)
    if volume is not None:
        level = _level(values, grid, volume)
    within = np.flatnonzero(values <= level)
    return Envelope(
        frozen_array(grid.places(within)),
        tuple(skeleton.hulls),
        owner[within],
        grid.spacing,
        _surface(values, grid, level),
        FrozenMap({name: level * part for name, part in share.items()}),
    )


def soft_tissue_of(
    model: Model, bones: Mapping[str, Surface], density: float, *, together: Sequence[Sequence[str]] = ()
) -> dict[str, float]:
    """Thickness of soft tissue over each body's bones, as a share of its length, that gives it the mass it has at a
    density [kg/m^3]. Bodies that cannot have theirs (a mass that stands for parts without bones) come as near as
    `THICKEST` and their neighbors let them.
    """
    skeleton = Skeleton(model, bones, None, together)
    names = list(skeleton.hulls)
    reach = {name: THICKEST * skeleton.lengths[name] for name in names}
    grid = skeleton.grid(COARSE, reach)
    apart = np.full((len(names), grid.size), np.inf)
    for i, name in enumerate(names):
        index, distances = skeleton.near(name, grid, reach[name])
        apart[i, index] = distances
    fixed = np.full(grid.size, -1)
    for group in skeleton.groups:
        index, owner = skeleton.between(group, grid)
        fixed[index] = owner
    some = np.flatnonzero((apart.min(axis=0) < THICKEST) | (fixed >= 0))
    apart, fixed = apart[:, some], fixed[some]
    wanted = np.array([model.body(name).mass for name in names]) / density / grid.spacing**3
    share = np.full(len(names), SOFT_TISSUE)
    for _ in range(ROUNDS):
        ratio = apart / share[:, None]
        owner = np.where(fixed >= 0, fixed, ratio.argmin(axis=0))
        inside = (fixed >= 0) | (ratio.min(axis=0) <= 1.0)
        got = np.bincount(owner[inside], minlength=len(names))
        share = share * np.clip((wanted / np.maximum(got, 0.5)) ** 0.5, 0.8, 1.25)
        share = np.clip(share, THINNEST, THICKEST)
    return dict(zip(names, map(float, share), strict=True))


def _posed_hulls(model: Model, bones: Mapping[str, Surface], pose: Motion | None) -> dict[str, Array]:
    """Corners of the convex hull of each body's bones, in ground."""
    if not bones:
        raise BadData("no bone to grow an envelope around")
    tree = compile_tree(model)
    poses = forward_kinematics(tree, tree.coordinates_of(DEFAULT_POSE if pose is None else pose)[:1]).transforms()
    result = {}
    for name, surface in bones.items():
        check_name("body", name, model.body_names)
        points = poses[name].apply(surface.vertices[np.unique(surface.faces)])
        result[name] = points[_corners(points, name)]
    return result


def _corners(points: Array, name: str) -> np.ndarray:
    try:
        return np.asarray(ConvexHull(points).vertices)
    except QhullError:
        raise BadData(f"the bone of '{name}' is flat or empty: it has no volume to grow soft tissue around") from None


def _fields(
    skeleton: Skeleton, share: Mapping[str, float], cells: int, widest: float
) -> tuple[Array, np.ndarray, Grid]:
    """Distance over soft tissue at each point of a grid, the least of all bodies, and the body that has it."""
    reach = {name: widest * share[name] * skeleton.lengths[name] for name in skeleton.hulls}
    grid = skeleton.grid(cells, reach)
    values, owner = np.full(grid.size, np.inf), np.full(grid.size, -1, np.int64)
    for i, name in enumerate(skeleton.hulls):
        index, distances = skeleton.near(name, grid, reach[name])
        ratio = distances / share[name]
        nearer = ratio < values[index]
        values[index[nearer]], owner[index[nearer]] = ratio[nearer], i
    for group in skeleton.groups:
        index, owners = skeleton.between(group, grid)
        free = values[index] > 0.0
        values[index[free]], owner[index[free]] = 0.0, owners[free]
    return values, owner, grid


def _outside(corners: Array, points: Array) -> Array:
    """Distances of points (n, 3) from the convex hull of corners, 0 inside [m]."""
    hull = ConvexHull(corners)
    boxes, result = Boxes(np.array(hull.points), hull_faces(hull).astype(np.int64)), np.zeros(len(points))
    away = ~boxes.holds(points)
    result[away] = np.sqrt(boxes.nearest(points[away])[0])
    return result


def _level(values: Array, grid: Grid, volume: float) -> float:
    """How many times the soft tissue has to be as thick for the whole to have a volume."""
    known, wanted = np.sort(values[np.isfinite(values)]), volume / grid.spacing**3
    inside, count = int((known <= 0.0).sum()), round(wanted)
    if count <= inside:
        raise BadData(
            f"the bones alone fill {inside / max(wanted, 1e-9):.2g} times the volume that mass and density allow: is "
            "the mass that of this skeleton?"
        )
    if count > len(known) or known[count - 1] > WIDEST:
        raise BadData(
            f"mass and density need over {WIDEST:g} times the usual soft tissue: is the mass this skeleton's?"
        )
    return float(known[count - 1])


def _surface(values: Array, grid: Grid, level: float) -> Surface:
    """The level set, closed and outward, by marching cubes."""
    igl = from_extra("morph", "igl", "libigl")

    x, y, z = (grid.origin[i] + grid.spacing * np.arange(grid.counts[i]) for i in range(3))
    # Far away and on the rim of the grid all is outside; the library counts x fastest.
    cube = np.minimum(values, 2.0 * level).reshape(grid.counts)
    cube[[0, -1]] = cube[:, [0, -1]] = cube[:, :, [0, -1]] = 2.0 * level
    places = np.stack(np.meshgrid(z, y, x, indexing="ij")[::-1], axis=-1).reshape(-1, 3)
    samples = np.ascontiguousarray(cube.transpose(2, 1, 0).reshape(-1))
    vertices, faces = igl.marching_cubes(samples, places, *(int(n) for n in grid.counts), level)[:2]
    outward = signed_volume(vertices - vertices.mean(axis=0), faces) > 0.0
    return Surface(vertices, faces if outward else faces[:, ::-1])
