"""Open the pages that commands make in a real browser.

Whether they fit screens of two widths, complain, or are hard for people who read with a program.

`python -m benchmarks pages [--save]`. Recordings are analyzed, and every page is opened at 1280 and
400 pixels, light and dark, with what is folded opened. Where axe-core (Deque, MPL-2.0) is installed
(`pip install --no-deps axe-playwright-python`), its rules of accessibility are checked.
`MYOMORPH_SCREENS` names a folder for pictures of the screens.
"""

from __future__ import annotations

import importlib.util
import json
import os
import shlex
import shutil
import tempfile
import threading
from collections.abc import Iterator, Mapping
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path

from benchmarks.figures.screens import FILES, GAIT_STUDY, WALK
from browser import Browser, browser_program
from data_collection import data_folder
from myomorph.lab.cli import main
from myomorph.show.app.desk import Desk
from myomorph.show.app.server import AppServer

PICTURES = "MYOMORPH_SCREENS"
WIDTHS = (1280, 400)
HEIGHT = 900
TALLEST = 12_000
"""Pictures show no more of a page than this [pixels]."""
LATE = 0.9
"""How long a page may take to draw itself [s]."""
SCHEMES = ("light", "dark")
OPEN_ALL = "document.querySelectorAll('details').forEach(one => { one.open = true; })"
WIDER = "document.documentElement.scrollWidth - window.innerWidth"
TALL = "document.documentElement.scrollHeight"
VIOLATIONS = (
    "axe.run(document, {resultTypes: ['violations']}).then(report => JSON.stringify("
    "report.violations.map(one => [one.id, one.nodes.length, one.nodes[0].html.slice(0, 160)])))"
)
"""Rule, number of places, and the first of them."""
OTHER_CUTOFF = ("cutoff = 6", "cutoff = 12")
"""Of the second analysis of the walk, with which the first is compared."""


@dataclass(frozen=True)
class Screen:
    """How a page is looked at.

    Attributes
    ----------
    width : of the window [pixels]
    scheme : "light" or "dark", as the reader's system prefers it
    """

    width: int
    scheme: str


@dataclass(frozen=True)
class Look:
    """What a browser reports of a page on one screen.

    Attributes
    ----------
    wider : how far its contents reach beyond the window [pixels]
    complaints : of its scripts
    findings : of axe, (rule, number of places, the first of them); None where it did not run
    """

    wider: int
    complaints: tuple[str, ...]
    findings: tuple[tuple[str, int, str], ...] | None


def run() -> list[dict[str, object]]:
    """Return a row for each page and screen.

    Raises
    ------
    RuntimeError : there is no Chromium, or a command fails
    """
    script = axe_script()
    program = browser_program()
    if program is None:
        raise RuntimeError("no Chromium: name one in MYOMORPH_BROWSER")
    rows: list[dict[str, object]] = []
    with tempfile.TemporaryDirectory() as work, app_page(Path(work)) as app:
        addresses = {**result_pages(Path(work)), "app, its first page": app}
        for width in WIDTHS:
            profile = Path(work) / f"browser {width}"
            with Browser(program, profile, width=width, height=HEIGHT) as browser:
                rows += _rows(browser, addresses, width=width, script=script)
    return rows


def _rows(
    browser: Browser, addresses: Mapping[str, str], *, width: int, script: str
) -> Iterator[dict[str, object]]:
    pictures = os.environ.get(PICTURES, "")
    for name, address in addresses.items():
        for scheme in SCHEMES:
            screen = Screen(width, scheme)
            yield {"page": name, **_row(looked_at(browser, address, screen, script), screen)}
            if pictures:
                file = f"{name.replace(', ', '-').replace(' ', '-')}-{width}-{scheme}.png"
                _picture(browser, Path(pictures) / file, width=width)


def axe_script() -> str:
    """Return the script of axe-core, "" where it is not installed."""
    package = importlib.util.find_spec("axe_playwright_python")
    if package is None or package.origin is None:
        return ""
    return Path(package.origin).with_name("axe.min.js").read_text(encoding="utf-8")


