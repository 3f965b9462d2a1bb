"""Real files, odd and damaged ones.

`info` and the steps end with 0 or 2, quickly, and never with a traceback.
"""

from __future__ import annotations

import time

import pytest

ODD = ("c3d-vendor-samples", "odd-trc-mot")
ENDINGS = (".c3d", ".trc", ".mot", ".sto", ".osim", ".xml")
WHOLE = (
    "rajagopal-walk-emg/subject_walk_scaled.osim",
    "rajagopal-walk-emg/markers_walk.trc",
    "rajagopal-walk-emg/grf_walk.mot",
    "rajagopal-walk-emg/grf_walk.xml",
    "rajagopal-walk-emg/coordinates.sto",
    "opensim-gait-subject01/ref_so_10dof18musc/subject01_adjusted_spring.osim",
    "c3d-functional-joints/static.c3d",
    "mouse-arm-muscles",
)


def judged(told):
    """0 with text, or 2 with one line on standard error; nothing else."""
    assert told.status in (0, 2), told.err
    assert "Traceback" not in told.err
    if told.status == 2:
        assert told.out == ""
        assert told.err.count("\n") == 1, told.err


@pytest.mark.long
@pytest.mark.parametrize("folder", ODD)
def test_info_of_odd_files(folder, data, command):
    paths = sorted(path for path in data(folder).rglob("*") if path.suffix.lower() in ENDINGS)
    assert len(paths) > 3
    read = 0
    for path in paths:
        started = time.monotonic()
        told = command("info", path)
        judged(told)
        assert time.monotonic() - started < 20.0, path
        read += told.status == 0
    assert read > len(paths) / 2


@pytest.mark.parametrize("name", WHOLE)
@pytest.mark.parametrize("share", [0.01, 0.3, 0.8, 0.999])
def test_truncated_copies(name, share, data, command, tmp_path):
    whole = data(name)
    if whole.is_dir():
        whole = sorted(whole.rglob("*.xml"))[0]
    content = whole.read_bytes()
    path = tmp_path / whole.name
    path.write_bytes(content[: int(share * len(content))])
    started = time.monotonic()
    judged(command("info", path))
    assert time.monotonic() - started < 20.0


def test_chain_on_a_real_walk(data, command, tmp_path):
    """Markers, forces and muscles of a real recording, by single commands."""
    model = data("rajagopal-walk-emg/subject_walk_scaled.osim")
    loads = data("rajagopal-walk-emg/grf_walk.xml")
    motion = tmp_path / "walk.mot"
    steps = (
        (
            "ik",
            "--markers",
            data("rajagopal-walk-emg/markers_walk.trc"),
            "--time",
            0.5,
            0.8,
            "--out",
            motion,
        ),
        ("id", "--motion", motion, "--loads", loads, "--cutoff", 6, "--out", tmp_path / "walk.sto"),
        ("muscles", "--motion", motion, "--out", tmp_path / "walk"),
        (
            "tension",
            "--motion",
            motion,
            "--loads",
            loads,
            "--no-passive",
            "--out",
            tmp_path / "walk",
        ),
    )
    for step, *arguments in steps:
        told = command(step, "--model", model, *arguments)
        assert told.status == 0, told.err
    assert "31 frames, 80 muscles, all frames optimal" in told.out
    # What inverse dynamics says of the root, where it was not asked by itself.
    assert "of the peak external force (times height)" in told.out
    arms = sorted(path.name for path in (tmp_path / "walk").glob("moment_arms_*.sto"))
    assert "moment_arms_knee_angle_r.sto" in arms
    assert "moment_arms_lumbar_extension.sto" not in arms
