"""TRC files: OpenSim's own reading as oracle, files that broke other readers, round trips."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.trc import read_trc, write_trc
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.series import Markers

READ_BY_OPENSIM = (
    "c3d-functional-joints/static.trc",
    "c3d-opensim-walking/dataWithBlanksForMissingMarkers.trc",
    "c3d-opensim-walking/dataWithEformat.trc",
    "c3d-opensim-walking/dataWithNaNsOfDifferentCases.trc",
    "c3d-opensim-walking/dataWithNaNsWithSpaces.trc",
    "c3d-opensim-walking/exampleFormat.trc",
    "c3d-opensim-walking/std_walking2_markers.trc",
    "c3d-vendor-samples/TRCSamples/Anto.trc",
    "c3d-vendor-samples/TRCSamples/MOTEK/T.trc",
    "c3d-vendor-samples/TRCSamples/Res16bits.trc",
    "fullbody-many-muscles/s01_static.trc",
    "hamner-run-subject04/run200/markers.trc",
    "lenhart-knee-contact-walk/motion/overground_17.trc",
    "opencap-subject4-multitask/markers/walking1.trc",
    "opensim-gait-subject01/ref_ik/subject01_synthetic_marker_data.trc",
    "rajagopal-walk-emg/markers_walk.trc",
    "shoulder-bonepin/abdbonepin.trc",
)


@pytest.mark.parametrize("name", READ_BY_OPENSIM)
def test_markers_are_what_opensim_reads(name, data):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("off")
    path = data(name)
    theirs = opensim.TimeSeriesTableVec3(str(path))
    unit = {"mm": 1e-3, "m": 1.0}[theirs.getTableMetaDataString("Units")]
    markers = read_trc(path).markers
    assert tuple(theirs.getColumnLabels()) == markers.names
    np.testing.assert_array_equal(theirs.getIndependentColumn(), markers.time)
    for frame in {0, len(markers) // 3, len(markers) - 1}:
        row = theirs.getRowAtIndex(frame)
        values = (
            np.array([[row[k][axis] for axis in range(3)] for k in range(len(markers.names))])
            * unit
        )
        np.testing.assert_array_equal(values, markers.values[frame])


@pytest.mark.parametrize(
    ("name", "shape", "warning"),
    [
        (
            "c3d-shoulder-emg-handle/markers.trc",
            (93, 51),
            "the header says 652 frames, the file has 93",
        ),
        ("odd-trc-mot/markers.trc", (281, 61), "exactly (0, 0, 0)"),
        ("odd-trc-mot/markers_StairUp3.trc", (440, 61), "exactly (0, 0, 0)"),
        (
            "c3d-vendor-samples/TRCSamples/UpperLimbStatic.trc",
            (146, 34),
            "6 columns behind the last marker",
        ),
        (
            "c3d-vendor-samples/TRCSamples/10002-20130731010438-Unnamed.trc",
            (1313, 37),
            "37 markers have no name",
        ),
    ],
)
def test_files_opensim_refuses_are_repaired_and_it_is_told(name, shape, warning, data):
    trial = read_trc(data(name))
    assert trial.markers.values.shape == (*shape, 3)
    assert any(warning in line for line in trial.warnings)
    assert 0.05 < np.nanmedian(np.abs(trial.markers.values)) < 3.0


def test_zeros_are_hidden_markers(data):
    markers = read_trc(data("odd-trc-mot/markers.trc")).markers
    assert np.isnan(markers["LWRA"]).all(axis=1).sum() == 29
    assert not np.any(np.all(markers.values == 0.0, axis=2))


def trc(
    rows: str,
    names: str = "A\t\t\tB",
    values: str = "100\t100\t3\t2\tmm\t100\t1\t3",
    end: str = "\n",
) -> str:
    keys = (
        "DataRate\tCameraRate\tNumFrames\tNumMarkers\tUnits\tOrigDataRate\t"
        "OrigDataStartFrame\tOrigNumFrames"
    )
    axes = "\t\tX1\tY1\tZ1\tX2\tY2\tZ2"
    return end.join(
        ["PathFileType\t4\t(X/Y/Z)\tx.trc", keys, values, f"Frame#\tTime\t{names}", axes, "", rows]
    )


ROWS = "1\t0.00\t1\t2\t3\t4\t5\t6\n2\t0.01\t7\t8\t9\t10\t11\t12\n3\t0.02\t13\t14\t15\t16\t17\t18\n"
EXPECTED = np.arange(1.0, 19.0).reshape(3, 2, 3) * 1e-3


def read(tmp_path, text: str):
    path = tmp_path / "x.trc"
    path.write_bytes(text.encode())
    return read_trc(path)


@pytest.mark.parametrize(
    "text",
    [
        trc(ROWS),
        trc(ROWS).replace("\n", "\r\n"),
        trc(ROWS).replace("\n", "\r"),
        trc(ROWS).replace("\t", ","),
        trc(ROWS).replace("A\t\t\tB", "A\tB"),
        trc(ROWS.replace("\t", "  ")),
        trc(ROWS, values="  100.0\t\t  100.0\t\t   3\t\t  2\t\t mm\t  100.0\t 1\t 3"),
        trc(ROWS.replace("\n", "\t\t\n")),
        trc(ROWS).rstrip("\n"),
        trc(ROWS.replace("7\t8", "7.0E+00\t8e0")),
        trc(ROWS, values="100\t100\t3\t2\tMM\t100\t1\t3"),
        trc(ROWS).replace("\n\n", "\n"),
        "\ufeff" + trc(ROWS),
    ],
    ids=[
        "plain",
        "crlf",
        "cr",
        "commas",
        "names close",
        "spaces",
        "shifted header",
        "trailing tabs",
        "no line end",
        "exponents",
        "capital unit",
        "no blank line",
        "byte order mark",
    ],
)
def test_one_content_in_many_clothes(text, tmp_path):
    trial = read(tmp_path, text)
    assert trial.markers.names == ("A", "B")
    np.testing.assert_allclose(trial.markers.values, EXPECTED, rtol=1e-15)
    np.testing.assert_array_equal(trial.markers.time, [0.0, 0.01, 0.02])
    assert trial.warnings == ()


@pytest.mark.parametrize(("unit", "factor"), [("m", 1.0), ("cm", 0.01), ("mm", 0.001)])
def test_units(unit, factor, tmp_path):
    trial = read(tmp_path, trc(ROWS, values=f"100\t100\t3\t2\t{unit}\t100\t1\t3"))
    np.testing.assert_allclose(trial.markers.values, EXPECTED * 1000 * factor)


def test_an_unknown_unit_is_guessed_and_told(tmp_path):
    trial = read(
        tmp_path,
        trc(ROWS.replace("\t5\t", "\t5000\t"), values="100\t100\t3\t2\tfurlong\t100\t1\t3"),
    )
    assert any("furlong" in line for line in trial.warnings)


def test_missing_cells_hide_the_whole_marker(tmp_path):
    rows = "1\t0.00\t\t2\t3\t4\t5\t6\n2\t0.01\t7\t8\t9\n3\t0.02\tNaN\tnan\tNAN\tinf\t1\t2\n"
    values = read(tmp_path, trc(rows)).markers.values
    hidden = np.isnan(values).all(axis=2)
    np.testing.assert_array_equal(hidden, [[True, False], [False, True], [True, True]])


def test_repeated_and_empty_names(tmp_path):
    trial = read(tmp_path, trc(ROWS, names="A\t\t\tA"))
    assert trial.markers.names == ("A", "A_2")
    trial = read(tmp_path, trc(ROWS, names="\t\t\tB"))
    assert len(trial.markers.names) == 2
    assert "B" in trial.markers.names
    assert trial.markers.names[1] == "B"


def test_times_that_do_not_rise(tmp_path):
    trial = read(tmp_path, trc(ROWS.replace("\t0.02\t", "\t0.01\t").replace("3\t0.01", "2\t0.01")))
    np.testing.assert_array_equal(trial.markers.time, [0, 0.01])
    assert any("does not increase" in line for line in trial.warnings)


def test_a_rounded_clock_is_counted_from_frames(tmp_path):
    rows = "".join(f"{k + 1}\t{k // 4 / 1000:.3f}\t1\t2\t3\t4\t5\t{k + 1}\n" for k in range(40))
    trial = read(tmp_path, trc(rows, values="4000\t4000\t40\t2\tmm\t4000\t1\t40"))
    np.testing.assert_allclose(np.diff(trial.markers.time), 1 / 4000)
    assert len(trial.markers) == 40


def test_a_row_cut_off_is_left_out(tmp_path):
    trial = read(tmp_path, trc(ROWS.rstrip("\n")[:-6]))
    assert len(trial.markers) == 2
    assert any("cut off" in line for line in trial.warnings)


@pytest.mark.parametrize(
    "text", ["", "\n\n", "x", "PathFileType\t4\n", trc(""), trc("a\tb\tc\n"), "\0\1\2" * 50]
)
def test_what_is_no_trc_is_refused_in_one_line(text, tmp_path):
    with pytest.raises(BadFile) as caught:
        read(tmp_path, text)
    assert "\n" not in str(caught.value)


@pytest.mark.parametrize("units", ["mm", "m"])
def test_what_is_written_reads_back_and_opens_in_opensim(units, tmp_path):
    values = np.random.default_rng(0).normal(size=(30, 4, 3))
    values[5:9, 1] = np.nan
    values[:, 3] = np.nan
    values[2, 3] = 1.0
    markers = Markers(np.arange(30) / 120, ("a", "b.c", "L ASIS", "d"), values)
    path = tmp_path / "out.trc"
    write_trc(markers, path, units)
    trial = read_trc(path)
    assert trial.markers.names == markers.names
    assert trial.warnings == ()
    np.testing.assert_allclose(trial.markers.values, values, rtol=1e-9)
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("off")
    theirs = opensim.TimeSeriesTableVec3(str(path))
    assert theirs.getNumRows() == 30
    assert np.isnan(theirs.getRowAtIndex(6)[1][0])


def test_an_unknown_unit_is_not_written(tmp_path):
    with pytest.raises(BadData, match="ell"):
        write_trc(Markers(np.zeros(1), ("a",), np.zeros((1, 1, 3))), tmp_path / "out.trc", "ell")
    assert not list(tmp_path.iterdir())
