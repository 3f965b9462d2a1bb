"""Comparison of the folders of studies.

Whether they are whole and equal: every file opened, every byte or value compared.
"""

from __future__ import annotations

import csv
import json
import re
from collections import Counter
from collections.abc import Callable, Iterator
from pathlib import Path

from lxml import etree

OWN = {"study.log", "timings.csv", "study.json"}
"""What tells of the runs rather than of the results."""
UNFINISHED = re.compile(r"^\..+(\.[a-z0-9_]{8}|\.part|\.lock)$|^\.seen-by-workers-|^\.study\.lock$")
"""Names of files and folders that are not finished, and of locks."""


def finished(folder: Path) -> Iterator[Path]:
    """All files with a final name."""
    for path in sorted(folder.rglob("*")):
        parts = path.relative_to(folder).parts
        if path.is_file() and not any(UNFINISHED.match(one) for one in parts):
            yield path


def half_written(folder: Path) -> list[str]:
    """Files with a final name that are not whole, and why."""
    found = []
    for path in finished(folder):
        if path.name in OWN - {"study.json"}:
            continue
        try:
            READERS.get(path.suffix, _text)(path)
        except Exception as error:
            found.append(f"{path.relative_to(folder)}: {type(error).__name__}: {error}")
    return found


def _netcdf(path: Path) -> None:
    import h5py

    with h5py.File(path, "r") as file:
        file.visititems(lambda name, one: one[()] if isinstance(one, h5py.Dataset) else None)


def _table(path: Path) -> None:
    text = path.read_text(encoding="utf-8")
    if not text.endswith("\n"):
        raise ValueError("ends within a line")
    rows = list(csv.reader(text.splitlines()))
    if {len(row) for row in rows} != {len(rows[0])}:
        raise ValueError("rows of different lengths")


def _storage(path: Path) -> None:
    from myomorph.core.io.sto import read_sto

    told = re.search(r"nRows=(\d+)", path.read_text(encoding="utf-8"))
    if told is None or len(read_sto(path)) != int(told.group(1)):
        raise ValueError("lacks rows")


def _page(path: Path) -> None:
    if not path.read_text(encoding="utf-8").rstrip().endswith("</html>"):
        raise ValueError("ends within the page")


def _parquet(path: Path) -> None:
    import pyarrow.parquet

    pyarrow.parquet.read_table(path)


def _text(path: Path) -> None:
    path.read_bytes()


READERS: dict[str, Callable[[Path], object]] = {
    ".nc": _netcdf,
    ".csv": _table,
    ".sto": _storage,
    ".mot": _storage,
    ".html": _page,
    ".parquet": _parquet,
    ".json": lambda path: json.loads(path.read_text(encoding="utf-8")),
    ".osim": etree.parse,
    ".xml": etree.parse,
}


def differences(folder: Path, reference: Path, whole: bool = True) -> tuple[int, list[str]]:
    """Count the files compared with those of another folder, and name those that differ.

    Files are equal where they are so byte for byte.

    Parameters
    ----------
    folder : with results
    reference : the other folder
    whole : whether both must have the same files; else only trials' files that are there are
        compared
    """
    here = {path.relative_to(folder): path for path in finished(folder) if path.name not in OWN}
    there = {
        path.relative_to(reference): path for path in finished(reference) if path.name not in OWN
    }
    if not whole:
        here = {
            name: path
            for name, path in here.items()
            if len(name.parts) > 2 and ".steps" not in name.parts
        }
    told = [f"{name}: is not in the other" for name in sorted(set(here) - set(there))]
    if whole:
        told += [f"{name}: is missing" for name in sorted(set(there) - set(here))]
    both = sorted(set(here) & set(there))
    told += [
        f"{name}: differs" for name in both if here[name].read_bytes() != there[name].read_bytes()
    ]
    return len(both), told


def left_over(folder: Path) -> list[str]:
    """Files and folders that are not finished."""
    return [
        str(path.relative_to(folder))
        for path in sorted(folder.rglob("*"))
        if UNFINISHED.match(path.name)
    ]


def computed_twice(folder: Path) -> list[str]:
    """Name steps of finished trials computed again by later runs, from the recorded times."""
    with (folder / "timings.csv").open(encoding="utf-8", newline="") as stream:
        rows = Counter(
            (row["subject"], row["trial"], row["step"]) for row in csv.DictReader(stream)
        )
    return [f"{'/'.join(key)}: {count} times" for key, count in sorted(rows.items()) if count > 1]


def runs(folder: Path) -> int:
    """How often the study was begun."""
    return len(_lines(folder, "begin:"))


def losses(folder: Path) -> int:
    """How many workers were lost."""
    return len(_lines(folder, "lost"))


def ended(folder: Path) -> int:
    """How many jobs have ended well."""
    return len(_lines(folder, "done"))


def _lines(folder: Path, event: str) -> list[str]:
    """Lines of the log that tell of an event."""
    log = folder / "study.log"
    return (
        re.findall(rf"^\S+ {event} .*", log.read_text(encoding="utf-8"), re.MULTILINE)
        if log.is_file()
        else []
    )
