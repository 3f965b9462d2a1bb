"""Landmarks from tables, 3D Slicer, JSON and OpenSim's files.

What is wrong with them is named by its line.
"""

from __future__ import annotations

import json

import numpy as np
import pytest

from myomorph.core.io.formats import read_model
from myomorph.core.io.landmarks import (
    read_body_landmarks,
    read_landmark_pairs,
    read_landmarks,
)
from myomorph.core.io.parsing.door import MAX_SIZES
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.landmarks import LandmarkPairs

HEADER = "body,name,source_x,source_y,source_z,target_x,target_y,target_z"
SLICER = """# Markups fiducial file version = 4.11
# CoordinateSystem = LPS
# columns = id,x,y,z,ow,ox,oy,oz,vis,sel,lock,label,desc,associatedNodeID
1,10.5,-20,30,0,0,0,1,1,1,0,head,,
2,1,2,3,0,0,0,1,1,1,0,epicondyle,,
"""


def written(tmp_path, text: str, name: str = "L.csv"):
    path = tmp_path / name
    path.write_text(text)
    return path


def test_pairs_by_body(tmp_path):
    rows = (
        "femur_r,head,0,0,0,0.1,0.2,0.3",
        "tibia_r,tip,1,2,3,4,5,6",
        'femur_r,"condyle, medial",0,-0.4,0,0,-0.5,0',
    )
    text = "\n".join((HEADER, *rows, ""))
    found = read_landmark_pairs(written(tmp_path, text))
    assert list(found) == ["femur_r", "tibia_r"]
    assert found["femur_r"].names == ("head", "condyle, medial")
    np.testing.assert_array_equal(found["femur_r"].source, [[0, 0, 0], [0, -0.4, 0]])
    np.testing.assert_array_equal(found["femur_r"].target, [[0.1, 0.2, 0.3], [0, -0.5, 0]])


def test_columns_in_any_order_case_and_unit(tmp_path):
    text = (
        "Target_X [mm];Target_Y [mm];target_z_mm;NAME;Body;source_x (cm);source_y;source_z;seen"
        " by\n100;200;-3,5;head;femur_r;10;0,2;0.3;A\n"
    )
    found = read_landmark_pairs(written(tmp_path, text))["femur_r"]
    np.testing.assert_allclose(found.source, [[0.1, 0.2, 0.3]])
    np.testing.assert_allclose(found.target, [[0.1, 0.2, -0.0035]])


@pytest.mark.parametrize(
    ("rows", "told"),
    [
        (
            "femur_r,head,0,0,0,,,",
            "line 2 has no target point of 'head' of 'femur_r'; give it, or leave the line out",
        ),
        ("femur_r,head,0,0,,1,1,1", "line 2 has no finite source point"),
        ("femur_r,head,0,0,inf,1,1,1", "line 2 has no finite source point"),
        ("femur_r,head,0,zero,0,1,1,1", "line 2 has 'zero' for source_y of 'head' of 'femur_r'"),
        (
            "femur_r,a,0,0,0,1,1,1\nfemur_r,a,0,0,1,1,1,1",
            "line 3 names landmark 'a' of 'femur_r' again",
        ),
        ("femur_r,,0,0,0,1,1,1", "line 2 has no name"),
        (",head,0,0,0,1,1,1", "line 2 has no body"),
        ("femur_r,a,0,0,0,,,\nfemur_r,b,0,0,1,,,", r"\(1 more lines are wrong too\)"),
        (
            "femur_r,a,0,5,0,5,0,0,1,1,1",
            "line 2 has 11 cells, but the header 8; is a decimal comma",
        ),
        ("", "has a header, but no landmark"),
    ],
)
def test_what_is_wrong_with_a_line_is_told(tmp_path, rows, told):
    with pytest.raises(BadFile, match=told):
        read_landmark_pairs(written(tmp_path, f"{HEADER}\n{rows}\n"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        (
            "body,name,source_x,source_y,source_z\nf,a,0,0,0\n",
            "has no column 'target_x', 'target_y', 'target_z'",
        ),
        (HEADER + ",name\n", "has the column 'name' twice"),
        ("", "is empty"),
        ("# nothing\n", "has no header"),
        ("solid\0\0\0\1", "is a binary file"),
        (f"{HEADER}\n{'a' * 200_000},head,0,0,0,1,1,1\n", "is no table of landmarks"),
        (f"{HEADER.replace('target_z', '_' * 100_000)}\n", "has no column 'target_z'"),
    ],
)
def test_what_is_wrong_with_a_table_is_told(tmp_path, text, told):
    with pytest.raises(BadFile, match=told):
        read_landmark_pairs(written(tmp_path, text))


def test_absent_and_endless_files(tmp_path):
    with pytest.raises(BadFile, match="no such file"):
        read_landmark_pairs(tmp_path / "L.csv")
    path = tmp_path / "L.csv"
    with path.open("wb") as stream:
        stream.truncate(MAX_SIZES["landmarks"] + 1)
    with pytest.raises(BadFile, match="more than the 64 MiB"):
        read_landmark_pairs(path)
    with pytest.raises(BadFile, match=r"ends in '\.stl'; expected \.csv"):
        read_landmarks(tmp_path / "bone.stl")


def test_pairs_are_checked_as_a_value():
    with pytest.raises(BadData, match="'a' is specified twice"):
        LandmarkPairs(("a", "a"), np.zeros((2, 3)), np.zeros((2, 3)))
    with pytest.raises(BadData, match="as many finite points as target"):
        LandmarkPairs(("a",), np.zeros((1, 3)), np.full((1, 3), np.nan))


