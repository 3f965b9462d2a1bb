"""`myomorph info`: what it says of real files, and that bad ones end in one line."""

from __future__ import annotations

import time
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.sto import write_sto
from myomorph.core.io.trc import write_trc
from myomorph.core.model.errors import BadFile, MyomorphError
from myomorph.core.model.series import Markers, Table
from myomorph.lab.info.inspect import inspect
from myomorph.lab.info.inspect_recording import Inspection

KINDS = (".trc", ".mot", ".sto", ".c3d")


def facts(found: Inspection) -> dict[str, str]:
    return dict(found.facts)


def outcome(path: Path) -> str:
    """ "good" or the one line that refuses the file; anything else fails the test."""
    start = time.perf_counter()
    try:
        found = inspect(path)
    except MyomorphError as error:
        said = str(error)
        assert said.strip()
        assert "\n" not in said
    else:
        assert not [line for line in found.lines() if "\n" in line]
        said = "good"
    assert time.perf_counter() - start < 20.0
    return said


def test_a_gait_recording(data):
    found = inspect(data("c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d"))
    told = facts(found)
    assert found.kind == "C3D recording"
    assert "197 at 100 Hz" in told["frames"]
    assert told["body mass"] == "45.8 kg"
    assert "type 2" in told["plate_1"]
    assert "Right Foot Strike 3.02" in told["events"]
    assert "L Hams" in told["probably EMG"]
    weight = float(told["load"].split(":")[1].split("kg")[0])
    assert weight == pytest.approx(45.8, rel=0.1)
    assert found.warnings == ()


def test_gaps_are_listed_by_marker(data):
    found = inspect(data("mouse-gait-c3d-force/Cage6_1L_05_01_26_trial_1.c3d"))
    told = facts(found)
    assert any(
        label.startswith("gaps of ") and "%" in text and "longest" in text
        for label, text in found.facts
    )
    assert told["unlabelled points"] == "14"
    # A tenth of a newton is a mouse, not a fault of the plate.
    assert not any("does not fit" in line for line in found.warnings)


def test_a_plate_scale_that_cannot_be_is_doubted(data):
    warnings = inspect(data("odd-trc-mot/upside_down_trial2.c3d")).warnings
    assert any("does not fit" in line for line in warnings)
    assert any("reversed" in line for line in warnings)


def test_tables_and_what_their_header_hides(data):
    told = facts(inspect(data("rajagopal-walk-emg/grf_walk.mot")))
    assert "4778 at 2000 Hz" in told["rows"]
    assert any("121120 rows" in line for line in inspect(data("odd-trc-mot/weird.mot")).warnings)


def test_a_model_and_its_loads(data):
    told = facts(inspect(data("rajagopal-walk-emg/subject_walk_scaled.osim")))
    assert told["mass"].startswith("85.")
    assert told["muscles"] == "80: 80 Millard2012EquilibriumMuscle"
    told = facts(inspect(data("rajagopal-walk-emg/grf_walk.xml")))
    assert "calcn_r" in told["Right_GRF"]
    assert (
        inspect(data("rajagopal-walk-emg/ik_tasks_walk.xml")).kind == "OpenSim settings: IKTaskSet"
    )


def test_wrong_units_jumps_and_lost_frames_are_doubted(tmp_path):
    random = np.random.default_rng(0)
    values = random.normal(size=(1, 8, 3)) * 0.4 + random.normal(size=(100, 8, 3)) * 1e-3
    values[60, 2] += 0.8
    values[:, 5] = np.nan
    clock = np.delete(np.arange(104) / 100, [40, 41, 42, 80])
    markers = Markers(clock, tuple("abcdefgh"), values)
    path = tmp_path / "x.trc"
    write_trc(markers, path)
    warnings = "\n".join(inspect(path).warnings)
    assert "1 markers are never seen: f" in warnings
    assert "'c' jumps 2 times" in warnings
    assert "3 frames missing between 0.39 and 0.43" in warnings
    path.write_text(path.read_text().replace("\tmm\t", "\tm\t"))
    assert any("does the unit in the file match" in line for line in inspect(path).warnings)


@pytest.mark.parametrize(
    ("degrees", "size", "doubt"), [(True, 0.5, "radians?"), (False, 60.0, "degrees?")]
)
def test_angles_that_do_not_fit_the_header_are_doubted(degrees, size, doubt, tmp_path):
    names = (
        "hip_flexion_r",
        "hip_adduction_r",
        "hip_rotation_r",
        "knee_angle_r",
        "ankle_angle_r",
        "pelvis_tx",
    )
    values = np.random.default_rng(0).uniform(0.8 * size, size, (50, 6))
    path = tmp_path / "q.mot"
    write_sto(Table(np.arange(50) / 100, names, values, in_degrees=degrees), path)
    assert any(doubt in line for line in inspect(path).warnings)


