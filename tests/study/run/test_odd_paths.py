"""Folders and files may have names that people give them.

Blanks, accents, and characters that shells and patterns know.
"""

from __future__ import annotations

import os
import re
import shutil
import subprocess
import sys
from pathlib import Path
from urllib.parse import unquote

import pytest

from myomorph.core.io.osim.read import read_osim
from myomorph.core.io.osim.write import write_osim
from myomorph.show.demo.arm import example_files

STUDY = """
[study]
name = "Größe & <Gang>"
[[subject]]
name = "s 01 é"
model = "mo del ü.osim"
trials = ["{trial}"]
steps = ["ik", "id", "report"]
"""

FOLDERS = ["Ärzte für  歩行 ", "100% [x] {y} $HOME ~ #1 'q' ;&", "-" + "n" * 120]


@pytest.mark.parametrize("name", FOLDERS)
def test_a_study_in_a_folder_with_an_odd_name(tmp_path: Path, command, name: str) -> None:
    if os.name == "nt":
        name = name.strip()
    home = tmp_path / name
    home.mkdir()
    arm = example_files(home)
    arm.model.rename(home / "mo del ü.osim")
    arm.markers.rename(home / "été [1] + 100%.trc")
    (home / "study file.toml").write_text(
        STUDY.format(trial="été [1] + 100%.trc"), encoding="utf-8"
    )
    told = command("run", home / "study file.toml", "--out", home / "résultats (2) #3")
    assert told.status == 0, told.err
    (report,) = (home / "résultats (2) #3").rglob("report.html")
    assert "été [1] + 100%" in report.read_text(encoding="utf-8")
    page = home / "résultats (2) #3" / "study.html"
    links = re.findall(r'href="([^"#]+report\.html)"', page.read_text(encoding="utf-8"))
    assert links
    assert all((page.parent / unquote(one)).is_file() for one in links)
    assert command("info", home / "été [1] + 100%.trc").status == 0


def test_patterns_match_accents_however_they_are_written(tmp_path: Path, command) -> None:
    """A file copied from a Mac may have its accents as signs of their own."""
    arm = example_files(tmp_path)
    arm.markers.rename(tmp_path / "e\u0301te\u0301.trc")
    text = STUDY.format(trial="*.trc").replace("mo del ü", "arm")
    (tmp_path / "study.toml").write_text(text, encoding="utf-8")
    assert command("run", tmp_path / "study.toml", "--out", tmp_path / "out").status == 0


def test_what_is_in_no_name_is_told_once_and_in_one_line(tmp_path: Path, command) -> None:
    told = command("info", tmp_path / ("x" * 300 + ".trc"))
    assert told.status == 2
    assert len(told.err.strip().splitlines()) == 1


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
@pytest.mark.parametrize("name", ['quo"te.trc', "back\\slash.trc", "line\nbreak.trc"])
def test_names_that_only_some_systems_have(tmp_path: Path, command, name: str) -> None:
    arm = example_files(tmp_path)
    try:
        shutil.copy(arm.markers, tmp_path / name)
    except OSError:
        pytest.skip("this file system does not take the name")
    told = command(
        "ik", "--model", arm.model, "--markers", tmp_path / name, "--out", tmp_path / "out.mot"
    )
    assert told.status == 0, told.err
    assert (tmp_path / "out.mot").is_file()


def test_a_model_may_name_its_meshes_as_windows_does(tmp_path: Path) -> None:
    """Backslashes and another case: the file is found, in this model and in a copy of it."""
    from myomorph.core.io.mesh import read_surfaces

    arm = example_files(tmp_path)
    mesh = "<Mesh name='m'><mesh_file>Geometry\\Bone.OBJ</mesh_file></Mesh>"
    text = arm.model.read_text(encoding="utf-8").replace(
        "</inertia>", f"</inertia><attached_geometry>{mesh}</attached_geometry>", 1
    )
    arm.model.write_text(text, encoding="utf-8")
    (tmp_path / "Geometry").mkdir()
    (tmp_path / "Geometry" / "bone.obj").write_text(
        "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n", encoding="utf-8"
    )
    write_osim(read_osim(arm.model), tmp_path / "copy.osim")
    for path in (arm.model, tmp_path / "copy.osim"):
        found, warnings = read_surfaces(read_osim(path), [tmp_path])
        assert list(found) == ["Geometry\\Bone.OBJ"]
        assert warnings == ()


@pytest.mark.skipif(os.name == "nt", reason="Windows has no such names")
def test_a_name_that_is_not_utf8_is_named(tmp_path: Path, command) -> None:
    """As an old Linux wrote accents: no table and no page could hold it."""
    arm = example_files(tmp_path)
    try:
        shutil.copy(arm.markers, tmp_path / "\udce9t\udce9.trc")
    except OSError:
        pytest.skip("this file system does not take the name")
    told = command(
        "ik",
        "--model",
        arm.model,
        "--markers",
        tmp_path / "\udce9t\udce9.trc",
        "--out",
        tmp_path / "a.mot",
    )
    assert (told.status, "is not UTF-8" in told.err) == (2, True)
    assert not list(tmp_path.glob("*a.mot*"))
    (tmp_path / "study.toml").write_text(
        STUDY.format(trial="*t*.trc").replace("mo del ü", "arm"), encoding="utf-8"
    )
    told = command("run", tmp_path / "study.toml", "--out", tmp_path / "out")
    assert (told.status, "is not UTF-8" in told.err) == (2, True)
    assert not (tmp_path / "out").exists()


def test_a_terminal_without_accents_shows_them_otherwise(tmp_path: Path) -> None:
    arm = example_files(tmp_path)
    arm.markers.rename(tmp_path / "été 歩.trc")
    (tmp_path / "study.toml").write_text(
        STUDY.format(trial="*.trc").replace("mo del ü", "arm"), encoding="utf-8"
    )
    given = [sys.executable, "-m", "myomorph", "run", "study.toml", "--dry-run", "--out", "out"]
    environment = {**os.environ, "PYTHONIOENCODING": "ascii", "PYTHONUTF8": "0"}
    ended = subprocess.run(given, cwd=tmp_path, env=environment, capture_output=True, check=False)
    assert ended.returncode == 0, ended.stderr
    assert b"\\xe9t\\xe9" in ended.stdout
