"""The page in a real browser.

It opens, its slider moves the pose, a muscle is found, and nothing goes wrong.
"""

from __future__ import annotations

import socket
import urllib.request
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from PIL import Image
from tests.walker import having

from browser import Browser, browser_program, wait
from myomorph.core.model.errors import BadData
from myomorph.core.model.frozen_map import FrozenMap
from myomorph.core.model.model import Marker
from myomorph.core.model.series import ForcePlate, Markers
from myomorph.lab.report.trial.report_input import ReportInput
from myomorph.lab.uncertainty.spread import Spread, Uncertainty
from myomorph.lab.viewer.replay import Replay
from walker import everything

pytest.importorskip("viser")

WIDTH = 1200
HEIGHT = 640
LEFT = 415
RIGHT = 855
"""Columns of pixels between the panels."""


def walker() -> ReportInput:
    """Return the walker with a marker on a thigh, as recorded a little off, and a plate."""
    given = everything()
    assert given.model is not None
    assert given.kinematics.fit is not None
    time = given.kinematics.fit.motion.time
    recorded = Markers(
        time, ("thigh",), np.stack([1.2 * time, np.full_like(time, 0.8), 0 * time], axis=1)[:, None]
    )
    none = np.zeros((0, 3))
    square = np.array([[0.0, 0.0, 0.0], [0.6, 0.0, 0.0], [0.6, 0.0, 0.4], [0.0, 0.0, 0.4]])
    plate = ForcePlate(name="plate", kind=2, corners=square, forces=none, points=none, torques=none)
    model = replace(given.model, markers=(Marker("thigh", "femur_r", np.array([0.05, -0.1, 0.0])),))
    return having(given, model=model, markers=recorded, plates=(plate,))


def with_limits() -> ReportInput:
    """Return the walker with interval bounds of its tensions."""
    given = walker()
    assert given.tension is not None
    time = given.tension.time
    forces = given.tension.muscle_force
    spread = Spread(
        time=time,
        names=given.tension.muscles,
        low=0.8 * forces,
        high=1.3 * forces,
        deviation=0.1 * forces,
    )
    return replace(given, uncertainty=Uncertainty(FrozenMap({"muscle_force": spread}), draws=20))


@pytest.fixture(scope="module")
def page() -> Iterator[Replay]:
    replay = Replay([{"first": walker, "second": lambda: having(walker(), title="another walk")}])
    yield replay
    replay.close()


@pytest.fixture(scope="module")
def browser(page: Replay, tmp_path_factory: pytest.TempPathFactory) -> Iterator[Browser]:
    program = browser_program()
    if program is None:
        pytest.skip(
            "needs a browser: no Chromium on the path, and MYOMORPH_BROWSER does not name one"
        )
    with Browser(
        program=program, folder=tmp_path_factory.mktemp("profile"), width=WIDTH, height=HEIGHT
    ) as opened:
        # On a busy machine the page would draw fewer pixels, and no picture would come back as it
        # was.
        opened.open(f"{page.address}&fixedDpr=1")
        opened.until("document.body.innerText.includes('Time [s]')")
        opened.until("document.querySelectorAll('.u-over').length >= 4")
        wait(lambda: len(np.unique(_scene(opened).reshape(-1, 3), axis=0)) > 500, 30, "the body")
        opened.run(
            "document.querySelectorAll('.mantine-Notification-closeButton').forEach(one =>"
            " one.click())"
        )
        yield opened


def _scene(browser: Browser) -> np.ndarray:
    """Return the pixels between the panels."""
    return browser.picture()[:, LEFT:RIGHT].astype(int)


def _changed(before: np.ndarray, after: np.ndarray) -> int:
    """How many pixels are not what they were."""
    return int((np.abs(after - before).max(axis=2) > 24).sum())


def _settled(browser: Browser) -> np.ndarray:
    """Return the pixels between the panels once they stay the same."""
    before = _scene(browser)
    for _ in range(60):
        after = _scene(browser)
        if not _changed(before, after):
            return after
        before = after
    raise TimeoutError("the picture does not come to rest")


def _same_again(browser: Browser, before: np.ndarray) -> None:
    """Wait until the picture is what it was before."""
    wait(lambda: _changed(before, _scene(browser)) < 60, 15, "the picture of before")


def _other(browser: Browser, before: np.ndarray, pixels: int = 100) -> None:
    """Wait until so many pixels are not what they were before."""
    wait(lambda: _changed(before, _scene(browser)) > pixels, 15, "another picture")