def test_slicer_s_tables_are_in_millimeters(tmp_path):
    found = read_landmarks(written(tmp_path, SLICER, "F.fcsv"))
    assert list(found) == ["head", "epicondyle"]
    np.testing.assert_allclose(found["head"], [0.0105, -0.02, 0.03])


def markups(**extra) -> str:
    point = {"label": "head", "position": [10.0, 20.0, 30.0], "positionStatus": "defined"}
    return json.dumps(
        {
            "markups": [
                {"type": "Fiducial", "controlPoints": [point | extra.pop("point", {})], **extra}
            ]
        }
    )


def test_slicer_s_markups(tmp_path):
    found = read_landmarks(written(tmp_path, markups(coordinateSystem="LPS"), "F.mrk.json"))
    np.testing.assert_allclose(found["head"], [0.01, 0.02, 0.03])
    found = read_landmarks(written(tmp_path, markups(coordinateUnits="m"), "F.json"))
    np.testing.assert_allclose(found["head"], [10, 20, 30])
    with pytest.raises(BadFile, match="has coordinates in 'furlong'"):
        read_landmarks(written(tmp_path, markups(coordinateUnits="furlong"), "F.json"))
    with pytest.raises(BadFile, match="point 'head' has no place yet"):
        read_landmarks(written(tmp_path, markups(point={"positionStatus": "undefined"}), "F.json"))


@pytest.mark.parametrize(
    ("text", "told"),
    [
        ('{"a": [0, 0, 0], "a": [1, 1, 1]}', "names 'a' twice"),
        ('{"a": [0, 0]}', r"landmark 'a' is \[0, 0\]"),
        ('{"a": [0, 0, NaN]}', "landmark 'a' is"),
        (f'{{"a": [0, 0, 1{"0" * 400}]}}', "landmark 'a' is"),
        ('{"a": [true, 0, 0]}', "landmark 'a' is"),
        ('{"a": "here"}', "landmark 'a' is here"),
        ('{"units": "ell", "a": [0, 0, 0]}', "has units 'ell'"),
        ('{"landmarks": [0, 0, 0]}', "'landmarks' are no table"),
        ('{"markups": [{"controlPoints": 5}]}', "no list"),
        ("[1, 2]", "holds no object of landmarks"),
        ('{"a": [0, 0, 0', "is not JSON"),
        ("[" * 100_000, "is not JSON"),
        ("{}", "holds no landmarks"),
    ],
)
def test_what_is_wrong_with_json_is_told(tmp_path, text, told):
    with pytest.raises(BadFile, match=told):
        read_landmarks(written(tmp_path, text, "L.json"))


def test_many_landmarks_are_read_at_once(tmp_path):
    text = json.dumps({f"p{k}": [0, 0, 0] for k in range(50_000)})
    assert len(read_landmarks(written(tmp_path, text, "L.json"))) == 50_000


def test_plain_json_with_bodies_and_units(tmp_path):
    path = written(
        tmp_path,
        '{"units": "mm", "landmarks": {"femur_r": {"head": [1, 2, 3]}, "top": [4, 5, 6]}}',
        "L.json",
    )
    found = read_body_landmarks(path)
    np.testing.assert_allclose(found["femur_r"]["head"], [0.001, 0.002, 0.003])
    np.testing.assert_allclose(found[""]["top"], [0.004, 0.005, 0.006])
    with pytest.raises(BadFile, match="landmarks of 2 bodies; say which: '', 'femur_r'"):
        read_landmarks(path)
    with pytest.raises(UnknownName, match="unknown body 'tibia_r'"):
        read_landmarks(path, "tibia_r")


def test_tables_of_real_bones(data):
    ours = read_landmarks(data("bones-landmarks-leg/Geometry/femur_r_warp.landmarks.csv"))
    theirs = read_landmarks(data("bones-landmarks-leg/Geometry/subject_femur_r.landmarks.csv"))
    assert set(ours) == set(theirs)
    assert len(ours) == 20
    np.testing.assert_array_equal(ours["landmark_10"], [0.485162, -0.008192, 0.146533])


def test_markers_and_stations_of_a_model(data):
    path = data("bones-landmarks-leg/make-a-leg_final.osim")
    found = read_body_landmarks(path)
    table = read_landmarks(data("bones-landmarks-leg/Geometry/femur_r.landmarks.csv"))
    assert set(found) == {"pelvis", "femur_r", "tibia_r"}
    shared = set(table) & set(found["femur_r"])
    assert len(shared) == 9
    for name in shared:
        np.testing.assert_allclose(found["femur_r"][name], table[name], atol=1e-6)


def test_markers_agree_with_the_model_s_reader(data):
    path = data("rajagopal-walk-emg/subject_walk_scaled.osim")
    found = read_body_landmarks(path)
    for marker in read_model(path).markers:
        np.testing.assert_array_equal(found[marker.body][marker.name], marker.location)


def test_a_marker_set_and_entities(data, tmp_path):
    found = read_body_landmarks(data("lenhart-knee-contact-walk/lenhart2015_markers.xml"))
    assert sum(len(one) for one in found.values()) == 39
    bomb = (
        '<?xml version="1.0"?><!DOCTYPE x [<!ENTITY a "aaaa">]><OpenSimDocument Version="40000"/>'
    )
    with pytest.raises(BadFile, match="declares XML entities"):
        read_landmarks(written(tmp_path, bomb, "m.xml"))
