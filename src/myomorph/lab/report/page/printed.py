"""Pages as PDF files, printed by a browser that is installed."""

from __future__ import annotations

import os
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from myomorph.core.model.errors import BadData, BadFile

VARIABLE = "MYOMORPH_BROWSER"
"""Environment variable that names a browser's program."""
COMMANDS = (
    "google-chrome",
    "google-chrome-stable",
    "chrome",
    "chromium",
    "chromium-browser",
    "microsoft-edge",
    "microsoft-edge-stable",
    "msedge",
    "brave-browser",
)
APPLICATIONS = (
    "Google Chrome.app/Contents/MacOS/Google Chrome",
    "Microsoft Edge.app/Contents/MacOS/Microsoft Edge",
    "Chromium.app/Contents/MacOS/Chromium",
    "Brave Browser.app/Contents/MacOS/Brave Browser",
)
"""Below the folders of applications of macOS."""
PROGRAMS = (
    "Google/Chrome/Application/chrome.exe",
    "Microsoft/Edge/Application/msedge.exe",
    "Chromium/Application/chrome.exe",
)
"""Below the folders of programs of Windows."""
PROGRAM_FOLDERS = ("PROGRAMFILES", "PROGRAMFILES(X86)", "LOCALAPPDATA")
MAX_SECONDS = 120.0


@dataclass(frozen=True)
class Browser:
    """A browser of the Chromium family, which prints without a window.

    Attributes
    ----------
    program : its file
    """

    program: Path

    @staticmethod
    def found() -> Browser:
        """Return the browser that is named or installed.

        Raises
        ------
        BadData : none is, with what to install
        """
        named = os.environ.get(VARIABLE, "")
        if named:
            program = shutil.which(named)
            if program is None:
                raise BadData(f"{VARIABLE}={named}: is no program")
            return Browser(Path(program))
        for place in _places():
            if place.is_file():
                return Browser(place)
        raise BadData(
            "--pdf needs a browser that prints: install Google Chrome, Microsoft Edge or Chromium,"
            f" or name one in {VARIABLE}; or open the page in any browser and print it there"
        )

    def print_pdf(self, page: Path) -> Path:
        """Print a page as a PDF file of the same name beside it, whole or not at all.

        Raises
        ------
        BadFile : the browser makes none
        """
        target = page.with_suffix(".pdf")
        with tempfile.TemporaryDirectory(
            prefix="myomorph-print-", ignore_cleanup_errors=True
        ) as folder:
            made = Path(folder) / "page.pdf"
            said = self._run(self._command(page, made, Path(folder) / "profile"), page)
            if not made.is_file() or not made.stat().st_size:
                raise BadFile(page, f"was not printed: {self.program} made no PDF file ({said})")
            _keep(made, target)
        return target

    def _run(self, command: list[str], page: Path) -> str:
        """Run the browser, and return the end of what it says."""
        try:
            done = subprocess.run(
                command,
                capture_output=True,
                text=True,
                errors="replace",
                timeout=MAX_SECONDS,
                check=False,
            )
        except (OSError, subprocess.TimeoutExpired) as error:
            raise BadFile(page, f"was not printed: {self.program} ({error})") from None
        return " ".join(done.stderr.split()[-30:])

    def _command(self, page: Path, made: Path, profile: Path) -> list[str]:
        """Return the words that print a page, without net and with a profile of their own."""
        options = [
            "--headless",
            "--disable-gpu",
            "--disable-background-networking",
            "--disable-sync",
            "--no-first-run",
            "--no-default-browser-check",
            "--no-pdf-header-footer",
            f"--user-data-dir={profile}",
            f"--print-to-pdf={made}",
        ]
        if sys.platform == "linux" and os.geteuid() == 0:
            # Chromium refuses its sandbox to root; the page is our own.
            options.append("--no-sandbox")
        return [str(self.program), *options, page.resolve().as_uri()]


def _keep(made: Path, target: Path) -> None:
    """Put the finished file in its place."""
    beside = target.with_name(f".{target.name}.tmp")
    try:
        shutil.copyfile(made, beside)
        os.replace(beside, target)
    except OSError as error:
        beside.unlink(missing_ok=True)
        raise BadFile(target, f"cannot be written ({error.strerror or error})") from None


def _places() -> Iterator[Path]:
    """Yield where browsers lie: on the path, then where macOS and Windows install them."""
    for command in COMMANDS:
        program = shutil.which(command)
        if program is not None:
            yield Path(program)
    if sys.platform == "darwin":
        for home in (Path("/Applications"), Path.home() / "Applications"):
            yield from (home / application for application in APPLICATIONS)
    for variable in PROGRAM_FOLDERS:
        folder = os.environ.get(variable, "")
        if folder:
            yield from (Path(folder) / program for program in PROGRAMS)
