"""`myomorph app` in a real browser: recordings of three laboratories, from dropping to the report.

`MYOMORPH_SCREENS` names a folder for pictures of each step, as docs/app.md shows them.
"""

from __future__ import annotations

import os
import re
import shutil
import threading
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from pathlib import Path

import pytest

from browser import Browser, browser_program
from myomorph.show.app.desk import Desk
from myomorph.show.app.server import AppServer

pytestmark = pytest.mark.long
WIDTH = 1280
HEIGHT = 900
PATIENCE = 1500.0  # A run may take so long where kernels compile on a busy machine [s].
SCREENS = os.environ.get("MYOMORPH_SCREENS", "")
OUT = "document.getElementById('out')"
SHORTER = r"""
(() => {
  const short = (text) => text.replace(/^.*?(?=.(Documents|Daten der Klinik).)/, "/Users/Anna");
  for (const one of document.querySelectorAll(".path")) one.textContent = short(one.textContent);
  for (const one of document.querySelectorAll("#out")) one.value = short(one.value);
})()
"""
"""Leaves temporary folders out of what a picture shows."""


@dataclass(frozen=True, kw_only=True)
class App:
    """The page in a browser, its server, and the folder for what is dropped."""

    browser: Browser
    server: AppServer
    home: Path

    def begin(self) -> None:
        """Load the page anew."""
        self.server.desk.start_over()
        self.size(WIDTH)
        self.browser.open(self.server.access.address)
        self.browser.until("!document.getElementById('start').hidden")

    def size(self, width: int, dark: bool = False) -> None:
        """Give the window a width, and the page a light or dark scheme."""
        self.browser.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=HEIGHT,
            deviceScaleFactor=1,
            mobile=False,
        )
        scheme = {"name": "prefers-color-scheme", "value": "dark" if dark else "light"}
        self.browser.call("Emulation.setEmulatedMedia", features=[scheme])

    def drop(self, *paths: Path) -> None:
        """Drop files or folders, as a file manager does."""
        data = {"items": [], "files": [str(path) for path in paths], "dragOperationsMask": 1}
        x, y = self.browser.run(
            "(() => { const box = document.getElementById('drop').getBoundingClientRect();"
            " return [box.left + box.width / 2, box.top + 20]; })()"
        )
        for kind in ("dragEnter", "dragOver", "drop"):
            self.browser.call("Input.dispatchDragEvent", type=kind, x=x, y=y, data=data)

    def choose(self, field: str, *paths: Path) -> None:
        """Choose files by the browser's own dialog."""
        root = self.browser.call("DOM.getDocument")["root"]["nodeId"]
        node = self.browser.call("DOM.querySelector", nodeId=root, selector=field)["nodeId"]
        self.browser.call("DOM.setFileInputFiles", nodeId=node, files=[str(one) for one in paths])

    def press(self, selector: str) -> None:
        """Press a button."""
        self.browser.run(f"document.querySelector({selector!r}).click()")

    def wait_for(self, section: str, seconds: float = 120.0) -> None:
        """Wait until a section is shown; a mistake that is shown ends it."""
        shown = f"!document.getElementById('{section}').hidden"
        failed = "!document.getElementById('error').hidden"
        self.browser.until(f"{shown} || {failed}", seconds)
        assert self.text("#error p") == ""

    def text(self, selector: str) -> str:
        """Text of an element."""
        return self.browser.run(f"document.querySelector({selector!r}).textContent")

    def fill(self, field: str, text: str) -> None:
        """Type into a field."""
        self.browser.run(f"document.getElementById({field!r}).select()")
        self.browser.run(f"document.getElementById({field!r}).focus()")
        self.browser.type(text)

    def compute(self, opened: str, screen: str = "") -> None:
        """Compute, until the browser shows a page of results."""
        self.press("#asked button[type=submit]")
        self.wait_for("running")
        if screen:
            self.browser.until(
                "parseInt(document.getElementById('share').textContent) > 20", PATIENCE
            )
            self.picture(screen)
        opens = f"location.pathname.endsWith({opened!r})"
        failed = "!document.getElementById('error').hidden"
        self.browser.until(f"{opens} || {failed}", PATIENCE)
        assert self.server.desk.state()["error"] == ""
        self.browser.until(f"{opens} && document.readyState === 'complete'", 60.0)

    def picture(self, name: str) -> None:
        """Keep what is seen, where somebody asks for pictures; temporary folders are not shown."""
        if SCREENS:
            out = self.browser.run(f"{OUT}?.value ?? ''")
            self.browser.run(SHORTER)
            # With the extra that few need, as in `Browser.picture`.
            from PIL import Image

            path = Path(SCREENS) / f"{name}.png"
            path.parent.mkdir(parents=True, exist_ok=True)
            image = Image.fromarray(self.browser.picture())
            image.quantize(160, dither=Image.Dither.NONE).save(path, optimize=True)
            self.browser.run(f"(one => {{ if (one) one.value = {out!r}; }})({OUT})")


