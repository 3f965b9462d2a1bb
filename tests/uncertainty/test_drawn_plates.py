"""Forces of drawn plates: a plate that is turned turns what it measures."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.model.series import Wrenches
from myomorph.lab.uncertainty.bodies import Draw
from myomorph.lab.uncertainty.drawn_inputs import drawn_wrenches
from myomorph.lab.uncertainty.normals import Normals
from myomorph.lab.uncertainty.sources import GROUPS, Sources

NONE = replace(Sources(), **{name: 0.0 for names in GROUPS.values() for name in names})
UP = np.array([0.0, 1.0, 0.0])
TIME = np.arange(5) / 100.0
HIP = np.array([0.0, 0.9, 0.0])
DRAWS = 400


def standing() -> Wrenches:
    """Let a body of 700 N stand below its hip, and turn on the spot."""
    forces = np.tile([0.0, 700.0, 0.0], (len(TIME), 1, 1))
    torques = np.tile([0.0, 5.0, 0.0], (len(TIME), 1, 1))
    return Wrenches(
        time=TIME,
        names=("plate",),
        bodies=("foot",),
        forces=forces,
        points=np.zeros_like(forces),
        torques=torques,
    )


def drawn(sources: Sources) -> list[Wrenches]:
    normals = Normals(DRAWS)
    return [drawn_wrenches(standing(), UP, Draw(k, sources, normals)) for k in range(DRAWS)]


def test_a_turned_plate_turns_its_force_and_torque():
    angle = 0.0087
    for moved in drawn(replace(NONE, plate_rotation=angle)):
        np.testing.assert_allclose(np.linalg.norm(moved.forces, axis=2), 700.0)
        np.testing.assert_allclose(np.linalg.norm(moved.torques, axis=2), 5.0)
        np.testing.assert_array_equal(moved.points, standing().points)
        # The angle between both stays.
        products = np.einsum("fwi,fwi->fw", moved.forces, moved.torques)
        np.testing.assert_allclose(products, 3500.0)


def test_half_a_degree_is_the_moment_that_geometry_says():
    """A force that leans by an angle has the moment F h sin(angle) about a hip at height h."""
    angle = 0.0087
    moments = np.array(
        [
            np.cross(moved.points[0, 0] - HIP, moved.forces[0, 0])[[0, 2]]
            for moved in drawn(replace(NONE, plate_rotation=angle))
        ]
    )
    expected = 700.0 * 0.9 * angle
    assert moments.std(axis=0) == pytest.approx([expected, expected], rel=0.05)


def test_the_orientation_matters_more_than_position_and_gain():
    """At the hip, by the usual sizes."""

    def moment(**sizes: float) -> float:
        values = [
            np.cross(moved.points[0, 0] - HIP, moved.forces[0, 0])[[0, 2]]
            for moved in drawn(replace(NONE, **sizes))
        ]
        return float(np.std(values))

    usual = Sources()
    rotation = moment(plate_rotation=usual.plate_rotation)
    others = moment(plate_position=usual.plate_position, plate_gain=usual.plate_gain)
    assert rotation > others


def test_without_a_size_nothing_is_drawn():
    (moved, *_) = drawn(NONE)
    np.testing.assert_array_equal(moved.forces, standing().forces)
    np.testing.assert_array_equal(moved.torques, standing().torques)
