"""Muscle attachments carried between persons of a shape model, whose correspondence is the truth.

A person is left out, a template is made of the others, and the attachments of a leg model, laid on
the bones once, are carried from the template to the person by a few landmarks or by all nodes.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from functools import cache, partial
from typing import TypeAlias

import igl
import numpy as np
from scipy.spatial import cKDTree

import myomorph as mm
from data_collection import data_folder
from myomorph.bones.morph.maps.fields import FeaturePoints, MapOptions, PointMap, fit_map, inverted
from myomorph.core.model.arrays import Array
from myomorph.core.model.paths import PathPoint
from myomorph.core.surfaces.linear_maps import AffineMap, procrustes
from myomorph.core.surfaces.rigid_registration import SurfaceOptions, register_surface
from truths.leg_shapes import BONES, leg_shapes

Row: TypeAlias = dict[str, object]
Indices: TypeAlias = np.ndarray

BODIES = {"pelvis": "pelvis", "femur": "femur_l", "patella": "patella_l", "tibia": "tibia_l"}
ON_BONE = 0.015
"""A muscle point this near to the bone on which it is laid is taken for an attachment [m]."""

HEIGHT = 0.02
"""Of points beside the bone [m]."""

FAR = 0.02
"""From the nearest landmark, for errors that no landmark takes care of [m]."""

PICKING = 0.002
"""Standard deviation of a picked landmark along each axis [m]."""

RIDGE = 0.3
"""Of the regression on other persons, as a share of their mean spread."""

COUNTS = (6, 12, 24)
MAPS = {
    "similarity": MapOptions(map="similarity"),
    "affine": MapOptions(map="affine"),
    "RBF, r": MapOptions(map="rbf"),
    "RBF, r^3": MapOptions(map="rbf", kernel="r3"),
    "SSD": MapOptions(),
}


@dataclass(frozen=True, eq=False)
class Attachments:
    """Muscle points on a bone.

    `corners`: (k, 3) nodes of the triangle that each is on; `shares`: (k, 3) of the triangle's
    corners; `around`: (k, n) nodes whose normals say which way is out, 1 for each; `axes`: (3, 3)
    of the leg model's body, as columns in the shape's frame.
    """

    corners: Indices
    shares: Array
    around: Array
    axes: Array

    def on(self, nodes: Array) -> Array:
        """Return the points of a person.

        Parameters
        ----------
        nodes : (n, 3) of the person's bone [m]

        Returns
        -------
        (k, 3) [m]
        """
        points: Array = np.einsum("kc,kcx->kx", self.shares, nodes[self.corners])
        return points

    def beside(self, nodes: Array, faces: Indices, height: float) -> Array:
        """Return points above those of a person, along the mean normal of the surface around.

        Parameters
        ----------
        nodes : (n, 3) of the person's bone [m]
        faces : (m, 3) of the bone
        height : above the points [m]

        Returns
        -------
        (k, 3) [m]
        """
        normals = self.around @ _normals(nodes, faces)
        above: Array = self.on(nodes) + height * normals / np.linalg.norm(
            normals, axis=1, keepdims=True
        )
        return above


@dataclass(frozen=True, eq=False)
class Case:
    """A template and the person who was left out: nodes in correspondence."""

    bone: str
    template: Array
    person: Array


Maker: TypeAlias = Callable[[Case, Indices, Array], PointMap]
"""Of a map, from the nodes that are landmarks and where they were picked on the person."""


@cache
def attachments() -> dict[str, Attachments]:
    """Return the left leg's muscle points of Rajagopal's model on the mean of all persons.

    They are at their nearest positions on its surface. Which positions these are does not depend on
    a person much, and every person has the same positions.
    """
    model = mm.read_model(data_folder() / "rajagopal-walk-emg" / "subject_walk_scaled.osim")
    return {bone: _attachments(model, bone) for bone in leg_shapes()}


def _attachments(model: mm.Model, bone: str) -> Attachments:
    shapes = leg_shapes()[bone]
    folder = data_folder() / "bones-opensim-rajagopal" / "Geometry"
    body = next(one for one in model.bodies if one.name == BODIES[bone])
    surface = _joined([mm.read_mesh(folder / mesh.file) for mesh in body.meshes])
    mean = mm.Surface(mean_shape(shapes.nodes), shapes.faces)
    options = SurfaceOptions(mirror=False, partial=False)
    similarity = register_surface(surface, mean, None, options).similarity
    places = [
        point.location / body.meshes[0].scale
        for muscle in model.muscles
        if muscle.name.endswith("_l")
        for point in muscle.path.points
        if isinstance(point, PathPoint) and point.body == body.name
    ]
    return _on_mean(mean, similarity.apply(np.array(places)), similarity.rotation)


def _on_mean(mean: mm.Surface, laid: Array, axes: Array) -> Attachments:
    """Return points (k, 3) [m] at their nearest positions on the mean, without those far off."""
    nodes = mean.vertices
    squared, face, nearest_of_all = igl.point_mesh_squared_distance(laid, nodes, mean.faces)
    near = squared < ON_BONE**2
    nearest = nearest_of_all[near]
    corners = mean.faces[face[near]]
    triangle = (np.ascontiguousarray(nodes[corners[:, k]]) for k in range(3))
    shares = igl.barycentric_coordinates(nearest, *triangle)
    normals = _normals(nodes, mean.faces)
    here = np.einsum("kc,kcx->kx", shares, normals[corners])
    around = (np.linalg.norm(nearest[:, None] - nodes, axis=2) < HEIGHT) & (here @ normals.T > 0)
    around[np.arange(len(corners))[:, None], corners] = True
    return Attachments(corners=corners, shares=shares, around=around.astype(float), axes=axes)


@cache
def cases(template: str) -> tuple[Case, ...]:
    """Return every bone of every person with its template.

    The template is the mean of the 25 others ("mean"), or one of them ("person").
    """
    found = []
    for bone in BONES:
        nodes = leg_shapes()[bone].nodes
        for k, person in enumerate(nodes):
            if template == "mean":
                found.append(Case(bone, mean_shape(np.delete(nodes, k, axis=0)), person))
            else:
                found.append(Case(bone, nodes[(k + 7) % len(nodes)], person))
    return tuple(found)


def mean_shape(nodes: Array) -> Array:
    """Return the mean of persons laid on each other without changing their sizes.

    Parameters
    ----------
    nodes : (m, n, 3) of m persons [m]

    Returns
    -------
    (n, 3) [m]
    """
    mean = nodes[0]
    for _ in range(3):
        mean = np.mean([procrustes(one, mean).apply(one) for one in nodes], axis=0)
    return mean


def spread_landmarks(case: Case, count: int) -> Indices:
    """Return nodes of the template as far from each other as they go: the bone's extremes.

    Parameters
    ----------
    case : with the template
    count : of nodes

    Returns
    -------
    (count,) indices
    """
    return _farthest(case.template, count)


def attached_landmarks(case: Case, count: int) -> Indices:
    """Return nodes of the template near attachments, then extremes.

    They are the nearest to attachments that are as far from each other as they go.

    Parameters
    ----------
    case : with the template
    count : of nodes

    Returns
    -------
    (count,) indices
    """
    points = attachments()[case.bone].on(case.template)
    first = cKDTree(case.template).query(points[_farthest(points, min(count, len(points)))])[1]
    every = np.concatenate([first, _farthest(case.template, 2 * count)])
    return every[np.sort(np.unique(every, return_index=True)[1])][:count]


PLACES = {"at attachments": attached_landmarks, "extremes": spread_landmarks}


def by_map(options: MapOptions) -> Maker:
    """Return maps of the package."""

    def make(case: Case, landmarks: Indices, picked: Array) -> PointMap:
        names = tuple(str(k) for k in landmarks)
        return fit_map(FeaturePoints(names, case.template[landmarks], picked), options)

    return make


def scaled_by_pairs(case: Case, landmarks: Indices, picked: Array) -> PointMap:
    """Scale each axis of the body by the distance of two markers, as OpenSim's Scale Tool does.

    They are those furthest apart along the axis.

    Parameters
    ----------
    case : template and person
    landmarks : (k,) nodes of the template
    picked : (k, 3) the same of the person [m]

    Returns
    -------
    Map of the template's points
    """
    axes = attachments()[case.bone].axes
    given = case.template[landmarks]
    along = given @ axes
    factors = []
    for k in range(3):
        high = np.argmax(along[:, k])
        low = np.argmin(along[:, k])
        factors.append(
            np.linalg.norm(picked[high] - picked[low]) / np.linalg.norm(given[high] - given[low])
        )
    return _scaled(axes, np.array(factors), given, picked)


def scaled_by_extents(case: Case, landmarks: Indices, picked: Array) -> PointMap:
    """Scale each axis by the extent of the whole bone, placed by all its nodes.

    That is more than a user of markers can know.

    Parameters
    ----------
    case : template and person
    landmarks : not used, as in every `Maker`
    picked : not used

    Returns
    -------
    Map of the template's points
    """
    axes = attachments()[case.bone].axes
    aligned = procrustes(case.person, case.template).apply(case.person)
    factors = np.ptp(aligned @ axes, axis=0) / np.ptp(case.template @ axes, axis=0)
    return _scaled(axes, factors, case.template, case.person)


SCALED: dict[str, Maker] = {
    "per-axis scaling, distances": scaled_by_pairs,
    "per-axis scaling, extents": scaled_by_extents,
}


SMOOTH = {
    "RBF, r, smoothing 2 mm": by_map(MapOptions(map="rbf", smoothing=PICKING)),
    "SSD, smoothing 2 mm": by_map(MapOptions(smoothing=PICKING)),
}


def every_map() -> dict[str, Maker]:
    """Scaling, and the maps of the package with their defaults."""
    return SCALED | {name: by_map(options) for name, options in MAPS.items()}


@dataclass(frozen=True, eq=False)
class Errors:
    """Of carried points.

    `on`, `beside`: (points,) at the attachments and `HEIGHT` above them [m]; `apart`: (points,)
    from the nearest landmark, in the template [m]; `inverted`: share of the points beside the bone
    at which the map turns space inside out.
    """

    on: Array
    beside: Array
    apart: Array
    inverted: float


def carried(
    make: Maker, landmarks: Callable[[Case], Indices], some: tuple[Case, ...], picking: float = 0.0
) -> Errors:
    """Measure errors over cases; landmarks see the template alone.

    Parameters
    ----------
    make : map from landmarks
    landmarks : (k,) nodes of a case's template
    some : cases
    picking : standard deviation of picked landmarks along each axis [m]

    Returns
    -------
    Errors over all cases
    """
    on = []
    beside = []
    apart = []
    inside_out = []
    random = np.random.default_rng(0)
    for case in some:
        chosen = landmarks(case)
        picked = case.person[chosen] + picking * random.normal(size=(len(chosen), 3))
        found = make(case, chosen, picked)
        points = attachments()[case.bone]
        faces = leg_shapes()[case.bone].faces
        size = procrustes(case.template, case.person, True).scale
        above = points.beside(case.template, faces, HEIGHT)
        on.append(
            np.linalg.norm(found.apply(points.on(case.template)) - points.on(case.person), axis=1)
        )
        beside.append(
            np.linalg.norm(
                found.apply(above) - points.beside(case.person, faces, size * HEIGHT), axis=1
            )
        )
        apart.append(cKDTree(case.template[chosen]).query(points.on(case.template))[0])
        inside_out.append(inverted(found, above))
    share = float(np.mean(np.concatenate(inside_out)))
    return Errors(
        on=np.concatenate(on),
        beside=np.concatenate(beside),
        apart=np.concatenate(apart),
        inverted=share,
    )


def dense_landmarks(case: Case) -> Indices:
    """Return dense correspondence: all nodes, of the pelvis every second one.

    Parameters
    ----------
    case : with the template

    Returns
    -------
    (k,) indices
    """
    return np.arange(0, len(case.template), 1 + len(case.template) // 1000)


def foreseen(landmarks: Callable[[Case], Indices]) -> float:
    """Return the mean error where the 25 others predict the person.

    It is by no map, but by what their shapes know of positions that are not marked. All are laid on
    the template by their landmarks; attachments follow landmarks by ridge regression on the others.

    Parameters
    ----------
    landmarks : (k,) nodes of a case's template

    Returns
    -------
    [m]
    """
    errors = []
    for number, case in enumerate(cases("mean")):
        chosen = landmarks(case)
        places = attachments()[case.bone]
        nodes = leg_shapes()[case.bone].nodes
        others = np.delete(nodes, number % len(nodes), axis=0)
        laid = [procrustes(one[chosen], case.template[chosen], True).apply(one) for one in others]
        seen = np.array([one[chosen].ravel() for one in laid])
        unseen = np.array([places.on(one).ravel() for one in laid])
        to_template = procrustes(case.person[chosen], case.template[chosen], True)
        offset = to_template.apply(case.person[chosen]).ravel() - seen.mean(axis=0)
        spread = seen - seen.mean(axis=0)
        gram = spread @ spread.T
        weights = np.linalg.solve(
            gram + RIDGE * np.trace(gram) / len(gram) * np.eye(len(gram)), spread @ offset
        )
        found = unseen.mean(axis=0) + weights @ (unseen - unseen.mean(axis=0))
        back = to_template.inverse().apply(found.reshape(-1, 3))
        errors.append(np.linalg.norm(back - places.on(case.person), axis=1))
    return float(np.concatenate(errors).mean())


def measure() -> Iterator[Row]:
    """Measure the mean error of carried attachments over all bones.

    The rows are by map and by number and position of landmarks.
    """
    for template, words in (("mean", "mean of 25"), ("person", "another person")):
        for name, make in every_map().items():
            row: Row = {"template": words, "map": name}
            for where, chosen in PLACES.items():
                for count in COUNTS:
                    row[f"{count} {where} [mm]"] = _mean(
                        make, partial(chosen, count=count), template
                    )
            dense = name not in SCALED and (template == "mean" or name == "SSD")
            row["dense [mm]"] = _mean(make, dense_landmarks, template) if dense else ""
            yield row
    row = {"template": "25 others", "map": "regression"}
    for where, chosen in PLACES.items():
        row |= {
            f"{count} {where} [mm]": 1e3 * foreseen(partial(chosen, count=count))
            for count in COUNTS
        }
    yield row | {"dense [mm]": ""}


def measure_bones() -> Iterator[Row]:
    """With 12 landmarks at attachments, bone by bone: SSD beside scaling."""
    for bone in (*BONES, "all"):
        some = tuple(case for case in cases("mean") if bone in (case.bone, "all"))
        ours = carried(by_map(MapOptions()), _twelve, some)
        scaled = carried(scaled_by_pairs, _twelve, some)
        far = ours.apart > FAR
        yield {
            "bone": bone,
            "points": len(ours.on) // len(leg_shapes()["femur"].nodes),
            "scaling [mm]": _spread(scaled.on),
            "SSD [mm]": _spread(ours.on),
            "ratio": float(ours.on.mean() / scaled.on.mean()),
            "median [mm]": 1e3 * float(np.median(ours.on)),
            "95 % [mm]": 1e3 * float(np.percentile(ours.on, 95)),
            "worst [mm]": 1e3 * float(ours.on.max()),
            "20 mm from landmarks: scaling [mm]": _spread(scaled.on[far]),
            "and SSD [mm]": _spread(ours.on[far]),
        }


def measure_beside() -> Iterator[Row]:
    """Measure points 20 mm beside the bone, picking errors, and folds.

    There are 12 landmarks at attachments, or dense ones.
    """
    for name, make in (every_map() | SMOOTH).items():
        exact = carried(make, _twelve, cases("mean"), 0.0)
        noisy = carried(make, _twelve, cases("mean"), PICKING)
        dense = None if name in SCALED | SMOOTH else carried(make, dense_landmarks, cases("mean"))
        yield {
            "map": name,
            "12, on the bone [mm]": 1e3 * float(exact.on.mean()),
            "12, beside [mm]": 1e3 * float(exact.beside.mean()),
            "12, picked with errors [mm]": 1e3 * float(noisy.on.mean()),
            "and beside [mm]": 1e3 * float(noisy.beside.mean()),
            "dense, beside [mm]": "" if dense is None else 1e3 * float(dense.beside.mean()),
            "inverted, 12 [%]": 100 * exact.inverted,
            "inverted, dense [%]": "" if dense is None else 100 * dense.inverted,
        }


_twelve = partial(attached_landmarks, count=12)


def _mean(make: Maker, landmarks: Callable[[Case], Indices], template: str) -> float:
    return 1e3 * float(carried(make, landmarks, cases(template)).on.mean())


def _spread(errors: Array) -> str:
    return f"{1e3 * errors.mean():.2f} ± {1e3 * errors.std():.2f}" if len(errors) else ""


def _scaled(axes: Array, factors: Array, given: Array, picked: Array) -> PointMap:
    stretch = axes @ np.diag(factors) @ axes.T
    placed = procrustes(given @ stretch.T, picked)
    return AffineMap(placed.rotation @ stretch, placed.translation)


def _farthest(points: Array, count: int) -> Indices:
    """Return indices of points, each the furthest from those before it.

    The first is the furthest from the middle.
    """
    found = [int(np.argmax(np.linalg.norm(points - points.mean(axis=0), axis=1)))]
    away = np.linalg.norm(points - points[found[0]], axis=1)
    while len(found) < min(count, len(points)):
        found.append(int(np.argmax(away)))
        away = np.minimum(away, np.linalg.norm(points - points[found[-1]], axis=1))
    return np.array(found)


def _normals(nodes: Array, faces: Indices) -> Array:
    """(n, 3) outward unit normals at nodes, triangles by their areas."""
    corners = nodes[faces]
    normals = np.zeros_like(nodes)
    crossed = np.cross(corners[:, 1] - corners[:, 0], corners[:, 2] - corners[:, 0])
    for k in range(3):
        np.add.at(normals, faces[:, k], crossed)
    outward: Array = normals / np.linalg.norm(normals, axis=1, keepdims=True)
    return outward


def _joined(parts: list[mm.Surface]) -> mm.Surface:
    starts = np.cumsum([0, *(len(one.vertices) for one in parts)])
    faces = [one.faces + start for one, start in zip(parts, starts, strict=False)]
    return mm.Surface(np.vstack([one.vertices for one in parts]), np.vstack(faces))
