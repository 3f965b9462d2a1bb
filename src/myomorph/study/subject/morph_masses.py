"""Masses, mass centers and inertias of a morphed model, from mass points inside a skin or around its bones."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Literal

import numpy as np
from scipy import sparse
from threadpoolctl import threadpool_limits

from myomorph.identify.body.fit_pose import pose_model_to_skin
from myomorph.identify.body.points import MassPoints, fill, links_of
from myomorph.identify.body.skin import check_skin
from myomorph.identify.body.weights import bone_weights, links_with_mass
from myomorph.model.arrays import Array
from myomorph.model.errors import BadData
from myomorph.model.inertia import inertial_parameters, pseudo_inertias, with_inertial_parameters
from myomorph.model.model import Model
from myomorph.model.series import DEFAULT_POSE, Motion
from myomorph.model.surface import Surface
from myomorph.morph.checks.checks import target_surface
from myomorph.morph.morphed import Morph
from myomorph.morph.shapes.envelope import SOFT_TISSUE, Envelope, grow_envelope, soft_tissue_of

DENSITY = 1050.0
"""Of a body without the air in its lungs, where its mass is not known [kg/m^3]."""

FEW = 6
"""Names that a note lists."""

CELLS = 160
"""Mass points along the longest side of a skin."""

LIKE = 3.0
"""A skin that holds so many times more or less than the body's mass is not this body's."""


def with_morphed_masses(
    morph: Morph,
    mass: float | None = None,
    skin: Surface | None = None,
    *,
    by: Literal["carried", "envelope", ""] = "",
    pose: Motion | None = None,
    together: Sequence[Sequence[str]] = (),
) -> tuple[Model, tuple[str, ...]]:
    """The morphed model with the masses of its new body, of `mass` [kg] as a whole, by default what the maps or volume
    times `DENSITY` give.

    With a skin (closed, in the ground and in `pose`), mass points fill it and belong to the nearest bones ([D] eq. 3.5
    to 3.8). Without one, by "carried" the masses that the bones' maps carried over stay, in one proportion; by
    "envelope" mass points fill one grown around the bones: flesh on each bone as thick, for its length, as the source's
    bones need for the source's masses, everywhere thicker or thinner in one proportion so that the whole has its mass.
    Where source and target have other bodies, flesh is a tenth of each bone's length at first. Bodies without bones
    keep their share; bodies `together` are around one belly.
    """
    if mass is not None and not (np.isfinite(mass) and mass > 0.0):
        raise BadData(f"a mass of {mass:g} kg: expected above 0")
    with threadpool_limits(1, "blas"):
        if skin is not None:
            return with_skin_masses(morph.model, skin, mass, pose=pose)
        if by == "carried" or (not by and _same_bodies(morph)):
            return _carried(morph.model, mass)
        bones = {bone.target_body: target_surface(bone) for bone in morph.bones.values()}
        known = {name: bone for name, bone in bones.items() if bone is not None}
        return with_envelope_masses(
            morph.model, known, mass, flesh=_flesh(morph, known, together), pose=pose, together=together
        )


def _same_bodies(morph: Morph) -> bool:
    return morph.source.body_names == morph.model.body_names


def _carried(model: Model, mass: float | None) -> tuple[Model, tuple[str, ...]]:
    if model.mass <= 0.0:
        raise BadData(f"model '{model.name}' has no masses to carry over: ask for an envelope, or give a skin")
    whole = model if mass is None else _scaled(model, np.ones(len(model.bodies), dtype=bool), mass)
    return whole, (f"masses are the source's, carried by the bones' maps, {whole.mass:.4g} kg together",)


def with_skin_masses(
    model: Model, skin: Surface, mass: float | None = None, *, pose: Motion | None = None
) -> tuple[Model, tuple[str, ...]]:
    """The model with masses of points that fill a skin; parameters as of `with_morphed_masses`."""
    checked = check_skin(skin)
    if pose is None:
        fitted = pose_model_to_skin(model, checked)
        checked, pose, notes = fitted.skin, fitted.motion, [*checked.notes, *fitted.notes]
    else:
        notes = list(checked.notes)
    spacing = float(np.ptp(checked.surface.vertices, axis=0).max()) / CELLS
    points = fill(checked, spacing)
    volume = len(points) * spacing**3
    weight = mass if mass is not None else DENSITY * volume
    expected = mass if mass is not None else model.mass
    if expected > 0.0 and not 1.0 / LIKE < DENSITY * volume / expected < LIKE:
        raise BadData(
            f"the skin holds {volume:.3g} m^3, {DENSITY * volume:.4g} kg at {DENSITY:g} kg/m^3, and "
            f"{expected:.4g} kg are expected: is it this body's skin, closed and in meters?"
        )
    links = links_of(model, pose)
    shares = bone_weights(points, links, taking=links_with_mass(model))
    mass_points = MassPoints(points, np.full(len(points), weight / len(points)), shares, links, spacing, "the skin")
    notes.append(
        f"masses from {len(points)} mass points inside the skin, {weight:.4g} kg"
        + ("" if mass is not None else f" ({DENSITY:g} kg/m^3, no mass was given)")
    )
    empty = [name for name, share in zip(model.body_names, shares.sum(axis=0), strict=True) if share <= 0.0]
    if empty:
        notes.append(f"no mass point belongs to {', '.join(empty[:FEW])}{', ...' if len(empty) > FEW else ''}")
    return _with_points(model, mass_points, np.ones(len(model.bodies), dtype=bool)), tuple(notes)


def with_envelope_masses(
    model: Model,
    bones: Mapping[str, Surface],
    mass: float | None = None,
    *,
    flesh: Mapping[str, float] | None = None,
    pose: Motion | None = None,
    together: Sequence[Sequence[str]] = (),
) -> tuple[Model, tuple[str, ...]]:
    """The model with masses of points that fill an envelope grown around its bones [m], in the bodies' frames, with
    `flesh` at first over each as a share of its length (else `SOFT_TISSUE`); other parameters as of
    `with_morphed_masses`.
    """
    known = {name: bone for name, bone in bones.items() if name in model.body_names}
    if not known:
        raise BadData("masses need bones of the target or a skin: neither is there")
    enveloped = np.array([name in known for name in model.body_names])
    share = mass / model.mass if mass is not None and model.mass > 0.0 else 1.0
    volume = None if mass is None else (mass - share * _mass(model, ~enveloped)) / DENSITY
    grown = grow_envelope(model, known, pose, volume=volume, soft_tissue=flesh or SOFT_TISSUE, together=together)
    # A bone inside another's hull may have no point of its own.
    enveloped &= np.array([grown.volumes.get(name, 0.0) > 0.0 for name in model.body_names])
    kept = share * _mass(model, ~enveloped)
    weight = DENSITY * grown.volume if mass is None else mass - kept
    whole = _points(model, grown, weight, DEFAULT_POSE if pose is None else pose)
    words = "as the source's masses ask for" if flesh else f"at first {100 * SOFT_TISSUE:g} % of each bone's length"
    notes = [
        f"masses from an envelope grown around {len(known)} bones, no skin was given: flesh {words}"
        + (f", {DENSITY:g} kg/m^3 (no mass was given)" if mass is None else f", so thick that all weighs {mass:g} kg")
    ]
    if kept > 0.0:
        names = [
            body.name
            for body, has_envelope in zip(model.bodies, enveloped, strict=True)
            if not has_envelope and body.mass > 0.0
        ]
        listed = ", ".join(names[:FEW]) + (f", ... ({len(names)} in all)" if len(names) > FEW else "")
        notes.append(f"masses in the model's proportion, for want of bones or places: {listed}, {kept:.3g} kg together")
    return _with_points(_scaled(model, ~enveloped, kept), whole, enveloped), tuple(notes)


def _mass(model: Model, which: np.ndarray) -> float:
    """Of some of the bodies [kg]."""
    return sum(body.mass for body, inside in zip(model.bodies, which, strict=True) if inside)


def _flesh(morph: Morph, bones: Mapping[str, Surface], together: Sequence[Sequence[str]]) -> dict[str, float] | None:
    """Thickness of flesh that the source's masses ask for, by body; None where the bodies are others."""
    source = {bone.body: bone.source for bone in morph.bones.values() if bone.source is not None}
    weights = {body.name: body.mass for body in morph.source.bodies}
    heavy = {name: weight for name, weight in source.items() if weights.get(name, 0.0) > 0.0}
    if not (_same_bodies(morph) and heavy and set(heavy) == set(bones)):
        return None
    return soft_tissue_of(morph.source, heavy, DENSITY, together=together)


