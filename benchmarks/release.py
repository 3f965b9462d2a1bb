"""Check what a release needs.

Sdist and wheel build clean, hold what they should, and work where nothing else is installed.

`python -m benchmarks.release [--python PROGRAM ...] [--without-demo]`, with `build` and `twine`
installed (`pip install -e ".[release]"`). Every Python named gets a fresh environment with the
wheel alone; the program is run in a folder outside of the checkout, whose name has blanks and
accents.
"""

from __future__ import annotations

import argparse
import email
import os
import shutil
import subprocess
import sys
import tarfile
import tempfile
import time
import zipfile
from collections.abc import Iterable, Sequence
from email.message import Message
from pathlib import Path

ROOT = Path(__file__).parents[1]
STUDY = Path(__file__).with_name("release_study")
LEFT_BY_BUILD = {"PKG-INFO", ".gitignore"}
NEEDED = (
    "Name",
    "Version",
    "Summary",
    "License-Expression",
    "License-File",
    "Requires-Python",
    "Classifier",
)
LARGEST_WHEEL = 4 << 20
"""Bytes: a wheel that is larger holds what it should not."""


class NotReady(Exception):
    """What keeps a release from being made."""


def run() -> list[dict[str, object]]:
    """All checks with this Python."""
    return list(checked([sys.executable], demo=True))


def checked(pythons: Sequence[str], demo: bool) -> Iterable[dict[str, object]]:
    """Yield a row for every check that passed; raise `NotReady` at the first that does not."""
    with tempfile.TemporaryDirectory(prefix="myomorph release é ") as folder:
        dist = Path(folder) / "dist"
        start = time.monotonic()
        said = _said([sys.executable, "-m", "build", "--outdir", str(dist), str(ROOT)], ROOT)
        if "warning" in said.lower():
            raise NotReady(f"the build warns:\n{said}")
        (wheel,) = dist.glob("*.whl")
        (sdist,) = dist.glob("*.tar.gz")
        yield _row(
            "sdist and wheel",
            start,
            f"{sdist.stat().st_size >> 10} and {wheel.stat().st_size >> 10} KiB",
        )
        start = time.monotonic()
        _said([sys.executable, "-m", "twine", "check", "--strict", str(wheel), str(sdist)], ROOT)
        yield _row("twine check --strict", start, "passed")
        start = time.monotonic()
        yield _row("built again", start, _built_again(wheel, sdist, Path(folder) / "again"))
        start = time.monotonic()
        yield _row("contents", start, _contents(wheel, sdist))
        for python in pythons:
            start = time.monotonic()
            installed = _installed(
                python,
                wheel,
                Path(folder) / f"with {Path(python).name} {time.monotonic_ns()}",
                demo,
            )
            yield _row(f"wheel alone, {installed[0]}", start, installed[1])


def _built_again(wheel: Path, sdist: Path, out: Path) -> str:
    """Build both once more and compare the bytes; the wheel comes from the sdist."""
    _said([sys.executable, "-m", "build", "--outdir", str(out), str(ROOT)], ROOT)
    for first in (wheel, sdist):
        if (out / first.name).read_bytes() != first.read_bytes():
            raise NotReady(f"{first.name} is another one when it is built again")
    return "the same bytes"


def _contents(wheel: Path, sdist: Path) -> str:
    """Compare both with what git knows."""
    known = {one for one in _said(["git", "ls-files", "-z"], ROOT).split("\0") if one}
    with zipfile.ZipFile(wheel) as opened:
        names = opened.namelist()
        about = [one for one in names if ".dist-info/" in one]
        metadata = email.message_from_bytes(
            opened.read(next(one for one in about if one.endswith("/METADATA")))
        )
    held = set(names) - set(about)
    package = {one.removeprefix("src/") for one in known if one.startswith("src/")}
    _equal("the wheel", held, package)
    licensed = any(one.endswith("/licenses/LICENSE") for one in about)
    if not licensed or "myomorph/py.typed" not in held:
        raise NotReady("the wheel lacks the license or py.typed")
    _require_metadata(metadata)
    if wheel.stat().st_size > LARGEST_WHEEL:
        raise NotReady(f"the wheel has {wheel.stat().st_size >> 20} MiB")
    sources = _files_of(sdist)
    _equal("the sdist", sources - LEFT_BY_BUILD, known - LEFT_BY_BUILD)
    return (
        f"{len(held)} files in the wheel, {len(sources)} in the sdist, none missing, none too many"
    )


