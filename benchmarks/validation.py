"""All comparisons of accuracy, written as docs/validation: `python -m benchmarks validation`.

`python -m benchmarks.validation SECTION ...` measures some sections anew and keeps the tables of the others;
without a section it writes the pages again from the tables that they have.
"""

from __future__ import annotations

import json
import sys
import time
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from pathlib import Path

from benchmarks.accuracy.claims import front_table
from benchmarks.accuracy.sections import Page, Row, pages
from benchmarks.cases import data_folder

FOLDER = Path(__file__).resolve().parents[1] / "docs" / "validation"
TEXT = Path(__file__).resolve().parent / "validation_text"
FRONT = "index.md"


def run(keep: Path | None = None) -> list[Row]:
    """Measure every section, write the pages, and return all rows.

    Parameters
    ----------
    keep : file for the rows found so far, as JSON by section
    """
    names = [name for page in pages(data_folder()) for name in page.sections]
    found = _measured(names, keep)
    write({name: as_table(found[name]) for name in names})
    return [{"section": name, **row} for name in names for row in found[name]]


def renew(names: list[str]) -> None:
    """Measure these sections and write the pages with the tables that they have of the others."""
    found = _measured(names, None)
    write(tables() | {name: as_table(found[name]) for name in names})


def tables() -> dict[str, str]:
    """The printed table of every section that the pages hold."""
    found = {}
    for page in pages(data_folder()):
        path = FOLDER / f"{page.name}.md"
        lines = path.read_text(encoding="utf-8").splitlines() if path.is_file() else []
        headings = {_text(page, name).splitlines()[0]: name for name in page.sections}
        starts = [i for i, line in enumerate(lines) if line in headings]
        # A page that is new has no sections yet.
        for start, end in zip(starts, [*starts[1:], len(lines)][: len(starts)], strict=True):
            table = [line for line in lines[start:end] if line.startswith(("|", "(nothing measured"))]
            found[headings[lines[start]]] = "\n".join(table) + "\n"
    return found


def write(found: dict[str, str]) -> None:
    """Write the front page and all others from the tables of their sections."""
    FOLDER.mkdir(exist_ok=True)
    known = pages(data_folder())
    for page in known:
        text = f"# {page.title}\n\n{page.lead}\n"
        for name in page.sections:
            text += "\n" + _text(page, name) + "\n" + (found.get(name, "").strip() or "(not measured yet)") + "\n"
        (FOLDER / f"{page.name}.md").write_text(text, encoding="utf-8")
    where = {name: f"{page.name}.md" for page in known for name in page.sections}
    text = (TEXT / "head.md").read_text(encoding="utf-8") + front_table(found, where) + "\n"
    text += "Pages: " + ", ".join(f"[{page.title}]({page.name}.md)" for page in known) + ".\n"
    (FOLDER / FRONT).write_text(text, encoding="utf-8")


def _text(page: Page, section: str) -> str:
    return (TEXT / page.name / f"{section}.md").read_text(encoding="utf-8")


def _measured(names: list[str], keep: Path | None) -> dict[str, list[Row]]:
    """Rows of some sections, by their names.

    Sections of one page share what they simulate, so they run in one process; pages run side by side.
    """
    parts = [[name for name in page.sections if name in names] for page in pages(data_folder())]
    found: dict[str, list[Row]] = {}
    failed: list[str] = []
    # Each in a fresh process: OpenSim's module and ezc3d's do not get on.
    with ProcessPoolExecutor(mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        waiting = {pool.submit(measured, part): part for part in parts if part}
        for done in as_completed(waiting):
            if error := done.exception():
                failed.append(f"{', '.join(waiting[done])}: {error!r}")
                continue
            part, seconds = done.result()
            found |= part
            print(f"{len(found)} of {len(names)} sections; {', '.join(part)}: {seconds:.0f} s", flush=True)
            if keep is not None:
                keep.write_text(json.dumps(found, default=float))
    unknown = set(names) - {name for part in parts for name in part}
    if failed or unknown:
        raise RuntimeError("; ".join([*failed, *(f"no section '{name}'" for name in sorted(unknown))]))
    return found


def measured(names: list[str]) -> tuple[dict[str, list[Row]], float]:
    """Rows of some sections by their names, and how long they took [s]."""
    started = time.monotonic()
    known = {name: measure for page in pages(data_folder()) for name, measure in page.sections.items()}
    return {name: list(known[name]()) for name in names}, time.monotonic() - started


def as_table(rows: list[Row]) -> str:
    """Rows as a Markdown table; the columns are the keys of the first."""
    if not rows:
        return "(nothing measured: the data collection is absent)\n"
    keys = list(rows[0])
    lines = ["| " + " | ".join(keys) + " |", "| " + " | ".join("---" for _ in keys) + " |"]
    lines += ["| " + " | ".join(_cell(row.get(key, "")) for key in keys) + " |" for row in rows]
    return "\n".join(lines) + "\n"


def _cell(value: object) -> str:
    if isinstance(value, float):
        return f"{value:.3g}"
    return json.dumps(value) if isinstance(value, dict) else str(value).replace("|", "/")


if __name__ == "__main__":
    renew(sys.argv[1:])
