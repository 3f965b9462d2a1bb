import re
from dataclasses import replace

import numpy as np
import pytest
from lxml import etree, html
from tests.walker import having, shown

from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.series import Emg, Event, Series, Wrenches
from myomorph.lab.report.page.parts import Note
from myomorph.lab.report.trial.report_input import ReportInput, Truth
from myomorph.lab.report.trial.trial_page import report_page
from walker import everything


def parsed(given: ReportInput) -> html.HtmlElement:
    text = report_page(given)
    return html.document_fromstring(text.encode("utf-8"), parser=html.HTMLParser(encoding="utf-8"))


@pytest.fixture(scope="module")
def page() -> html.HtmlElement:
    return parsed(everything())


def keys(page: html.HtmlElement) -> set[str]:
    return set(page.xpath("//main/section/@id"))


def test_it_needs_nothing_else(page: html.HtmlElement) -> None:
    """Nothing is loaded: pictures are inside.

    There is no style, script, font or frame from elsewhere.
    """
    for element in page.iter(etree.Element):
        for name in ("src", "srcset", "href", "data", "poster"):
            value = element.get(name)
            if value is not None and element.tag != "a":
                assert value.startswith("data:image/png;base64,"), (element.tag, value[:80])
    assert not page.xpath("//link | //iframe | //object | //base | //form")
    assert not re.search(r"@import|url\(", "".join(page.xpath("//style/text()")))
    assert not re.search(
        r"fetch\(|XMLHttpRequest|WebSocket|import\(", "".join(page.xpath("//script/text()"))
    )


def test_all_parts_have_their_section(page: html.HtmlElement) -> None:
    analysis = {"analysis", "center-of-gravity", "phases", "correlations"}
    chain = {"markers", "forces", "joints", "activations", "tensions"}
    assert keys(page) == {"verdict", "causes", "body", "made"} | analysis | chain


def test_the_first_lines_say_what_is_made_up(page: html.HtmlElement) -> None:
    verdict = page.xpath("string(//p[contains(@class, 'judgement')])")
    assert "Simulated: nobody was measured." in verdict
    made = page.xpath("//section[@id='made']//li/text()")
    assert any("everything here is made up" in text for text in made)
    assert "Myomorph 1.2.3 · computed 2026-01-02" in page.xpath("string(//header/p)")


def test_sections_are_folded_below_the_answer(page: html.HtmlElement) -> None:
    assert page.xpath("//header//h1")
    sections = page.xpath("//main/section")
    assert all(len(one.xpath("./details[@class='fold']")) == 1 for one in sections)


def test_no_message_is_lost(page: html.HtmlElement) -> None:
    assert page.xpath("//section[@id='causes']//li/text()") == ["one thing was odd"]


def test_drawings_are_well_formed() -> None:
    text = report_page(everything())
    drawings = re.findall(r"<svg.*?</svg>", text, re.DOTALL)
    assert len(drawings) > 15
    for drawing in drawings:
        etree.fromstring(drawing)


def test_the_table_tells_what_was_over(page: html.HtmlElement) -> None:
    rows = {
        row.xpath("string(td[2]/text())"): row
        for row in page.xpath("//table[@class='verdicts']/tbody/tr")
    }
    worst = rows["Marker error, RMS of the worst frame"]
    assert worst.get("class") == "over"
    assert worst.xpath("string(td[3])") == "2.24 cm"
    assert worst.xpath("string(td[4])") == "2.00 cm"
    assert worst.xpath("string(td[7]//a/@href)") == "#ref-hicks2015"
    states = [row.get("class") for row in page.xpath("//table[@class='verdicts']/tbody/tr")]
    assert states == sorted(states, key=["over", "note", "ok"].index)


def test_both_sides_lie_over_each_other(page: html.HtmlElement) -> None:
    drawing = page.xpath("//section[@id='joints']//svg[@aria-label='Knee angle']")[0]
    assert drawing.xpath(".//path[@data-label]/@data-label") == ["right", "left"]
    parts = page.xpath("//section[@id='activations']//svg[@aria-label='Gluteus maximus']")[0]
    assert "2 parts" in parts.xpath("string()")


def test_the_movement_has_its_events(page: html.HtmlElement) -> None:
    captions = page.xpath("//section[@id='body']//figcaption/text()")
    assert [one.split(",")[0] for one in captions] == [
        "Right foot strike",
        "Left foot strike",
        "Right foot off",
        "Left foot off",
    ]


@pytest.mark.parametrize(
    ("without", "gone", "word"),
    [
        (("fit",), {"markers"}, "Marker errors"),
        (("tension",), {"activations", "tensions"}, "Muscle activations"),
        (("wrenches",), set(), "Ground forces"),
        (("model", "fit"), {"body", "joints", "markers"}, "Joint angles"),
        (("torques",), set(), "Joint moments"),
    ],
)
def test_a_part_that_is_missing_is_told(
    without: tuple[str, ...], gone: set[str], word: str
) -> None:
    given = having(everything(40), **dict.fromkeys(without))  # type: ignore[arg-type]
    if "fit" in without and "model" not in without:
        given = having(given, coordinates=everything(40).kinematics.fit.motion)  # type: ignore[union-attr]
    page = parsed(given)
    assert not keys(page) & gone
    assert any(one.startswith(word) for one in page.xpath("//section[@class='absent']//li/text()"))


