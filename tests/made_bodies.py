"""Made bodies: mass points that fill an ellipsoid, and links with random frames in it."""

from __future__ import annotations

import numpy as np
from scipy.spatial.transform import Rotation

from myomorph.body.shape.points import Links, MassPoints
from myomorph.body.shape.weights import WeightMap, bone_weights

AXES = np.array([0.2, 0.8, 0.15])
"""Semi-axes of the body [m]."""

MASS = 70.0


def filled(spacing: float, place: tuple[float, float, float] = (0.3, 1.0, -0.2)) -> np.ndarray:
    """Return points of a grid inside the ellipsoid.

    Parameters
    ----------
    spacing : of the grid [m]
    place : center of the ellipsoid [m]

    Returns
    -------
    (points, 3) [m]
    """
    steps = [np.arange(-a + 0.5 * spacing, a, spacing) for a in AXES]
    grid = np.stack(np.meshgrid(*steps, indexing="ij"), axis=-1).reshape(-1, 3)
    return grid[((grid / AXES) ** 2).sum(axis=1) < 1.0] + place


def random_links(
    count: int, place: tuple[float, float, float] = (0.3, 1.0, -0.2), seed: int = 0
) -> Links:
    """Links along the body with random axes, and a bone of 20 cm in each."""
    random = np.random.default_rng(seed)
    centers = np.zeros((count, 3))
    centers[:, 1] = np.linspace(-0.9, 0.9, count) * AXES[1]
    centers += 0.05 * random.normal(size=(count, 3)) + place
    rotations = Rotation.random(count, rng=random).as_matrix()
    bones = np.stack(
        [centers - 0.1 * rotations[:, :, 0], centers + 0.1 * rotations[:, :, 0]], axis=1
    )
    names = tuple(f"link{i}" for i in range(count))
    origins = centers + 0.05 * random.normal(size=(count, 3))
    return Links(
        names=names,
        rotations=rotations,
        origins=origins,
        centers=centers,
        bones=bones,
        bone_links=np.arange(count),
    )


def made_body(
    spacing: float, count: int = 5, weights: WeightMap = bone_weights, seed: int = 0
) -> MassPoints:
    """Mass points of 70 kg in all."""
    points = filled(spacing)
    links = random_links(count, seed=seed)
    reference = np.full(len(points), MASS / len(points))
    return MassPoints(
        points=points,
        reference=reference,
        weights=weights(points, links),
        links=links,
        spacing=spacing,
        source="an ellipsoid",
    )


def measured(
    body: MassPoints, rows: int, truth: np.ndarray, noise: float = 1.0, seed: int = 1
) -> tuple:
    """Make random combinations of the true parameters in units of their noise.

    Parameters
    ----------
    body : whose reference scales the parameters
    rows : number of combinations
    truth : (links, 10) inertial parameters
    noise : standard deviation of each row
    seed : of combinations and noise

    Returns
    -------
    A (rows, 10 links) and b (rows,)
    """
    random = np.random.default_rng(seed)
    typical = np.abs(body.parameters(body.reference)).mean(axis=0)
    A = 30.0 * random.normal(size=(rows, truth.size)) / np.tile(typical, len(truth))
    return A, A @ truth.ravel() + noise * random.normal(size=rows)
