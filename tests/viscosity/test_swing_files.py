"""Markers and forces of a swing from every kind of file are those that were recorded.

Which way is up does not matter.
"""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest
from swung_specimen import Release, arm_specimen, swing

from myomorph.core.contact.plate_placements import MarkedWeight
from myomorph.core.io.c3d.write import write_c3d
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadData, BadFile, BadModel, UnknownName
from myomorph.core.model.series import Z_UP_TO_Y_UP, Markers, PlateRecording, Table, Wrenches
from myomorph.core.model.spatial import axis_rotation
from myomorph.swings.viscosity.study.calibration import (
    PlateFiles,
    calibrate,
    placed,
    plate_residuals,
)
from myomorph.swings.viscosity.study.recordings import SwingFiles
from myomorph.swings.viscosity.study.specimen_files import SpecimenFiles
from myomorph.swings.viscosity.study.swing_files import (
    carrying,
    open_specimen,
    open_swing,
    turn_to,
    turned,
    wrench_of_table,
)
from myomorph.swings.viscosity.swings.plate import wrench_about

DOWN = np.array([0.0, -9.80665, 0.0])
LABELS = [
    f"{what}{axis}"
    for what in ("ground_force_v", "ground_force_p", "ground_torque_")
    for axis in "xyz"
]


@pytest.fixture(scope="module")
def swung(tmp_path_factory):
    folder = tmp_path_factory.mktemp("swing")
    specimen = arm_specimen()
    write_osim(specimen.model, folder / "arm.osim")
    return folder, specimen, swing(specimen, Release(seconds=2.0))


def whole(wrenches):
    """Return (samples, 9) force, point, torque."""
    return np.hstack([wrenches.forces[:, 0], wrenches.points[:, 0], wrenches.torques[:, 0]])


def write_table(wrenches, path, names=LABELS):
    write_sto(Table(wrenches.time, tuple(names), whole(wrenches)), path)


def plate_of(wrenches, rotation, center):
    """Make a plate at a pose whose channels represent the wrench on what it carries.

    The channels are force and moment about its origin.
    """
    origin = np.array([0.001, -0.002, -0.04])
    force = wrenches.forces[:, 0] @ rotation
    about = wrench_about(wrenches, center)[:, :3] @ rotation
    local = np.array([[0.2, 0.3, 0.0], [-0.2, 0.3, 0.0], [-0.2, -0.3, 0.0], [0.2, -0.3, 0.0]])
    channels = np.hstack([force, about - np.cross(force, origin)])
    return PlateRecording(
        name="FP1", kind=2, corners=local @ rotation.T + center, origin=origin, channels=channels
    )


def opened(folder, specimen, markers, loads, **given):
    files = replace(SpecimenFiles("s", folder / "arm.osim"), **given)
    place = given.pop("place", None)
    return open_swing(
        SwingFiles("one", folder / markers, folder / loads), specimen.model, files, place
    )


def same(trial, truth, center, tolerance):
    np.testing.assert_allclose(trial.markers.values, truth.markers.values, atol=tolerance)
    found = wrench_about(trial.wrenches, center)
    known = wrench_about(truth.wrenches, center)
    np.testing.assert_allclose(found, known[: len(found)], atol=50 * tolerance)


def test_tables_come_back(swung):
    folder, specimen, made = swung
    write_trc(made.trial.markers, folder / "a.trc")
    write_table(made.trial.wrenches, folder / "a.mot")
    trial, notes = opened(folder, specimen, "a.trc", "a.mot")
    same(trial, made.trial, specimen.center_in_ground, 2e-6)
    assert notes == ()


