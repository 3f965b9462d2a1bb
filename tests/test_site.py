"""The documentation site builds without a warning, leads nowhere in vain, and needs no network."""

from __future__ import annotations

import os
import subprocess
import sys
from pathlib import Path

import pytest
from docs_build.examples import DOCS
from docs_build.links import broken_links, foreign_files

ROOT = Path(__file__).resolve().parents[1]
ROOMS = sorted(path.parent.name for path in (ROOT / "src" / "myomorph").glob("*/__init__.py"))
LARGEST = 300_000
LARGEST_MOVIE = 1_000_000
"""Of a picture, and of one that moves [bytes]."""


@pytest.fixture(scope="session")
def site(tmp_path_factory):
    """Return the built site.

    It is the one that MYOMORPH_SITE names, as where it was built just before, or a new one.
    """
    if "MYOMORPH_SITE" in os.environ:
        return Path(os.environ["MYOMORPH_SITE"])
    for module in ("material", "mkdocstrings", "latex2mathml"):
        pytest.importorskip(module, reason="needs the extra 'docs'")
    folder = tmp_path_factory.mktemp("site")
    command = [sys.executable, "-m", "mkdocs", "build", "--strict", "--site-dir", str(folder)]
    environment = {**os.environ, "NO_MKDOCS_2_WARNING": "1"}
    done = subprocess.run(
        command, cwd=ROOT, capture_output=True, text=True, check=False, env=environment
    )
    assert done.returncode == 0, done.stdout + done.stderr
    return folder


@pytest.mark.long
def test_links_and_anchors_lead_somewhere(site):
    assert broken_links(site) == []


@pytest.mark.long
def test_nothing_is_fetched_from_elsewhere(site):
    assert foreign_files(site) == []


@pytest.mark.long
def test_equations_need_no_script(site):
    page = (site / "contact-forces.html").read_text(encoding="utf-8")
    assert '<math xmlns="http://www.w3.org/1998/Math/MathML" display="block">' in page
    assert "arithmatex" not in page


@pytest.mark.long
def test_every_module_has_its_page(site):
    for room in ROOMS:
        for module in (ROOT / "src" / "myomorph" / room).rglob("*.py"):
            page = module.relative_to(ROOT / "src" / "myomorph").with_suffix(".html")
            if not module.stem.startswith("_"):
                assert (site / "reference" / page).is_file(), page


@pytest.mark.long
def test_fields_of_docstrings_are_descriptions_and_not_types(site):
    """What stands behind a field's colon is its description; its type is that of the annotation."""
    page = (site / "reference" / "core" / "motion" / "ik.html").read_text(encoding="utf-8")
    before = page[: page.index("maximum number of iterations per frame")]
    assert ">int<" in before[before.rindex("iterations") :]


def test_pictures_are_small():
    pictures = {path: path.stat().st_size for path in (DOCS / "images").rglob("*.*")}
    limits = {path: LARGEST_MOVIE if path.suffix == ".gif" else LARGEST for path in pictures}
    assert [path.name for path, size in pictures.items() if size > limits[path]] == []


def test_pictures_are_shown_somewhere():
    shown = " ".join(path.read_text(encoding="utf-8") for path in DOCS.rglob("*.md"))
    unused = [path.name for path in (DOCS / "images").rglob("*.*") if path.name not in shown]
    assert unused == []


def test_links_that_lead_nowhere_are_found(tmp_path):
    (tmp_path / "a.html").write_text(
        '<a href="b.html#there">x</a><a href="c.html">y</a><h1 id="here">', "utf-8"
    )
    (tmp_path / "b.html").write_text(
        '<a href="a.html#here">x</a><script src="https://elsewhere.org/a.js">', "utf-8"
    )
    assert broken_links(tmp_path) == [
        "a.html: b.html#there: there is no such anchor",
        "a.html: c.html: there is no such file",
    ]
    assert foreign_files(tmp_path) == ["b.html: https://elsewhere.org/a.js"]


def test_descriptions_of_fields_stand_below_their_names():
    pytest.importorskip("griffe", reason="needs the extra 'docs'")
    from docs_build.fields import told_below

    told = told_below(
        "Length.\n\nParameters\n----------\nl : of the tendon, see x[i](t)"
        " [m]\n\nReturns\n-------\n(n,) [m]\n"
    )
    assert told.splitlines()[4:] == [
        "l",
        r"    of the tendon, see x[i\](t) [m]",
        "",
        "**Returns**",
        "",
        "(n,) [m]",
    ]