def focus(browser: Browser, label: str) -> None:
    """Put the cursor into the field with a label, and empty it."""
    told = browser.run(f"""(() => {{
            const labels = [...document.querySelectorAll('label')];
            const label = labels.find(one => one.textContent.trim() === {label!r});
            const field = label.closest('.mantine-Flex-root').querySelector('input');
            field.focus(); field.select(); return true;
        }})()""")
    assert told


def click(browser: Browser, text: str) -> None:
    """Press the button with a text."""
    place = browser.run(f"""(() => {{
            const all = [...document.querySelectorAll('button, label')];
            const button = all.find(one => one.textContent.trim() === {text!r});
            button.scrollIntoView({{block: 'center'}});
            const found = button.getBoundingClientRect();
            return [found.x + found.width / 2, found.y + found.height / 2];
        }})()""")
    browser.click(*place)


def test_the_slider_moves_the_pose(page: Replay, browser: Browser) -> None:
    before = _settled(browser)
    assert page.now == page.span[0]
    browser.run("document.querySelectorAll('[role=slider]')[0].focus()")
    browser.press("End")
    wait(
        lambda: page.now == pytest.approx(page.span[1], abs=2e-3),
        10,
        "the time of the slider's end",
    )
    _other(browser, before, 400)
    browser.press("Home")
    wait(
        lambda: page.now == pytest.approx(page.span[0], abs=2e-3),
        10,
        "the time of the slider's start",
    )
    _same_again(browser, before)


def test_it_plays_and_pauses(page: Replay, browser: Browser) -> None:
    page.seek(page.span[0])
    drawn = page.drawn
    click(browser, "Play")
    wait(lambda: page.playing and page.drawn > drawn + 10, 10, "frames")
    told = (
        "[...document.querySelectorAll('button')].some(one => one.textContent.trim() === 'Pause')"
    )
    browser.until(told)
    click(browser, "Pause")
    wait(lambda: not page.playing, 10, "a pause")
    assert page.span[0] < page.now <= page.span[1]
    browser.until(
        f"Math.abs({page.now:.3f} - document.querySelectorAll('[role=slider]')[0].ariaValueNow) <"
        " 0.05"
    )


def test_a_muscle_is_found_by_typing(page: Replay, browser: Browser) -> None:
    page.seek(0.6)
    before = _settled(browser)
    focus(browser, "Find")
    browser.type("recfem_r")
    browser.until("document.body.innerText.includes('activation')")
    body = page.bodies[0]
    muscle = body.muscles.index("recfem_r")
    wait(lambda: page.found[0] == (muscle,), 10, "the one muscle")
    frame = body.frame_at(0.6)
    row = [
        "recfem_r",
        f"{body.activations[frame, muscle]:.2f}",
        f"{body.tensions[frame, muscle]:.0f} N",
    ]
    rows = (
        "[...document.querySelectorAll('tr')].map(row => [...row.children].map(one =>"
        " one.textContent).join('|'))"
    )
    browser.until(f"{rows}.includes({'|'.join(row)!r})")
    _other(browser, before)
    focus(browser, "Find")
    browser.type("gluteus maximus left")
    wait(lambda: len(page.found[0]) == 2, 10, "both parts of the muscle")
    assert {body.muscles[m] for m in page.found[0]} == {"glmax1_l", "glmax2_l"}
    focus(browser, "Find")
    browser.type("nobody")
    browser.until("document.body.innerText.includes(\"no muscle is called 'nobody'\")")
    focus(browser, "Find")
    browser.press("Backspace")
    wait(lambda: not page.found[0], 10, "no muscle")
    _same_again(browser, before)


def test_a_layer_is_hidden(page: Replay, browser: Browser) -> None:
    page.seek(0.6)
    before = _settled(browser)
    page.toggle("muscles", False)
    _other(browser, before)
    page.toggle("muscles", True)
    _same_again(browser, before)


def test_the_camera_looks_from_where_it_is_told(page: Replay, browser: Browser) -> None:
    page.seek(0.6)
    before = _settled(browser)
    click(browser, "Front")
    _other(browser, before, 300)
    front = _settled(browser)
    click(browser, "Right")
    _other(browser, front, 300)
    click(browser, "Front")
    _same_again(browser, front)


