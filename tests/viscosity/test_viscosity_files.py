"""Tables of a cohort have the specified columns.

The report can be made again from its store.
"""

from __future__ import annotations

import csv
import io

import numpy as np
import pytest

from myomorph.core.io.sto import read_sto
from myomorph.core.model.errors import BadFile
from myomorph.swings.viscosity.cohort import MEAN, SPECIMENS, specimen_row
from myomorph.swings.viscosity.report.page import viscosity_page
from myomorph.swings.viscosity.report.specimen_report import (
    SpecimenReport,
    ViscosityInput,
    specimen_report,
)
from myomorph.swings.viscosity.study import results as files
from myomorph.swings.viscosity.study.results import DIGITS, STORE, read_store, write_value
from swing_cohort import MUSCLES, specimens

COLUMNS = [
    "name",
    "mass_muscles_removed",
    "com_muscles_removed",
    "first_moment_muscles_removed",
    "joint_viscosity",
    "mass_intact",
    "com_intact",
    "first_moment_intact",
    "total_viscosity",
    "muscle_viscosity",
    "estimated_muscle_mass",
    "measured_muscle_mass",
]


@pytest.fixture(scope="module")
def reports():
    return tuple(specimen_report(one) for one in specimens())


def table(text):
    return list(csv.DictReader(io.StringIO(text)))


def test_specimens_have_the_columns_in_their_order_each_with_its_interval(reports):
    text = files.specimens_table([(one.name, one.row) for one in reports])
    head = text.splitlines()[0].split(",")
    assert [name for name in head if not name.endswith(("_low", "_high"))] == COLUMNS
    assert [head[head.index(name) + 1] for name in COLUMNS[1:-1]] == [
        f"{name}_low" for name in COLUMNS[1:-1]
    ]
    rows = table(text)
    for printed, row in zip(SPECIMENS, rows, strict=True):
        assert row["name"] == printed.name
        for name in COLUMNS[1:]:
            assert float(row[name]) == pytest.approx(getattr(printed, name), rel=1e-12)
        assert float(row["mass_intact_low"]) < printed.mass_intact < float(row["mass_intact_high"])


def test_cohort_has_mean_and_population_sd(reports):
    rows = {row["quantity"]: row for row in table(files.cohort_table([one.row for one in reports]))}
    values = np.array([one.joint_viscosity for one in SPECIMENS])
    assert float(rows["joint_viscosity"]["mean"]) == pytest.approx(values.mean(), rel=1e-7)
    assert float(rows["joint_viscosity"]["sd"]) == pytest.approx(values.std(ddof=0), rel=1e-7)
    assert f"{float(rows['muscle_viscosity']['mean']):.2E}" == f"{MEAN.muscle_viscosity:.2E}"
    assert {row["n"] for row in rows.values()} == {"6"}


def test_a_specimen_with_one_condition_leaves_cells_empty():
    (found, *_) = specimens()
    row = specimen_row(type(found)(found.name, found.without, None, None, None, None))
    (cells,) = table(files.specimens_table([("01", row)]))
    assert float(cells["mass_muscles_removed"]) == SPECIMENS[0].mass_muscles_removed
    assert {
        cells[name] for name in ("mass_intact", "total_viscosity_low", "measured_muscle_mass")
    } == {""}


def test_tables_are_written_for_axes_muscles_models_and_notes(reports, tmp_path):
    failed = SpecimenReport("07", failure="a wire slipped")
    files.write_tables((*reports, failed), tmp_path)
    assert len(table((tmp_path / files.AXES).read_text())) == 6 * 2 * 3
    muscles = table((tmp_path / files.MUSCLES).read_text())
    assert [row["muscle"] for row in muscles[:3]] == list(MUSCLES)
    notes = table((tmp_path / files.NOTES).read_text())
    assert notes[0] == {"name": "07", "kind": "failed", "text": "a wire slipped"}
    assert len(table((tmp_path / files.SPECIMENS).read_text())) == 6
    assert not list(tmp_path.glob(".*"))


def test_trials_are_tables_over_time(tmp_path):
    (found, *_) = specimens()
    files.write_swings(found, tmp_path)
    written = read_sto(tmp_path / "without_swing1.sto")
    (recording,) = found.without.recordings
    np.testing.assert_allclose(written["rate_y"], recording.rates[:, 1], atol=1e-8)
    np.testing.assert_allclose(
        written["predicted_Fz"], (recording.wrench_rows @ found.without.parameters)[:, 5], rtol=1e-8
    )
    np.testing.assert_allclose(written["viscous_x"], -0.0761 * recording.rates[:, 0], atol=1e-8)
    assert set(written["swing"]) == {-1.0, 0.0, 1.0}


def test_the_page_is_made_again_from_the_store(reports, tmp_path):
    given = ViscosityInput("shoulder", reports, date="2026-11-21T16:00:00+00:00", version="1")
    write_value(given, tmp_path / STORE, DIGITS)
    again = read_store(tmp_path)
    assert again.specimens[0].row == reports[0].row
    assert viscosity_page(again) == viscosity_page(read_store(tmp_path))
    first = viscosity_page(given).count("<svg")
    second = viscosity_page(again).count("<svg")
    assert first == second > 60


def test_a_store_that_is_none_is_refused(tmp_path):
    (tmp_path / STORE).write_text('{"is": "Estimate", "value": 1, "low": 0, "high": 2}')
    with pytest.raises(BadFile, match="no result of 'myomorph viscosity'"):
        read_store(tmp_path)
    (tmp_path / STORE).write_text('{"is": "Bomb"}')
    with pytest.raises(BadFile):
        read_store(tmp_path)
