"""The tables of docs/deprecated.md, as the package has them; `python -m docs_build.renamed` prints them."""

from __future__ import annotations

import sys

from myomorph.model import deprecated


def tables() -> str:
    """One table for options, files, variables, columns and arguments."""
    options = [_row(one.place, f"--{one.old}", f"--{one.new}") for one in deprecated.OPTIONS]
    options += [
        (f"`{one.place.split()[0]}`", f"{one.place.split()[1]} {one.old}", f"{one.place.split()[1]} {one.new}")
        for one in deprecated.OPTION_VALUES
    ]
    parts = [("Options of commands", ("command", "old", "new"), options)]
    keys = [
        (f"{kind}, `[{one.place}]`" if one.place else kind, one.old, one.new)
        for kind, names in deprecated.KEYS.items()
        for one in names
    ]
    keys += [
        (f"{kind}, `{one.place}`", f'"{one.old}"', f'"{one.new}"')
        for kind, own in deprecated.VALUES.items()
        for one in own
    ]
    parts.append(("Keys and values of files", ("file", "old", "new"), keys))
    arguments = [_row(*one) for one in deprecated.ARGUMENTS]
    parts.append(("Arguments of public functions", ("function", "old", "new"), arguments))
    parts.append(("Fields of public classes", ("class", "old", "new"), [_row(*one) for one in deprecated.FIELDS]))
    named = {"variable": deprecated.VARIABLES, "dimension": deprecated.DIMENSIONS, "attribute": deprecated.FACTS}
    stored = [(what, old, new) for what, names in named.items() for old, new in names.items()]
    parts.append(("NetCDF results", ("part", "old", "new"), stored))
    parts.append(("Tables of results", ("table", "old", "new"), [_row(*one) for one in deprecated.COLUMNS]))
    return "\n".join(_section(*one) for one in parts)


def _row(place: str, old: str, new: str) -> tuple[str, str, str]:
    return f"`{place}`", old, new


def _section(title: str, head: tuple[str, ...], rows: list[tuple[str, str, str]]) -> str:
    lines = [f"## {title}", "", f"| {' | '.join(head)} |", "|---|---|---|"]
    lines += [f"| {where} | `{old}` | `{new}` |" for where, old, new in rows]
    return "\n".join(lines) + "\n"


if __name__ == "__main__":
    sys.stdout.write(tables())