@pytest.fixture(scope="module")
def app(tmp_path_factory: pytest.TempPathFactory) -> Iterator[App]:
    program = browser_program()
    if program is None:
        pytest.skip(
            "needs a browser: no Chromium on the path, and MYOMORPH_BROWSER does not name one"
        )
    pytest.importorskip("websockets")
    folder = tmp_path_factory.mktemp("app")
    desk = Desk(folder / "Documents" / "Myomorph")
    server = AppServer(desk)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    with Browser(program=program, folder=folder / "profile", width=WIDTH, height=HEIGHT) as browser:
        yield App(browser=browser, server=server, home=desk.home)
    desk.cancel()
    server.shutdown()
    server.server_close()


def sideways(app: App) -> int:
    """Width of the page beyond the window [pixels]."""
    return app.browser.run(
        "document.documentElement.scrollWidth - document.documentElement.clientWidth"
    )


def test_a_gait_laboratory_whose_folder_is_dropped(
    app: App, data: Callable[[str], Path], tmp_path: Path
) -> None:
    """Plug-in Gait with two plates, which weigh the child: nothing is asked."""
    source = data("c3d-gait-plugingait/HC002D")
    folder = tmp_path / "Gangbild Müller"
    for name in ("Static", "Straight"):
        shutil.copytree(source / name, folder / name)
    home = app.home / "Gangbild Müller"
    results = home / "Gangbild Müller_results"
    app.begin()
    app.picture("start")
    app.drop(folder)
    app.wait_for("found")
    assert app.browser.run("document.getElementById('out').value") == str(results)
    app.picture("found")
    assert "2 recordings, markers of Plug-in Gait" in app.text("#summary")
    assert app.browser.run("document.getElementById('mass-0').value") == "31.1"
    assert app.browser.run("document.getElementById('movement-1').value") == "walking"
    for dark in (False, True):
        app.size(400, dark)
        assert sideways(app) <= 0
        scheme = "dark" if dark else "light"
        app.picture(f"found-{scheme}-400")
    app.size(WIDTH)
    app.compute("/report.html", "running")
    assert app.browser.run("document.querySelector('.answer h1, h1').textContent").strip()
    app.picture("answer")
    assert (home / "Straight" / "HC002D06.c3d").is_file()
    assert (results / "HC002D06" / "report.html").is_file()
    assert "Written by: myomorph app" in (results / "study.toml").read_text(encoding="utf-8")
    app.browser.run("history.back()")
    app.wait_for("done")
    app.picture("done")
    assert "1 recording, all computed" in app.text("#outcome")


def test_a_treadmill_whose_files_are_chosen(app: App, data: Callable[[str], Path]) -> None:
    """Markers and forces of a run as two files; its belts weigh the runner, which is corrected."""
    source = data("hamner-run-subject04/run200")
    app.begin()
    app.choose("#files", source / "markers.trc", source / "grf.mot")
    app.wait_for("found")
    assert app.browser.run("document.getElementById('movement-0').value") == "running"
    assert app.browser.run("document.getElementById('mass-0').value") == "82.1"
    app.fill("mass-0", "80,5")
    app.fill("name-0", "Läufer 4")
    app.compute("/report.html")
    results = next(app.home.glob("markers/*_results"))
    text = (results / "study.toml").read_text(encoding="utf-8")
    assert "mass = 80.5" in text
    assert 'name = "Läufer 4"' in text


