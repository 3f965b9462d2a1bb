"""Attachments carried between the persons of a shape model, whose correspondence is the truth."""

from __future__ import annotations

from functools import partial

import igl
import numpy as np
import pytest
from benchmarks.accuracy.morph.shapes import (
    Errors,
    Maker,
    attached_landmarks,
    by_map,
    carried,
    cases,
    dense_landmarks,
    scaled_by_pairs,
)

from myomorph.bones.morph.maps.fields import MapOptions
from truths.leg_shapes import leg_shapes

PARTS = {"pelvis": 3, "femur": 1, "patella": 1, "tibia": 2}


@pytest.fixture(autouse=True)
def _needs_data(data):
    data("bones-shape-model-llp26")
    data("bones-opensim-rajagopal")
    data("rajagopal-walk-emg")


def test_bones_are_closed_surfaces_over_the_nodes():
    for bone, shapes in leg_shapes().items():
        edges = np.sort(
            np.concatenate([shapes.faces[:, pair] for pair in ([0, 1], [1, 2], [2, 0])]), axis=1
        )
        assert (np.unique(edges, axis=0, return_counts=True)[1] == 2).all()
        assert igl.facet_components(shapes.faces)[0] == PARTS[bone]
        assert set(np.unique(shapes.faces)) == set(range(shapes.nodes.shape[1]))


def of_femurs(make: Maker, count: int) -> Errors:
    landmarks = partial(attached_landmarks, count=count) if count else dense_landmarks
    return carried(make, landmarks, tuple(case for case in cases("person") if case.bone == "femur"))


def test_twelve_landmarks_halve_the_error_of_scaling():
    scaled = of_femurs(scaled_by_pairs, 12)
    ours = of_femurs(by_map(MapOptions()), 12)
    assert ours.on.mean() < 0.5 * scaled.on.mean()
    assert ours.inverted == 0.0


def test_more_features_are_better_and_few_no_worse_than_a_similarity():
    errors = [of_femurs(by_map(MapOptions()), count).on.mean() for count in (4, 12, 0)]
    assert errors == sorted(errors, reverse=True)
    assert errors[0] < of_femurs(by_map(MapOptions(map="similarity")), 4).on.mean()
    assert errors[-1] < 1e-3
