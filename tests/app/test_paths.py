"""Paths that people type, drop or ask for."""

from __future__ import annotations

from pathlib import Path, PurePosixPath, PureWindowsPath

import pytest

from myomorph.core.model.errors import BadFile
from myomorph.show.app import paths

WALK = PureWindowsPath(r"C:\Users\Anna Müller\Meine Daten\walk 1.c3d")


@pytest.mark.parametrize(
    "text",
    [
        str(WALK),
        f'"{WALK}"',
        f"  {WALK}  ",
        f"\u201c{WALK}\u201d",
        "C:/Users/Anna Müller/Meine Daten/walk 1.c3d",
        "file:///C:/Users/Anna%20M%C3%BCller/Meine%20Daten/walk%201.c3d",
    ],
)
def test_paths_of_windows(text):
    assert paths.typed_path(text, windows=True) == WALK


def test_a_server_of_windows():
    share = PureWindowsPath(r"\\\\labor\\gang\\S 01".replace(r"\\", "\\"))
    assert paths.typed_path(str(share), windows=True) == share
    assert paths.typed_path("file://labor/gang/S%2001", windows=True) == share


@pytest.mark.parametrize(
    "text", ["/data/S 01/Läufe", "'/data/S 01/Läufe'", "file:///data/S%2001/L%C3%A4ufe"]
)
def test_paths_of_other_systems(text):
    assert paths.typed_path(text, windows=False) == PurePosixPath("/data/S 01/Läufe")


def test_home():
    assert paths.typed_path("~/walks", windows=False).is_absolute()


@pytest.mark.parametrize("text", ["", "  ", '""', "walks", r"Users\Anna", r"C:walks"])
def test_what_is_no_whole_path_is_refused_with_an_example(text):
    with pytest.raises(BadFile, match=r"C:\\Users\\Anna\\walks"):
        paths.typed_path(text, windows=True)


@pytest.mark.parametrize("text", [str(WALK), r"\\labor\gang", "d:/gang"])
def test_a_path_of_windows_elsewhere(text):
    with pytest.raises(BadFile, match="is a path of Windows"):
        paths.typed_path(text, windows=False)


@pytest.mark.parametrize(
    ("relative", "parts"),
    [
        ("walk 1.c3d", ("walk 1.c3d",)),
        ("Müller/Läufe/walk.trc", ("Müller", "Läufe", "walk.trc")),
        ("a\\b.c3d", ("a", "b.c3d")),
        ("./a/b.c3d", ("a", "b.c3d")),
        ('walk "1"?.c3d', ("walk _1__.c3d",)),
        ("con.c3d", ("_con.c3d",)),
        ("LPT1/x.c3d", ("_LPT1", "x.c3d")),
        ("console.c3d", ("console.c3d",)),
        ("end. /x.c3d", ("end", "x.c3d")),
        ("tab\tname.c3d", ("tab_name.c3d",)),
    ],
)
def test_names_of_dropped_files_are_safe_on_every_system(relative, parts):
    assert paths.upload_parts(relative) == parts


@pytest.mark.parametrize(
    "relative",
    [
        "../x.c3d",
        "a/../../x.c3d",
        "a\\..\\..\\x.c3d",
        "/etc/passwd",
        "\\windows\\x.c3d",
        "C:\\x.c3d",
        "c:x.c3d",
        "//server/share/x.c3d",
        "",
        ".",
        "/".join("a" * 40),
    ],
)
def test_names_that_lead_elsewhere_are_refused(relative):
    with pytest.raises(BadFile, match="is no name below a folder"):
        paths.upload_parts(relative)


def test_a_long_name_keeps_its_ending():
    assert paths.safe_name("x" * 500 + ".c3d").endswith("x.c3d")
    assert len(paths.safe_name("x" * 500 + ".c3d")) <= paths.MAX_NAME
    assert len(paths.safe_name("x" * 500)) <= paths.MAX_NAME


def test_files_of_results_lie_inside(tmp_path):
    home = tmp_path / "results"
    (home / "walk 1").mkdir(parents=True)
    (home / "walk 1" / "report.html").write_text("x")
    (tmp_path / "secret.txt").write_text("x")
    assert paths.inside(home, "walk 1/report.html") == (home / "walk 1" / "report.html").resolve()
    for relative in ("../secret.txt", "walk 1/../../secret.txt", "walk 1", "nothing.html", ""):
        with pytest.raises(BadFile):
            paths.inside(home, relative)


def test_a_link_does_not_lead_out(tmp_path):
    home = tmp_path / "results"
    home.mkdir()
    (tmp_path / "secret.txt").write_text("x")
    try:
        (home / "link.txt").symlink_to(tmp_path / "secret.txt")
    except OSError:
        pytest.skip("this system lets nobody make links")
    with pytest.raises(BadFile):
        paths.inside(home, "link.txt")


def test_folders_of_drops_are_new(tmp_path):
    assert paths.free_folder(tmp_path, "S 01") == tmp_path / "S 01"
    (tmp_path / "S 01").mkdir()
    assert paths.free_folder(tmp_path, "S 01") == tmp_path / "S 01 2"


def test_folders_are_listed_without_hidden_ones(tmp_path):
    for name in ("b", "A", ".hidden"):
        (tmp_path / name).mkdir()
    (tmp_path / "file").write_text("x")
    assert paths.subfolders(tmp_path) == ["A", "b"]
    with pytest.raises(BadFile, match="cannot be read"):
        paths.subfolders(tmp_path / "nothing")
    assert Path.home() in list(paths.roots())
