"""C3D files: six formats of one recording, ezc3d as the oracle, and what vendors write."""

from __future__ import annotations

import contextlib
import os
from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.c3d.emg import emg_channels
from myomorph.core.io.c3d.raw import read_raw_c3d
from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.parsing.guard import run_guarded
from myomorph.core.model.errors import BadFile
from myomorph.core.model.series import Event

SAMPLES = "c3d-vendor-samples/C3DSamples"
ORG = f"{SAMPLES}/c3d.org"


def c3d_files(folder: Path) -> list[Path]:
    return sorted(path for path in folder.rglob("*") if path.suffix.lower() == ".c3d")


# An integer of sample02 stands for 0.2812 mm, and each of its files was rounded in another way.
STEP = 0.2812e-3


@pytest.mark.parametrize(
    ("folder", "names", "tolerance"),
    [
        (
            "sample01",
            (
                "Eb015pr.c3d",
                "Eb015pi.c3d",
                "Eb015vr.c3d",
                "Eb015vi.c3d",
                "Eb015sr.c3d",
                "Eb015si.c3d",
            ),
            5e-7,
        ),
        ("sample02", ("pc_real.c3d", "Dec_real.c3d"), 1e-7),
        ("sample02", ("pc_real.c3d", "pc_int.c3d", "DEC_INT.C3D"), STEP),
    ],
)
def test_formats_of_one_recording_agree(folder, names, tolerance, data):
    first = read_c3d(data(f"{ORG}/{folder}/{names[0]}"))
    for name in names[1:]:
        other = read_c3d(data(f"{ORG}/{folder}/{name}"))
        assert other.markers.names == first.markers.names
        np.testing.assert_array_equal(other.markers.time, first.markers.time)
        np.testing.assert_allclose(
            other.markers.values, first.markers.values, rtol=0, atol=tolerance
        )
        np.testing.assert_allclose(other.analog.values, first.analog.values, rtol=1e-4, atol=1e-4)
        np.testing.assert_allclose(
            [plate.corners for plate in other.plate_recordings],
            [plate.corners for plate in first.plate_recordings],
        )
    assert len(first.markers) in (450, 89)


def test_headers_are_believed_where_parameters_lie_elsewhere(data):
    plain = read_c3d(data(f"{ORG}/sample01/Eb015pi.c3d"))
    for letter in "ABCD":
        moved = read_c3d(data(f"{ORG}/sample08/TEST{letter}PI.c3d"))
        np.testing.assert_array_equal(moved.markers.values, plain.markers.values)
        np.testing.assert_array_equal(moved.analog.values, plain.analog.values)


@pytest.mark.parametrize(
    "name",
    [
        f"{ORG}/sample01/Eb015pi.c3d",
        f"{ORG}/sample02/Dec_real.c3d",
        f"{ORG}/sample04/sub_labels.c3d",
        f"{ORG}/sample10/type-4a.c3d",
        f"{ORG}/sample15/FP1.C3D",
        f"{ORG}/sample24/MotionMonitorC3D.c3d",
        f"{SAMPLES}/others/Analysis.c3d",
        f"{SAMPLES}/others/FunctionalWalk.c3d",
        f"{SAMPLES}/others/Res16bits.c3d",
        f"{SAMPLES}/PiG/PiG_Motion3_FF.c3d",
        "c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d",
        "c3d-functional-joints/functional_trials/right_hip.c3d",
        "c3d-shoulder-emg-handle/markers_analogs.c3d",
        "mouse-gait-c3d-force/Cage6_1L_05_01_26_trial_1.c3d",
        "odd-trc-mot/upside_down_trial2.c3d",
        "wheelchair-pushrim/kinematics/racing_full.c3d",
    ],
)
def test_what_ezc3d_reads_is_read(name, data):
    ezc3d = pytest.importorskip("ezc3d")
    path = data(name)
    file = ezc3d.c3d(str(path), extract_forceplat_data=False)
    raw = read_raw_c3d(path)
    header = file["header"]
    parameters = file["parameters"]
    samples = file["data"]
    np.testing.assert_array_equal(raw.points, samples["points"][:3].transpose(2, 1, 0))
    np.testing.assert_array_equal(raw.residuals < 0, samples["meta_points"]["residuals"][0].T < 0)
    np.testing.assert_allclose(raw.analog, samples["analogs"][0].T, rtol=1e-12, atol=1e-12)
    assert (raw.first_frame, raw.point_rate, raw.analog_rate) == (
        header["points"]["first_frame"] + 1,
        header["points"]["frame_rate"],
        header["analogs"]["frame_rate"],
    )
    labels = parameters["POINT"]["LABELS"]["value"]
    assert raw.texts("POINT", "LABELS")[: len(labels)] == tuple(label.strip() for label in labels)
    for parameter in ("CORNERS", "ORIGIN", "CHANNEL", "TYPE", "CAL_MATRIX"):
        expected = parameters.get("FORCE_PLATFORM", {}).get(parameter, {"value": []})["value"]
        np.testing.assert_array_equal(
            raw.numbers("FORCE_PLATFORM", parameter),
            np.asarray(expected, np.float64).ravel(order="F"),
        )


