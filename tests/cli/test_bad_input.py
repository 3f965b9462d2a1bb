"""Bad input ends with exit status 2 and one line that helps.

It does so within seconds, and leaves nothing behind.
"""

from __future__ import annotations

import itertools
import subprocess
import sys
import time

import numpy as np
import pytest

BOMB = """<?xml version="1.0"?>
<!DOCTYPE x [<!ENTITY a "aaaaaaaaaa">
{entities}]>
<OpenSimDocument Version="40000"><Model name="&j;"></Model></OpenSimDocument>
"""


def steps_of(arm):
    """Every command with good arguments, by the role of the file that a test may spoil."""
    model = ("--model", arm.model)
    out = arm.out
    ik = ("ik", *model, "--markers", arm.markers, "--out", arm.folder / "out.mot")
    inverse = (
        "id",
        *model,
        "--motion",
        arm.motion,
        "--loads",
        arm.loads,
        "--out",
        arm.folder / "out.sto",
    )
    muscles = ("muscles", *model, "--motion", arm.motion, "--out", out)
    tension = ("tension", *model, "--motion", arm.motion, "--loads", arm.loads, "--out", out)
    return {
        "model": [ik, inverse, muscles, tension],
        "markers": [ik],
        "motion": [inverse, muscles, tension],
        "loads": [inverse, tension],
        "forces": [inverse, tension],
    }


def refused(told, *words):
    """One line on standard error, exit status 2, and the words in it."""
    assert told.status == 2, told
    assert told.out == ""
    assert told.err.count("\n") == 1, told.err
    assert "Traceback" not in told.err
    for word in words:
        assert str(word) in told.err, told.err


@pytest.fixture
def spoilt(arm, command):
    """Return a check that all commands that read a file of one role refuse it.

    No command may leave a file behind.
    """

    def check(role, *words):
        before = {path: path.stat().st_mtime_ns for path in arm.folder.rglob("*")}
        for arguments in steps_of(arm)[role]:
            started = time.monotonic()
            refused(command(*arguments), *words)
            assert time.monotonic() - started < 20.0
        assert {path: path.stat().st_mtime_ns for path in arm.folder.rglob("*")} == before

    return check


@pytest.mark.parametrize("role", ["model", "markers", "motion", "loads", "forces"])
def test_missing_file(role, arm, spoilt):
    path = getattr(arm, role)
    path.unlink()
    spoilt(role, path.name)


@pytest.mark.parametrize("role", ["model", "markers", "motion", "loads", "forces"])
def test_empty_file(role, arm, spoilt):
    path = getattr(arm, role)
    path.write_bytes(b"")
    spoilt(role, path.name)


@pytest.mark.parametrize("role", ["model", "loads"])
@pytest.mark.parametrize("share", [0.05, 0.5, 0.97])
def test_truncated_xml(role, share, arm, spoilt):
    path = getattr(arm, role)
    text = path.read_bytes()
    path.write_bytes(text[: int(share * len(text))])
    spoilt(role, path.name)


@pytest.mark.parametrize("role", ["markers", "motion", "forces"])
def test_truncated_before_the_numbers(role, arm, spoilt):
    path = getattr(arm, role)
    path.write_text("\n".join(path.read_text().splitlines()[:3]))
    spoilt(role, path.name)


@pytest.mark.parametrize("role", ["model", "markers", "motion", "loads", "forces"])
def test_binary_rubbish(role, arm, spoilt):
    path = getattr(arm, role)
    path.write_bytes(np.random.default_rng(5).bytes(5000))
    spoilt(role, path.name)


@pytest.mark.parametrize("value", ["nan", "inf", "-inf"])
def test_not_finite_coordinate(value, arm, spoilt):
    lines = arm.motion.read_text().splitlines()
    cells = lines[20].split("\t")
    lines[20] = "\t".join([cells[0], value, cells[2]])
    arm.motion.write_text("\n".join(lines))
    spoilt("motion", arm.motion.name, "shoulder_flexion", "--time")


def test_not_finite_force(arm, spoilt):
    lines = arm.forces.read_text().splitlines()
    lines[20] = "\t".join([lines[20].split("\t")[0], "nan", *lines[20].split("\t")[2:]])
    arm.forces.write_text("\n".join(lines))
    spoilt("forces")


