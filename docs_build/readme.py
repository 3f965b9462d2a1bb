"""Numbers of the README, from the tables of results: `python -m docs_build.readme` puts them in.

Where the README is read nothing is put in its place, so each number stands there, and a comment
behind it, which readers do not see, names its cell, as `docs_build.tables` has it, or a count of
rows:

    **0.38<!-- knee :: default :: total, mean --> body weights**
    34<!-- count: laboratories :: ends with = report --> of 43<!-- count: laboratories -->

A bar would end a cell of the README's table.

`--pictures ADDRESS` gives links to files of this repository an address in the web, for indexes of
packages.
"""

from __future__ import annotations

import argparse
import re
from pathlib import Path

from benchmarks.results import load

from docs_build.tables import number

README = Path(__file__).resolve().parents[1] / "README.md"
MARKED = re.compile(r"(?P<shown>[\d.,]+)<!-- (?P<words>[^>]+?) -->")
LINK = re.compile(r"(?P<before>\]\(|src=\")(?!https?:|#)(?P<path>[^)\s\"]+)")


def with_numbers(text: str) -> str:
    """Return a text whose marked numbers are those of the tables."""
    return MARKED.sub(lambda found: f"{shown(found['words'])}<!-- {found['words']} -->", text)


def shown(words: str) -> str:
    """Write the number that a comment names, with as many digits as readers need.

    Parameters
    ----------
    words : of the comment


    Raises
    ------
    ValueError : there is no such cell
    """
    if words.startswith("count: "):
        return str(_count(words.removeprefix("count: ")))
    value = float(number(words.replace(" :: ", " | ")))
    if value >= 1000.0:
        rounded = float(f"{value:.2g}")
        return f"{rounded:,.0f}"
    if value >= 10.0:
        return f"{value:.0f}"
    return f"{value:.1f}" if value >= 1.0 else f"{value:.2f}"


def _count(words: str) -> int:
    """Count the rows of a table, all or those with a cell: "table :: column = cell"."""
    table, _, choice = words.partition(" :: ")
    rows = load(f"validation/{table}")
    if not choice:
        return len(rows)
    column, _, cell = choice.partition(" = ")
    return sum(row[column] == cell for row in rows)


def with_addresses(text: str, address: str) -> str:
    """Return a text whose links to files lead to an address in the web."""
    there = address.rstrip("/")
    return LINK.sub(lambda found: f"{found['before']}{there}/{found['path']}", text)


def main() -> None:
    """Put numbers, or addresses, into the README."""
    parser = argparse.ArgumentParser(prog="python -m docs_build.readme", description=__doc__)
    parser.add_argument("--pictures", metavar="ADDRESS", help="of the files of this repository")
    options = parser.parse_args()
    text = with_numbers(README.read_text(encoding="utf-8"))
    if options.pictures:
        text = with_addresses(text, options.pictures)
    README.write_text(text, encoding="utf-8")


if __name__ == "__main__":
    main()
