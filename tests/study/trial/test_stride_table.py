"""Single strides in tables: they average to the mean curves, and spread as an independent count."""

from __future__ import annotations

import csv
import statistics

import numpy as np
import pytest

from made_walker import recording, walker
from myomorph.core.io.osim.write import write_osim
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import write_trc
from myomorph.lab.analysis.gait_curves import KEYS, SIDES
from myomorph.lab.analysis.stride_quantities import QUANTITIES, STRIDE_CURVES, stride_column
from myomorph.lab.store.results import read_result
from myomorph.lab.study.plan.plan import read_plan
from myomorph.lab.study.run.run import run_study
from myomorph.lab.study.trial.reporting import report_input
from myomorph.lab.study.trial.stride_table import write_stride_table
from myomorph.lab.study.trial.tidy import read_curves, read_values, value_row

STUDY = """
[study]
name = "one"
[[subject]]
name = "s"
model = "walker.osim"
mass = 60
age = 34
sex = "female"
height = 1.66
trials = ["walk.trc"]
steps = ["ik", "id"]
"""


@pytest.fixture(scope="module")
def walk(tmp_path_factory):
    """Folder of the results of a made walk."""
    home = tmp_path_factory.mktemp("strides")
    write_osim(walker(), home / "walker.osim")
    write_trc(recording(walker(), np.random.default_rng(5), 0.5), home / "walk.trc")
    (home / "study.toml").write_text(STUDY)
    (outcome,) = run_study(read_plan(home / "study.toml"), home / "out")
    assert outcome.error == ""
    return outcome.folder


@pytest.fixture(scope="module")
def rows(walk):
    with (walk / "strides.csv").open(encoding="utf-8", newline="") as stream:
        return list(csv.DictReader(stream))


def strides_of(rows, side):
    """Rows of each stride of a side, in their order."""
    numbers = sorted({int(row["stride"]) for row in rows if row["side"] == side})
    chosen = [
        [row for row in rows if row["side"] == side and int(row["stride"]) == number]
        for number in numbers
    ]
    assert numbers == list(range(1, len(numbers) + 1))
    return chosen


def test_columns_are_those_that_are_declared(rows):
    assert list(rows[0]) == [stride_column(quantity) for quantity in QUANTITIES]
    assert [quantity.attribute for quantity in STRIDE_CURVES] == list(KEYS)
    assert {"knee_flexion_deg", "hip_moment_Nm_per_kg", "ankle_power_W_per_kg"} <= set(rows[0])
    assert not any(" " in name or "/" in name for name in rows[0])


@pytest.mark.parametrize("side", SIDES)
def test_strides_average_to_the_mean_curve(walk, rows, side):
    _, curves = read_curves(walk / "curves.csv")
    mean = curves["joint angle [°]"][f"knee_angle_{side[0]}"]
    strides = strides_of(rows, side)
    assert len(strides) >= 3
    each = np.array([[float(row["knee_flexion_deg"]) for row in stride] for stride in strides])
    sign = np.sign(np.corrcoef(each.mean(axis=0), mean[::2])[0, 1])
    np.testing.assert_allclose(sign * each.mean(axis=0), mean[::2], atol=2e-4 * np.ptp(mean))


@pytest.mark.parametrize("side", SIDES)
def test_values_have_spread_and_number_of_an_independent_count(walk, rows, side):
    name = f"knee_angle_{side[0]}"
    angles = read_sto(walk / "coordinates.mot")
    peaks = []
    for stride in strides_of(rows, side):
        times = np.linspace(float(stride[0]["time_s"]), float(stride[-1]["time_s"]), 101)
        peaks.append(float(np.interp(times, angles.time, angles[name]).max()))
    values = {value.quantity: value for value in read_values(walk / "values.csv")}
    found = values[f"{name}, maximum in a stride"]
    assert found.strides.count == len(peaks)
    assert found.value == pytest.approx(statistics.fmean(peaks), abs=1e-3)
    assert found.strides.sd == pytest.approx(statistics.stdev(peaks), rel=0.02)
    assert values[f"{name}, maximum"].strides is None
    # Those of draws are another matter.
    assert np.isnan(found.sd)


def test_parameters_of_strides_have_their_spread(walk, rows):
    values = {value.quantity: value for value in read_values(walk / "values.csv")}
    durations = [
        float(stride[-1]["time_s"]) - float(stride[0]["time_s"])
        for stride in strides_of(rows, "right")
    ]
    found = values["stride duration, foot_r"]
    assert found.strides.count == len(durations) == values["strides, foot_r"].value
    assert found.strides.sd == pytest.approx(statistics.stdev(durations), abs=1e-5)


def test_rows_come_back_and_older_tables_are_read(walk, tmp_path):
    values = read_values(walk / "values.csv")
    with (walk / "values.csv").open(encoding="utf-8", newline="") as stream:
        written = list(csv.reader(stream))[1:]
    assert [list(value_row(value)) for value in values] == written
    with (tmp_path / "values.csv").open("w", encoding="utf-8", newline="") as stream:
        table = csv.writer(stream)
        table.writerow(("step", "quantity", "value", "unit", "low", "high", "sd"))
        table.writerows(row[:7] for row in written)
    older = read_values(tmp_path / "values.csv")
    assert [value.value for value in older] == [value.value for value in values]
    assert all(value.strides is None for value in older)


def test_what_has_no_strides_has_no_table(tmp_path):
    path = tmp_path / "strides.csv"
    path.write_text("of an earlier run")
    write_stride_table(path, None)
    assert not path.exists()


def test_who_was_recorded_is_kept_with_the_results(walk):
    (path,) = walk.glob("*.nc")
    recorded = report_input(read_result(path), walker(), drawn=False).recorded
    assert (recorded.age, recorded.sex, recorded.height) == (34.0, "female", 1.66)
    assert recorded.mass == 60.0
