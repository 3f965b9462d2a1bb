"""A map of marker labels in a file: from the recording's names to the model's."""

from __future__ import annotations

import io
import os
import tomllib
from pathlib import Path

from myomorph.core.io.parsing.cells import csv_rows
from myomorph.core.io.parsing.text import file_text
from myomorph.core.model.errors import BadData, BadFile

HINT = (
    'expected lines of "recorded,model" (.csv) or of recorded = "model" (.toml); an empty name'
    " drops a marker"
)
HEADINGS = ("label", "labels", "recorded", "recording", "from", "name")


def read_labels(path: str | os.PathLike[str]) -> dict[str, str]:
    """Read which marker of the model each recorded label is.

    A CSV file has two columns (separated by comma, semicolon or tab), with a heading or without,
    and lines that begin with # are remarks. A TOML file has a line for each label, alone or in a
    table `[labels]`.

    Parameters
    ----------
    path : of the file (.csv, .tsv, .txt or .toml)

    Returns
    -------
    the model's marker by recorded label, "" where the marker is to be left out

    Raises
    ------
    BadFile : its name has another ending, it is not of pairs of names, a label stands for two
        markers, or it holds no label
    """
    path = Path(path)
    ending = path.suffix.lower()
    if ending not in (".csv", ".tsv", ".txt", ".toml"):
        raise BadFile(path, f"is no map of labels: its name ends in '{ending}'", HINT)
    text = file_text(path, HINT, "settings")
    try:
        result = _from_toml(path, text) if ending == ".toml" else _from_csv(path, text)
    except BadData as error:
        raise BadFile(path, f"is no table of labels ({error})", HINT) from None
    if not result:
        raise BadFile(path, "holds no label", HINT)
    return result


def _from_toml(path: Path, text: str) -> dict[str, str]:
    try:
        read = tomllib.loads(text)
    except tomllib.TOMLDecodeError as error:
        raise BadFile(path, f"is not TOML: {error}", HINT) from None
    table = read.get("labels", read)
    if not isinstance(table, dict) or not all(isinstance(name, str) for name in table.values()):
        raise BadFile(
            path, "holds something else than names", HINT + "; labels with dots in quotes"
        )
    return {label.strip(): name.strip() for label, name in table.items()}


def _from_csv(path: Path, text: str) -> dict[str, str]:
    lines = [
        line for line in text.splitlines() if line.strip() and not line.lstrip().startswith("#")
    ]
    if not lines:
        return {}
    sign = max(",;\t", key=lines[0].count)
    result: dict[str, str] = {}
    for number, row in enumerate(csv_rows(io.StringIO("\n".join(lines)), delimiter=sign)):
        cells = [cell.strip() for cell in row]
        if len(cells) == 1 or (len(cells) > 2 and any(cells[2:])):
            raise BadFile(path, f"has a line of {len(cells)} cells: '{sign.join(row)}'", HINT)
        label, name = cells[:2]
        if number == 0 and label.lower() in HEADINGS:
            continue
        if result.get(label, name) != name:
            raise BadFile(path, f"has label '{label}' twice: '{result[label]}' and '{name}'", HINT)
        result[label] = name
    return result
