"""Equal inputs give equal numbers by `analyze`, a study file, `tension` and Python."""

from __future__ import annotations

import numpy as np
import pytest
from numpy.testing import assert_allclose

import myomorph as mm
from myomorph.core.io.sto import read_sto
from myomorph.lab.cli import main

DIGITS = 1e-6
"""What files leave of a number, over the largest of its table."""
TABLES = ("forces.sto", "reserves.sto", "contact_groups.sto", "torques_with_contacts.sto")


@pytest.fixture(scope="module")
def analyzed(data, tmp_path_factory):
    """Analyze a walk on plates that contacts share, whose laboratory is turned to the model."""
    recording = data("c3d-opensim-walking/walking5.c3d")
    folder = tmp_path_factory.mktemp("analyzed") / "results"
    shared = ["--contacts", "auto", "--measured", "shared"]
    named = ["analyze", str(recording), "--mass", "59.4", *shared, "--out", str(folder)]
    assert main(named) == 0
    return recording, folder


def same(first, second):
    """Hold two tables against each other, as far as files keep numbers."""
    expected = read_sto(first)
    found = read_sto(second)
    assert found.names == expected.names
    size = float(np.nanmax(np.abs(expected.values)))
    assert_allclose(found.values, expected.values, rtol=0.0, atol=DIGITS * size)


@pytest.mark.long
def test_tension_of_what_analyze_wrote_gives_its_numbers(analyzed, tmp_path):
    """A model, a motion and a recording of plates: outlines and repairs are those of `analyze`."""
    recording, folder = analyzed
    status = main(
        [
            "tension",
            *("--model", str(folder / "calibrated.osim")),
            *("--motion", str(folder / "walking5" / "coordinates.mot")),
            *("--loads", str(recording), "--up", "z", "--turn", "180"),
            *("--contacts", "auto", "--measured", "shared", "--intervals", "0"),
            *("--out", str(tmp_path)),
        ]
    )
    assert status == 0
    for table in TABLES:
        same(folder / "walking5" / table, tmp_path / table)


@pytest.mark.long
def test_the_study_file_that_analyze_wrote_gives_its_numbers(analyzed, tmp_path):
    _, folder = analyzed
    study = folder / "study.toml"
    assert main(["run", str(study), "--out", str(tmp_path / "again")]) == 0
    (forces,) = (tmp_path / "again").rglob("forces.sto")
    for table in TABLES:
        same(folder / "walking5" / table, forces.parent / table)


@pytest.mark.long
def test_what_python_opens_has_the_numbers_of_the_tables(analyzed):
    _, folder = analyzed
    (trial,) = mm.load(folder / "walking5").values()
    table = read_sto(folder / "walking5" / "forces.sto")
    known = np.isfinite(table.values)
    found = np.asarray(trial.tension.muscle_force)[known]
    assert_allclose(found, table.values[known], rtol=0.0, atol=DIGITS * np.abs(found).max())
