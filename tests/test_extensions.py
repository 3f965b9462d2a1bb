"""Packages that somebody else wrote: one adds a step, a format and a command, two are broken."""

from __future__ import annotations

import os
import re
import subprocess
import sys
import tomllib
from pathlib import Path

import numpy as np
import pytest
from docs_build.examples import parts_of

from myomorph.core.io.trc import read_trc
from myomorph.lab.store.results import read_result

PAGE = Path(__file__).resolve().parents[1] / "docs" / "adding.md"
READER = "lin_kit/lin.py"  # The one file whose text stands further down on the page.
STUDY = """
[study]
name = "reaching"
[[subject]]
name = "s01"
model = "arm.osim"
trials = ["reach.lin"]
steps = ["ik", "{step}"]
"""
BROKEN = """
from myomorph.core.model.extension import CommandEntry, Extension, StepEntry

EXTENSION = Extension(
    steps=(StepEntry(name="lost", place="half_kit.nowhere:STEP", help="A step that is missing."),),
    commands={
        "gone": CommandEntry(function="half_kit.nowhere:gone_command", help="Another."),
        "info": CommandEntry(function="half_kit.nowhere:info_command", help="A name in use."),
    },
)
"""


@pytest.fixture
def site(tmp_path):
    """Make a folder of Python's path to install packages in."""
    folder = tmp_path / "site"
    folder.mkdir()
    return folder


def install(site: Path, project: dict, files: dict[str, str]) -> None:
    """Do what pip does with a package of Python files alone: copy them, and write what it says."""
    for name, text in files.items():
        (site / name).parent.mkdir(exist_ok=True)
        (site / name).write_text(text, encoding="utf-8")
    stem = f"{project['name'].replace('-', '_')}-{project['version']}.dist-info"
    (site / stem).mkdir()
    metadata = f"Metadata-Version: 2.1\nName: {project['name']}\nVersion: {project['version']}\n"
    (site / stem / "METADATA").write_text(metadata, encoding="utf-8")
    points = project["entry-points"]["myomorph"]
    lines = "".join(f"{name} = {place}\n" for name, place in points.items())
    (site / stem / "entry_points.txt").write_text(f"[myomorph]\n{lines}", encoding="utf-8")


def install_page(site: Path) -> None:
    """Install the package of the page, word by word."""
    files = {part.name: part.text for part in parts_of(PAGE) if part.kind == "file"}
    project = tomllib.loads(files.pop("pyproject.toml"))["project"]
    section = PAGE.read_text(encoding="utf-8").split("## A file format")[1]
    reader = re.search(r"^```python\n(.*?)^```", section, re.MULTILINE | re.DOTALL)
    assert reader is not None
    install(site, project, files | {READER: reader[1]})


def install_broken(site: Path) -> None:
    """Install a package whose declaration raises, and one whose parts are missing."""
    for name, text in {"no_kit": "import nowhere\n", "half_kit": BROKEN}.items():
        points = {"myomorph": {name: f"{name}.extension:EXTENSION"}}
        project = {"name": name.replace("_", "-"), "version": "2.0", "entry-points": points}
        install(site, project, {f"{name}/extension.py": text})


def run(site: Path, folder: Path, *words: str) -> subprocess.CompletedProcess[str]:
    """Run a command in a process of its own, in which the packages are installed."""
    path = os.pathsep.join((str(site), os.environ.get("PYTHONPATH", "")))
    return subprocess.run(
        [sys.executable, "-m", "myomorph", *words],
        cwd=folder,
        env=os.environ | {"PYTHONPATH": path},
        capture_output=True,
        text=True,
        check=False,
    )


def line_with(part: str, text: str) -> str:
    """Find the one line that has a part."""
    lines = [line for line in text.splitlines() if part in line]
    assert len(lines) == 1, text
    return lines[0]


def test_a_package_adds_a_step_a_format_and_a_command(arm, site):
    install_page(site)
    markers = read_trc(arm.markers).markers
    lines = [
        f"{time:.6f} {name} " + " ".join(f"{1000.0 * value:.10g}" for value in position)
        for time, frame in zip(markers.time, markers.values, strict=True)
        for name, position in zip(markers.names, frame, strict=True)
    ]
    (arm.folder / "reach.lin").write_text("\n".join(lines) + "\n", encoding="utf-8")
    (arm.folder / "study.toml").write_text(STUDY.format(step="travel"), encoding="utf-8")

    shown = run(site, arm.folder, "--help")
    assert (shown.returncode, shown.stderr) == (0, "")
    assert " labels " in shown.stdout
    assert "Length of the path of every marker." in shown.stdout
    labels = run(site, arm.folder, "labels", "reach.lin")
    assert (labels.returncode, labels.stdout.split()) == (0, list(markers.names)), labels.stderr

    done = run(site, arm.folder, "run", "study.toml", "--out", "results")
    assert done.returncode == 0, done.stdout + done.stderr
    stored = read_result(arm.folder / "results" / "s01" / "reach" / "reach.nc")
    lengths = np.linalg.norm(np.diff(markers.values, axis=0), axis=2).sum(axis=0)
    np.testing.assert_allclose(stored.values["marker_travel"], lengths, rtol=1e-6)
    assert stored.provenance["travel"].sources


def test_broken_packages_are_named_and_take_nothing_down(arm, site):
    install_broken(site)
    shown = run(site, arm.folder, "info", "arm.osim")
    assert shown.returncode == 0
    assert "shoulder_flexion" in shown.stdout
    assert len(shown.stderr.splitlines()) == 2
    declaration = line_with("'no-kit'", shown.stderr)
    assert "No module named 'nowhere'" in declaration
    assert declaration.endswith("update the package or uninstall it")
    assert "there is a command 'info' already" in line_with("'half-kit'", shown.stderr)

    gone = run(site, arm.folder, "gone")
    assert gone.returncode == 2
    error = line_with("error: ", gone.stderr)
    assert "half_kit" in error
    assert "uninstall it" in error

    named = STUDY.format(step="lost").replace("reach.lin", "reach.trc")
    (arm.folder / "study.toml").write_text(named, encoding="utf-8")
    lost = run(site, arm.folder, "run", "study.toml", "--out", "results")
    assert lost.returncode == 2
    assert "the step 'lost' cannot run" in lost.stderr
    (arm.folder / "study.toml").write_text(named.replace('"lost"', '"id"'), encoding="utf-8")
    others = run(site, arm.folder, "run", "study.toml", "--out", "results", "--dry-run")
    assert others.returncode == 0, others.stdout + others.stderr