def _files_of(sdist: Path) -> set[str]:
    """Return the files of an sdist, relative to its folder."""
    with tarfile.open(sdist) as archive:
        return {one.name.partition("/")[2] for one in archive.getmembers() if one.isfile()}


def _require_metadata(metadata: Message) -> None:
    missing = [one for one in NEEDED if not metadata.get(one)]
    if missing or not metadata.get_payload():
        raise NotReady(f"the metadata lack {', '.join(missing) or 'the description'}")


def _equal(where: str, held: set[str], wanted: set[str]) -> None:
    if held != wanted:
        missing = sorted(wanted - held)
        more = sorted(held - wanted)
        raise NotReady(
            f"{where} lacks {missing[:9]} ({len(missing)}), and has {more[:9]} ({len(more)}) too"
            " many"
        )


def _installed(python: str, wheel: Path, folder: Path, demo: bool) -> tuple[str, str]:
    """Install the wheel alone, and run the program on a study and on a demo."""
    folder.mkdir()
    _said([python, "-m", "venv", str(folder / "venv")], folder)
    programs = folder / "venv" / ("Scripts" if os.name == "nt" else "bin")
    own = str(programs / "python")
    _said(
        [own, "-m", "pip", "install", "--quiet", "--disable-pip-version-check", str(wheel)], folder
    )
    _said([own, "-m", "pip", "check"], folder)
    version = _said(
        [own, "-c", "import platform; print(platform.python_version())"], folder
    ).strip()
    where = _said([own, "-c", "import myomorph; print(myomorph.__file__)"], folder)
    if "site-packages" not in where:
        raise NotReady(f"the package was taken from {where}")
    shutil.copytree(STUDY, folder / "étude à deux")
    shutil.copy(STUDY / "reach.trc", folder / "étude à deux" / "geste é 2.trc")
    program = str(programs / "myomorph")
    _said([program, "--version"], folder)
    steps = []
    for name, given, report in (
        (
            "study",
            ["run", str(Path("étude à deux") / "study.toml"), "--out", "résultats 1"],
            "results.csv",
        ),
        (
            "study again",
            ["run", str(Path("étude à deux") / "study.toml"), "--out", "résultats 1"],
            "results.csv",
        ),
        *([("demo", ["demo", "--out", "the demo"], "report.html")] if demo else ()),
    ):
        start = time.monotonic()
        _said([program, *given], folder)
        steps.append(f"{name} {time.monotonic() - start:.0f} s")
        if not (folder / given[-1] / report).is_file():
            raise NotReady(f"{name} left no {report}")
    return f"Python {version}", ", ".join(steps)


def _said(command: Sequence[str], folder: Path) -> str:
    """Return what a program prints; raise `NotReady` where it fails."""
    environment = {
        name: value
        for name, value in os.environ.items()
        if name not in ("PYTHONPATH", "VIRTUAL_ENV")
    }
    environment |= {"PYTHONIOENCODING": "utf-8", "PYTHONUTF8": "1"}
    ended = subprocess.run(
        command,
        cwd=folder,
        env=environment,
        capture_output=True,
        encoding="utf-8",
        errors="replace",
    )
    if ended.returncode:
        raise NotReady(
            f"{' '.join(command)} ended with {ended.returncode}:\n{ended.stdout}\n{ended.stderr}"
        )
    return ended.stdout


def _row(check: str, start: float, found: str) -> dict[str, object]:
    return {"check": check, "found": found, "seconds": round(time.monotonic() - start)}


def main() -> None:
    """Check what the command line names."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.release", description=__doc__)
    parser.add_argument(
        "--python", action="append", help="to install the wheel into; else this one"
    )
    parser.add_argument("--without-demo", action="store_true", help="run a small study alone")
    given = parser.parse_args()
    try:
        for row in checked(given.python or [sys.executable], not given.without_demo):
            print("; ".join(f"{key}: {value}" for key, value in row.items()), flush=True)
    except NotReady as error:
        sys.exit(f"not ready: {error}")


if __name__ == "__main__":
    main()