def test_a_picture_is_saved(page: Replay, browser: Browser, tmp_path: Path) -> None:
    browser.call("Browser.setDownloadBehavior", behavior="allow", downloadPath=str(tmp_path))
    page.seek(0.6)
    click(browser, "Save a picture")
    wait(lambda: [one for one in tmp_path.iterdir() if one.suffix == ".png"], 30, "a file")
    (saved,) = tmp_path.iterdir()
    assert saved.name == "walker_first_steps_0.600s.png"
    pixels = np.asarray(Image.open(saved))
    assert pixels.shape[2] == 4
    opaque = (pixels[..., 3] > 200).mean()
    assert 0.001 < opaque < 0.5, "the background is transparent"


def test_another_recording_is_chosen(page: Replay, browser: Browser) -> None:
    page.choose(0, "second")
    browser.until("document.body.innerText.includes('another walk')")
    browser.until("document.querySelectorAll('.u-over').length >= 4")
    assert len(np.unique(_settled(browser).reshape(-1, 3), axis=0)) > 500
    assert page.now == page.span[0]


def test_nothing_went_wrong_and_nothing_left_the_machine(page: Replay, browser: Browser) -> None:
    """After all that was done above."""
    assert browser.errors == []
    asked = browser.run("performance.getEntriesByType('resource').map(one => one.name)")
    assert all(
        one.startswith((f"http://127.0.0.1:{page.port}", "data:", "blob:")) for one in asked
    ), asked


def test_two_bodies_share_a_clock() -> None:
    late = walker()
    assert late.kinematics.fit is not None
    motion = late.kinematics.fit.motion
    moved = replace(motion, time=motion.time + 100.0)
    other = having(
        late,
        title="later",
        fit=replace(late.kinematics.fit, motion=moved),
        markers=None,
        wrenches=None,
        tension=None,
    )
    replay = Replay([{"one": walker}, {"two": lambda: other}])
    try:
        assert replay.span == pytest.approx((0.0, 1.99))
        replay.seek(0.5)
        assert [replay.own_time(i) for i in range(2)] == pytest.approx([0.5, 100.5])
        assert [shown.body.results.head.title for shown in replay.shown] == [
            "walker: first steps",
            "later",
        ]
        assert replay.spacing > 0.3, "bodies in one place begin side by side"
        replay.part(1.5)
        assert replay.shown[1].node.position == pytest.approx(1.5 * replay.bodies[0].scene.right)
    finally:
        replay.close()


def test_it_listens_on_this_machine_and_on_the_port_it_is_given() -> None:
    with socket.socket() as probe:
        probe.bind(("127.0.0.1", 0))
        port = probe.getsockname()[1]
    replay = Replay([{"one": walker}], port)
    try:
        assert replay.port == port
        assert b"<html" in urllib.request.urlopen(replay.address, timeout=10).read()
        own = socket.gethostbyname(socket.gethostname())
        if not own.startswith("127."):
            with socket.socket() as outside:
                outside.settimeout(2)
                assert outside.connect_ex((own, port)) != 0
        with pytest.raises(BadData, match=f"port {port} cannot be used"):
            Replay([{"one": walker}], port)
    finally:
        replay.close()


def test_a_plot_has_its_values_after_every_message(monkeypatch: pytest.MonkeyPatch) -> None:
    """A busy browser draws between any two messages.

    Another that opens the page gets the last of each kind.
    """
    buffers = pytest.importorskip("viser.infra._async_message_buffer")
    push = buffers.AsyncMessageBuffer.push
    plots = {}
    drawn = []
    bands = set()

    def look(buffer: object, message: object) -> None:
        push(buffer, message)
        kind = type(message).__name__
        uuid = getattr(message, "uuid", None)
        if kind == "GuiUplotMessage":
            plots[uuid] = {"series": message.props.series, "data": message.props.data}
            for band in message.props.bands or ():
                assert max(band["series"]) < len(message.props.data) - 1
                bands.add(len(message.props.bands))
        elif kind == "GuiUpdateMessage" and uuid in plots:
            plots[uuid].update(
                {name: one for name, one in message.updates.items() if name in plots[uuid]}
            )
        elif kind == "GuiRemoveMessage":
            plots.pop(uuid, None)
        for one in plots.values():
            drawn.append(len(one["data"]))
            assert len(one["series"]) == len(one["data"])

    monkeypatch.setattr(buffers.AsyncMessageBuffer, "push", look)
    replay = Replay([{"one": with_limits}])
    try:
        for text in ("recfem", "glmax1_l", "nobody", ""):
            replay.panel.find(text)
            replay.seek(0.5)
        assert len(set(drawn)) > 1, "charts of different numbers of curves were shown"
        assert bands >= {1, 2}, "limits of one curve and of two were shown"
    finally:
        replay.close()
