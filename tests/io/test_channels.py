"""Tables as spreadsheets write them."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.channels import read_csv_table
from myomorph.core.model.errors import BadFile


@pytest.mark.parametrize(
    "text",
    [
        "time,soleus_r,tibant_r\n0,0.1,1\n0.01,0.2,\n",
        "Time [s];soleus_r;tibant_r\n0;0,1;1\n0,01;0,2;\n",
        "made by a program\ntime (ms)\tsoleus_r\ttibant_r\n0\t0.1\t1\n10\t0.2\t\n",
    ],
)
def test_every_way_of_writing_gives_the_same_table(text: str, tmp_path: Path) -> None:
    (tmp_path / "emg.csv").write_text(text)
    found = read_csv_table(tmp_path / "emg.csv")
    assert found.names == ("soleus_r", "tibant_r")
    np.testing.assert_allclose(found.time, [0.0, 0.01])
    np.testing.assert_allclose(found.values, [[0.1, 1.0], [0.2, np.nan]])


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("a,b\n1,2\n", "no line of column names"),
        ("time,a\n0,x\n", "line 2 is not of numbers"),
        ("time,a\n1,0\n0,1\n", "times do not rise"),
        ("time,a\n", "no row of numbers"),
    ],
)
def test_what_is_no_table_is_refused(text: str, message: str, tmp_path: Path) -> None:
    (tmp_path / "emg.csv").write_text(text)
    with pytest.raises(BadFile, match=message):
        read_csv_table(tmp_path / "emg.csv")
