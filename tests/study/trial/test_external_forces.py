"""External forces come from files of every kind by one way, each on the foot that carries it."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from myomorph.core.io.loads import loads_table
from myomorph.core.io.sto import write_sto
from myomorph.core.model.errors import BadData
from myomorph.core.model.series import ForcePlate, Trial
from myomorph.core.motion.filters import differentiate
from myomorph.core.motion.sync import clock_shift, resample_wrenches
from myomorph.core.rigid.dynamics import inverse_dynamics
from myomorph.core.rigid.regressor import sum_of_wrenches
from myomorph.lab.store.settings import ForceOptions
from myomorph.lab.study.inputs.external_forces import on_feet, plate_wrenches, read_loads
from myomorph.lab.study.inputs.keys import keys_of
from myomorph.lab.study.inputs.loads import LoadsFile, loads_by_name
from myomorph.lab.study.inputs.reading import open_model, read_motion
from myomorph.lab.study.subject.identifying import MotionFiles, open_motions

FOLDER = "rajagopal-walk-emg"


@pytest.fixture(scope="module")
def walk(data):
    """Model, motion, and forces whose feet the file names."""
    model = open_model(data(f"{FOLDER}/subject_walk_scaled.osim"))
    motion = read_motion(data(f"{FOLDER}/coordinates.sto"), model)
    return model, motion, read_loads(data(f"{FOLDER}/grf_walk.xml"), model, motion)


def by_body(wrenches, body, motion):
    """Force (frames, 3) on a body while a motion lasts."""
    during = (wrenches.time >= motion.time[0]) & (wrenches.time <= motion.time[-1])
    return sum(wrenches.forces[during, k] for k, name in enumerate(wrenches.bodies) if name == body)


def table_of(wrenches, path, **changes):
    write_sto(loads_table(replace(wrenches, **changes)), path)
    return path


def test_a_table_needs_no_bodies(walk, data) -> None:
    model, motion, named = walk
    found = read_loads(data(f"{FOLDER}/grf_walk.mot"), model, motion)
    for body in ("calcn_r", "calcn_l"):
        np.testing.assert_allclose(
            by_body(found, body, motion), by_body(named, body, motion), atol=0.5
        )


def test_a_plate_that_nobody_steps_on_is_left_out(walk, tmp_path) -> None:
    model, motion, named = walk
    parts = {
        part: np.concatenate([getattr(named, part), np.zeros((len(named), 1, 3))], axis=1)
        for part in ("forces", "points", "torques")
    }
    path = table_of(
        named, tmp_path / "three.mot", names=("a", "b", "idle"), bodies=("x", "x", "x"), **parts
    )
    found = read_loads(path, model, motion)
    assert "" not in found.bodies
    assert set(found.bodies) == {"calcn_r", "calcn_l"}
    assert any("not loaded during the motion" in text for text in found.notes)


def test_feet_that_step_on_one_plate_in_turn_each_get_their_part(walk, tmp_path) -> None:
    """One belt carries both feet in single support: each foot gets what its file says."""
    model, motion, named = walk
    alone = (named.forces[:, :, 1] > 30.0).sum(axis=1) == 1
    keep = alone[:, None, None]
    forces = np.where(keep, named.forces, 0.0).sum(axis=1, keepdims=True)
    first = (named.forces[:, 0, 1] > 30.0)[:, None, None]
    points = np.where(first, named.points[:, :1], named.points[:, 1:2])
    torques = np.where(keep, np.where(first, named.torques[:, :1], named.torques[:, 1:2]), 0.0)
    path = table_of(
        named,
        tmp_path / "belt.mot",
        names=("belt",),
        bodies=("x",),
        forces=forces,
        points=points,
        torques=torques,
    )
    found = read_loads(path, model, motion)
    assert set(found.bodies) == {"calcn_r", "calcn_l"}
    inside = (named.time >= motion.time[0]) & (named.time <= motion.time[-1])
    for body in ("calcn_r", "calcn_l"):
        mine = by_body(named, body, motion)
        expected = np.where((alone[inside] & (mine[:, 1] > 30.0))[:, None], mine, 0.0)
        assert np.abs(by_body(found, body, motion) - expected).max() < 30.0


def test_forces_that_count_from_another_zero_are_moved_or_the_option_is_named(
    walk, tmp_path
) -> None:
    """A table that lasts as long as the motion and begins at another time is shifted.

    Any other is refused.
    """
    model, motion, named = walk
    inside = (named.time >= motion.time[0] - 1e-9) & (named.time <= motion.time[-1] + 1e-9)
    parts = {part: getattr(named, part)[inside] for part in ("forces", "points", "torques")}
    same = replace(named, time=named.time[inside], **parts)
    plain = read_loads(table_of(same, tmp_path / "same.mot"), model, motion)
    later = read_loads(table_of(same, tmp_path / "later.mot", time=same.time + 40.0), model, motion)
    np.testing.assert_allclose(later.time, plain.time, atol=1e-6)
    np.testing.assert_allclose(later.forces, plain.forces, atol=1e-6)
    assert later.findings[0].kind == "clock zero"
    assert "moved by -40" in later.findings[0].text
    assert "clock zero" not in {one.kind for one in plain.findings}
    with pytest.raises(BadData, match=r"--force-shift SECONDS; -40"):
        read_loads(
            tmp_path / "later.mot", model, motion, options=ForceOptions(force_checks="report")
        )
    half = {
        part: getattr(same, part)[: len(same) // 2]
        for part in ("time", "forces", "points", "torques")
    }
    path = table_of(replace(same, **half), tmp_path / "half.mot", time=half["time"] + 40.0)
    with pytest.raises(BadData, match=r"no time in common.*--force-shift"):
        read_loads(path, model, motion)
    stated = read_loads(path, model, motion, options=ForceOptions(force_shift=-40.0))
    np.testing.assert_allclose(stated.time, half["time"], atol=1e-6)


@pytest.mark.parametrize(
    ("start", "stop", "shift"),
    [
        (0.0, 3.6, 0.0),
        (12.4, 16.0, -12.4),
        (0.3, 3.9, 0.0),
        (2.4, 6.0, -2.4),
        (0.01, 3.605, 0.0),
        (-5.0, 30.0, 0.0),
        (40.0, 60.0, None),
    ],
)
def test_recordings_of_one_length_have_one_clock(start, stop, shift) -> None:
    found = clock_shift(np.arange(0.0, 3.605, 0.01), np.arange(start, stop + 5e-4, 1e-3))
    assert found == shift if shift is None else found == pytest.approx(shift, abs=1e-9)


def test_prefixes_and_plates_as_texts() -> None:
    keys = {key.name: key.kind for key in keys_of(LoadsFile)}
    bodies = keys["bodies"].parsed("bodies", ["ground_force_r_=calcn_r", "x=calcn_l"])
    assert dict(bodies) == {"ground_force_r_": "calcn_r", "x": "calcn_l"}
    assert keys["plates"].parsed("plates", "calcn_r,none,-,,calcn_l") == (
        "calcn_r",
        "",
        "",
        "",
        "calcn_l",
    )
    for wrong in (["calcn_r"], ["a="], ["a=b", "a=c"]):
        with pytest.raises(BadData, match="prefix=body"):
            keys["bodies"].parsed("bodies", wrong)


def test_times_that_do_not_meet_are_refused(walk, tmp_path) -> None:
    model, motion, named = walk
    path = table_of(named, tmp_path / "late.mot", time=named.time + 100.0)
    with pytest.raises(BadData, match="no time in common"):
        read_loads(path, model, motion)


def test_a_csv_of_forces_and_moments_about_the_origin(walk, tmp_path) -> None:
    """The same wrench, whatever its form.

    The sum about the ground's origin is that of the file with points.
    """
    model, motion, named = walk
    moments = named.torques + np.cross(named.points, named.forces)
    values = np.concatenate([named.forces[:, 0], moments[:, 0]], axis=1)
    columns = ("Fx1", "Fy1", "Fz1", "Mx1", "My1", "Mz1")
    lines = ["time," + ",".join(columns)]
    lines += [
        ",".join(f"{x:.9g}" for x in (t, *row)) for t, row in zip(named.time, values, strict=True)
    ]
    path = tmp_path / "cells.csv"
    path.write_text("\n".join(lines) + "\n", "utf-8")
    found = read_loads(path, model, motion, {"F1": named.bodies[0]})
    here = read_motion_at(motion, found.time[::50])
    picked = {part: getattr(found, part)[::50] for part in ("time", "forces", "points", "torques")}
    one = replace(found, **picked)
    other = replace(
        named,
        names=named.names[:1],
        bodies=named.bodies[:1],
        time=found.time[::50],
        **{part: getattr(named, part)[::50, :1] for part in ("forces", "points", "torques")},
    )
    origin = np.zeros((len(here), 3))
    np.testing.assert_allclose(
        sum_of_wrenches(model, here, one, origin),
        sum_of_wrenches(model, here, other, origin),
        atol=1e-5,
    )


def read_motion_at(motion, time):
    """Return the motion at some times."""
    values = np.column_stack([np.interp(time, motion.time, column) for column in motion.values.T])
    return replace(motion, time=time, values=values)


def test_an_idle_plate_of_a_recording_does_not_end_inverse_dynamics(walk) -> None:
    """As a C3D file with a plate that nobody steps on.

    Its force acts on nobody, and torques come out.
    """
    model, motion, named = walk
    plates = [plate_of(named, k) for k in range(2)]
    still = replace(
        plates[0], name="idle", forces=0.0 * plates[0].forces, points=np.nan * plates[0].points
    )
    recording = Trial(plates=(*plates, still), plate_time=named.time, source="walk.c3d")
    found = on_feet(plate_wrenches(recording), model, motion)
    assert set(found.bodies) == {"calcn_r", "calcn_l"}
    assert [one.kind for one in found.findings] == ["idle plate"]
    some = differentiate(motion, 6.0)
    torques = inverse_dynamics(model, some, resample_wrenches(found, some.time, 6.0))
    assert np.isfinite(torques.values).all()


def test_identification_takes_tables_too(walk, data) -> None:
    model, motion, named = walk
    files = MotionFiles(
        motions=[data(f"{FOLDER}/coordinates.sto")], loads=[data(f"{FOLDER}/grf_walk.mot")]
    )
    (one,) = open_motions(model, files)
    for body in ("calcn_r", "calcn_l"):
        np.testing.assert_allclose(
            by_body(one.wrenches, body, motion), by_body(named, body, motion), atol=0.5
        )
    bodies = LoadsFile(bodies={"ground_force_r_": "calcn_r", "ground_force_l_": "calcn_l"})
    (same,) = open_motions(model, replace(files, bodies=bodies))
    assert set(same.wrenches.bodies) == {"calcn_r", "calcn_l"}


def plate_of(wrenches, number):
    """Return a force as that of a plate."""
    loaded = (wrenches.forces[:, number, 1] > 30.0)[:, None]
    point = np.where(loaded, wrenches.points[:, number], np.nan)
    torque = np.where(loaded, wrenches.torques[:, number], np.nan)
    corners = np.nanmean(point, axis=0) + 0.3 * np.array(
        [[1, 0, 1], [-1, 0, 1], [-1, 0, -1], [1, 0, -1]]
    )
    force = np.where(loaded, wrenches.forces[:, number], 0.0)
    return ForcePlate(
        name=f"plate {number + 1}",
        kind=2,
        corners=corners,
        forces=force,
        points=point,
        torques=torque,
    )


def test_a_model_with_the_name_of_a_recording_is_no_file_of_forces(tmp_path) -> None:
    path = tmp_path / "tori.xml"
    path.write_text("<mujoco/>")
    assert loads_by_name(tmp_path / "tori.trc") is None
    path.write_text("<OpenSimDocument><ExternalLoads/></OpenSimDocument>")
    assert loads_by_name(tmp_path / "tori.trc") == path
