"""Tables of labels: what a recording calls a marker or channel, and what it is to be called."""

from __future__ import annotations

import csv
import os
import tomllib
from pathlib import Path

from myomorph.io.parsing.text import file_text
from myomorph.model.errors import BadFile

HINT = "give lines of 'label,new name' (.csv), or a table of label = \"new name\" (.toml); an empty new name drops one"


def read_label_table(path: str | os.PathLike[str]) -> dict[str, str]:
    """New names by label, "" for one that is dropped.

    Raises
    ------
    BadFile
        where a line does not hold two names, or a label stands twice
    """
    path = Path(path)
    text = file_text(path, HINT)
    if path.suffix.lower() == ".toml":
        try:
            found = tomllib.loads(text)
        except tomllib.TOMLDecodeError as error:
            raise BadFile(path, f"is no TOML file ({error})", HINT) from None
        found = found.get("labels", found)
        if not all(isinstance(one, str) for one in found.values()):
            raise BadFile(path, "holds something else than names", HINT)
        return found
    labels: dict[str, str] = {}
    for number, row in enumerate(csv.reader(text.splitlines()), start=1):
        cells = [cell.strip() for cell in row]
        if not any(cells) or cells[0].startswith("#") or (number == 1 and cells[0].lower() in ("label", "name", "old")):
            continue
        if len(cells) != 2 or not cells[0]:
            raise BadFile(path, f"line {number} holds {len(cells)} cells", HINT)
        if cells[0] in labels:
            raise BadFile(path, f"label '{cells[0]}' stands twice", HINT)
        labels[cells[0]] = cells[1]
    return labels
