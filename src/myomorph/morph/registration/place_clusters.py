"""Markers that a CT shows beside a bone, put on the model's bone ([S] figure 3)."""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace

import numpy as np

from myomorph.model.arrays import Array, frozen_array, read_only
from myomorph.model.errors import BadData
from myomorph.model.model import Body, Marker, Model
from myomorph.model.scale import scale
from myomorph.model.surface import Surface
from myomorph.morph.maps.linear import PointFit, fit_points
from myomorph.morph.registration.rigid import SurfaceFit, SurfaceOptions, register_surface

GOOD = 5e-4
"""Surfaces that come so near [m] need no other starts beside the picked points: bones turned end over end may differ by
little more than a millimetre."""

FAR = 0.25  # A marker further from its bone than that is named [m].


@read_only
class Picks:
    """Points picked on a CT and the same points on the model's bone."""

    names: tuple[str, ...]  # of the points
    # scanned, modelled: (points, 3) in the CT's frame and in the body's frame [m]
    scanned: Array
    modelled: Array


@read_only
class ScannedBone:
    """A CT bone laid on a model's bone, and where its markers come to lie."""

    body: str  # of the model
    fit: SurfaceFit  # of the surfaces, from the CT's frame to the body's
    picks: PointFit | None  # of the points that it started from, or None
    markers: Mapping[str, Array]  # (3,) by name in the CT's frame [m]
    notes: tuple[str, ...] = ()  # what looks wrong, one line each

    @property
    def scale(self) -> float:
        """Size of the model's bone in terms of the scanned one."""
        return self.fit.similarity.scale


def bone_surface(body: Body, surfaces: Mapping[str, Surface]) -> Surface:
    """The meshes of a body as one surface in the body's frame. `surfaces`: by `Mesh.file`."""
    vertices, faces, first = [], [], 0
    for mesh in body.meshes:
        surface = surfaces.get(mesh.file)
        if mesh.shape != "mesh" or surface is None:
            continue
        vertices.append(mesh.pose.apply(surface.vertices * mesh.scale))
        flipped = float(np.prod(mesh.scale)) < 0
        faces.append((surface.faces[:, ::-1] if flipped else surface.faces) + first)
        first += len(surface.vertices)
    if not vertices:
        named = ", ".join(mesh.file for mesh in body.meshes if mesh.file) or "none"
        raise BadData(f"body '{body.name}' has no bone mesh that can be read (the model names {named})")
    return Surface(np.concatenate(vertices), np.concatenate(faces))


def place_scanned_bone(
    body: str,
    scanned: Surface,
    modelled: Surface,
    markers: Mapping[str, Array],
    picks: Picks | None = None,
    options: SurfaceOptions | None = None,
) -> ScannedBone:
    """Lay the surface of a bone in a CT, or of a part of it, on the bone of a model (`bone_surface`), picked points
    first. `markers`: (3,) by name in the CT's frame [m].
    """
    options = options or SurfaceOptions()
    start, fitted, notes = None, None, []
    if picks is not None:
        fitted = fit_points(picks.names, picks.scanned, picks.modelled, options.scale and len(picks.names) > 3)
        notes = [f"{body}: {line}" for line in fitted.notes]
        # A wrong pick would only lead the surfaces astray; without picks they find each other from many starts.
        start = None if fitted.notes else fitted.similarity
    fit = register_surface(scanned, modelled, start, options)
    if start is not None and fit.rms > GOOD:
        other = register_surface(scanned, modelled, None, options)
        if other.rms < 0.7 * fit.rms:
            notes.append(
                f"{body}: from the picked points the surfaces come to {1e3 * fit.rms:.1f} mm, from other starts to "
                f"{1e3 * other.rms:.1f} mm, which was taken: were the points picked on this bone?"
            )
            fit = other
    notes += [f"{body}: {line}" for line in fit.notes]
    notes += _warnings(body, fit, scanned, markers)
    frozen = {name: frozen_array(place, (3,)) for name, place in markers.items()}
    return ScannedBone(body, fit, fitted, frozen, tuple(notes))


def _warnings(body: str, fit: SurfaceFit, scanned: Surface, markers: Mapping[str, Array]) -> list[str]:
    notes = []
    size = fit.similarity.scale
    if not 0.8 < size < 1.25:
        notes.append(f"{body}: the model's bone is {size:.2f} times the scanned one: another bone, or a wrong unit?")
    if fit.rms > 0.005:
        notes.append(f"{body}: the surfaces differ by {1e3 * fit.rms:.1f} mm (root mean square): is it this bone?")
    for name, place in markers.items():
        apart = float(np.min(np.linalg.norm(scanned.vertices - place, axis=1)))
        if apart > FAR:
            notes.append(f"{body}: marker '{name}' lies {1e3 * apart:.0f} mm from the bone: another scan, or unit?")
    return notes


def place_cluster_markers(
    model: Model,
    bones: Sequence[ScannedBone],
    resize: bool = True,
    path_lengths: Callable[[Model], Array] | None = None,
) -> Model:
    """The model with the markers of CT clusters fixed to its bones. `resize`: give every body the size of its scanned
    bone (see `scale`), so that the markers keep their place on it exactly; otherwise the bones stay, and each
    cluster keeps its own size with its middle where the fit puts it; `path_lengths`: see `scale`.
    """
    names = [bone.body for bone in bones]
    if len(set(names)) != len(names):
        twice = next(name for name in names if names.count(name) > 1)
        raise BadData(f"two scanned bones are for body '{twice}'")
    for name in names:
        model.body(name)
    if resize:
        factors = {bone.body: np.full(3, 1.0 / bone.scale) for bone in bones}
        model = scale(model, factors, path_lengths=path_lengths)
    placed = [
        Marker(name, bone.body, _on_body(bone, place, resize)) for bone in bones for name, place in bone.markers.items()
    ]
    new = {marker.name for marker in placed}
    if len(new) != len(placed):
        raise BadData("two clusters hold a marker of one name: marker names are unique over all bones")
    kept = tuple(marker for marker in model.markers if marker.name not in new)
    return replace(model, markers=(*kept, *placed))


def _on_body(bone: ScannedBone, place: Array, resize: bool) -> Array:
    """Place (3,) of a marker in the body's frame [m]."""
    similarity = bone.fit.similarity
    if resize:
        return similarity.rigid.apply(place)
    middle = np.mean(list(bone.markers.values()), axis=0)
    return similarity.apply(middle) + similarity.rotation @ (place - middle)
