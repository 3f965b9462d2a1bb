"""A leg carried into deformed bones and into bones of persons who are held out.

Compared are attachments and moment arms. The leg is laid on the mean of other persons of LLP26.
From there the truth is the model that the map through all corresponding nodes makes. The persons'
bones do not share a frame, so joints go by the maps.
"""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from dataclasses import dataclass, replace
from functools import cache

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.correspondence import (
    BONES,
    MODEL,
    Deformation,
    bone,
    deformed,
    three_landmarks,
)
from benchmarks.accuracy.morph.shapes import BODIES, attachments, mean_shape
from data_collection import data_folder
from myomorph.bones.morph.arm_intervals import with_arm_intervals
from myomorph.bones.morph.checks.checks import check_morph
from myomorph.bones.morph.checks.moment_arms import compare_moment_arms, compared_coordinates
from myomorph.bones.morph.maps.fields import BoneMap, FeaturePoints, PointMap, fit_map
from myomorph.bones.morph.morphed import Morph, MorphOptions
from myomorph.bones.study.morph_files import source_bones
from myomorph.core.model.arrays import Array
from myomorph.core.surfaces.linear_maps import procrustes
from truths.leg_shapes import leg_shapes

Row = dict[str, object]

GEOMETRY = "bones-opensim-rajagopal/Geometry"
PERSONS = (2, 10, 18, 24)
"""Held out; the template is the mean of persons with an odd number, on whom settings were chosen.
"""

DENSE = 400
"""Nodes through which the true map of a bone goes."""

LANDMARKS = 12
"""At attachments, exact, as in `morph_shapes_bones`."""

EXACT = MorphOptions(surface_within=0.0, joints="mapped", clear=False, fibers="keep", force="keep")
DEFAULT = MorphOptions(joints="mapped", fibers="keep", force="keep")


@dataclass(frozen=True, eq=False)
class Leg:
    """The leg in the template's bones.

    `morph`: from Rajagopal's model; `nodes`: (n, 3) of the template, by body [m].
    """

    morph: Morph
    nodes: Mapping[str, Array]


@cache
def leg() -> Leg:
    """Rajagopal's left leg, without landmarks, in the mean bones of persons with an odd number."""
    model = mm.read_model(data_folder() / MODEL)
    model = replace(model, muscles=tuple(one for one in model.muscles if one.name.endswith("_l")))
    ours = source_bones(model, data_folder() / GEOMETRY)
    nodes = {BODIES[name]: mean_shape(shapes.nodes[1::2]) for name, shapes in leg_shapes().items()}
    faces = {BODIES[name]: shapes.faces for name, shapes in leg_shapes().items()}
    bones = {
        body: mm.map_bone(body, ours[body], mm.Surface(nodes[body], faces[body])) for body in nodes
    }
    return Leg(mm.morph_model(model, bones, DEFAULT), nodes)


def given_map(body: str, mapping: PointMap, source: mm.Surface, target: mm.Surface) -> BoneMap:
    """Return a bone that goes by a map."""
    whole = procrustes(source.vertices, mapping.apply(source.vertices), True)
    return BoneMap(
        body=body,
        target_body=body,
        map=mapping,
        whole=whole,
        basis="given",
        source=source,
        target=target,
    )


def ways(person: int) -> Iterator[tuple[str, dict[str, BoneMap], MorphOptions]]:
    """Yield the true maps of a person's bones, then each method's, and what is made of them."""
    pairs = {}
    for name, shapes in leg_shapes().items():
        body = BODIES[name]
        template = leg().nodes[body]
        there = shapes.nodes[person]
        pairs[body] = (name, mm.Surface(template, shapes.faces), mm.Surface(there, shapes.faces))

    def through(count: int) -> dict[str, BoneMap]:
        found = {}
        for body, (name, source, target) in pairs.items():
            places = attachments()[name].on(source.vertices) if count < DENSE else source.vertices
            chosen = spread_nodes(source.vertices, places, count)
            features = FeaturePoints(
                tuple(str(k) for k in chosen), source.vertices[chosen], target.vertices[chosen]
            )
            found[body] = given_map(body, fit_map(features), source, target)
        return found

    def laid(marked: bool) -> dict[str, BoneMap]:
        found = {}
        for body, (_, source, target) in pairs.items():
            marks = None
            if marked:
                ends = three_landmarks(source)
                index = [
                    int(np.argmin(np.linalg.norm(source.vertices - one, axis=1))) for one in ends
                ]
                marks = FeaturePoints(("a", "b", "c"), ends, target.vertices[index])
            found[body] = mm.map_bone(body, source, target, marks)
        return found

    yield "truth", through(DENSE), EXACT
    scaled = {
        body: given_map(body, procrustes(source.vertices, target.vertices, True), source, target)
        for body, (_, source, target) in pairs.items()
    }
    yield "scaling", scaled, EXACT
    yield f"{LANDMARKS} landmarks", through(LANDMARKS), EXACT
    yield "no landmarks", laid(False), DEFAULT
    yield "three landmarks", laid(True), DEFAULT


def spread_nodes(nodes: Array, places: Array, count: int) -> np.ndarray:
    """Return nodes that are spread as far as possible.

    First come those nearest to positions as far from each other as they go, then nodes of the whole
    as far as they go.

    Parameters
    ----------
    nodes : (n, 3) [m]
    places : (k, 3) positions [m]
    count : of nodes to choose

    Returns
    -------
    (count,) indices, fewer where there are not so many nodes
    """
    chosen = [int(np.argmax(np.linalg.norm(nodes - nodes.mean(axis=0), axis=1)))]
    away = np.linalg.norm(nodes - nodes[chosen[0]], axis=1)
    near = np.array([int(np.argmin(np.linalg.norm(nodes - one, axis=1))) for one in places])
    while len(chosen) < min(count, len(nodes)):
        wanted = near if away[near].max() > 0.0 else np.arange(len(nodes))
        chosen.append(int(wanted[np.argmax(away[wanted])]))
        away = np.minimum(away, np.linalg.norm(nodes - nodes[chosen[-1]], axis=1))
    return np.array(chosen)