def test_columns_are_known_by_name_or_by_order(swung, tmp_path):
    wrenches = swung[2].trial.wrenches
    write_table(wrenches, tmp_path / "order.sto", [f"c{i}" for i in range(9)])
    np.testing.assert_allclose(
        whole(wrench_of_table(tmp_path / "order.sto")), whole(wrenches), rtol=1e-9
    )
    shuffled = [*LABELS[3:6], *LABELS[6:], *LABELS[:3]]
    values = whole(wrenches)[:, [3, 4, 5, 6, 7, 8, 0, 1, 2]]
    write_sto(Table(wrenches.time, tuple(shuffled), values), tmp_path / "names.sto")
    np.testing.assert_allclose(
        whole(wrench_of_table(tmp_path / "names.sto")), whole(wrenches), rtol=1e-9
    )
    write_sto(Table(wrenches.time, ("a", "b"), values[:, :2]), tmp_path / "two.sto")
    with pytest.raises(BadFile, match="2 columns beside the time"):
        wrench_of_table(tmp_path / "two.sto")


def test_forces_on_the_plate_are_reversed_and_said(swung):
    folder, specimen, made = swung
    wrenches = made.trial.wrenches
    write_trc(made.trial.markers, folder / "b.trc")
    write_table(
        replace(wrenches, forces=-wrenches.forces, torques=-wrenches.torques), folder / "b.mot"
    )
    trial, notes = opened(folder, specimen, "b.trc", "b.mot")
    same(trial, made.trial, specimen.center_in_ground, 2e-6)
    assert notes == ("one: the forces were those on the plate, and were reversed",)


def test_another_vertical_is_asked_for_and_then_turned(swung):
    folder, specimen, made = swung
    lab = Z_UP_TO_Y_UP.T
    markers = made.trial.markers.rotated(lab)
    write_trc(markers, folder / "z.trc")
    write_table(turned(made.trial.wrenches, lab), folder / "z.mot")
    with pytest.raises(BadData, match=r'the weight hangs along z, .* give up = "z"'):
        opened(folder, specimen, "z.trc", "z.mot")
    trial, _ = opened(folder, specimen, "z.trc", "z.mot", up="z")
    same(trial, made.trial, specimen.center_in_ground, 2e-6)


@pytest.mark.parametrize("up", ["x", "y", "z"])
@pytest.mark.parametrize("gravity", [DOWN, [0.0, 0.0, -9.8], [0.0, 9.8, 0.0], [-9.8, 0.0, 0.0]])
def test_turning_puts_up_against_gravity(up, gravity):
    turn = turn_to(up, np.array(gravity))
    np.testing.assert_allclose(turn @ turn.T, np.eye(3), atol=1e-12)
    assert np.linalg.det(turn) == pytest.approx(1.0)
    np.testing.assert_allclose(
        turn @ np.eye(3)["xyz".index(up)], -np.array(gravity) / np.linalg.norm(gravity), atol=1e-12
    )


def test_a_plate_that_hides_the_weight_tells_no_vertical():
    force = np.random.default_rng(0).normal(size=(50, 1, 3))
    wrenches = Wrenches(
        time=np.arange(50.0),
        names=("p",),
        bodies=("",),
        forces=force - force.mean(axis=0),
        points=0 * force,
        torques=0 * force,
    )
    assert carrying(wrenches, DOWN, "one") == (wrenches, ())


def test_a_c3d_holds_all_of_it(swung):
    folder, specimen, made = swung
    lab = Z_UP_TO_Y_UP.T
    center = np.array([0.3, 0.2, 1.4])
    rotation = axis_rotation([0.0, 0.6, 0.8], 2.9)
    plate = plate_of(turned(made.trial.wrenches, lab), rotation, center)
    write_c3d(folder / "c.c3d", made.trial.markers.rotated(lab), plate)
    trial, _ = opened(folder, specimen, "c.c3d", "c.c3d", up="z")
    same(trial, made.trial, specimen.center_in_ground, 2e-5)


