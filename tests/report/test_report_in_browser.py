"""The report in a real browser: it opens without errors.

Its rows are read at one time and saved as one drawing.
"""

from __future__ import annotations

from collections.abc import Iterator
from pathlib import Path

import pytest
from lxml import etree

from browser import Browser, browser_program
from myomorph.lab.report.trial.trial_page import report_page
from odd_names import MARKUP, RAN, odd_report
from walker import everything


@pytest.fixture(scope="module")
def browser(tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    program = browser_program()
    if program is None:
        pytest.skip(
            "needs a browser: no Chromium on the path, and MYOMORPH_BROWSER does not name one"
        )
    pytest.importorskip("websockets")
    folder: Path = tmp_path_factory.mktemp("page")
    (folder / "report.html").write_text(report_page(everything(100)), encoding="utf-8")
    with Browser(program=program, folder=folder / "profile", width=1300, height=900) as opened:
        opened.open((folder / "report.html").as_uri())
        opened.until("document.querySelectorAll('#analysis figure .save').length === 1")
        opened.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
        yield opened


def test_every_row_is_read_at_the_same_time(browser: Browser) -> None:
    browser.run(
        "document.querySelector('#analysis svg.track').scrollIntoView({ block: 'center', behavior:"
        " 'instant' })"
    )
    box = browser.run(
        "(() => { const b = document.querySelector('#analysis svg.track').getBoundingClientRect();"
        " return [b.left, b.top, b.width, b.height]; })()"
    )
    x = box[0] + 0.6 * box[2]
    y = box[1] + 0.5 * box[3]
    browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    text = browser.until("document.querySelector('.reading:not([hidden])')?.innerText")
    assert "height:" in text
    marks = (
        "[...document.querySelectorAll('#analysis svg.track .cursor')].map(one =>"
        " one.getAttribute('d'))"
    )
    browser.until(f"{marks}.filter(Boolean).length > 3")
    places = {one.split("V")[0].split()[0] for one in browser.run(marks) if one}
    assert len(places) == 1, "one time, one place in all rows"


def test_the_rows_of_a_figure_are_saved_as_one_drawing(browser: Browser) -> None:
    browser.run(
        "URL.createObjectURL = (blob) => { window.saved = blob; return '#'; };"
        "HTMLAnchorElement.prototype.click = function () { window.savedAs = this.download; };"
        "document.querySelector('#analysis figure .save').click()"
    )
    drawing = etree.fromstring(browser.run("window.saved.text()").encode("utf-8"))
    parts = drawing.findall("{http://www.w3.org/2000/svg}svg")
    assert (
        len(parts) == browser.run("document.querySelectorAll('#analysis figure > svg').length") > 5
    )
    tops = [float(one.get("y")) for one in parts]
    heights = [float(one.get("height")) for one in parts]
    assert tops == pytest.approx([sum(heights[:i]) for i in range(len(parts))])
    assert drawing.get("viewBox").split()[2:] == ["1040", f"{sum(heights):g}"]
    assert browser.run("window.savedAs").endswith(".svg")


def test_the_skeleton_plays(browser: Browser) -> None:
    assert browser.run("document.querySelector('.player').hidden") is False
    names = browser.run("[...document.querySelectorAll('[id]')].map(one => one.id)")
    assert len(names) == len(set(names)), "an anchor must not be the name of the skeleton's data"


def test_names_that_hold_markup_are_texts(browser: Browser, tmp_path: Path) -> None:
    """In the page, and in what is read beside the pointer."""
    path = tmp_path / "odd.html"
    path.write_text(report_page(odd_report()), encoding="utf-8")
    with_errors = len(browser.errors)
    home = browser.run("location.href")
    browser.open(path.as_uri())
    browser.until(f"document.body.innerText.includes({MARKUP[0]!r})")
    browser.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")
    tracks = browser.run("document.querySelectorAll('figure svg').length")
    for index in range(tracks):
        x, y = browser.run(
            f"(() => {{ const svg = document.querySelectorAll('figure svg')[{index}];"
            " svg.scrollIntoView({ block: 'center', behavior: 'instant' });"
            " const box = svg.getBoundingClientRect();"
            " return [box.left + box.width / 2, box.top + box.height / 2]; })()"
        )
        browser.call("Input.dispatchMouseEvent", type="mouseMoved", x=x, y=y)
    assert tracks > 5
    assert not browser.run(RAN)
    assert browser.errors[with_errors:] == []
    browser.open(home)
    browser.until("document.querySelectorAll('#analysis figure .save').length === 1")
    browser.run("document.querySelectorAll('details').forEach(one => { one.open = true; })")


def test_nothing_went_wrong(browser: Browser) -> None:
    assert browser.errors == []


def test_a_narrow_page_needs_no_sideways_scrolling(browser: Browser, tmp_path: Path) -> None:
    """Also where a model has a long name without spaces, which stands above the sentence."""
    given = everything(20)
    long = "Rajagopal_no_arms-scaled_x0.6_knee" * 2
    text = report_page(given).replace(given.head.title, long)
    assert long in text
    (tmp_path / "narrow.html").write_text(text, encoding="utf-8")
    browser.call(
        "Emulation.setDeviceMetricsOverride",
        width=400,
        height=900,
        deviceScaleFactor=1,
        mobile=False,
    )
    browser.open((tmp_path / "narrow.html").as_uri())
    browser.until(
        "document.readyState === 'complete' &&"
        f" document.querySelector('header').textContent.includes('{long}')"
    )
    width = "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    assert browser.run(width) <= 0
