"""Tables of marked contacts: spans, events, frames of a camera, and rows that are wrong."""

from __future__ import annotations

import pytest

from myomorph.core.io.contact_events import read_events
from myomorph.core.model.contacts import FOREVER
from myomorph.core.model.errors import BadFile


def written(folder, text):
    path = folder / "events.csv"
    path.write_text(text)
    return path


def test_spans(tmp_path):
    text = (
        "# tap dance\nsite,start,stop,surface,confidence\n"
        "heel_r,0.10,0.25,,0.5\ntoe_r,0.05,0.2,ground,\n"
    )
    found = read_events(written(tmp_path, text), start=1.0)
    assert found.sites == ("heel_r", "toe_r")
    assert [(one.site, one.start, one.stop, one.confidence) for one in found.intervals] == [
        ("toe_r", 1.05, 1.2, 1.0),
        ("heel_r", 1.1, 1.25, 0.5),
    ]
    assert {one.source for one in found.intervals} == {"camera"}
    assert {one.surface for one in found.intervals} == {"ground"}


@pytest.mark.parametrize("rate", [300.0, 600.0])
def test_frames_of_a_camera_are_times(tmp_path, rate):
    """The same touch, told by frames and by times, is the same; a semicolon may separate."""
    text = f"frame;site;event\n{0.5 * rate:.0f};heel_r;touch\n{0.7 * rate:.0f};heel_r;leave\n"
    (touch,) = read_events(written(tmp_path, text), rate=rate, start=-0.2).intervals
    assert (touch.start, touch.stop) == pytest.approx((0.3, 0.5))
    spans = f"site,first_frame,last_frame\nheel_r,{0.5 * rate:.0f},{0.7 * rate:.0f}\n"
    (other,) = read_events(written(tmp_path, spans), rate=rate, start=-0.2).intervals
    assert (other.start, other.stop) == pytest.approx((touch.start, touch.stop))


def test_events_are_paired_site_by_site(tmp_path):
    rows = (
        "0.0,a,touch",
        "0.1,b,on",
        "0.2,a,leave",
        "0.2,a,touch",
        "0.3,b,off",
        "0.4,a,off",
        "0.5,c,touch",
        "0.6,a,touch",
        "0.7,a,leave",
    )
    text = "\n".join(("time,site,event", *rows))
    found = read_events(written(tmp_path, text))
    assert [(one.start, one.stop) for one in found.of("a")] == [(0.0, 0.2), (0.2, 0.4), (0.6, 0.7)]
    assert [(one.start, one.stop) for one in found.of("c")] == [(0.5, FOREVER)]
    assert "never leaves" in found.warnings[0]


def test_a_span_without_an_end_goes_on(tmp_path):
    found = read_events(written(tmp_path, "site,start,stop\nfoot_l,0.5,\n"))
    assert [(one.start, one.stop) for one in found.of("foot_l")] == [(0.5, FOREVER)]


def test_spans_that_overlap_are_told(tmp_path):
    found = read_events(written(tmp_path, "site,start,stop\na,0,1\na,0.5,2\n"))
    assert "again from 0.5 s" in found.warnings[0]


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("", "is empty"),
        ("# only a remark\n", "no table"),
        ("site,begin,end\na,0,1\n", "expected columns site,start,stop"),
        ("site,start,stop\na,0\n", "line 2 has 2 cells"),
        ("site,start,stop\na,0,one\n", "line 2: 'one' is no number for stop"),
        ("site,start,stop\na,2,1\n", "line 2: site 'a' touches from 2 to 1"),
        ("site,start,stop,confidence\na,0,1,7\n", "confidence 7"),
        ("site,start,stop\n,0,1\n", "names no site"),
        ("site,start,stop\na,0,nan\n", "stop is nan"),
        ("time,site,event\n0,a,tuch\n", "event 'tuch'; expected touch or leave"),
        ("time,site,event\n0,a,leave\n", "line 2: 'a' leaves, but did not touch"),
        (
            "time,site,event\n0,a,touch\n1,a,touch\n",
            "line 3: 'a' touches again, but never left since line 2",
        ),
        ("frame,site,event\n0,a,touch\n", "rate is not known"),
        ("time,frame,site,event\n0,0,a,touch\n", "has the columns"),
    ],
)
def test_bad_tables_are_refused_by_line(tmp_path, text, message):
    with pytest.raises(BadFile, match=message):
        read_events(written(tmp_path, text))


@pytest.mark.parametrize("encoding", ["utf-8", "utf-8-sig", "latin-1", "utf-16"])
def test_tables_as_spreadsheets_save_them(tmp_path, encoding):
    path = tmp_path / "events.csv"
    path.write_bytes("site;start;stop\r\nFuß_r;0,1;0,25\r\n".encode(encoding))
    (touch,) = read_events(path).intervals
    assert (touch.site, touch.start, touch.stop) == ("Fuß_r", 0.1, 0.25)


def test_what_is_no_text_is_refused(tmp_path):
    path = tmp_path / "events.csv"
    path.write_bytes(b"\xff\xfe\x00\x81")
    with pytest.raises(BadFile):
        read_events(path)
    with pytest.raises(BadFile):
        read_events(tmp_path / "absent.csv")
