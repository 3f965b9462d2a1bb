"""Tables and numbers of results in pages: what commands wrote as CSV files under docs/results.

A line that is a link to such a file stands for its table, with a choice of rows behind the address
if need be:

    [Results: models](../results/validation/models.csv)
    [Results: morph](results/performance/morph.csv "rows with map")
    [Results: elastic](results/performance/elastic.csv "rows with frames = 1500")
    [Results: masspoints](results/performance/masspoints.csv "rows without links")

Where pages are read as they are, it is a link that can be followed. Columns that are empty in all
rows shown are left out. A number within a sentence names its table, row and column; a row is known
by one cell or several:

    {{ knee | default | total, mean }}
    {{ performance/start | myomorph demo, later | seconds }}
    {{ uncertainty_knee | walk1; default | total, inside [%] }}

A table, row or column that does not exist ends the building of the site.
"""

from __future__ import annotations

import re
from pathlib import Path

from benchmarks.results import LOG, Table, load

DOCS = Path(__file__).resolve().parents[1] / "docs"
SHOWN = re.compile(
    r"^\[(?P<text>[^\]]+)\]\((?P<path>[\w./-]*results/(?P<table>[\w/-]+)\.csv)(?:"
    r" \"(?P<choice>[^\"]*)\")?\)$",
    re.MULTILINE,
)
NUMBER = re.compile(r"\{\{ (?P<words>[^{}]+?) \}\}")


def rendered(markdown: str, page: str) -> str:
    """Return a page with its tables and numbers in place.

    Parameters
    ----------
    markdown : of the page
    page : its path under docs, for links to other pages
    """
    text = SHOWN.sub(lambda line: _shown(line, page), markdown)
    return NUMBER.sub(lambda words: number(words["words"]), text)


def pages_of_tables() -> dict[str, str]:
    """Path under docs of the page that shows a table, by the table."""
    found: dict[str, str] = {}
    for path in sorted(DOCS.rglob("*.md")):
        for line in SHOWN.finditer(path.read_text(encoding="utf-8")):
            found.setdefault(line["table"], path.relative_to(DOCS).as_posix())
    return found


def number(words: str) -> str:
    """Return the cell that "table | row | column" names.

    Raises
    ------
    ValueError
        where there is no such cell, or where more than one row has the words
    """
    try:
        table, row, column = map(str.strip, words.split(" | "))
    except ValueError:
        raise ValueError(f"'{words}' is not 'table | row | column'") from None
    rows = load(table if "/" in table else f"validation/{table}")
    wanted = {part.strip() for part in row.split(";")}
    chosen = [one for one in rows if wanted <= set(one.values())]
    if len(chosen) != 1:
        raise ValueError(f"'{words}': {len(chosen)} rows of {table} have these cells")
    if not chosen[0].get(column):
        raise ValueError(f"'{words}': nothing there; the columns are {', '.join(rows[0])}")
    return chosen[0][column]


def _shown(line: re.Match[str], page: str) -> str:
    """Table, and below it the file, the command, date, commit and machine."""
    table = line["table"]
    rows = chosen(load(table), line["choice"] or "")
    if table == "claims":
        rows = [_linked(row, page) for row in rows]
    made = next(row for row in load(LOG) if row["table"] == table)
    parts = [f"[{table.rpartition('/')[2]}.csv]({line['path']})", f"`{made['command']}`"]
    parts += [
        made["date"],
        f"commit {made['commit']}",
        *([made["machine"]] if made["machine"] else []),
    ]
    return f"{as_markdown(rows)}\n{', '.join(parts)}\n{{ .results }}\n"


def chosen(rows: Table, choice: str) -> Table:
    """Return the rows "with COLUMN", "with COLUMN = CELL" or "without COLUMN".

    Columns that are empty in all of these rows are left out.

    Raises
    ------
    ValueError
        where no row is like that
    """
    if choice:
        _, kind, rest = choice.split(" ", 2)
        column, _, cell = rest.partition(" = ")
        rows = [
            row
            for row in rows
            if (row[column] == cell if cell else bool(row[column])) == (kind == "with")
        ]
    if not rows:
        raise ValueError(f"no rows '{choice}'")
    return [
        {column: cell for column, cell in row.items() if any(each[column] for each in rows)}
        for row in rows
    ]


def as_markdown(rows: Table) -> str:
    """Rows as a Markdown table."""
    # Two brackets of code in a row would be a reference.
    cells = [[cell.replace("][", "]&#91;") for cell in row.values()] for row in rows]
    lines = [list(rows[0]), ["---"] * len(rows[0]), *cells]
    return "".join(f"| {' | '.join(cells)} |\n" for cells in lines)


def _linked(row: dict[str, str], page: str) -> dict[str, str]:
    """Return a claim whose cell "table" leads to the page that shows that table."""
    target = pages_of_tables()[f"validation/{row['table']}"]
    up = "../" * page.count("/")
    return {**row, "table": f"[{row['table']}]({up}{target})"}
