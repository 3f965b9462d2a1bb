"""The raw files of the virtual laboratory lead back to the truth.

Plate, clock of a C3D file, bones, and clusters.
"""

from __future__ import annotations

import tomllib
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.contact.plate_placements import MarkedWeight
from myomorph.core.contact.plates import plate_wrench
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.mesh import read_mesh
from myomorph.core.model.errors import BadModel
from myomorph.core.model.series import Markers
from myomorph.core.model.spatial import Transform
from myomorph.core.surfaces.clusters import find_balls
from myomorph.core.surfaces.rigid_registration import Surface
from myomorph.swings.simulate.laboratory import (
    BALL,
    BONES,
    ROD,
    Noise,
    VirtualPlate,
    at_center,
    bone_of,
    write_rod,
    write_scans,
    write_swing_c3d,
)
from myomorph.swings.simulate.shoulder import (
    PLATE,
    Setup,
    VirtualSpecimen,
    arm_specimen,
    virtual_specimen,
)
from myomorph.swings.viscosity.study.calibration import PlateFiles, calibrate, read_picks

pytest.importorskip("myo_sim")


@pytest.fixture(scope="module")
def made() -> VirtualSpecimen:
    return virtual_specimen(
        1, seconds=1.0, trials=1, setup=Setup(noise=Noise(0.0, 0.0, offset=0.0131))
    )


def plate_of(made: VirtualSpecimen) -> VirtualPlate:
    center = made.specimen.stand.apply(made.specimen.center)
    return VirtualPlate(Transform(np.eye(3), center + PLATE), np.random.default_rng(1))


def test_rod_finds_the_plate(made: VirtualSpecimen, tmp_path: Path) -> None:
    plate = plate_of(made)
    write_rod(plate, Noise(), np.random.default_rng(2), tmp_path / "rod.c3d")
    weight = MarkedWeight("rod", tuple(ROD), axis=("rod_1", "rod_2"), tip=ROD["rod_1"])
    found = calibrate(PlateFiles((tmp_path / "rod.c3d",), weight))
    assert np.linalg.norm(plate.nominal.translation - plate.true.translation) > 2e-3
    assert np.linalg.norm(found.center - plate.true.translation) < 5e-4
    assert np.abs(found.rotation - plate.true.rotation).max() < 2e-3


def test_c3d_holds_the_swing_with_the_clock_of_the_plate(
    made: VirtualSpecimen, tmp_path: Path
) -> None:
    trial = made.without.trials[0]
    plate = plate_of(made)
    write_swing_c3d(trial, plate, tmp_path / "swing.c3d")
    read = read_c3d(tmp_path / "swing.c3d")
    assert isinstance(read.markers, Markers)
    first = int(np.argmin(np.abs(trial.markers.values - read.markers.values[0]).max(axis=(1, 2))))
    assert first == 3  # the first frame after 13.1 ms
    np.testing.assert_allclose(
        read.markers.values, trial.markers.values[first : first + len(read.markers)], atol=1e-6
    )
    force, moment = plate_wrench(read.plate_recordings[0])
    at = int(np.searchsorted(trial.wrenches.time, trial.markers.time[first] - 1e-9))
    true_force, true_moment = at_center(trial.wrenches, plate.true.translation)
    np.testing.assert_allclose(
        force @ plate.true.rotation.T, true_force[at : at + len(force)], atol=1e-4
    )
    np.testing.assert_allclose(
        moment @ plate.true.rotation.T, true_moment[at : at + len(force)], atol=1e-4
    )


def test_scans_hold_bones_and_balls(made: VirtualSpecimen, tmp_path: Path) -> None:
    (tmp_path / "scan").mkdir()
    text = write_scans(made.specimen, tmp_path / "scan", np.random.default_rng(3))
    entries = tomllib.loads(f"ct = {text}")["ct"]
    assert [one["bone"] for one in entries] == list(BONES)
    one = entries[1]
    seen = read_mesh(tmp_path / one["cluster"])
    balls = find_balls(Surface(1e-3 * seen.vertices, seen.faces), BALL)
    places = np.array([m.location for m in made.specimen.model.markers if m.body == one["bone"]])
    assert len(balls) == 3
    points = read_picks(tmp_path / one["picked"])
    apart_part, truly_part = np.split(np.array([*points.values()]), 2, 1)
    apart = np.linalg.norm(np.diff(apart_part, axis=0), axis=1)
    truly = np.linalg.norm(np.diff(truly_part, axis=0), axis=1)
    np.testing.assert_allclose(1e-3 * apart, truly, atol=3e-3)
    assert np.linalg.norm(places[0] - places[1]) > 0.03


def test_bone_without_mesh_is_told() -> None:
    specimen = arm_specimen()
    bodies = tuple(replace(one, meshes=()) for one in specimen.model.bodies)
    with pytest.raises(BadModel, match=r"'humerus_r' has no mesh 'humerus\.stl'"):
        bone_of(replace(specimen, model=replace(specimen.model, bodies=bodies)), "humerus_r")
