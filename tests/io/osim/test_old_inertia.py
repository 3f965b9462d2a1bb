"""Inertia that an old document leaves out, against OpenSim's own reading of it."""

from __future__ import annotations

import numpy as np
import pytest

import opensim_oracle
from myomorph.core.io.osim.read import read_osim

DOCUMENT = """<?xml version="1.0" encoding="UTF-8"?>
<OpenSimDocument Version="{version}">
<Model name="m"><BodySet><objects>
<Body name="ground"><mass>0</mass></Body>
<Body name="arm"><mass>2</mass><mass_center>0 0 0</mass_center>{inertia}<Joint>
<PinJoint name="elbow"><parent_body>ground</parent_body>
<CoordinateSet><objects><Coordinate name="flexion"/></objects></CoordinateSet></PinJoint>
</Joint></Body>
</objects></BodySet></Model></OpenSimDocument>
"""
STATED = {
    "": (1.0, 1.0, 1.0, 0.0),
    "<inertia_xx>0.5</inertia_xx>": (0.5, 1.0, 1.0, 0.0),
    "<inertia_yy>0.5</inertia_yy><inertia_xy>0.1</inertia_xy>": (1.0, 0.5, 1.0, 0.1),
}
"""Moments about x, y and z and the product xy [kg m^2] by what the body states."""
UNIT_VERSIONS = ("20302", "30000", "30499")
"""Of documents in which a moment that is left out is 1 kg m^2; from 3.5.0 on all are 0."""
CASES = [(version, stated) for version in (*UNIT_VERSIONS, "30500") for stated in STATED]


def _expected_inertia(version: str, stated: str) -> np.ndarray:
    if version not in UNIT_VERSIONS:
        return np.zeros((3, 3))
    xx, yy, zz, xy = STATED[stated]
    return np.array([[xx, xy, 0.0], [xy, yy, 0.0], [0.0, 0.0, zz]])


@pytest.mark.parametrize(("version", "stated"), CASES)
def test_moments_that_are_left_out(tmp_path, version, stated):
    path = tmp_path / "old.osim"
    path.write_text(DOCUMENT.format(version=version, inertia=stated), encoding="utf-8")
    inertia = read_osim(path).body("arm").inertia
    np.testing.assert_array_equal(inertia, _expected_inertia(version, stated))


def test_opensim_leaves_out_the_same(tmp_path):
    pytest.importorskip("opensim")
    files = {}
    for index, (version, stated) in enumerate(CASES):
        path = tmp_path / f"old_{index}.osim"
        path.write_text(DOCUMENT.format(version=version, inertia=stated), encoding="utf-8")
        files[f"{version}{stated}"] = path
    answers = opensim_oracle.ask(files, tmp_path)
    for version, stated in CASES:
        _, _, inertia = answers[f"{version}{stated}"]["bodies"]["arm"]
        np.testing.assert_array_equal(inertia, _expected_inertia(version, stated))