@pytest.mark.long
def test_every_vendor_file_is_opened_or_refused_in_one_line(data):
    folders = [
        data(name)
        for name in (
            "c3d-vendor-samples",
            "odd-trc-mot",
            "lifting-box-15kg",
            "c3d-functional-joints",
        )
    ]
    refused = []
    for path in (one for folder in folders for one in c3d_files(folder)):
        try:
            trial = read_c3d(path)
        except BadFile as error:
            refused.append((path.name, str(error).count("\n")))
            continue
        assert trial.markers is not None or trial.other_points is not None
        if trial.markers is not None and np.isfinite(trial.markers.values).any():
            assert 0.01 < np.nanmedian(np.abs(trial.markers.values)) < 5.0, path
    assert refused == [("Empty.c3d", 0)]


def test_gait_recording_with_computed_quantities(data):
    trial = read_c3d(data("c3d-gait-plugingait/HC030A/Straight/HC030A05.c3d"))
    assert {"LASI", "RTOE", "C7"} <= set(trial.markers.names)
    assert not {"LHipAngles", "RKneeMoment", "LGroundReactionForce", "LHPA"} & set(
        trial.markers.names
    )
    assert {"LHipAngles", "RKneeMoment", "LGroundReactionForce", "LHPA"} <= set(
        trial.other_points.names
    )
    assert trial.facts["body mass"] == "45.8 kg"
    assert trial.facts["height"] == "1.48 m"
    assert trial.facts["maker"].startswith("Vicon Nexus")
    # Frame 286 of a 100 Hz recording: time counts from frame 1.
    assert trial.markers.time[0] == pytest.approx(2.85)
    assert trial.analog.rate == pytest.approx(1000.0)
    assert trial.analog.time[0] == trial.markers.time[0]
    assert trial.events[0] == Event(3.02, "Foot Strike", "Right") or trial.events[
        0
    ].time == pytest.approx(3.02)
    assert [event.side for event in trial.events[:3]] == ["Right", "Left", "Left"]
    assert (
        trial.markers.time[0]
        <= trial.events[0].time
        <= trial.events[-1].time
        <= trial.markers.time[-1] + 0.01
    )


def test_subject_names_before_a_colon_and_emg_by_name(data):
    trial = read_c3d(data("c3d-shoulder-emg-handle/markers_analogs.c3d"))
    assert {"ASISr", "CLAV_SC", "gauche_ext"} <= set(trial.markers.names)
    assert trial.facts["label prefixes"] == "Daphnee, boite"
    emg = emg_channels(trial)
    assert "Biceps.EMG4" in emg
    assert not {f"Voltage.{k}" for k in range(1, 7)} & set(emg)


def test_unlabelled_points_are_counted_and_left_out(data):
    trial = read_c3d(data("mouse-gait-c3d-force/Cage6_1L_05_01_26_trial_1.c3d"))
    assert len(trial.markers.names) == 13
    assert trial.facts["unlabelled points"] == "14"
    hidden = np.isnan(trial.markers.values).any(axis=2)
    assert 0.4 < hidden.mean() < 0.9
    assert not np.any(np.all(trial.markers.values == 0, axis=2))


