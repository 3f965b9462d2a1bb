"""Mass points of a subject from a skin mesh, from height and chest, or from envelopes of the model's own links."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from scipy import sparse

from myomorph.identify.consistency import Inside
from myomorph.identify.envelope import envelope_points
from myomorph.identify.points import Links, MassPoints, links_of
from myomorph.identify.weights import bone_weights, cog_weights, links_with_mass, nearest_weights
from myomorph.model.errors import BadData
from myomorph.model.model import Model
from myomorph.model.series import Motion
from myomorph.model.spatial import Array
from myomorph.model.surface import Surface
from myomorph.study.body_shape import BodyOptions, BodyShape
from myomorph.study.progress import progress

OWN = "own"
"""Weight map of envelopes: each point belongs to the link whose envelope it fills."""

POSE = Motion(np.zeros(1), (), np.zeros((1, 0)))
"""The model's default pose."""


def weight_maps(model: Model) -> Mapping[str, Callable[[Array, Links], sparse.csr_array]]:
    """The weight maps by the names of the command, links without mass left out."""
    taking = links_with_mass(model)
    return {
        "bone": lambda points, links: bone_weights(points, links, taking=taking),
        "cog": lambda points, links: cog_weights(points, links, taking=taking),
        "nearest": lambda points, links: nearest_weights(points, links, taking=taking),
    }


def body_points(
    model: Model,
    shape: BodyShape,
    mass: float,
    options: BodyOptions,
    compare: bool = True,
    surfaces: Mapping[str, Surface] | None = None,
) -> tuple[dict[str, MassPoints], Inside | None, tuple[str, ...]]:
    """Mass points by weight map, the one to use first; what tells what is inside the skin; and what there is to say.

    Parameters
    ----------
    compare : also by the other weight maps, where a skin makes them differ
    surfaces : meshes of the model's bodies

    Raises
    ------
    BadData : a shape that cannot be, or more points than memory holds
    """
    if not 0.0005 <= options.spacing <= 0.1:
        raise BadData(f"--spacing {options.spacing:g}: expected a distance in metres from 0.0005 to 0.1, as 0.005")
    if shape.skin is not None or shape.height is not None or shape.chest is not None:
        return _in_skin(model, shape, mass, options, compare)
    links = links_of(model, POSE)
    points, owners, reference, words = envelope_points(model, POSE, options.spacing, surfaces)
    reference = reference * (mass / reference.sum())
    if options.weights is None:
        own = (np.ones(len(owners)), (np.arange(len(owners)), owners))
        weights = {OWN: sparse.csr_array(own, (len(owners), len(links.names)))}
    else:
        weights = _weights(model, points, links, (options.weights,))
    return _made(points, reference, weights, links, options.spacing, words), None, ()


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


def _in_skin(
    model: Model, shape: BodyShape, mass: float, options: BodyOptions, compare: bool
) -> tuple[dict[str, MassPoints], Inside | None, tuple[str, ...]]:
    raise BadData("a skin or height and chest cannot be used yet: leave them out, and envelopes of the links are used")
