"""Maps of marker labels from files, and what they do to a recording."""

from __future__ import annotations

import numpy as np
import pytest

from myomorph.core.io.labels import read_labels
from myomorph.core.model.errors import BadData, BadFile, UnknownName
from myomorph.core.model.model import Marker, Model
from myomorph.core.model.series import Markers, Trial
from myomorph.lab.study.inputs.reading import check_labels, cut_warning, fitted_to, with_labels

WANTED = {"RASI": "R.ASIS", "LASI": "L.ASIS", "BAD": ""}


@pytest.mark.parametrize(
    ("name", "text"),
    [
        ("a.csv", "RASI,R.ASIS\nLASI,L.ASIS\nBAD,\n"),
        ("b.csv", "# ours\nlabel;marker\nRASI; R.ASIS\n\nLASI;L.ASIS\nBAD;\n"),
        ("c.toml", 'RASI = "R.ASIS"\nLASI = "L.ASIS"\nBAD = ""\n'),
        ("d.toml", '[labels]\nRASI = "R.ASIS"\nLASI = "L.ASIS"\nBAD = ""\n'),
    ],
)
def test_labels_are_read_from_tables_of_both_kinds(tmp_path, name, text):
    path = tmp_path / name
    path.write_text(text)
    assert read_labels(path) == WANTED


@pytest.mark.parametrize(
    ("name", "text", "told"),
    [
        ("a.csv", "RASI,R.ASIS\nRASI,L.ASIS\n", "twice"),
        ("a.csv", "RASI\n", "1 cells"),
        ("a.csv", "# nothing\n", "no label"),
        ("a.toml", "RASI = 3\n", "something else than names"),
        ("a.toml", "RASI\n", "not TOML"),
        ("a.xml", "<a/>", "ends in '.xml'"),
    ],
)
def test_a_wrong_file_is_refused_with_what_is_expected(tmp_path, name, text, told):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(BadFile, match=told):
        read_labels(path)


def trial(*names: str) -> Trial:
    return Trial(
        markers=Markers(
            np.arange(3) / 100.0, names, np.random.default_rng(0).normal(size=(3, len(names), 3))
        )
    )


def test_markers_are_renamed_and_an_empty_name_drops_one():
    given = trial("RASI", "BAD", "LASI", "SACR")
    found = with_labels(given, WANTED).markers
    assert found.names == ("R.ASIS", "L.ASIS", "SACR")
    np.testing.assert_array_equal(found.values, given.markers.values[:, [0, 2, 3]])


def test_two_labels_of_one_name_are_refused_unless_one_is_dropped():
    with pytest.raises(BadData, match="would both be named"):
        with_labels(trial("RASI", "R.ASIS"), {"RASI": "R.ASIS"})
    found = with_labels(trial("RASI", "R.ASIS"), {"RASI": "R.ASIS", "R.ASIS": ""})
    assert found.markers.names == ("R.ASIS",)


def test_a_map_of_which_nothing_was_recorded_is_told():
    found = with_labels(trial("A", "B"), WANTED)
    assert "none of its 3 labels was recorded" in found.warnings[0]


def test_names_that_the_model_lacks_are_refused():
    model = Model(name="empty", bodies=(), joints=(), coordinates=(), gravity=np.zeros(3))
    with pytest.raises(UnknownName, match=r"R\.ASIS"):
        check_labels(WANTED, model)
    check_labels({"BAD": ""}, model)


def test_a_time_beyond_the_recording_says_that_it_is_cut():
    markers = Markers(np.arange(143) / 100.0, ("A",), np.zeros((143, 1, 3)))
    assert cut_warning((0.4, 1.42), markers) == ()
    assert cut_warning((0.0, 1.425), markers) == ()
    (told,) = cut_warning((0.4, 1.6), markers)
    assert "0.4 to 1.42 s are used" in told


@pytest.mark.parametrize(
    ("recorded", "fitted"),
    [
        (("r asis", "sacrum", "r+met"), ("r_asis", "sacrum", "r_met")),
        (("r asis", "r_asis"), ("r asis", "r_asis")),
        (("r asis", "r+asis", "sacrum"), ("r asis", "r+asis", "sacrum")),
    ],
)
def test_a_recorded_label_is_the_marker_that_a_file_writes_for_it(recorded, fitted):
    """OpenSim refuses blanks in names.

    A model made from a recording therefore has other names than the recording.
    """
    markers = tuple(Marker(name, "ground", np.zeros(3)) for name in ("r_asis", "sacrum", "r_met"))
    model = Model(
        name="hip", bodies=(), joints=(), coordinates=(), gravity=np.zeros(3)
    ).with_markers(markers)
    assert fitted_to(model, trial(*recorded)).markers.names == fitted


def test_a_recording_of_which_the_model_has_few_markers_says_so():
    markers = tuple(Marker(name, "ground", np.zeros(3)) for name in "abcd")
    model = Model(
        name="hip", bodies=(), joints=(), coordinates=(), gravity=np.zeros(3)
    ).with_markers(markers)
    (warning,) = fitted_to(model, trial("a", "x", "y", "z")).warnings
    assert (
        "1 of the model's 4 markers were recorded, and 3 labels are not among its markers ('x',"
        " 'y',"
        " 'z')" in warning
    )
    assert not fitted_to(model, trial("a", "b", "y", "z")).warnings


def test_a_cell_without_end_is_named(tmp_path):
    path = tmp_path / "labels.csv"
    path.write_text("LASI,L.ASIS\n" + "a" * 200_000 + ",b\n", encoding="utf-8")
    with pytest.raises(BadFile, match="is no table of labels"):
        read_labels(path)