@pytest.mark.parametrize("name", ["absent.trc", "note.txt", "folder.c3d"])
def test_what_is_no_known_file_is_refused(name, tmp_path):
    (tmp_path / "note.txt").write_text("hello")
    (tmp_path / "folder.c3d").mkdir()
    with pytest.raises(BadFile):
        inspect(tmp_path / name)


@pytest.mark.parametrize("kind", KINDS)
def test_garbage_under_any_name_ends_in_one_line(kind, tmp_path):
    random = np.random.default_rng(3)
    contents = [
        b"",
        b"\n",
        b"\0" * 3000,
        b"hello world\n" * 50,
        random.bytes(5000),
        b"\x02\x50" + random.bytes(5000),
    ]
    contents += [
        b"DataRate\tUnits\n1\tmm\nFrame#\tTime\tA\n" + random.bytes(500),
        b"endheader\ntime\ta\n" + random.bytes(500),
    ]
    contents += [
        b"Frame#\tTime\tA\n\tX1\tY1\tZ1\n",
        b"endheader\ntime\ta\n",
        b"endheader\ntime\n0\n1\n",
    ]
    for number, content in enumerate(contents):
        path = tmp_path / f"{number}{kind}"
        path.write_bytes(content)
        outcome(path)


@pytest.mark.parametrize(
    "name",
    [
        "c3d-opensim-walking/exampleFormat.trc",
        "odd-trc-mot/markers.trc",
        "c3d-shoulder-emg-handle/markers.trc",
        "odd-trc-mot/weird.mot",
        "opensim-reference-small/arm26_InverseKinematics.mot",
        "c3d-shoulder-emg-handle/inverse_kin.mot",
        "opensim-gait-subject01/ref_ik/std_markers_coords_ik.sto",
    ],
)
def test_tables_cut_anywhere_or_damaged_end_in_one_line(name, data, tmp_path):
    random = np.random.default_rng(5)
    content = data(name).read_bytes()[:60_000]
    path = tmp_path / f"x{Path(name).suffix}"
    told = set()
    for length in [*random.integers(1, 2000, 12), *random.integers(1, len(content), 6)]:
        path.write_bytes(content[:length])
        told.add(outcome(path) == "good")
    for _ in range(25):
        damaged = bytearray(content)
        for where in random.integers(0, min(4000, len(content)), random.integers(1, 30)):
            damaged[where] = random.choice(list(b"\t\n,;-.:eE0129 \0x=NaN#"))
        path.write_bytes(bytes(damaged))
        told.add(outcome(path) == "good")
    assert told == {True, False}


@pytest.mark.parametrize(
    ("value", "shown"), [("nan", "NaN"), ("inf", "infinite"), ("1e300", "good")]
)
def test_values_that_are_no_measure_are_told(value, shown, tmp_path):
    path = tmp_path / "x.mot"
    path.write_text(f"t\nversion=1\nendheader\ntime\ta\tb\n0\t{value}\t1\n0.1\t2\t3\n0.2\t2\t3\n")
    said = "\n".join(inspect(path).warnings) or "good"
    assert shown in said


def test_recordings_cut_at_any_length_end_in_one_line(data, tmp_path):
    names = (
        "c3d-vendor-samples/C3DSamples/c3d.org/sample01/Eb015si.c3d",
        "c3d-vendor-samples/C3DSamples/c3d.org/sample15/FP1.C3D",
        "c3d-vendor-samples/C3DSamples/others/Gait.c3d",
        "c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d",
    )
    for name in names:
        content = data(name).read_bytes()
        for length in (1, 511, 512, 600, 3000, 6000, 12_000, len(content) // 2, len(content) - 1):
            path = tmp_path / f"cut{length}.c3d"
            path.write_bytes(content[:length])
            outcome(path)


@pytest.mark.long
def test_every_odd_file_is_good_or_refused_in_one_line(data):
    paths = [
        path
        for folder in ("c3d-vendor-samples", "odd-trc-mot")
        for path in sorted(data(folder).rglob("*"))
    ]
    paths = [path for path in paths if path.suffix.lower() in KINDS]
    assert len(paths) > 50
    refused = {path.name for path in paths if outcome(path) != "good"}
    assert refused == {"Empty.c3d", "Empty.trc", "Truncated.trc"}


def test_a_model_of_a_package_is_described_by_its_name():
    pytest.importorskip("myo_sim")
    assert any("muscles" in line for line in inspect("myo-sim:myoarm").lines())