def measure(persons: tuple[int, ...] = PERSONS) -> Iterator[Row]:
    """Yield a row for each method.

    It has errors of muscle points and of moment arms over the ranges, and whether intervals hold.
    """
    every: dict[str, list[tuple[Array, Array, Array, Array]]] = {}
    for person in persons:
        true: Morph | None = None
        for way, bones, options in ways(person):
            found = mm.morph_model(leg().morph.model, bones, options)
            if true is None:
                true = found
                continue
            every.setdefault(way, []).append(_against(true, found))
    for way, parts in every.items():
        points, within, arms, sizes = map(np.concatenate, zip(*parts, strict=True))
        known = np.isfinite(within)
        yield {
            "way": way,
            "persons": len(persons),
            "points": len(points),
            "median [mm]": 1e3 * float(np.median(points)),
            "95 % [mm]": 1e3 * float(np.percentile(points, 95)),
            "largest [mm]": 1e3 * float(points.max()),
            "intervals hold [%]": 100.0 * float(np.mean(points[known] <= within[known]))
            if known.any()
            else "",
            "moment arms": len(arms),
            "moment arm, median [mm]": 1e3 * float(np.median(arms)),
            "moment arm, 95 % [mm]": 1e3 * float(np.percentile(arms, 95)),
            "moment arm, largest [mm]": 1e3 * float(arms.max()),
            "all together, of the arms' [%]": 100.0
            * float(np.linalg.norm(arms) / np.linalg.norm(sizes)),
        }


def _against(true: Morph, found: Morph) -> tuple[Array, Array, Array, Array]:
    """Return errors and radii of muscle points on the mapped bones, then those of moment arms [m].

    Of moment arms they are errors and sizes, the rms of each.
    """
    mapped = {BODIES[name] for name in leg_shapes()}
    goals = {(one.owner, one.name): one.target for one in true.points}
    own = [one for one in found.points if one.body in mapped]
    away = np.array([np.linalg.norm(one.target - goals[one.owner, one.name]) for one in own])
    tables = compare_moment_arms(
        true.model, found.model, compared_coordinates(true.model, found.model)
    )
    turning = [one for one in tables if one.kind == "rotational"]
    arms = [np.sqrt(np.mean((one.target - one.source) ** 2, axis=0)) for one in turning]
    sizes = [np.sqrt(np.mean(one.source**2, axis=0)) for one in turning]
    return away, np.array([one.within for one in own]), np.concatenate(arms), np.concatenate(sizes)


SEEDS = range(22, 26)
"""Deformations that were not used to choose anything."""


@cache
def deformed_leg() -> mm.Model:
    """Return the model with the muscles of its right leg."""
    model = mm.read_model(data_folder() / MODEL)
    return replace(model, muscles=tuple(one for one in model.muscles if one.name.endswith("_r")))


def legs(seed: int) -> tuple[Morph, Morph]:
    """Return the leg in deformed bones, as the deformations make it and as found without landmarks.

    Muscles are not cleared of bones.
    """
    true: dict[str, BoneMap] = {}
    found: dict[str, BoneMap] = {}
    for body in BONES:
        surface, *_ = bone(body)
        change = Deformation(surface, seed)
        found[body] = mm.map_bone(body, surface, deformed(surface, change))
        target = found[body].target
        features = found[body].features
        assert target is not None
        assert features is not None
        chosen = surface.vertices[spread_nodes(surface.vertices, surface.vertices, DENSE)]
        pairs = FeaturePoints(tuple(str(k) for k in range(len(chosen))), chosen, change(chosen))
        # Turned as the places that were matched are, so that both legs stand alike.
        whole = procrustes(features.source, change(features.source), True)
        true[body] = replace(given_map(body, fit_map(pairs), surface, target), whole=whole)
    return mm.morph_model(deformed_leg(), true, EXACT), mm.morph_model(
        deformed_leg(), found, replace(DEFAULT, clear=False)
    )


def measure_deformed(seeds: range = SEEDS) -> Iterator[Row]:
    """Yield a row for each coordinate, and one for all.

    It has errors of moment arms over its range, and how often intervals hold.
    """
    parts: dict[str, list[np.ndarray]] = {}
    for seed in seeds:
        true, found = legs(seed)
        checks = with_arm_intervals(found, check_morph(found))
        tables = compare_moment_arms(true.model, found.model, [one.pair for one in checks.arms])
        for one, other in zip(checks.arms, tables, strict=True):
            if one.kind == "rotational" and one.within is not None:
                away = np.abs(other.target - other.source)
                parts.setdefault(one.pair.target, []).append(
                    np.array([away.ravel(), one.within.ravel()])
                )
    for name, own in [*parts.items(), ("all", [one for rows in parts.values() for one in rows])]:
        away, within = np.concatenate(own, axis=1)
        yield {
            "coordinate": name,
            "legs": len(seeds),
            "moment arms": len(away),
            "error, median [mm]": 1e3 * float(np.median(away)),
            "95 % [mm]": 1e3 * float(np.percentile(away, 95)),
            "interval, median [mm]": 1e3 * float(np.median(within)),
            "intervals hold [%]": 100.0 * float(np.mean(away <= within)),
        }