def result_pages(work: Path) -> Mapping[str, str]:
    """Analyze recordings, and return the addresses of their pages by what they are."""
    data = data_folder()
    for name in FILES:
        shutil.copy(data / WALK / name, work)
    (work / "first.toml").write_text(GAIT_STUDY, encoding="utf-8")
    (work / "second.toml").write_text(GAIT_STUDY.replace(*OTHER_CUTOFF), encoding="utf-8")
    tasks = data / "opencap-subject4-multitask"
    running = data / "hamner-run-subject04" / "run200"
    for command in (
        f"run {_quoted(work / 'first.toml')} --out {_quoted(work / 'first')}",
        f"run {_quoted(work / 'second.toml')} --out {_quoted(work / 'second')}",
        (
            f"report {_quoted(work / 'first')} {_quoted(work / 'second')}"
            f" --out {_quoted(work / 'compare.html')}"
        ),
        f"analyze {_quoted(tasks)} --mass 73 --out {_quoted(work / 'tasks')}",
        f"analyze {_quoted(running)} --mass 76.5 --out {_quoted(work / 'run')}",
    ):
        _run(command)
    places = {
        "report of a walk": "tasks/walking1/report.html",
        "report of a jump": "tasks/DJ1/report.html",
        "report of rising from a seat": "tasks/STS1/report.html",
        "report of a run": "run/run200/report.html",
        "gait page": "first/s01/walk/gait.html",
        "two sessions compared": "compare.html",
        "study": "tasks/study.html",
    }
    missing = [place for place in places.values() if not (work / place).is_file()]
    if missing:
        raise RuntimeError(f"no page at {', '.join(missing)}")
    return {name: (work / place).as_uri() for name, place in places.items()}


@contextmanager
def app_page(work: Path) -> Iterator[str]:
    """Serve `myomorph app` meanwhile, and give its address."""
    server = AppServer(Desk(work / "app"))
    serving = threading.Thread(target=server.serve_forever, daemon=True)
    serving.start()
    try:
        yield server.access.address
    finally:
        server.shutdown()
        server.server_close()


def looked_at(browser: Browser, address: str, screen: Screen, script: str) -> Look:
    """Open a page on a screen and ask what is wrong with it."""
    browser.errors.clear()
    preferred = [{"name": "prefers-color-scheme", "value": screen.scheme}]
    browser.call("Emulation.setEmulatedMedia", features=preferred)
    browser.open(address)
    browser.until("document.readyState === 'complete'")
    browser.run(f"new Promise(done => setTimeout(done, {1000 * LATE:.0f}))")
    browser.run(OPEN_ALL)
    wider = max(int(browser.run(WIDER)), 0)
    findings = None
    if script:
        # A debugger's script: what the page lets scripts do does not hold for it.
        browser.run(f"{script};0")
        violations = json.loads(browser.run(VIOLATIONS))
        findings = tuple((rule, int(places), first) for rule, places, first in violations)
    return Look(wider=wider, complaints=tuple(browser.errors), findings=findings)


def _row(look: Look, screen: Screen) -> dict[str, object]:
    findings = look.findings or ()
    listed = "; ".join(f"{rule} in {places}: {first}" for rule, places, first in findings)
    return {
        "width [px]": screen.width,
        "scheme": screen.scheme,
        "beyond the window [px]": look.wider,
        "complaints": len(look.complaints),
        "findings of axe": "not asked" if look.findings is None else len(findings),
        "which": "; ".join(part for part in (listed, *look.complaints) if part),
    }


def _picture(browser: Browser, file: Path, *, width: int) -> None:
    """Write the whole page as a picture, as tall as `TALLEST` at most."""
    file.parent.mkdir(parents=True, exist_ok=True)
    for height in (min(int(browser.run(TALL)), TALLEST), HEIGHT):
        browser.call(
            "Emulation.setDeviceMetricsOverride",
            width=width,
            height=height,
            deviceScaleFactor=1,
            mobile=False,
        )
        if height != HEIGHT:
            browser.picture(file)


def _quoted(path: Path) -> str:
    return shlex.quote(str(path))


def _run(command: str) -> None:
    status = main(shlex.split(command))
    if status:
        raise RuntimeError(f"myomorph {command}: exit status {status}")