def test_markers_never_seen(arm, spoilt):
    lines = arm.markers.read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("Frame#")) + 2
    for i in range(head, len(lines)):
        cells = lines[i].split("\t")
        lines[i] = "\t".join(cells[:2] + ["nan"] * (len(cells) - 2))
    arm.markers.write_text("\n".join(lines))
    spoilt("markers", arm.markers.name)


@pytest.mark.parametrize(("role", "rows"), [("markers", 6), ("motion", 7), ("forces", 7)])
def test_no_frames(role, rows, arm, spoilt):
    path = getattr(arm, role)
    lines = path.read_text().splitlines()
    path.write_text(
        "\n".join(lines[: next(i for i, line in enumerate(lines) if line[:2] in ("1\t", "0\t"))])
        + "\n"
    )
    spoilt(role, path.name)


def test_millimetres_called_metres(arm, spoilt):
    arm.markers.write_text(arm.markers.read_text().replace("\tmm\t", "\tm\t"))
    spoilt("markers", arm.markers.name, "millimetres", "unit")


def test_metres_called_millimetres(arm, spoilt):
    lines = arm.markers.read_text().splitlines()
    head = next(i for i, line in enumerate(lines) if line.startswith("Frame#")) + 2
    for i in range(head, len(lines)):
        cells = lines[i].split("\t")
        lines[i] = "\t".join(
            cells[:2] + [f"{float(one) / 1000:.9f}" if one.strip() else one for one in cells[2:]]
        )
    arm.markers.write_text("\n".join(lines))
    spoilt("markers", arm.markers.name, "metres", "unit")


def test_markers_of_another_model(arm, spoilt):
    text = arm.markers.read_text()
    for name in ("UA1", "UA2", "FA1", "FA2"):
        text = text.replace(name, f"X{name}")
    arm.markers.write_text(text)
    spoilt("markers", "UA1", "XUA1")


def test_motion_of_another_model(arm, spoilt):
    text = arm.motion.read_text()
    arm.motion.write_text(text.replace("shoulder_flexion", "hip").replace("elbow_flexion", "knee"))
    spoilt("motion", "hip", "shoulder_flexion")


def test_missing_force_columns(arm, spoilt):
    arm.forces.write_text(arm.forces.read_text().replace("hand_vz", "foot_vz"))
    spoilt("forces", "hand_v", arm.forces.name)


def test_loads_on_an_unknown_body(arm, spoilt):
    arm.loads.write_text(arm.loads.read_text().replace(">fore<", ">calcn_r<"))
    spoilt("loads", "calcn_r", "fore", "upper", arm.loads.name)


