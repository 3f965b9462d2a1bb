"""EMG and sensors of Delsys' CSV files, in each of its layouts."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.channels import read_csv_table
from myomorph.core.model.errors import BadFile

RATE = 1925.93
NAMES = ("L TIBIALIS ANTERIOR: EMG 3", "L SOLEUS: EMG 4")


@pytest.fixture
def emg():
    """Draw times (samples,) and volts (samples, channels)."""
    random = np.random.default_rng(5)
    return np.arange(50) / RATE, random.normal(0.0, 1e-4, (50, 2))


def _rows(time, volts, separator=",", comma="."):
    lines = []
    for at, (first, second) in zip(time, volts, strict=True):
        cells = [f"{at:.7f}", f"{first:.9f}", f"{at:.7f}", f"{second:.9f}"]
        lines.append(separator.join(cell.replace(".", comma) for cell in cells))
    return lines


def _of_works(time, volts):
    titles = ",".join(f'"X [s]","{name} [Volts]"' for name in NAMES)
    return [titles, *_rows(time, volts)]


def _of_german_works(time, volts):
    titles = ";".join(f"Zeit [s];{name} [Volt]" for name in NAMES)
    return [titles, *_rows(time, volts, ";", ",")]


def _of_discover(time, volts):
    return [
        "Trial: 4,,,",
        "Date: 1 May,,,",
        "L TIBIALIS ANTERIOR,,L SOLEUS,",
        ",,,",
        "EMG 3 Time Series (s),EMG 3 (V),EMG 4 Time Series (s),EMG 4 (V)",
        f"{RATE} Hz,,{RATE} Hz,",
        *_rows(time, volts),
    ]


@pytest.mark.parametrize("layout", [_of_works, _of_german_works, _of_discover])
def test_each_channel_at_its_times(tmp_path, emg, layout):
    time, volts = emg
    path = tmp_path / "emg.csv"
    path.write_text("\n".join(layout(time, volts)) + "\n", encoding="utf-8")
    table = read_csv_table(path)
    assert table.names == NAMES
    np.testing.assert_allclose(table.time, time, atol=1e-7)
    np.testing.assert_allclose(table.values, volts, atol=1e-9)
    assert table.warnings == ()


def test_a_slower_channel_comes_to_the_clock_of_the_fastest(tmp_path, emg):
    time, volts = emg
    slow = np.arange(0.0, time[-1], 5.0 / RATE)
    lines = ["X [s],EMG 1 [V],X [s],Goniometer [deg]"]
    for row, at in enumerate(time):
        cells = [f"{at:.7f}", f"{volts[row, 0]:.9f}"]
        cells += [f"{slow[row]:.7f}", f"{100.0 * slow[row]:.7f}"] if row < len(slow) else ["", ""]
        lines.append(",".join(cells))
    path = tmp_path / "emg.csv"
    path.write_text("\n".join(lines), encoding="utf-8")
    table = read_csv_table(path)
    np.testing.assert_allclose(table["EMG 1"], volts[:, 0], atol=1e-9)
    inside = time <= slow[-1]
    np.testing.assert_allclose(table["Goniometer"][inside], 100.0 * time[inside], atol=1e-4)
    assert np.isnan(table["Goniometer"][~inside]).all()


@pytest.mark.parametrize("row", ["0.0,far,0.0,1.0", ""])
def test_a_broken_file_is_named(tmp_path, row):
    path = tmp_path / "emg.csv"
    path.write_text(f"X [s],EMG 1 [V],X [s],EMG 2 [V]\n{row}\n", encoding="utf-8")
    with pytest.raises(BadFile, match=r"far|no row of numbers"):
        read_csv_table(path)