def test_a_laboratory_whose_data_stay_where_they_lie(
    app: App, data: Callable[[str], Path], tmp_path: Path
) -> None:
    """A folder of cameras is named by its path; the mass is asked, and a movement corrected."""
    source = data("opencap-subject4-multitask")
    folder = tmp_path / "Daten der Klinik" / "OpenCap 4"
    (folder / "markers").mkdir(parents=True)
    (folder / "grf").mkdir()
    for name in ("markers/walking1.trc", "markers/static1.trc", "grf/walking1_grf.mot"):
        shutil.copy(source / name, folder / name)
    app.begin()
    app.fill("folder", f'"{folder}"')
    app.press("#typed button[type=submit]")
    app.wait_for("found")
    assert app.browser.run("document.activeElement.id") == "mass-0"
    app.press("#asked button[type=submit]")
    app.browser.until("!document.getElementById('error').hidden")
    assert app.text("#error p") == "The body mass is missing: forces need it."
    app.picture("missing")
    walk = app.browser.run(
        "[...document.querySelectorAll('select[id^=movement]')].find(one => one.value ==="
        " 'walking').id"
    )
    app.browser.run(f"document.getElementById({walk!r}).value = 'stairs'")
    app.fill("height-0", "1,78 m")
    app.fill("mass-0", "75")
    app.compute(".html")
    results = folder / "OpenCap 4_results"
    assert 'movement = "stairs"' in (results / "study.toml").read_text(encoding="utf-8")
    assert len(list(results.glob("*/report.html"))) >= 1
    assert not (app.home / "OpenCap 4").exists(), "nothing is copied"


def test_a_run_can_be_cancelled(app: App, data: Callable[[str], Path]) -> None:
    app.begin()
    app.drop(data("c3d-gait-plugingait/HC002D"))
    app.wait_for("found")
    app.press("#asked button[type=submit]")
    app.wait_for("running")
    app.picture("cancel")
    app.press("#running [data-act=cancel]")
    app.wait_for("found", 30.0)
    assert app.server.desk.state()["phase"] == "found"


def test_mistakes_are_told_where_they_are_made(app: App, tmp_path: Path) -> None:
    app.begin()
    (tmp_path / "notes.docx").write_text("x")
    app.drop(tmp_path / "notes.docx")
    app.browser.until("!document.getElementById('error').hidden")
    assert re.match(r"notes\.docx: no recording\. Expected .*\.c3d", app.text("#error p"))
    app.fill("folder", "C:\\Users\\Anna\\walks")
    app.press("#typed button[type=submit]")
    app.browser.until("document.querySelector('#error p').textContent.includes('Windows')")
    app.picture("mistake")
    (tmp_path / "damaged").mkdir()
    (tmp_path / "damaged" / "walk.c3d").write_bytes(b"no recording")
    app.browser.run("document.getElementById('folder').value = ''")
    app.fill("folder", str(tmp_path / "damaged"))
    app.press("#typed button[type=submit]")
    app.browser.until("document.querySelector('#error p').textContent.includes('walk.c3d')", 60.0)
    assert not app.browser.run("document.getElementById('start').hidden")


def test_it_is_used_by_keyboard(app: App, tmp_path: Path) -> None:
    """Every control is reached by Tab, and the list of folders by Enter."""
    (tmp_path / "S 01").mkdir()
    app.begin()
    reached = []
    for _ in range(6):
        app.browser.call(
            "Input.dispatchKeyEvent", type="keyDown", key="Tab", code="Tab", windowsVirtualKeyCode=9
        )
        reached.append(
            app.browser.run("document.activeElement.id || document.activeElement.textContent")
        )
    assert reached == ["files", "tree", "folder", "Look", "browse", "quit"]
    app.fill("folder", str(tmp_path))
    app.browser.run("document.getElementById('browse').focus()")
    app.browser.press("Enter")
    app.press("#browse")
    app.browser.until("document.querySelectorAll('#folders li button').length > 1")
    assert "S 01" in app.text("#folders")
    assert app.browser.run("document.activeElement.closest('#folders') !== null")


def test_nothing_went_wrong(app: App) -> None:
    expected = "the server responded with a status of 400"
    assert [text for text in app.browser.errors if expected not in text] == []
