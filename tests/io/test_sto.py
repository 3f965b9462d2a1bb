"""STO and MOT files: OpenSim's own reading as the oracle, headers old and odd, and the way back."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

from myomorph.core.io.sto import motion_from_table, read_sto, table_from_motion, write_sto
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.functions import PiecewisePolynomial
from myomorph.core.model.model import Axis, Body, Coordinate, Joint, Model
from myomorph.core.model.series import Motion, Table
from myomorph.core.model.spatial import Transform

SETS = (
    "c3d-opensim-walking/std_cop_walking2_grfs.sto",
    "ceinms-emg-walk/walk36/ik.sto",
    "hamner-run-subject04/run200/grf.mot",
    "lenhart-knee-contact-walk/reference_comak/walking_kinematics.sto",
    "odd-trc-mot/grf_extra_line.mot",
    "odd-trc-mot/weird.mot",
    "opencap-subject4-multitask/ik_manual_scaling/DJ1_ik.mot",
    "opensim-gait-subject01/ref_ik/std_subject01_walk1_ik.mot",
    "opensim-reference-small/arm26_InverseKinematics.mot",
    "opensim-reference-small/std_DoublePendulum3D_JointReaction_ReactionLoads.sto",
    "rajagopal-walk-emg/coordinates.sto",
    "fullbody-many-muscles/s01static.mot",
)


def written(folder: Path, text: str, name: str = "table.sto") -> Path:
    path = folder / name
    path.write_bytes(text.encode())
    return path


@pytest.mark.parametrize("name", SETS)
def test_tables_are_what_opensim_reads(name, data):
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("off")
    path = data(name)
    storage = opensim.Storage(str(path))
    table = read_sto(path)
    assert storage.isInDegrees() == table.in_degrees
    assert storage.getSize() == len(table)
    assert storage.getColumnLabels().getSize() == len(table.names) + 1
    for row in {0, len(table) // 2, len(table) - 1}:
        state = storage.getStateVector(row)
        assert state.getTime() == pytest.approx(table.time[row], abs=1e-12)
        values = [state.getData().get(column) for column in range(len(table.names))]
        np.testing.assert_allclose(values, table.values[row], rtol=1e-12, atol=1e-14)


def test_commas_for_tabs_and_a_count_that_does_not_hold(data):
    table = read_sto(data("c3d-shoulder-emg-handle/inverse_kin.mot"))
    assert table.values.shape == (88, 25)
    assert table.in_degrees
    assert table.names[0] == "thorax_tilt"
    assert table.warnings == ("the header says 250 rows, the file has 88",)


def test_names_that_occur_twice_stay_reachable(data):
    table = read_sto(data("opensim-gait-subject01/ref_rra/subject01_walk1_ik.mot"))
    assert len(set(table.names)) == len(table.names)
    assert "ground_force_vx_2" in table.names
    assert any("ground_force_vx" in line for line in table.warnings)


BODY = "time\ta\tb\n0\t1\t2\n0.1\t3\t4\n"
HEADERS = {
    "opensim": "title\nversion=1\nnRows=2\nnColumns=3\ninDegrees=no\nendheader\n" + BODY,
    "simm": "name title\ndatacolumns 3\ndatarows 2\nrange 0 0.1\nendheader\n" + BODY,
    "quoted": '"title"\t\n"Nrows=2"\t\n"nColumns=3"\n"endheader"\t\n'
    + BODY.replace("time", '"time"'),
    "windows": ("title\nversion=1\ninDegrees=no\nendheader\n" + BODY).replace("\n", "\r\n"),
    "commas": "title,,\nendheader,,\n" + BODY.replace("\t", ","),
    "spaces": "title\nendheader\n" + BODY.replace("\t", "   "),
    "padded": "title\nendheader\n\n"
    + BODY.replace("time\t", "      time\t ").replace("\n", "\t\n"),
    "no endheader": BODY,
    "no last line end": "title\nendheader\n" + BODY.rstrip("\n"),
    "blank lines": "title\nendheader\n\n\n" + BODY + "\n\n",
}


@pytest.mark.parametrize("kind", HEADERS)
def test_headers_old_and_odd(kind, tmp_path):
    table = read_sto(written(tmp_path, HEADERS[kind]))
    assert table.names == ("a", "b")
    np.testing.assert_array_equal(table.time, [0.0, 0.1])
    np.testing.assert_array_equal(table.values, [[1, 2], [3, 4]])


@pytest.mark.parametrize(
    ("header", "name", "degrees"),
    [
        ("title\nversion=1\ninDegrees=yes\n", "q.sto", True),
        ("title\nversion=1\ninDegrees=no\n", "q.mot", False),
        ("name title\ndatacolumns 3\n", "q.mot", True),
        ("title\nnRows=2\n", "q.mot", True),
        ("title\nnRows=2\n", "q.sto", False),
        ("title\nAngles are in degrees.\n", "q.sto", True),
        ("title\nversion=3\nDataType=double\n", "q.mot", False),
    ],
)
def test_degrees_follow_opensim(header, name, degrees, tmp_path):
    assert read_sto(written(tmp_path, header + "endheader\n" + BODY, name)).in_degrees is degrees


def test_blank_and_misspelt_numbers_are_nan(tmp_path):
    body = (
        "time\ta\tb\tc\td\n0\t\tNaN\t-1.#IND\t1.5D+02\n1\t1\tnan(ind)\t2\t3\n2\tinf\t1\t-Inf\t3\n"
    )
    table = read_sto(written(tmp_path, "t\nendheader\n" + body))
    nan = np.nan
    np.testing.assert_array_equal(
        table.values, [[nan, nan, nan, 150], [1, nan, 2, 3], [nan, 1, nan, 3]]
    )
    assert any("infinite" in line for line in table.warnings)


def test_rows_out_of_time_and_rows_cut_off_are_left_out(tmp_path):
    body = "time\ta\tb\n0\t1\t2\n1\t3\t4\n1\t5\t6\n0.5\t7\t8\n2\t9\t10\n3\t1"
    table = read_sto(written(tmp_path, "t\nendheader\n" + body))
    np.testing.assert_array_equal(table.time, [0, 1, 2])
    assert len(table.warnings) == 2


def test_vectors_become_columns(tmp_path):
    body = "time\tforce\n0\t1,2,3\n0.5\t4,5,6\n"
    table = read_sto(written(tmp_path, "DataType=Vec3\nversion=3\nendheader\n" + body))
    assert table.names == ("force_1", "force_2", "force_3")
    np.testing.assert_array_equal(table.values, [[1, 2, 3], [4, 5, 6]])


def test_vectors_with_a_blank_part_become_columns(tmp_path):
    body = "time\tforce\n0\t1,2,3\n0.5\t4,n/a,6\n"
    table = read_sto(written(tmp_path, "DataType=Vec3\nversion=3\nendheader\n" + body))
    np.testing.assert_array_equal(table.values, [[1, 2, 3], [4, np.nan, 6]])


@pytest.mark.parametrize(
    "text",
    [
        "",
        "   \n",
        "hello\n",
        "endheader\n",
        "t\nendheader\ntime\ta\n",
        "t\nendheader\ntime\ta\nx\ty\n",
        "a\0b",
        "1 2 3\n4 5 6\n",
    ],
)
def test_what_is_no_table_is_refused_in_one_line(text, tmp_path):
    with pytest.raises(BadFile) as caught:
        read_sto(written(tmp_path, text))
    assert "\n" not in str(caught.value)


def test_what_is_written_reads_back_and_opens_in_opensim(tmp_path):
    values = np.random.default_rng(1).normal(size=(40, 7)) * 10.0 ** np.arange(-3, 4)
    values[3, 2] = np.nan
    table = Table(np.arange(40) / 200, tuple("abcdefg"), values, in_degrees=True)
    path = tmp_path / "out.sto"
    write_sto(table, path)
    back = read_sto(path)
    assert back.names == table.names
    assert back.in_degrees
    assert not back.warnings
    np.testing.assert_allclose(back.values, values, rtol=1e-9)
    assert [one.name for one in tmp_path.iterdir()] == ["out.sto"]
    opensim = pytest.importorskip("opensim")
    opensim.Logger.setLevelString("off")
    theirs = opensim.TimeSeriesTable(str(path))
    assert (theirs.getNumRows(), theirs.getNumColumns()) == (40, 7)
    assert theirs.getTableMetaDataString("inDegrees") == "yes"
    assert opensim.Storage(str(path)).isInDegrees()


def test_nothing_half_written_stays_behind(tmp_path):
    table = Table(np.zeros(1), ("a",), np.zeros((1, 1)))
    object.__setattr__(table, "values", np.full((1, 1), "no number"))
    with pytest.raises(TypeError):
        write_sto(table, tmp_path / "out.sto")
    assert not list(tmp_path.iterdir())


def test_a_folder_that_does_not_exist_is_named(tmp_path):
    with pytest.raises(BadFile, match="cannot be written"):
        write_sto(Table(np.zeros(1), ("a",), np.zeros((1, 1))), tmp_path / "absent" / "out.sto")


def two_joints() -> Model:
    frame = Transform.identity()
    bodies = tuple(
        Body(name=name, mass=1.0, mass_center=np.zeros(3), inertia=np.eye(3))
        for name in ("cart", "arm")
    )
    slide = Axis(
        kind="translation",
        vector=np.array([1.0, 0, 0]),
        function=PiecewisePolynomial(np.zeros(1), np.array([[0.0, 1.0]])),
        coordinates=("reach",),
    )
    turn = Axis(
        kind="rotation",
        vector=np.array([0.0, 0, 1]),
        function=PiecewisePolynomial(np.zeros(1), np.array([[0.0, 1.0]])),
        coordinates=("angle",),
    )
    joints = (
        Joint(
            name="slide",
            kind="SliderJoint",
            parent="ground",
            child="cart",
            parent_frame=frame,
            child_frame=frame,
            axes=(slide,),
            coordinates=("reach",),
        ),
        Joint(
            name="pin",
            kind="PinJoint",
            parent="cart",
            child="arm",
            parent_frame=frame,
            child_frame=frame,
            axes=(turn,),
            coordinates=("angle",),
        ),
    )
    coordinates = (Coordinate("reach", "translational"), Coordinate("angle", "rotational"))
    return Model(
        name="two",
        bodies=bodies,
        joints=joints,
        coordinates=coordinates,
        gravity=np.array([0, -9.81, 0]),
    )


def test_degrees_become_radians_for_rotations_only():
    names = ("/jointset/pin/angle/value", "/jointset/pin/angle/speed", "angle_u", "reach", "other")
    table = Table(
        np.arange(2.0),
        names,
        np.array([[90.0, 5, 6, 0.3, 7], [180.0, 5, 6, 0.4, 7]]),
        in_degrees=True,
    )
    motion = motion_from_table(table, two_joints())
    assert motion.names == ("reach", "angle")
    np.testing.assert_allclose(motion.values, [[0.3, np.pi / 2], [0.4, np.pi]])


@pytest.mark.parametrize("degrees", [True, False])
def test_a_motion_survives_the_table(degrees):
    motion = Motion(
        np.arange(5) / 10, ("angle", "reach"), np.random.default_rng(0).normal(size=(5, 2))
    )
    table = table_from_motion(motion, two_joints(), degrees)
    back = motion_from_table(table, two_joints())
    np.testing.assert_allclose(back["angle"], motion["angle"], rtol=1e-14)
    np.testing.assert_allclose(back["reach"], motion["reach"], rtol=1e-14)


def test_a_table_of_another_model_is_named():
    table = Table(np.zeros(1), ("hip",), np.zeros((1, 1)))
    with pytest.raises(BadData, match=r"'hip'.*'reach'"):
        motion_from_table(table, two_joints())


def test_tabs_and_blanks_mixed_are_cells_as_storage_reads_them(tmp_path):
    path = tmp_path / "mixed.sto"
    path.write_text(
        "mixed\nnRows=3\nnColumns=4\nendheader\n\t\ntime\tone   two\tthree\n"
        "0.0\t1.0  2.0\t3.0\n0.1   1.5\t2.5  3.5\n0.2 1.75\t2.75\t\t3.75\n",
        encoding="utf-8",
    )
    table = read_sto(path)
    assert table.names == ("one", "two", "three")
    np.testing.assert_array_equal(table.time, [0.0, 0.1, 0.2])
    np.testing.assert_array_equal(table["two"], [2.0, 2.5, 2.75])
    assert table.warnings == ()
