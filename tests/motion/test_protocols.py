"""Marker protocols found from labels."""

from __future__ import annotations

import pytest

from myomorph.core.model.errors import BadData
from myomorph.core.motion.protocols import (
    find_protocol,
    labels_between,
    protocol_table,
    protocols,
    recognize,
)


@pytest.mark.parametrize("name", list(protocols().protocols))
def test_a_recording_with_all_labels_of_a_protocol_follows_it(name: str) -> None:
    protocol = protocols().protocols[name]
    found = find_protocol(protocol.labels)
    assert found is not None
    assert set(protocol.labels.values()) <= set(found.labels.values())


def test_case_and_the_name_of_the_subject_do_not_count() -> None:
    labels = [f"Anna:{one.lower()}" for one in protocols().protocols["ior"].labels]
    found = find_protocol(labels)
    assert found is not None
    assert found.name == "ior"


def test_medial_markers_tell_cgm2_from_plug_in_gait() -> None:
    labels = list(protocols().protocols["plug_in_gait"].labels)
    assert find_protocol(labels).name == "plug_in_gait"  # type: ignore[union-attr]
    assert find_protocol([*labels, "LKNM", "RKNM", "LMED", "RMED"]).name == "cgm2"  # type: ignore[union-attr]


def test_root_tells_halpe_from_body_25b() -> None:
    limbs = [
        f"{side}{part}" for side in "RL" for part in ("Hip", "Knee", "Ankle", "BigToe", "Heel")
    ]
    assert find_protocol(["Hip", *limbs]).name == "halpe_26"  # type: ignore[union-attr]
    assert find_protocol(["CHip", *limbs]).name == "body_25b"  # type: ignore[union-attr]


def test_no_protocol_of_unknown_labels() -> None:
    assert find_protocol(["*1", "*2", "ball", "wand1", "wand2", "wand3", "rim"]) is None
    assert recognize(["*1", "ball"]).unknown == ("*1", "ball")


def test_two_labels_never_lie_on_one_bony_landmark() -> None:
    found = recognize(["LASI", "RASI", "L.ASIS", "LPSI", "RPSI", "LKNE", "LANK", "RKNE"])
    assert "L.ASIS" not in found.sites
    assert found.unknown == ("L.ASIS",)


def test_labels_between_protocols_keep_landmark_and_side() -> None:
    one = protocols().protocols["plug_in_gait"].labels
    other = protocols().protocols["gait2392"].labels
    found = labels_between(one, other)
    assert found["LASI"] == "L.ASIS"
    assert found["RHEE"] == "R.Heel"
    assert "RTHI" not in found
    for label, marker in found.items():
        assert one[label] == other[marker]


def test_a_table_of_the_user_adds_a_protocol_and_a_landmark() -> None:
    text = """
    [landmarks.thigh]
    adductor = "adductor tubercle"
    [protocols.ours]
    title = "Our laboratory"
    also = ["plug_in_gait"]
    [protocols.ours.labels]
    "#ADD" = "thigh.adductor"
    LKNE = ""
    "#TIB" = ""
    """
    table = protocol_table(text, "ours.toml", protocols())
    ours = table.protocols["ours"]
    assert ours.site("x:radd").landmark == "adductor tubercle"  # type: ignore[union-attr]
    assert ours.site("LKNE") is None
    assert ours.site("RKNE") is not None
    assert ours.site("LTIB") is ours.site("RTIB") is None


def test_a_table_has_letters_of_its_own_for_sides() -> None:
    text = """
    [protocols.french]
    sides = { D = "right", G = "left" }
    [protocols.french.labels]
    "EAS#" = "pelvis.asis"
    """
    french = protocol_table(text, "french.toml", protocols()).protocols["french"]
    assert [french.site(label).side for label in ("EASD", "easg")] == ["right", "left"]  # type: ignore[union-attr]
    assert french.site("EASR") is None


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("[protocols.a]\nsides = { D = 'droit' }", "'sides' of 'right' and 'left'"),
        ("[protocol]", "unknown table 'protocol'"),
        ("[protocols.a.labels]\nx = 'pelvis.asi'", "unknown landmark 'pelvis.asi'"),
        ("[protocols.a]\nalso = ['b']", "unknown protocol 'b'"),
        (
            "[protocols.a.labels]\n'#ASI' = 'pelvis.asis'\nRASI = 'pelvis.asis'",
            "'RASI' is given twice",
        ),
        ("[", "is not TOML"),
    ],
)
def test_a_wrong_table_is_refused(text: str, message: str) -> None:
    with pytest.raises(BadData, match=message):
        protocol_table(text, "ours.toml", protocols())
