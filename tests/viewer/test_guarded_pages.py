"""Pages of this machine in a real browser: who opens them, and names that hold markup.

Each is opened by its address, without the token, with another one, by a name that leads to this
machine, and by a page of another port, which a browser takes for the same site and sends cookies.
"""

from __future__ import annotations

import http.server
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from functools import partial
from pathlib import Path

import numpy as np
import pytest

from browser import Browser, browser_program
from myomorph.lab.viewer.replay import Replay
from myomorph.live.live_page import ChainViewer, Shown
from myomorph.show.app.desk import Desk
from myomorph.show.app.server import AppServer
from odd_names import MARKUP, RAN, odd_model, odd_report

pytest.importorskip("viser")

STRANGER = "evil.example"
HINTS = ("Open the address that the terminal shows", "open the address that 'myomorph app' printed")
"""What a refused request shows."""


@dataclass(frozen=True, kw_only=True)
class Opened:
    """A page that is served.

    Attributes
    ----------
    address : that opens it, with its token
    port : of its server
    text : that it shows
    token : in its address
    """

    address: str
    port: int
    text: str
    token: str


@contextmanager
def _view() -> Iterator[Opened]:
    shown = odd_report()
    replay = Replay([{MARKUP[1]: lambda: shown, "other": lambda: shown}])
    try:
        replay.panel.find("0")
        yield Opened(
            address=replay.address,
            port=replay.port,
            text="Time [s]",
            token=replay.address.partition("=")[2],
        )
    finally:
        replay.close()


@contextmanager
def _live() -> Iterator[Opened]:
    model = odd_model()
    muscles = len(model.muscles)
    count = len(model.coordinates)
    page = ChainViewer(model=model, surfaces=None, port=_free_port(), wrenches=0)
    shown = Shown(
        coordinates=np.array([coordinate.default for coordinate in model.coordinates]),
        activations=np.full(muscles, 0.5),
        forces=np.linspace(10.0, 900.0, muscles),
        torques=np.linspace(1.0, 50.0, count),
        wrenches=np.zeros((0, 6)),
        markers=np.zeros((0, 3)),
        state="",
        facts={"Time": "1.00 s"},
    )
    try:
        page.show(shown)
        yield Opened(
            address=page.address,
            port=page.port,
            text="Muscle",
            token=page.address.partition("=")[2],
        )
    finally:
        page.close()


@contextmanager
def _app(home: Path) -> Iterator[Opened]:
    server = AppServer(Desk(home))
    thread = threading.Thread(target=server.serve_forever, daemon=True)
    thread.start()
    access = server.access
    try:
        yield Opened(address=access.address, port=access.port, text="Drop", token=access.token)
    finally:
        server.shutdown()
        server.server_close()


def _free_port() -> int:
    with http.server.HTTPServer(("127.0.0.1", 0), http.server.BaseHTTPRequestHandler) as probe:
        return int(probe.server_address[1])


@pytest.fixture(scope="module", params=["view", "live", "app"])
def page(request, tmp_path_factory) -> Iterator[Opened]:
    home = tmp_path_factory.mktemp("home")
    with {"view": _view, "live": _live, "app": partial(_app, home)}[request.param]() as opened:
        yield opened


@pytest.fixture(scope="module")
def browser(page: Opened, tmp_path_factory) -> Iterator[Browser]:
    """Open a browser that has not seen the page, and knows a stranger's name for this machine."""
    program = browser_program()
    if program is None:
        pytest.skip(
            "needs a browser: no Chromium on the path, and MYOMORPH_BROWSER does not name one"
        )
    leads_here = f"--host-resolver-rules=MAP {STRANGER} 127.0.0.1"
    folder = tmp_path_factory.mktemp("profile")
    with Browser(program=program, folder=folder, options=(leads_here,)) as opened:
        yield opened


@pytest.mark.parametrize("wrong", ["none", "another", "stranger"])
def test_a_refused_request_shows_no_page(page: Opened, browser: Browser, wrong: str) -> None:
    """Before the browser has the cookie, and after."""
    for has_cookie in (False, True):
        browser.call("Network.clearBrowserCookies")
        if has_cookie:
            browser.open(page.address)
            browser.until(f"document.body.innerText.includes({page.text!r})")
        if wrong == "none":
            address = f"http://127.0.0.1:{page.port}/"
        elif wrong == "another":
            address = page.address.replace(page.token, "x" * len(page.token))
        else:
            address = page.address.replace("127.0.0.1", STRANGER)
        if has_cookie and wrong != "stranger" and "token=" in page.address:
            # The cookie lets it in.
            continue
        browser.open(address)
        browser.until(f"{list(HINTS)}.some(hint => document.body.innerText.includes(hint))")
        assert not browser.run(f"document.body.innerText.includes({page.text!r})")


def test_names_that_hold_markup_are_texts(page: Opened, browser: Browser, tmp_path) -> None:
    browser.open(page.address)
    browser.until(f"document.body.innerText.includes({page.text!r})")
    if page.text != "Drop":
        browser.until("document.body.innerText.includes('<img src=x onerror=')")
    assert not browser.run(RAN)
    assert len(np.unique(browser.picture(tmp_path / "page.png").reshape(-1, 3), axis=0)) > 10


class _Other(http.server.BaseHTTPRequestHandler):
    """A page of another port of this machine."""

    def do_GET(self) -> None:
        """Send an empty page."""
        self.send_response(200)
        self.send_header("Content-Type", "text/html")
        self.end_headers()
        self.wfile.write(b"<html><body>another page</body></html>")

    def log_message(self, *_: object) -> None:
        """Say nothing."""


SOCKET = """
new Promise(done => {
  const socket = new WebSocket(%r, ["viser-v1.1.1"]);
  socket.onopen = () => done("open");
  socket.onerror = () => done("refused");
})
"""
FRAMED = """
new Promise(done => {
  const frame = document.createElement("iframe");
  frame.src = %r;
  frame.onload = () => {
    try { done(frame.contentDocument === null ? "hidden" : frame.contentDocument.body.innerText); }
    catch (error) { done("hidden"); }
  };
  document.body.append(frame);
})
"""
POSTED = """
fetch(%r, {method: "POST", credentials: "include", body: "{}"})
  .then(answer => "answered " + answer.status, () => "refused")
"""


def test_another_page_reaches_nothing(page: Opened, browser: Browser) -> None:
    """With the token and with the cookie, which go along as it is of the same site."""
    other = http.server.HTTPServer(("127.0.0.1", 0), _Other)
    threading.Thread(target=other.serve_forever, daemon=True).start()
    try:
        browser.open(page.address)
        browser.until(f"document.body.innerText.includes({page.text!r})")
        browser.open(f"http://127.0.0.1:{other.server_address[1]}/")
        browser.until("document.body.innerText.includes('another page')")
        assert browser.run(SOCKET % page.address.replace("http:", "ws:")) == "refused"
        assert browser.run(SOCKET % f"ws://127.0.0.1:{page.port}/") == "refused"
        assert browser.run(POSTED % page.address) == "refused"
        seen = len(browser.errors)
        browser.run(FRAMED % page.address)
        assert any("frame" in error for error in browser.errors[seen:]), browser.errors[seen:]
    finally:
        other.shutdown()
        other.server_close()


def test_the_own_socket_is_let_in(page: Opened, browser: Browser) -> None:
    if page.text == "Drop":
        pytest.skip("the app has no socket")
    browser.open(page.address)
    browser.until(f"document.body.innerText.includes({page.text!r})")
    assert browser.run(SOCKET % f"ws://127.0.0.1:{page.port}/") == "open"
