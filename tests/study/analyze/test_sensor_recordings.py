"""`analyze` of inertial sensors: alone, and beside markers."""

from __future__ import annotations

import numpy as np
import pytest

import myomorph as mm
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.rigid.tree import compile_tree
from myomorph.lab.cli import main
from myomorph.lab.session.recordings import files_of, look_at
from sensor_files import write_orientations
from truths.simulated_sensors import NO_ERRORS, Mounting, mounted_sensors

BODIES = ("pelvis", "torso", "femur_r", "tibia_r", "calcn_r", "femur_l", "tibia_l", "calcn_l")
HEIGHT = 1.80
MASS = 85.0


@pytest.fixture(scope="module")
def walk(data):
    """Return a recorded walk on the generic model, its sensors and those of calibration."""
    pytest.importorskip("myo_sim")
    from myomorph.lab.analyze.generic_model import generic_model

    model, _ = generic_model({}, HEIGHT, MASS)
    home = "rajagopal-walk-emg"
    recorded = mm.read_motion(
        data(f"{home}/coordinates.sto"), mm.read_model(data(f"{home}/subject_walk_scaled.osim"))
    )
    names = [name for name in recorded.names if name in model.coordinate_names]
    # Of 1000 frames a second every tenth.
    known = mm.Motion(
        recorded.time[::10], tuple(names), np.column_stack([recorded[name][::10] for name in names])
    )
    motion = mm.Motion(
        known.time, model.coordinate_names, compile_tree(model).coordinates_of(known)
    )
    return motion, mounted_sensors(
        model,
        motion,
        Mounting(bodies=BODIES, rotations=np.tile(np.eye(3), (len(BODIES), 1, 1))),
        NO_ERRORS,
    )


@pytest.fixture
def files(walk, tmp_path):
    """Files of the walk and of the pose."""
    for name, part in (("walk.sto", walk[1].sensors), ("npose.sto", walk[1].pose)):
        write_orientations(tmp_path / name, part)
    return tmp_path / "walk.sto", tmp_path / "npose.sto"


def test_sensors_alone_become_a_study(files, tmp_path):
    prepared = mm.prepare_study(files, tmp_path / "out", mass=MASS, height=HEIGHT)
    assert prepared.assumed[0].startswith("INERTIAL SENSORS ALONE")
    assert any("npose.sto is the calibration pose" in text for text in prepared.assumed)
    assert any("forces under the feet are estimated" in text for text in prepared.assumed)
    plan = mm.read_plan(prepared.study)
    assert not any("forces" in remark for remark in plan.remarks)
    assert plan.steps[0] == ("ik", "id", "muscles", "tension", "report")
    (trial,) = plan.trials
    assert [path.name for path in trial.paths] == ["walk.sto", "npose.sto"]
    assert mm.read_model(tmp_path / "out" / "generic.osim").mass == pytest.approx(MASS)


def test_what_is_missing_is_said_in_one_line(files, tmp_path):
    out = tmp_path / "out"
    with pytest.raises(BadData, match=r"no lengths.*--height.*--model"):
        mm.prepare_study(files, out, mass=MASS)
    with pytest.raises(BadData, match="--mass"):
        mm.prepare_study(files, out, height=HEIGHT)
    with pytest.raises(BadData, match=r"quiet standing.*--static.*--imu-pose-time"):
        mm.prepare_study(files[:1], out, mass=MASS, height=HEIGHT)
    (tmp_path / "forces.sto").write_text("x\nendheader\ntime\ta\n0\t1\n")
    with pytest.raises(BadFile, match="no recording of markers or inertial sensors"):
        files_of([tmp_path / "forces.sto"])
    assert not out.exists() or not list(out.glob("study.toml"))


def test_still_sensors_are_known(files):
    assert [look_at(path).still for path in files] == [False, True]
    assert look_at(files[0]).trial.markers is None


@pytest.mark.long
def test_sensors_alone_to_a_report(walk, files, tmp_path, capsys):
    out = tmp_path / "out"
    flags = ["--mass", str(MASS), "--height", str(HEIGHT), "--imu-heading", "pelvis_imu=x"]
    assert main(["analyze", *map(str, files), *flags, "--out", str(out), "--workers", "1"]) == 0
    said = capsys.readouterr().out.splitlines()
    assert said[1].strip().startswith("INERTIAL SENSORS ALONE")
    assert (out / "walk" / "report.html").is_file()
