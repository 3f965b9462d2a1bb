"""`myomorph identify`: the model it writes, and what it says of bad input."""

from __future__ import annotations

import csv

import numpy as np
import pytest

from identified_arm import UPPER, put_on_plate
from myomorph.core.io.osim.read import read_osim
from opensim_oracle import ask


@pytest.fixture
def plate(arm):
    put_on_plate(arm)
    return arm


def given(arm, *more, out="identified.osim"):
    return (
        *("identify", "--model", arm.model, "--motion", arm.motion, "--loads", arm.loads),
        *("--spacing", "0.02", "--out", arm.folder / out, *more),
    )


def test_expected_masses_move_to_where_the_forces_are(plate, command):
    told = command(*given(plate, "--mass", 4.0, "--masses", "expected"))
    assert told.status == 0, told.err
    model = read_osim(plate.folder / "identified.osim")
    assert model.mass == pytest.approx(4.0, abs=1e-6)
    assert model.body("upper").mass == pytest.approx(UPPER, abs=0.1)
    folder = plate.folder / "identified_identification"
    assert {"masses.csv", "parameters.csv", "links.csv", "report.html", "provenance.json"} <= {
        path.name for path in folder.iterdir()
    }
    rows = list(csv.reader((folder / "masses.csv").read_text().splitlines()))
    assert {"upper", "fore"} <= {row[0] for row in rows}
    assert "61 of 61 frames used" in told.out
    assert "all 2 links are physically possible" in told.out
    assert "from the prior" in told.out
    assert "soft tissue: not identifiable" in told.out
    assert told.err == ""
    assert not list(plate.folder.glob(".*"))


def test_a_mass_that_is_not_shown_stays_and_is_named(plate, command):
    """The default: the interval of the upper arm holds what the model says."""
    told = command(*given(plate, "--mass", 4.0, "--no-compare"))
    assert told.status == 0, told.err
    assert "masses that forces show to differ from the shape's: none" in told.out
    model = read_osim(plate.folder / "identified.osim")
    assert model.body("upper").mass == pytest.approx(2.0, rel=1e-5)
    table = (plate.folder / "identified_identification" / "masses.csv").read_text().splitlines()
    rows = {row["link"]: row for row in csv.DictReader(table)}
    assert rows["upper"]["another mass than the shape's"] == "not shown"
    assert float(rows["upper"]["expected [kg]"]) == pytest.approx(UPPER, abs=0.15)
    assert float(rows["upper"]["90 % interval from [kg]"]) < UPPER
    assert float(rows["upper"]["90 % interval to [kg]"]) > UPPER


def test_opensim_opens_what_was_written(plate, command, tmp_path):
    pytest.importorskip("opensim")
    assert command(*given(plate, "--no-compare", "--mass-sd", 0.2)).status == 0
    model = read_osim(plate.folder / "identified.osim")
    theirs = ask({"arm": plate.folder / "identified.osim"}, tmp_path)["arm"]
    assert not isinstance(theirs, str), theirs
    for body in model.bodies:
        mass, center, inertia = theirs["bodies"][body.name]
        assert mass == pytest.approx(body.mass)
        np.testing.assert_allclose(center, body.mass_center, atol=1e-9)
        np.testing.assert_allclose(inertia, body.inertia, atol=1e-9)


def test_another_motion_is_compared(plate, command):
    more = (
        "--check-motion",
        plate.motion,
        "--check-loads",
        plate.loads,
        "--mass-sd",
        0.5,
        "--no-compare",
    )
    told = command(*given(plate, *more))
    assert told.status == 0, told.err
    assert "reach.mot, not used:" in told.out
    assert (plate.folder / "identified_identification" / "cross_validation.csv").is_file()


@pytest.mark.parametrize(
    ("more", "told"),
    [
        (("--mass", -4), "in kilograms"),
        (("--mass", 72.6), "scale it to the subject first"),
        (("--height", 182, "--chest", 0.9), "182"),
        (("--chest", 0.9), "--chest needs --height"),
        (("--skin", "nobody.obj"), "nobody.obj"),
        (("--mass-sd", -1), "mass_sd"),
        (("--time", 5, 6), "has nothing from"),
        (("--time", 0.1, 0.3), "fewer than 0.5"),
        (("--min-duration", 1000), "fewer than 1000"),
        (("--check-motion", "a.mot"), "1 motions but 0 files of forces"),
    ],
)
def test_bad_input_is_one_line_and_leaves_nothing(plate, command, more, told):
    before = sorted(plate.folder.iterdir())
    found = command(*given(plate, *more))
    assert found.status == 2
    assert told in found.err.splitlines()[-1]
    assert sorted(plate.folder.iterdir()) == before


def test_forces_of_another_contact_and_names_of_no_model_are_refused(arm, command):
    """The arm's own loads: a hand that pushes 10 N down, where 40 N must hold the arm up."""
    found = command(*given(arm))
    assert found.status == 2
    assert "61 (a contact that no plate measures" in found.err
    assert command(*given(arm, out="identified.txt")).status == 2
    assert command(*given(arm, out="no/identified.osim")).status == 2
    assert not list(arm.folder.glob("identified*"))


def test_landmarks_are_read_line_by_line(tmp_path):
    from myomorph.core.io.landmarks import read_landmarks
    from myomorph.core.model.errors import BadFile

    path = tmp_path / "landmarks.csv"
    path.write_text("name,x,y,z\nright knee, 0.1, 0.5, 0.1\nC7,0,1.5,0\n")
    found = read_landmarks(path)
    np.testing.assert_allclose(found["right knee"], [0.1, 0.5, 0.1])
    assert list(found) == ["right knee", "C7"]
    path.write_text("right knee, 0.1, 0.5, 0.1\nC7, 0, 1.5, 0\n")
    assert list(read_landmarks(path)) == ["right knee", "C7"]
    path.write_text("right knee, 0.1, 0.5, 0.1\nC7, 1.5\n")
    with pytest.raises(BadFile, match="line 2"):
        read_landmarks(path)
