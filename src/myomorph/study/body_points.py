"""Mass points of a subject from a skin mesh, from height and chest, or from envelopes of the model's own links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy import sparse

from myomorph.identify.consistency import Inside
from myomorph.identify.points import Links, MassPoints, links_of
from myomorph.identify.weights import bone_weights, cog_weights, links_with_mass, nearest_weights
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.model.spatial import Array
from myomorph.study.body_shape import BodyOptions, BodyShape
from myomorph.study.progress import progress

OWN = "own"
"""Weight map of envelopes: each point belongs to the link whose envelope it fills."""

MOST_POINTS = 5_000_000


def weight_maps(model: Model) -> Mapping[str, Callable[[Array, Links], sparse.csr_array]]:
    """The weight maps by the names of the command, links without mass left out."""
    taking = links_with_mass(model)
    return {
        "bone": lambda points, links: bone_weights(points, links, taking=taking),
        "cog": lambda points, links: cog_weights(points, links, taking=taking),
        "nearest": lambda points, links: nearest_weights(points, links, taking=taking),
    }


def body_points(
    model: Model, shape: BodyShape, mass: float, options: BodyOptions, compare: bool = True
) -> tuple[dict[str, MassPoints], Inside | None, tuple[str, ...]]:
    """Mass points by weight map, the one to use first; what tells what is inside the skin; and what there is to say.

    Parameters
    ----------
    compare : also by the other weight maps, where a skin makes them differ

    Raises
    ------
    BadData : a shape that cannot be, or more points than memory holds
    """
    if not 0.0005 <= options.spacing <= 0.1:
        raise BadData(f"--spacing {options.spacing:g}: expected a distance in metres from 0.0005 to 0.1, as 0.005")
    if shape.skin is not None or shape.height is not None or shape.chest is not None:
        return _in_skin(model, shape, mass, options, compare)
    links = links_of(model, Motion(np.zeros(1), (), np.zeros((1, 0))))
    points, owners, reference = _ellipsoids(model, links, options.spacing)
    reference = reference * (mass / reference.sum())
    source = "ellipsoids of the inertia that the model's own links have; no skin and no height and chest were given"
    if options.weights is None:
        own = (np.ones(len(owners)), (np.arange(len(owners)), owners))
        weights = {OWN: sparse.csr_array(own, (len(owners), len(links.names)))}
    else:
        weights = _weights(model, points, links, (options.weights,))
    return _made(points, reference, weights, links, options.spacing, source), None, ()


def _weights(model: Model, points: Array, links: Links, names: Sequence[str]) -> dict[str, sparse.csr_array]:
    """Weights of points by the maps' names."""
    functions = weight_maps(model)
    found = {}
    with progress("weights of mass points", len(names), "maps") as advance:
        for name in names:
            found[name] = functions[name](points, links)
            advance(1)
    return found


def _made(
    points: Array, reference: Array, weights: Mapping[str, sparse.csr_array], links: Links, spacing: float, source: str
) -> dict[str, MassPoints]:
    return {name: MassPoints(points, reference, one, links, spacing, source) for name, one in weights.items()}


def _ellipsoids(model: Model, links: Links, spacing: float) -> tuple[Array, np.ndarray, Array]:
    """Grid points in each link's ellipsoid of even density, their links, and reference masses [kg]."""
    points, owners, reference = [], [], []
    for i in np.flatnonzero(links_with_mass(model)):
        body = model.bodies[i]
        second = 0.5 * np.trace(body.inertia) * np.eye(3) - body.inertia
        values, axes = np.linalg.eigh(second / body.mass)
        half = np.sqrt(5.0 * np.maximum(values, 0.2 * spacing**2))
        turn = links.rotations[i] @ axes
        center = links.origins[i] + links.rotations[i] @ body.mass_center
        reach = np.abs(turn) @ half
        lines = [np.arange(np.ceil((c - r) / spacing), np.floor((c + r) / spacing) + 1) * spacing
                 for c, r in zip(center, reach, strict=True)]  # fmt: skip
        if np.prod([float(len(line)) for line in lines]) > MOST_POINTS:
            raise BadData(
                f"--spacing {spacing:g}: body '{body.name}' would hold millions of points; choose a larger one"
            )
        grid = np.stack(np.meshgrid(*lines, indexing="ij"), axis=-1).reshape(-1, 3)
        inside = grid[np.square((grid - center) @ turn / half).sum(axis=1) <= 1.0]
        own = inside if len(inside) else center[None]
        points.append(own)
        owners.append(np.full(len(own), i))
        reference.append(np.full(len(own), body.mass / len(own)))
    return np.concatenate(points), np.concatenate(owners), np.concatenate(reference)


def _in_skin(
    model: Model, shape: BodyShape, mass: float, options: BodyOptions, compare: bool
) -> tuple[dict[str, MassPoints], Inside | None, tuple[str, ...]]:
    raise BadData("a skin or height and chest cannot be used yet: leave them out, and envelopes of the links are used")
