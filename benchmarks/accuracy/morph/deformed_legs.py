"""A leg in bones that are deformed at random: whether intervals of its moment arms hold."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace
from functools import cache

import numpy as np

import myomorph as mm
from benchmarks.accuracy.morph.correspondence import BONES, MODEL, Deformation, bone, deformed
from benchmarks.accuracy.morph.held_out import DEFAULT, DENSE, EXACT, given_map, spread_nodes
from data_collection import data_folder
from myomorph.morph.arm_intervals import with_arm_intervals
from myomorph.morph.checks.checks import check_morph
from myomorph.morph.checks.moment_arms import compare_moment_arms
from myomorph.morph.maps.fields import BoneMap, FeaturePoints, fit_map
from myomorph.morph.maps.linear import procrustes
from myomorph.morph.morphed import Morph

Row = dict[str, object]

SEEDS = range(22, 26)
"""Deformations that were not used to choose anything."""


@cache
def leg() -> mm.Model:
    """The model with the muscles of its right leg."""
    model = mm.read_model(data_folder() / MODEL)
    return replace(model, muscles=tuple(one for one in model.muscles if one.name.endswith("_r")))


def legs(seed: int) -> tuple[Morph, Morph]:
    """The leg in deformed bones: as the deformations make it, and as it is found without landmarks; not cleared."""
    true: dict[str, BoneMap] = {}
    found: dict[str, BoneMap] = {}
    for body in BONES:
        surface, *_ = bone(body)
        change = Deformation(surface, seed)
        found[body] = mm.map_bone(body, surface, deformed(surface, change))
        target, features = found[body].target, found[body].features
        assert target is not None
        assert features is not None
        chosen = surface.vertices[spread_nodes(surface.vertices, surface.vertices, DENSE)]
        pairs = FeaturePoints(tuple(str(k) for k in range(len(chosen))), chosen, change(chosen))
        # Turned as the places that were matched are, so that both legs stand alike.
        whole = procrustes(features.source, change(features.source), True)
        true[body] = replace(given_map(body, fit_map(pairs), surface, target), whole=whole)
    return mm.morph_model(leg(), true, EXACT), mm.morph_model(leg(), found, replace(DEFAULT, clear=False))


def measure(seeds: range = SEEDS) -> Iterator[Row]:
    """A row a coordinate, and one for all: errors of moment arms over its range, and how often intervals hold."""
    parts: dict[str, list[np.ndarray]] = {}
    for seed in seeds:
        true, found = legs(seed)
        checks = with_arm_intervals(found, check_morph(found))
        tables = compare_moment_arms(true.model, found.model, [one.pair for one in checks.arms])
        for one, other in zip(checks.arms, tables, strict=True):
            if one.kind == "rotational" and one.within is not None:
                away = np.abs(other.target - other.source)
                parts.setdefault(one.pair.target, []).append(np.array([away.ravel(), one.within.ravel()]))
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
