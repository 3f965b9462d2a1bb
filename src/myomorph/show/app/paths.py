"""Paths that people type, drop or ask for, on any system."""

from __future__ import annotations

import os
import re
import string
from collections.abc import Iterator
from pathlib import Path, PurePath, PurePosixPath, PureWindowsPath
from urllib.parse import unquote, urlsplit

from myomorph.core.model.errors import BadFile

WINDOWS = os.name == "nt"
QUOTES = "\"'\u201c\u201d\u00ab\u00bb"  # As a file manager puts around a copied path.
LIKE_WINDOWS = re.compile(r"^(?:[A-Za-z]:[\\/]|\\\\[^\\])")
# Names that Windows keeps for devices, whatever their ending is.
DEVICE = re.compile(r"^(?:con|prn|aux|nul|com\d|lpt\d)(?:\..*)?$", re.IGNORECASE)
# Characters that no name may have on Windows.
FORBIDDEN = re.compile(r'[\x00-\x1f\x7f<>:"|?*]')
MAX_PARTS = 16  # Folders within each other that are dropped.
MAX_NAME = 200  # Characters of a name.
EXAMPLE = ("Users", "Anna", "walks")
MAX_FOLDERS = 400  # That a list shows.


def typed_path(text: str, windows: bool = WINDOWS) -> PurePath:
    """Path that somebody typed or pasted: with quotes, with ~, or as a file's address.

    Parameters
    ----------
    text : as typed
    windows : of which system the path is

    Raises
    ------
    BadFile : it is empty, no whole path, or one of another system
    """
    plain = text.strip().strip(QUOTES).strip()
    if plain.lower().startswith("file:"):
        plain = _path_of_address(plain, windows)
    if not plain:
        raise BadFile("''", "is no folder", f"give one, as {_example(windows)}")
    if not windows and LIKE_WINDOWS.match(plain):
        raise BadFile(
            plain,
            "is a path of Windows, and this computer runs another system",
            f"give one of this computer, as {_example(windows)}",
        )
    if plain.startswith("~"):
        plain = os.path.expanduser(plain)
    path: PurePath = PureWindowsPath(plain) if windows else PurePosixPath(plain)
    if not path.is_absolute():
        raise BadFile(plain, "is not a full path", f"give all of it, as {_example(windows)}")
    return path


def _path_of_address(text: str, windows: bool) -> str:
    """Path of an address that begins with "file:"."""
    address = urlsplit(text)
    path = unquote(address.path)
    if not windows:
        return path
    if address.netloc:
        return f"//{address.netloc}{path}"
    return path.lstrip("/")


def _example(windows: bool) -> str:
    """Path that is written as those of a system are."""
    return ("\\" if windows else "/").join(("C:" if windows else "", *EXAMPLE))


def upload_parts(relative: str) -> tuple[str, ...]:
    """Folders and name of a file that a browser sends, each safe on every system.

    Parameters
    ----------
    relative : path below what was dropped, with either kind of slash

    Raises
    ------
    BadFile : it leads elsewhere
    """
    path = PureWindowsPath(relative)
    parts = path.parts
    leads_away = bool(path.anchor) or relative.startswith("/") or ".." in parts
    if leads_away or not parts or len(parts) > MAX_PARTS:
        raise BadFile(relative, "is no name below a folder", "drop the file or its folder again")
    return tuple(safe_name(part) for part in parts)


def safe_name(name: str) -> str:
    """Name without what Windows does not allow."""
    plain = FORBIDDEN.sub("_", name).rstrip(". ")
    if len(plain) > MAX_NAME:
        stem, dot, ending = plain.rpartition(".")
        plain = f"{(stem or ending)[: MAX_NAME - 20]}{dot}{ending[-19:]}"
    if not plain:
        return "_"
    return f"_{plain}" if DEVICE.match(plain) else plain


def inside(folder: Path, relative: str) -> Path:
    """File of a folder, links followed.

    Parameters
    ----------
    folder : that it must lie in
    relative : path below it, as an address has it

    Raises
    ------
    BadFile : it is not there, or lies outside
    """
    home = folder.resolve()
    path = home.joinpath(*upload_parts(relative)).resolve()
    if not path.is_relative_to(home) or not path.is_file():
        raise BadFile(relative, "is no file of the results", "go back to the page")
    return path


def free_folder(home: Path, name: str) -> Path:
    """Folder of a home that does not exist yet: NAME, NAME 2, ..."""
    plain = safe_name(name)
    folder = home / plain
    number = 2
    while folder.exists():
        folder = home / f"{plain} {number}"
        number += 1
    return folder


def documents_folder() -> Path:
    """Folder for recordings that are dropped: in the user's documents, else where we are."""
    documents = Path.home() / "Documents"
    return (documents if documents.is_dir() else Path.cwd()) / "Myomorph"


def roots() -> Iterator[Path]:
    """Folders to begin with when one is looked for: home, documents, drives."""
    home = Path.home()
    for path in (home, home / "Documents", home / "Desktop", Path.cwd()):
        if path.is_dir():
            yield path
    if not WINDOWS:
        yield Path("/")
        return
    for letter in string.ascii_uppercase:
        drive = Path(f"{letter}:\\")
        if drive.is_dir():
            yield drive


def subfolders(folder: Path) -> list[str]:
    """Names of the folders in a folder, hidden ones left out.

    Raises
    ------
    BadFile : it cannot be read
    """
    try:
        with os.scandir(folder) as entries:
            names = [entry.name for entry in entries if _is_shown(entry)]
    except OSError as error:
        raise BadFile(
            folder, f"cannot be read ({error.strerror or error})", "choose another folder"
        ) from None
    return sorted(names, key=str.casefold)[:MAX_FOLDERS]


def _is_shown(entry: os.DirEntry[str]) -> bool:
    try:
        return not entry.name.startswith((".", "$")) and entry.is_dir()
    except OSError:
        return False