def test_nothing_at_all_is_still_a_page() -> None:
    page = parsed(shown("empty"))
    assert keys(page) == {"made"}
    assert page.xpath("string(//h1)") == "empty"


def test_what_users_write_stays_text() -> None:
    odd = '<script>alert("x")</script> & "quotes" \u00e9\u6f22'
    given = everything(40)
    body = given.model
    assert body is not None
    renamed = replace(body, name=odd)
    page = parsed(
        having(
            given,
            title=odd,
            model=renamed,
            notes=(Note("real", odd),),
            warnings=(odd,),
            facts=FrozenMap({odd: odd}),
            events=(Event(0.1, odd, "Right"),),
        )
    )
    assert odd in page.xpath("string(//header)")
    assert not [one for one in page.xpath("//script/text()") if one.strip().startswith("alert")]


def test_emg_is_drawn_on_its_muscle_and_never_guessed() -> None:
    given = everything(100)
    assert given.tension is not None
    emg = Emg(
        given.tension.time, ("ch1", "ch2"), np.abs(np.sin(given.tension.time))[:, None] * [1.0, 0.5]
    )
    page = parsed(having(given, emg=emg, emg_muscles=FrozenMap({"ch1": ("recfem_r",)})))
    drawing = page.xpath("//section[@id='activations']//svg[@aria-label='Rectus femoris']")[0]
    assert "EMG right" in drawing.xpath(".//path[@data-label]/@data-label")
    assert page.xpath("//section[@id='emg']//svg/@aria-label") == ["ch2"]
    assert "does not specify their muscles: ch2" in page.xpath("string(//section[@id='emg']//p)")


def test_truth_is_set_beside_the_estimate() -> None:
    given = everything(100)
    assert given.kinematics.fit is not None
    assert given.dynamics.torques is not None
    true = Series(
        given.kinematics.fit.motion.time,
        given.kinematics.fit.motion.names,
        given.kinematics.fit.motion.values + np.deg2rad(2.0),
    )
    page = parsed(having(given, truth=Truth(true, given.dynamics.torques, None)))
    table = page.xpath("//section[@id='truth']//table")[0]
    assert table.xpath("string(tbody/tr[1]/td[2])") == "2.00 °"
    drawing = page.xpath("//section[@id='joints']//svg[@aria-label='Knee angle']")[0]
    assert "right truth" in drawing.xpath(".//path[@data-label]/@data-label")


def test_a_part_of_a_body_is_not_judged_by_its_root() -> None:
    page = parsed(having(everything(100), root_note="The trunk hangs on the root."))
    assert "The trunk hangs on the root." in page.xpath("string(//section[@id='forces'])")
    assert "Residual" not in page.xpath("string(//section[@id='verdict'])")


def test_a_long_recording_stays_a_small_page() -> None:
    given = everything(36000)
    text = report_page(given)
    assert len(text) < 8e6
    assert "of a recording of 360 s" in text


@pytest.mark.filterwarnings("error")
@pytest.mark.parametrize("frames", [1, 2, 3, 100])
def test_short_recordings_make_a_page_without_complaint(frames: int) -> None:
    given = everything(frames)
    given.tension.overstretched = ("recfem_r",)
    page = parsed(given)
    assert {"body", "markers", "joints", "activations", "tensions"} <= keys(page) | (
        {"joints"} if frames == 1 else set()
    )
    assert "recfem_r" in page.xpath("string(//section[@id='verdict'])")


@pytest.mark.filterwarnings("error")
def test_frames_without_a_pose_or_a_solution_are_borne() -> None:
    given = everything(100)
    assert given.kinematics.fit is not None
    values = np.array(given.kinematics.fit.motion.values)
    values[10:20] = np.nan
    hidden = replace(
        given.kinematics.fit,
        motion=replace(given.kinematics.fit.motion, values=values),
        marker_error=np.full((100, 2), np.nan),
    )
    tension = given.tension
    assert tension is not None
    tension.activation[30:] = np.nan
    tension.muscle_force[30:] = np.nan
    assert given.dynamics.wrenches is not None
    lost = Wrenches(
        time=given.dynamics.wrenches.time,
        names=given.dynamics.wrenches.names,
        bodies=given.dynamics.wrenches.bodies,
        forces=np.full((100, 2, 3), np.nan),
        points=given.dynamics.wrenches.points,
        torques=given.dynamics.wrenches.torques,
    )
    page = parsed(having(given, fit=hidden, wrenches=lost))
    assert "joints" in keys(page)
    assert "nan" not in page.xpath("string(//main)").replace("finance", "").lower().split()