def test_forces_of_another_time(arm, spoilt):
    lines = arm.forces.read_text().splitlines()
    later = [
        "\t".join([f"{float(line.split()[0]) + 50:g}", *line.split()[1:]]) for line in lines[7:]
    ]
    # As long as the motion they would be moved: these are a part of them.
    arm.forces.write_text("\n".join([*lines[:7], *later[: len(later) // 2]]))
    spoilt("forces", "50", "--force-shift")


def test_model_without_mass(arm, command):
    arm.model.write_text(arm.model.read_text().replace("<mass>2.0</mass>", "<mass>0</mass>"))
    for step in steps_of(arm)["loads"]:
        refused(command(*step), arm.model.name, "mass")
    assert not arm.out.exists()


def test_entity_bomb(arm, spoilt):
    names = "abcdefghij"
    entities = ""
    for other, name in itertools.pairwise(names):
        ten = 10 * f"&{other};"
        entities += f'<!ENTITY {name} "{ten}">\n'
    arm.model.write_text(BOMB.format(entities=entities))
    spoilt("model", arm.model.name)


def test_mesh_outside_of_the_folder(arm, command):
    outside = arm.folder.parent / "outside.stl"
    outside.write_text("solid x\nendsolid x\n")
    model = arm.folder / "reach.xml"
    model.write_text(
        '<mujoco><asset><mesh name="m" file="../outside.stl"/></asset><worldbody><body><joint/>'
        '<geom type="mesh" mesh="m"/></body></worldbody></mujoco>'
    )
    refused(
        command("muscles", "--model", model, "--motion", arm.motion, "--out", arm.out),
        "outside.stl",
    )
    assert not arm.out.exists()


@pytest.mark.parametrize(
    ("change", "words"),
    [
        (("--time", "0.5", "0.1"), ("--time", "start before an end")),
        (("--time", "7", "8"), ("0 to 0.6 s",)),
        (("--time", "x", "y"), ("--time",)),
        (("--cutoff", "-3"), ("cutoff", "positive")),
        (("--cutof", "6"), ("--cutof", "--cutoff")),
        (("--threads", "0"), ("--threads", "1 or more")),
    ],
)
def test_bad_options(change, words, arm, command):
    step = steps_of(arm)["motion"][0]
    refused(command(*step, *change), *words)
    assert not (arm.folder / "out.sto").exists()


def test_bad_tension_options(arm, command):
    refused(command(*steps_of(arm)["motion"][2], "--exponent", "0.5"), "exponent", "1.2 to 20")
    refused(command(*steps_of(arm)["motion"][2], "--weights", "heavy"), "weights")
    assert not arm.out.exists()


def test_unknown_command_and_missing_options(arm, command):
    refused(command("ikk"), "ikk", "'ik'")
    refused(command("ik", "--model", arm.model), "--out", "myomorph ik --help")
    refused(
        command("ik", "--model", arm.model, "--out", arm.folder / "out.mot"), "--markers", "--imu"
    )
    refused(command("info", arm.folder / "nothing.trc"), "nothing.trc")
    (arm.folder / "empty").mkdir()
    refused(command("info", arm.folder / "empty"), "empty")


def test_output_that_cannot_be_written(arm, command):
    step = list(steps_of(arm)["markers"][0])
    step[-1] = arm.folder / "absent" / "out.mot"
    refused(command(*step), "absent", "does not exist")
    step[-1] = arm.folder
    refused(command(*step), "is a folder")
    step[-1] = arm.folder / "out.txt"
    refused(command(*step), "out.txt", ".mot")
    arm.out.write_text("a file")
    refused(command(*steps_of(arm)["motion"][1]), "is a file")
    assert arm.out.read_text() == "a file"


def test_report_without_results(arm, command):
    refused(command("report", arm.folder), "no results")
    refused(command("report", arm.folder / "absent"), "absent")
    (arm.folder / "broken.nc").write_bytes(b"CDF no")
    refused(command("report", arm.folder), "broken.nc")
    assert not (arm.folder / "report.html").exists()


def test_a_fault_of_ours_is_told_as_such(arm, command, monkeypatch):
    import myomorph.core.motion.marker_checks

    def broken(*_, **__):
        raise ZeroDivisionError("surprise")

    monkeypatch.setattr("myomorph.lab.study.trial.steps.ik.checked_kinematics", broken)
    assert myomorph.core.motion.marker_checks.checked_kinematics is not broken
    step = steps_of(arm)["markers"][0]
    told = command(*step)
    assert told.status == 1
    assert told.err.count("\n") == 1
    assert "report" in told.err
    assert "--debug" in told.err
    assert "Traceback" not in told.err
    assert "Traceback" in command(*step, "--debug").err
    assert not list(arm.folder.glob("*.nc"))


def test_interrupt_leaves_nothing(arm, command, monkeypatch):
    def interrupted(*_, **__):
        raise KeyboardInterrupt

    monkeypatch.setattr("myomorph.lab.study.trial.steps.ik.checked_kinematics", interrupted)
    before = sorted(arm.folder.iterdir())
    told = command(*steps_of(arm)["markers"][0])
    assert told.status == 130
    assert told.err.count("\n") == 1
    assert sorted(arm.folder.iterdir()) == before


def test_bad_input_through_the_program(arm):
    arm.markers.write_text(arm.markers.read_text().replace("\tmm\t", "\tm\t"))
    run = [sys.executable, "-m", "myomorph", *map(str, steps_of(arm)["markers"][0])]
    done = subprocess.run(run, capture_output=True, text=True, check=False, timeout=60)
    assert done.returncode == 2
    assert done.stderr.count("\n") == 1
    assert done.stdout == ""
