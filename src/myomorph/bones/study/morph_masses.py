"""Masses, centers of mass and inertias of a morphed model.

They are transferred by its bones' maps, or those of mass points inside a skin.
"""

from __future__ import annotations

import numpy as np
from threadpoolctl import threadpool_limits

from myomorph.body.causes import SKIN
from myomorph.body.shape.fit_pose import pose_model_to_skin
from myomorph.body.shape.points import MassPoints, fill, links_of
from myomorph.body.shape.skin import check_skin
from myomorph.body.shape.weights import bone_weights, links_with_mass
from myomorph.bones.morph.morphed import Morph
from myomorph.core.model.errors import BadData, few
from myomorph.core.model.inertia import inertial_parameters, with_inertial_parameters
from myomorph.core.model.model import Model
from myomorph.core.model.surface import Surface

DENSITY = 1050.0  # Of a body without the air in its lungs, where its mass is not known [kg/m^3].

CELLS = 160  # Mass points along the longest side of a skin.

LIKE = 3.0  # A skin that holds so many times more or less than the body's mass is not this body's.


def with_morphed_masses(
    morph: Morph, mass: float | None = None, skin: Surface | None = None
) -> tuple[Model, tuple[str, ...]]:
    """Give the morphed model the masses of its new body, of `mass` [kg] as a whole.

    They are those that the bones' maps transferred, in one proportion, or with a skin those of
    `with_skin_masses`.
    """
    model = morph.model
    if mass is not None and not (np.isfinite(mass) and mass > 0.0):
        raise BadData(f"a mass of {mass:g} kg: expected above 0")
    if skin is not None:
        with threadpool_limits(1, "blas"):
            return with_skin_masses(model, skin, mass)
    if model.mass <= 0.0:
        raise BadData(f"model '{model.name}' has no masses to carry over: give a skin")
    if mass is not None:
        model = with_inertial_parameters(model, inertial_parameters(model) * mass / model.mass)
    return model, (
        f"masses are the source's, carried by the bones' maps, {model.mass:.4g} kg together",
    )


def with_skin_masses(
    model: Model, skin: Surface, mass: float | None = None
) -> tuple[Model, tuple[str, ...]]:
    """Give the model masses of points that fill a skin ([D] eq. 3.5 to 3.8).

    The skin is closed and in the ground; each point belongs to the nearest bone. By default the
    total is volume times `DENSITY` [kg].
    """
    checked = check_skin(skin)
    fitted = pose_model_to_skin(model, checked)
    checked, notes = fitted.skin, [*checked.notes, *fitted.notes]
    spacing = float(np.ptp(checked.surface.vertices, axis=0).max()) / CELLS
    points = fill(checked, spacing)
    volume = len(points) * spacing**3
    weight = mass if mass is not None else DENSITY * volume
    expected = mass if mass is not None else model.mass
    if expected > 0.0 and not 1.0 / LIKE < DENSITY * volume / expected < LIKE:
        raise BadData(
            f"the skin holds {volume:.3g} m^3, {DENSITY * volume:.4g} kg at {DENSITY:g} kg/m^3, and"
            f" {expected:.4g} kg are expected: is it this body's skin, closed and in meters?"
        )
    links = links_of(model, fitted.motion)
    shares = bone_weights(points, links, taking=links_with_mass(model))
    mass_points = MassPoints(
        points=points,
        reference=np.full(len(points), weight / len(points)),
        weights=shares,
        links=links,
        spacing=spacing,
        source="the skin",
    )
    unsaid = "" if mass is not None else f" ({DENSITY:g} kg/m^3, no mass was given)"
    notes.append(
        SKIN.message(
            f"masses from {len(points)} mass points inside the skin, {weight:.4g} kg{unsaid}",
            severity="good to know",
        )
    )
    empty = [
        name
        for name, share in zip(model.body_names, shares.sum(axis=0), strict=True)
        if share <= 0.0
    ]
    if empty:
        notes.append(SKIN.message(f"no mass point belongs to {few(empty)}"))
    parameters = mass_points.parameters(mass_points.reference)
    # A cube has an inertia of its own, which matters where a body is few cubes large.
    parameters[:, 4:7] += parameters[:, :1] * spacing**2 / 6.0
    return with_inertial_parameters(model, parameters), tuple(notes)