def _points(model: Model, grown: Envelope, weight: float, pose: Motion) -> MassPoints:
    links = links_of(model, pose)
    columns = np.array([model.body_names.index(name) for name in grown.bodies])[grown.owner]
    count = len(grown.points)
    shares = sparse.csr_array((np.ones(count), (np.arange(count), columns)), shape=(count, len(links.names)))
    masses = np.full(count, weight / count)
    return MassPoints(grown.points, masses, shares, links, grown.spacing, "an envelope grown around the bones")


def _with_points(model: Model, points: MassPoints, massive: np.ndarray) -> Model:
    """The model with some bodies made of mass points, each a cube of the grid; others as they are."""
    parameters = points.parameters(points.reference)
    # A cube has an inertia of its own, which matters where a body is few cubes large.
    parameters[:, 4:7] += parameters[:, :1] * points.spacing**2 / 6.0
    return with_inertial_parameters(model, np.where(massive[:, None], parameters, inertial_parameters(model)))


def _scaled(model: Model, which: np.ndarray, total: float) -> Model:
    """The model with some bodies' masses in one proportion, so that together they weigh a total."""
    table = inertial_parameters(model)
    before = float(table[which, 0].sum())
    if before > 0.0:
        table[which] *= total / before
    return with_inertial_parameters(model, table)


def min_eigenvalues(model: Model) -> Array:
    """(bodies,) least eigenvalue of each body's pseudo-inertia: above 0 for a body of mass that can be."""
    return np.asarray(np.linalg.eigvalsh(pseudo_inertias(inertial_parameters(model)))[:, 0], dtype=np.float64)