def test_labels_cut_to_four_letters_are_told_by_descriptions(data):
    trial = read_c3d(data(f"{SAMPLES}/others/Gait.c3d"))
    assert len(set(trial.markers.names)) == 33
    assert any("descriptions" in line for line in trial.warnings)


def test_units_of_length_become_metres(data):
    feet = [
        read_c3d(data(name)) for name in (f"{ORG}/sample15/FP1.C3D", "lifting-box-15kg/stoop1.c3d")
    ]
    for trial in feet:
        assert 0.1 < np.nanmedian(np.abs(trial.markers.values)) < 2.0


def test_jump_recording_of_a_package():
    biomdp = pytest.importorskip("biomdp")
    path = Path(biomdp.__file__).parent / "tests/datasets/vicon_CMJ_kinem_kinet_emg.c3d"
    if not path.exists():
        pytest.skip(f"this biomdp brings no {path.name}")
    trial = read_c3d(path)
    assert trial.markers.rate == pytest.approx(200.0)
    assert {"RASI", "RHJC", "Right_AnkleExt"} <= set(trial.markers.names)
    assert trial.facts["computed positions"].endswith("RKJC, RAJC")
    assert len(emg_channels(trial)) == 16
    assert [plate.kind for plate in trial.plate_recordings] == [2, 2]


def test_a_reader_that_hangs_or_dies_is_stopped():
    hung = run_guarded("builtins:exec", ["import time; time.sleep(60)"], 0.5)
    assert hung.status == "hung"
    died = run_guarded("builtins:exec", ["import os; os._exit(7)"], 20)
    assert (died.status, died.message) == ("failed", "ended with status 7")
    raised = run_guarded("builtins:exec", ["raise ValueError('of no\\nuse')"], 20)
    assert (raised.status, raised.message) == ("failed", "of no use")
    if os.name != "nt":
        ate = run_guarded("builtins:exec", ["bytes(8 << 30)"], 20, gigabytes=4.0)
        assert (ate.status, ate.message) == (
            "failed",
            "asked for more memory than such a file can need",
        )


@pytest.mark.parametrize(
    "content",
    [
        b"",
        b"\0" * 100,
        b"\x02\x50" + b"\0" * 600,
        b"\x02\x50" + b"\xff" * 4000,
        b"PathFileType" * 99,
    ],
)
def test_what_is_no_c3d_is_refused_in_one_line(content, tmp_path):
    path = tmp_path / "x.c3d"
    path.write_bytes(content)
    with pytest.raises(BadFile) as caught:
        read_c3d(path)
    assert "\n" not in str(caught.value)
    assert str(path) in str(caught.value)


def test_a_file_cut_off_keeps_its_whole_frames(data, tmp_path):
    path = data("c3d-opensim-walking/walking2.c3d")
    whole = read_c3d(path)
    cut = tmp_path / "cut.c3d"
    cut.write_bytes(path.read_bytes()[:600_000])
    trial = read_c3d(cut)
    count = len(trial.markers)
    assert 100 < count < len(whole.markers)
    np.testing.assert_array_equal(trial.markers.values, whole.markers.values[:count])
    assert any("ends early" in line for line in trial.warnings)


def test_our_reader_survives_any_damage(data, tmp_path):
    """Random bytes anywhere in header and parameters: a result or one line, and never a hang."""
    random = np.random.default_rng(7)
    path = tmp_path / "damaged.c3d"
    for name in (
        "others/Gait.c3d",
        "c3d.org/sample01/Eb015si.c3d",
        "c3d.org/sample02/Dec_real.c3d",
    ):
        content = np.frombuffer(data(f"{SAMPLES}/{name}").read_bytes(), dtype=np.uint8)
        for _ in range(150):
            damaged = content.copy()
            where = random.integers(0, 5000, random.integers(1, 40))
            damaged[where] = random.integers(0, 256, len(where))
            path.write_bytes(damaged[: random.integers(400, len(damaged))].tobytes())
            with contextlib.suppress(BadFile):
                raw = read_raw_c3d(path)
                assert raw.points.shape[:2] == raw.residuals.shape
