"""Ligaments of OpenSim files: their paths are the model's, the rest stays as the file has it."""

from __future__ import annotations

import re
from dataclasses import replace

import numpy as np

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.core.model.join import join_models
from myomorph.core.model.scale import scale
from myomorph.core.muscles.kinematics import default_path_lengths

FILE = "lenhart-knee-contact-walk/lenhart2015.osim"


def test_written_ligaments_are_those_read(data, tmp_path):
    model = read_osim(data(FILE))
    assert len(model.ligaments) == 76
    assert not write_osim(model, tmp_path / "again.osim")
    again = read_osim(tmp_path / "again.osim")
    for one, other in zip(model.ligaments, again.ligaments, strict=True):
        assert (one.name, one.kind, one.slack_length) == (
            other.name,
            other.kind,
            other.slack_length,
        )
        assert [wrap.wrap_object for wrap in one.path.wraps] == [
            wrap.wrap_object for wrap in other.path.wraps
        ]
        for point, same in zip(one.path.points, other.path.points, strict=True):
            assert point.body == same.body
            assert np.array_equal(point.location, same.location)
    stiffness = [
        re.search(r"<linear_stiffness>(.*?)<", part.text)
        for part in again.kept
        if "Ligament" in part.kind
    ]
    assert len([one for one in stiffness if one]) == 76


def test_scaled_ligaments_are_as_taut(data):
    model = read_osim(data(FILE))
    twin = scale(
        model, dict.fromkeys(model.body_names, (1.1, 1.1, 1.1)), path_lengths=default_path_lengths
    )
    strings = [
        replace(one, muscles=tuple(each.as_muscle() for each in one.ligaments))
        for one in (model, twin)
    ]
    before, after = map(default_path_lengths, strings)
    ratios = [
        one.slack_length / old.slack_length
        for one, old in zip(twin.ligaments, model.ligaments, strict=True)
    ]
    np.testing.assert_allclose(ratios, after / before, rtol=1e-9)
    assert max(ratios) > 1.05


def test_joined_models_keep_their_ligaments_apart(data):
    model = read_osim(data(FILE))
    both = join_models({"a": model, "b": model})
    assert len(both.ligaments) == 152
    assert {one.path.points[0].body[:2] for one in both.ligaments} == {"a_", "b_"}
