"""Commands on good input: the files they write, and what they say."""

from __future__ import annotations

import subprocess
import sys

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.core.model.provenance import Provenance
from myomorph.lab.cli.app import COMMANDS


@pytest.mark.parametrize("name", COMMANDS)
def test_every_command_has_help_with_an_example(name, command):
    told = command(name, "--help")
    assert told.status == 0
    text = " ".join(told.out.split())
    assert f"Usage: myomorph {name}" in text
    assert f"myomorph {name}" in text.split("Example:")[1]


def test_help_names_every_command(command):
    told = command("--help")
    assert told.status == 0
    assert all(f" {name} " in told.out for name in COMMANDS)


def test_ik_finds_the_motion_again(arm, command):
    told = command(
        "ik", "--model", arm.model, "--markers", arm.markers, "--out", arm.folder / "found.mot"
    )
    assert told.status == 0, told.err
    found = read_sto(arm.folder / "found.mot")
    known = read_sto(arm.motion)
    for name in known.names:
        # Markers are written with six decimals of a millimetre.
        np.testing.assert_allclose(np.deg2rad(found[name]), known[name], atol=1e-5)
    assert "61 frames, all 4 markers of the model" in told.out
    assert (arm.folder / "found_ik.nc").is_file()


def test_results_open_in_xarray_with_provenance(arm, command):
    xarray = pytest.importorskip("xarray")
    assert (
        command(
            "ik", "--model", arm.model, "--markers", arm.markers, "--out", arm.folder / "found.mot"
        ).status
        == 0
    )
    with xarray.open_dataset(arm.folder / "found_ik.nc") as found:
        assert found.coordinate_value.dims == ("time", "coordinate")
        assert found.coordinate_value.sel(coordinate="elbow_flexion").shape == (61,)
        assert found.marker_error.attrs["units"] == "m"
        made = Provenance.from_json(found.attrs["provenance_ik"])
    assert {source.role for source in made.sources} == {"model", "markers"}
    assert all(len(source.sha256) == 64 for source in made.sources)
    assert made.options["ik.tolerance"] == 1e-6
    assert made.version
    assert made.date.startswith("20")


def test_id_agrees_with_statics(arm, command):
    """A resting arm: the elbow carries the forearm's weight and the force at the hand."""
    rest = arm.folder / "rest.mot"
    lines = arm.motion.read_text().splitlines()
    head = lines[:7]
    rows = lines[7:]
    rest.write_text(
        "\n".join(head + [row.split("\t")[0] + "\t0\t1.5707963267949" for row in rows]) + "\n"
    )
    out = arm.folder / "torques.sto"
    told = command("id", "--model", arm.model, "--motion", rest, "--loads", arm.loads, "--out", out)
    assert told.status == 0, told.err
    torque = read_sto(out)["elbow_flexion_moment"]
    # The forearm points along +x from the elbow at (0, 1.1): its center is 0.15 m ahead, the force
    # acts at x = 0.
    np.testing.assert_allclose(torque, 2.0 * 9.80665 * 0.15, rtol=1e-6)


def test_muscles_and_tension_write_their_tables(arm, command):
    told = command("muscles", "--model", arm.model, "--motion", arm.motion, "--out", arm.out)
    assert told.status == 0, told.err
    assert {path.name for path in arm.out.iterdir()} == {
        "lengths.sto",
        "velocities.sto",
        "moment_arms_shoulder_flexion.sto",
        "moment_arms_elbow_flexion.sto",
        "muscles.nc",
    }
    lengths = read_sto(arm.out / "lengths.sto")
    arms = read_sto(arm.out / "moment_arms_elbow_flexion.sto")
    motion = read_sto(arm.motion)
    slope = np.gradient(lengths["flexor"], lengths.time)
    other = read_sto(arm.out / "moment_arms_shoulder_flexion.sto")
    rates = {name: np.gradient(motion[name], motion.time) for name in motion.names}
    by_arms = -arms["flexor"] * rates["elbow_flexion"] - other["flexor"] * rates["shoulder_flexion"]
    np.testing.assert_allclose(slope[2:-2], by_arms[2:-2], atol=2e-4)

    told = command(
        "tension",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--loads",
        arm.loads,
        "--out",
        arm.out,
    )
    assert told.status == 0, told.err
    names = {path.name for path in arm.out.iterdir()}
    assert {"activations.sto", "forces.sto", "reserves.sto", "tension.nc", "lengths.sto"} <= names
    activations = read_sto(arm.out / "activations.sto")
    assert activations.names == ("flexor", "extensor")
    assert np.all((activations.values >= 0.0) & (activations.values <= 1.0))


def test_time_cuts_the_recording(arm, command):
    out = arm.folder / "cut.sto"
    told = command(
        "id",
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--time",
        0.1,
        0.3,
        "--cutoff",
        6,
        "--out",
        out,
    )
    assert told.status == 0, told.err
    time = read_sto(out).time
    assert (time[0], time[-1]) == (0.1, 0.3)


def test_info_tells_what_is_inside(arm, command):
    for path, word in ((arm.model, "muscles"), (arm.markers, "61"), (arm.motion, "61")):
        told = command("info", path)
        assert told.status == 0, told.err
        assert word in told.out


def test_report_of_single_commands(arm, command):
    arm.out.mkdir()
    steps = (
        ("ik", "--markers", arm.markers, "--out", arm.out / "reach.mot"),
        (
            "id",
            "--motion",
            arm.out / "reach.mot",
            "--loads",
            arm.loads,
            "--out",
            arm.out / "reach.sto",
        ),
        (
            "tension",
            "--motion",
            arm.out / "reach.mot",
            "--loads",
            arm.loads,
            "--emg",
            arm.emg,
            "--out",
            arm.out,
        ),
    )
    for step in steps:
        told = command(step[0], "--model", arm.model, *step[1:])
        assert told.status == 0, told.err
    told = command("report", arm.out)
    assert told.status == 0, told.err
    page = (arm.out / "report.html").read_text(encoding="utf-8")
    assert "oordinates from reach.mot" in page
    assert "flexor" in page


def test_program_runs_by_itself(arm):
    run = [sys.executable, "-m", "myomorph", "info", str(arm.model)]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 0, done.stderr
    assert "arm" in done.stdout
    assert (
        subprocess.run(
            [*run[:3], "--version"], capture_output=True, check=False, timeout=60
        ).returncode
        == 0
    )
