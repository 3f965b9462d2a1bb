"""Pages as PDF files: by the browser that is there, and what is said where none is."""

from __future__ import annotations

import shutil
import sys

import pytest

from myomorph.core.model.errors import BadData, BadFile
from myomorph.lab.cli import main
from myomorph.lab.report.page import printed
from myomorph.lab.report.page.printed import VARIABLE, Browser

PAGE = "<!DOCTYPE html><title>page</title><style>@page { size: A4 }</style><p>Knee flexion</p>"


@pytest.fixture
def no_browser(monkeypatch):
    monkeypatch.delenv(VARIABLE, raising=False)
    monkeypatch.setattr(printed.shutil, "which", lambda name: None)
    for folder in printed.PROGRAM_FOLDERS:
        monkeypatch.delenv(folder, raising=False)
    monkeypatch.setattr(printed, "APPLICATIONS", ())


def made_browser(tmp_path, script):
    """Write a program that stands for a browser."""
    program = tmp_path / "browser"
    program.write_text(f"#!{sys.executable}\nimport sys\n{script}\n")
    program.chmod(0o755)
    return Browser(program)


def test_without_a_browser_it_is_said_what_to_install(no_browser, tmp_path, capsys):
    with pytest.raises(BadData, match="install Google Chrome, Microsoft Edge or Chromium"):
        Browser.found()
    assert main(["report", str(tmp_path), "--pdf"]) == 2
    assert "print it there" in capsys.readouterr().err


def test_a_browser_that_is_named_is_taken(monkeypatch, tmp_path):
    monkeypatch.setenv(VARIABLE, sys.executable)
    assert str(Browser.found().program) == sys.executable
    monkeypatch.setenv(VARIABLE, str(tmp_path / "none"))
    with pytest.raises(BadData, match="is no program"):
        Browser.found()


@pytest.mark.parametrize("place", printed.PROGRAMS)
def test_a_browser_of_windows_is_found(no_browser, monkeypatch, tmp_path, place):
    program = tmp_path / place
    program.parent.mkdir(parents=True)
    program.touch()
    monkeypatch.setenv("PROGRAMFILES", str(tmp_path))
    assert Browser.found().program == program


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a script")
def test_a_page_is_printed_beside_itself(tmp_path):
    page = tmp_path / "a page.html"
    page.write_text(PAGE)
    script = (
        "out = next(w.partition('=')[2] for w in sys.argv if w.startswith('--print-to-pdf='))\n"
        "open(out, 'w').write(sys.argv[-1])"
    )
    made = made_browser(tmp_path, script).print_pdf(page)
    assert made == tmp_path / "a page.pdf"
    assert made.read_text() == page.resolve().as_uri()
    left = sorted(path.name for path in tmp_path.iterdir())
    assert left == ["a page.html", "a page.pdf", "browser"]


@pytest.mark.skipif(sys.platform == "win32", reason="the stand-in is a script")
@pytest.mark.parametrize("script", ["sys.exit('no display')", "pass"])
def test_a_browser_that_prints_nothing_is_named(tmp_path, script):
    page = tmp_path / "page.html"
    page.write_text(PAGE)
    with pytest.raises(BadFile, match="made no PDF file"):
        made_browser(tmp_path, script).print_pdf(page)
    assert not (tmp_path / "page.pdf").exists()


def test_an_installed_browser_prints_a_pdf(tmp_path):
    try:
        browser = Browser.found()
    except BadData:
        pytest.skip("no browser of the Chromium family is installed")
    page = tmp_path / "page.html"
    page.write_text(PAGE)
    made = browser.print_pdf(page)
    assert made.read_bytes().startswith(b"%PDF-")
    assert shutil.which(str(browser.program)) is not None