def _weight_on(center, turn):
    """Put a disc of 10 kg on five places of a plate, 4 s each; markers and what it presses with."""
    grid = [(0.15, 0.2), (-0.15, 0.2), (-0.15, -0.2), (0.15, -0.2), (0.0, 0.05)]
    time = np.arange(0.0, 6.0 * len(grid), 0.005)
    fine = np.arange(0.0, 6.0 * len(grid), 0.0005)
    point = np.zeros((len(time), 3))
    force = np.zeros((len(fine), 1, 3))
    points = np.zeros((len(fine), 1, 3))
    for i, place in enumerate(grid):
        foot = center + turn @ [*place, 0.0]
        point[(time >= 6 * i) & (time < 6 * i + 6)] = foot + [0.0, 0.0, 0.1]
        loaded = (fine >= 6 * i + 1) & (fine < 6 * i + 5)
        force[loaded, 0] = [0.0, 0.0, 10 * 9.80665]
        points[loaded, 0] = foot
    spread = np.array([[0.08, 0, 0], [-0.04, 0.07, 0], [-0.04, -0.07, 0]])
    markers = Markers(time, ("a", "b", "c"), point[:, None] + spread)
    wrenches = Wrenches(
        time=fine, names=("w",), bodies=("",), forces=force, points=points, torques=0 * force
    )
    return markers, wrenches


def _write_weight(path, center, turn):
    """Write the weight on a plate that the file has a centimeter off; return these corners."""
    markers, wrenches = _weight_on(center, turn)
    weight = plate_of(wrenches, turn, center)
    corners = weight.corners + [0.01, -0.008, 0.0]
    write_c3d(path, markers, replace(weight, corners=corners))
    return corners


def test_a_plate_is_put_where_a_weight_says_it_is(swung):
    folder, specimen, made = swung
    turn = axis_rotation([0.0, 0.0, 1.0], 0.4)
    center = np.array([0.2, -0.1, 0.0])
    corners = _write_weight(folder / "weight.c3d", center, turn)
    files = PlateFiles((folder / "weight.c3d",), MarkedWeight("disc", ("a", "b", "c"), mass=10.0))
    found = calibrate(files)
    np.testing.assert_allclose(found.center[:2], center[:2], atol=2e-4)
    assert plate_residuals(found)[0].value < 0.2
    plate = plate_of(turned(made.trial.wrenches, Z_UP_TO_Y_UP.T), turn, center)
    markers = made.trial.markers.rotated(Z_UP_TO_Y_UP.T)
    write_c3d(folder / "d.c3d", markers, replace(plate, corners=corners))
    swings = SwingFiles("one", folder / "d.c3d", folder / "d.c3d")
    known = SpecimenFiles("s", folder / "arm.osim", up="z")
    trial = open_swing(swings, specimen.model, known, lambda one: placed(one, files, found))[0]
    at = specimen.center_in_ground
    truth = wrench_about(made.trial.wrenches, at)
    np.testing.assert_allclose(wrench_about(trial.wrenches, at), truth, atol=0.02)
    trial = open_swing(swings, specimen.model, known)[0]
    assert np.abs(wrench_about(trial.wrenches, at) - truth).max() > 0.1
    with pytest.raises(UnknownName, match="'FP7'"):
        calibrate(replace(files, plate="FP7"))


def test_bodies_are_known_by_their_names_or_asked_for(swung):
    folder, specimen, made = swung
    files = SpecimenFiles("s", folder / "arm.osim")
    found = open_specimen(files, made.trial.markers).specimen
    assert (found.base, found.first) == ("scapula", "humerus")
    assert set(found.model.body_names) == set(specimen.model.body_names)
    with pytest.raises(BadData, match=r"unknown body 'humerous': .* 'humerus'"):
        open_specimen(replace(files, first="humerous"), made.trial.markers)
    renamed = (folder / "arm.osim").read_text().replace("scapula", "blade")
    (folder / "blade.osim").write_text(renamed)
    with pytest.raises(BadModel, match="no body is called 'scapula': give 'base'"):
        open_specimen(replace(files, model=folder / "blade.osim"), made.trial.markers)


def test_a_plate_goes_with_c3d_only(swung):
    folder, specimen, made = swung
    write_trc(made.trial.markers, folder / "e.trc")
    write_table(made.trial.wrenches, folder / "e.mot")
    swings = SwingFiles("one", folder / "e.trc", folder / "e.mot")
    with pytest.raises(BadFile, match="'plate' goes with C3D forces"):
        open_swing(swings, specimen.model, SpecimenFiles("s", folder / "arm.osim"), lambda one: one)
