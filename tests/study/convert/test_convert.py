"""A recording in other files is the same recording, to the digits that files hold."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.c3d.read import read_c3d
from myomorph.core.io.loads import read_external_loads
from myomorph.core.io.sto import read_sto
from myomorph.core.io.trc import read_trc
from myomorph.core.model.errors import BadData, BadFile
from myomorph.core.model.series import Z_UP_TO_Y_UP, Markers
from myomorph.lab.convert.axes import axes_of_text, turned
from myomorph.lab.convert.convert import ConvertOptions, convert, side_of
from myomorph.lab.convert.recording import Recording, read_parts
from myomorph.lab.study.inputs.plate_wrenches import recorded_wrenches
from myomorph.lab.study.inputs.reading import read_recording

WALKS = ("knee-implant-walk/walk1.c3d", "c3d-gait-plugingait/HC002D/Straight/HC002D06.c3d")


def about_origin(wrenches):
    """Force and moment about the origin (samples, 6) of all wrenches together."""
    moment = np.nan_to_num(wrenches.torques) + np.cross(
        np.nan_to_num(wrenches.points), wrenches.forces
    )
    return np.hstack([wrenches.forces.sum(axis=1), moment.sum(axis=1)])


@pytest.fixture(scope="module", params=WALKS)
def walk(request, data, tmp_path_factory):
    """Return a C3D file, what it holds with y up, and the folder it was converted to."""
    path = data(request.param)
    out = tmp_path_factory.mktemp("converted") / "walk"
    made = convert([path], out)
    return path, read_recording(path).rotated(Z_UP_TO_Y_UP), out, made


def test_markers_and_forces_in_opensims_files(walk):
    path, trial, out, _ = walk
    markers = read_trc(out / f"{path.stem}.trc").markers
    assert markers.names == trial.markers.names
    np.testing.assert_allclose(markers.time, trial.markers.time, atol=1e-9)
    np.testing.assert_allclose(markers.values, trial.markers.values, atol=1e-9)
    loads = read_external_loads(out / f"{path.stem}_grf.xml")
    assert set(loads.bodies) == {"calcn_r", "calcn_l"}
    whole = recorded_wrenches(trial)
    np.testing.assert_allclose(loads.time, whole.time, atol=1e-9)
    np.testing.assert_allclose(about_origin(loads), about_origin(whole), atol=1e-5)


def test_emg_keeps_its_values_and_clock(walk):
    path, trial, out, _ = walk
    table = read_sto(out / f"{path.stem}_emg.sto")
    np.testing.assert_allclose(table.time, trial.analog.time, atol=1e-9)
    for name in table.names:
        np.testing.assert_allclose(table[name], trial.analog[name], rtol=1e-9, atol=1e-15)


def test_back_to_c3d(walk, tmp_path):
    """TRC, MOT and STO to one C3D file.

    Markers and EMG are as they were, and the wrenches of each plate are the same.
    """
    path, trial, out, _ = walk
    parts = [out / f"{path.stem}{one}" for one in (".trc", "_grf.mot", "_emg.sto")]
    convert(parts, tmp_path / "back.c3d")
    again = read_recording(tmp_path / "back.c3d")
    assert again.markers.names == trial.markers.names
    np.testing.assert_allclose(again.markers.values, trial.markers.values, atol=1e-6)
    emg = read_sto(out / f"{path.stem}_emg.sto")
    for name in emg.names:
        np.testing.assert_allclose(again.analog[name], emg[name], rtol=1e-6, atol=1e-10)
    expected = recorded_wrenches(trial)
    found = recorded_wrenches(again)
    # What lies below the threshold of load is left out of both; the edges of loading may differ by
    # a sample.
    firm = (np.linalg.norm(expected.forces, axis=2) > 50.0) & (
        np.linalg.norm(found.forces, axis=2) > 50.0
    )
    assert firm.sum() > 0.9 * (np.linalg.norm(expected.forces, axis=2) > 50.0).sum()
    np.testing.assert_allclose(found.forces[firm], expected.forces[firm], atol=1e-3)
    np.testing.assert_allclose(found.points[firm], expected.points[firm], atol=1e-5)
    np.testing.assert_allclose(found.torques[firm], expected.torques[firm], atol=1e-3)


def test_c3d_to_c3d_is_exact(walk, tmp_path):
    path, _, _, _ = walk
    convert([path], tmp_path / "same.c3d")
    one = read_c3d(path)
    other = read_c3d(tmp_path / "same.c3d")
    np.testing.assert_allclose(other.markers.values, one.markers.values, rtol=1e-6, atol=1e-7)
    for a, b in zip(one.plate_recordings, other.plate_recordings, strict=True):
        np.testing.assert_allclose(b.channels, a.channels, rtol=1e-5, atol=1e-4)
        np.testing.assert_allclose(b.corners, a.corners, atol=1e-6)
    assert other.events == one.events


def test_units_names_and_time(walk, tmp_path):
    path, trial, _, _ = walk
    first, second = trial.markers.names[:2]
    start = float(trial.markers.time[10])
    options = ConvertOptions(
        units="m", labels={first: "renamed", second: ""}, time=(start, start + 0.3)
    )
    convert([path], tmp_path / "some.trc", options)
    text = (tmp_path / "some.trc").read_text()
    assert "\tm\t" in text.splitlines()[2]
    markers = read_trc(tmp_path / "some.trc").markers
    assert markers.names[0] == "renamed"
    assert second not in markers.names
    np.testing.assert_allclose(markers.time[[0, -1]], [start, start + 0.3], atol=0.011)
    np.testing.assert_allclose(markers["renamed"][0], trial.markers[first][10], atol=1e-9)


def test_the_walk_goes_where_it_is_told(data):
    """All four directions are reached, by rotations about the vertical that keep distances."""
    found = read_parts([data("c3d-gait-plugingait/HC002D/Straight/HC002D06.c3d")])
    for forward in ("x", "-x", "z", "-z"):
        made = turned(found, "y", forward, "")
        middle = np.nanmean(made.markers.values, axis=1)
        way = middle[-1] - middle[0]
        assert way @ (
            np.eye(3)["xyz".index(forward[-1])] * (-1 if forward[0] == "-" else 1)
        ) > 0.7 * np.linalg.norm(way)
        assert np.nanmax(made.markers.values[..., 1]) > 1.2
        forces = made.wrenches.forces.sum(axis=1)
        assert forces[:, 1].mean() > 100.0
        np.testing.assert_allclose(
            np.linalg.norm(made.markers.values[:, 0] - made.markers.values[:, 5], axis=1),
            np.linalg.norm(found.markers.values[:, 0] - found.markers.values[:, 5], axis=1),
        )


def test_axes_as_text():
    np.testing.assert_array_equal(axes_of_text("x,z,-y"), Z_UP_TO_Y_UP)
    for wrong, why in (
        ("x,y", "three axes"),
        ("x,x,z", "twice"),
        ("x,z,y", "left-handed"),
        ("a,b,c", "three axes"),
    ):
        with pytest.raises(BadData, match=why):
            axes_of_text(wrong)


def test_what_cannot_be_converted_is_named(data, tmp_path):
    walk = data("knee-implant-walk/walk1.c3d")
    table = data("rajagopal-walk-emg/grf_walk.mot")
    for paths, out, why in (
        ([], "x.trc", "no file"),
        ([walk], "x.doc", "its name ends in"),
        ([table], "x.trc", "no markers"),
        ([table], "x.c3d", "needs markers"),
        ([walk, walk], "x.trc", "second file with markers"),
        ([data("rajagopal-walk-emg/markers_walk.trc")], "x.mot", "no forces"),
    ):
        with pytest.raises((BadData, BadFile), match=why):
            convert(paths, tmp_path / out)
    with pytest.raises(BadData, match="none of the 1 labels"):
        convert([walk], tmp_path / "x.trc", ConvertOptions(labels={"nothing": "x"}))
    with pytest.raises(BadData, match="moves by"):
        turned(Recording("x", Markers(np.arange(9.0), ("a", "b"), _standing())), "keep", "x", "")


def _standing():
    values = np.zeros((9, 2, 3))
    values[:, 1, 1] = 1.5
    return values


def test_bodies_of_plates_by_name(data, tmp_path):
    made = convert(
        [data("knee-implant-walk/walk1.c3d")],
        tmp_path / "walk",
        ConvertOptions(plates=("calcn_l", "", "toes_r")),
    )
    loads = read_external_loads(tmp_path / "walk" / "walk1_grf.xml")
    assert loads.bodies == ("calcn_l", "toes_r")
    assert {path.suffix for path, _ in made.files} >= {".trc", ".mot", ".xml", ".sto"}


@pytest.mark.parametrize(
    ("name", "side"),
    [
        ("RHEE", "right"),
        ("LTOE", "left"),
        ("RHeel", "right"),
        ("L_heel", "left"),
        ("r_calc", "right"),
        ("heel", ""),
    ],
)
def test_sides_of_foot_markers(name, side):
    assert side_of(name) == side
