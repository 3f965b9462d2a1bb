"""`tension --contact-points`: files, notes, store, report and tables.

What is wrong with a file is reported.
"""

from __future__ import annotations

import csv

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.core.model.series import Motion, Series
from myomorph.core.tension.joint_contact import JointContactForces
from myomorph.lab.analysis.joint_loads import stride_loads
from myomorph.lab.analysis.strides import Stride, Strides
from myomorph.lab.store.contact_store import get_joint_contacts
from myomorph.lab.store.results import read_result
from myomorph.lab.study.inputs.reading import coupled_motion, open_model
from myomorph.lab.study.trial.joint_contact_step import joint_contact_numbers, lift_off_notes

POINTS = """
[[point]]
joint = "elbow"
name = "near"
point = [0.0, 0.0, -0.02]
normal = [0.0, -1.0, 0.0]
[[point]]
joint = "elbow"
name = "far"
frame = "fore"
point = [0.0, 0.0, 0.02]
normal = [0.0, -1.0, 0.0]
"""


@pytest.fixture
def solved(arm, command, tmp_path):
    points = tmp_path / "points.toml"
    out = tmp_path / "tension"
    points.write_text(POINTS)
    files = ("--model", arm.model, "--motion", arm.motion, "--loads", arm.loads)
    told = command("tension", *files, "--contact-points", points, "--out", out)
    return told, out


def test_points_of_a_file_go_through_tables_store_and_report(solved, command):
    told, out = solved
    assert told.status == 0, told
    table = read_sto(out / "joint_contact_forces.sto")
    assert table.names[:3] == ("total_elbow", "near_elbow", "far_elbow")
    stored = read_result(out / "tension.nc")
    found = get_joint_contacts(stored)
    assert found.table().values == pytest.approx(table.values, rel=1e-6, abs=1e-6)
    assert found.point_columns == ("near_elbow", "far_elbow")
    with open(out / "joint_contact_strides.csv") as lines:
        rows = list(csv.DictReader(lines))
    peak = next(one for one in rows if one["load"] == "total_elbow")
    assert (peak["stride"], float(peak["peak_N"])) == (
        "recording",
        pytest.approx(table["total_elbow"].max(), rel=1e-4),
    )
    assert float(peak["impulse_N_s"]) == pytest.approx(
        _integral(table["total_elbow"], table.time), rel=1e-4
    )
    numbers = {one.quantity: one.value for one in joint_contact_numbers(stored, None)}
    assert numbers["total_elbow contact force, peak"] == pytest.approx(
        table["total_elbow"].max() / found.weight
    )
    assert command("report", out).status == 0
    assert 'id="joint_contacts"' in (out / "report.html").read_text()


def _integral(values, time):
    return float(0.5 * (values[1:] + values[:-1]) @ np.diff(time))


@pytest.mark.parametrize(
    ("text", "words"),
    [
        (
            "[[point]]\njoint = 'knee'\nname = 'a'\npoint = [0.0, 0.0, 0.0]\nnormal = [0, 1, 0]",
            "knee",
        ),
        ("[[point]]\njoint = 'elbow'\nname = 'a'\npoint = [0.0, 0.0]", "point"),
        ("[[points]]\njoint = 'elbow'", "points"),
        ("", "point"),
        ("[[point]]\njoint = 'elbow'\nname = 'a'\npoint = [0.0, 0.0, 0.0]", "no normal"),
    ],
)
def test_a_wrong_file_is_refused_with_what_is_wrong(arm, command, tmp_path, text, words):
    points = tmp_path / "points.toml"
    points.write_text(text)
    files = (
        "--model",
        arm.model,
        "--motion",
        arm.motion,
        "--contact-points",
        points,
        "--out",
        tmp_path / "out",
    )
    told = command("tension", *files)
    assert told.status == 2
    assert words in told.err


def test_auto_without_a_knee_and_a_file_that_is_not_there_are_refused(arm, command, tmp_path):
    files = ("--model", arm.model, "--motion", arm.motion, "--out", tmp_path / "out")
    assert "no knee" in command("tension", *files, "--contact-points", "auto").err
    told = command("tension", *files, "--contact-points", tmp_path / "none.toml")
    assert told.status == 2
    assert "expected 'auto', a folder of bone meshes, or a file .toml" in told.err


def _forces(moment, pull):
    one = np.full((3, 1), 900.0)
    zero = np.zeros((3, 1))
    shared = np.array([[900.0, 0.0]] * 3)
    return JointContactForces(
        time=np.arange(3.0),
        joints=("knee",),
        points=("in", "out"),
        joint_of=("knee",) * 2,
        joint_contact_force=shared,
        joint_contact_total=one,
        joint_contact_shear=zero,
        joint_contact_unbalanced_force=zero + pull,
        joint_contact_unbalanced_moment=zero + moment,
        weight=700.0,
    )


def test_notes_tell_of_lift_off_and_of_nothing_else():
    half = {"knee": 0.023}
    assert lift_off_notes(_forces(0.0, 0.0), half) == ()
    assert lift_off_notes(_forces(2.0, 0.0), half) == ()
    (note,) = lift_off_notes(_forces(9.0, 0.0), half)
    assert "9.0 N m is left (at 0.00 s, out off)" in note
    (note,) = lift_off_notes(_forces(0.0, 400.0), half)
    assert "pulled apart" in note
    assert "400 N" in note


def test_coordinates_that_couplers_drive_follow_them(data):
    """A patella's angle in degrees, as OpenSim 3 wrote it, is corrected and reported.

    Where it is right, nothing is reported.
    """
    model = open_model(data("knee-implant-walk/nominal.osim"))
    names = ("knee_angle_l", "knee_angle_l_beta")
    right = Motion(np.arange(3.0), names, np.array([[0.2, 0.2], [0.6, 0.6], [np.nan, np.nan]]))
    same, notes = coupled_motion(right, model)
    assert notes == ()
    assert same.values == pytest.approx(right.values, nan_ok=True)
    wrong = Motion(right.time, names, right.values * [1.0, 180.0 / np.pi])
    repaired, (note,) = coupled_motion(wrong, model)
    assert repaired.values == pytest.approx(right.values, nan_ok=True)
    assert "'knee_angle_l_beta' is 34.38 at 1.00 s where its coupler puts it at 0.6" in note


def test_loads_of_a_leg_are_cut_by_its_own_strides():
    def stride(limb, start, stop):
        return Stride(
            limb=limb,
            start=start,
            lift=np.nan,
            stop=stop,
            length=1.0,
            width=0.1,
            seen=1.0,
            source="markers",
        )

    strides = Strides(
        strides=(stride("calcn_r", 0.0, 1.0), stride("calcn_l", 0.5, 1.5)),
        strikes={"calcn_r": np.array([0.0, 1.0]), "calcn_l": np.array([0.5, 1.5])},
        lifts={},
        phases={},
        direction=np.array([1.0, 0.0, 0.0]),
        ground_speed=0.0,
    )
    time = np.linspace(0.0, 2.0, 201)
    ramp = Series(time, ("total_knee_r", "total_knee_l"), np.column_stack([time, time]))
    right, left = stride_loads(ramp, strides)
    assert (right.peak, right.peak_percent, right.impulse) == pytest.approx((1.0, 100.0, 0.5))
    assert (left.start, left.peak, left.impulse) == pytest.approx((0.5, 1.5, 1.0))
