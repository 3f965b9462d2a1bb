"""Measure tables of accuracy, and write them.

`python -m benchmarks.validation [TABLE ...]` measures some, or all.
"""

from __future__ import annotations

import argparse
import time
import traceback
from concurrent.futures import ProcessPoolExecutor, as_completed
from multiprocessing import get_context
from typing import NamedTuple

from benchmarks.accuracy.claims import claim_rows
from benchmarks.accuracy.sections import PAGES, measurement
from benchmarks.results import Row, save

COMMAND = "python -m benchmarks.validation"


def run(names: list[str] | None = None) -> list[Row]:
    """Measure tables by their names, all without names, write them, and return their rows.

    Tables of one page share what they simulate, so they run in one process; pages run side by side.
    """
    parts = _chosen(names)
    every = [name for part in parts for name in part]
    found: dict[str, list[Row]] = {}
    failed: list[str] = []
    # Each in a fresh process: OpenSim's module and ezc3d's do not get on.
    with ProcessPoolExecutor(mp_context=get_context("spawn"), max_tasks_per_child=1) as pool:
        waiting = {pool.submit(measured, part): part for part in parts if part}
        for done in as_completed(waiting):
            if error := done.exception():
                failed.append(f"{', '.join(waiting[done])}: {error!r}")
                continue
            part = done.result()
            found |= part.rows
            failed.extend(part.failed)
            for name, rows in part.rows.items():
                write(name, rows)
            written = ", ".join(part.rows)
            print(
                f"{len(found)} of {len(every)} tables; {written}: {part.seconds:.0f} s", flush=True
            )
    save("claims", claim_rows(), COMMAND)
    if failed:
        raise RuntimeError("; ".join(failed))
    return [{"table": name, **row} for name in every for row in found[name]]


def _chosen(names: list[str] | None) -> list[list[str]]:
    """Return the tables of each page that are named, all without names.

    Raises
    ------
    ValueError
        where there is no table of a name
    """
    parts = [[name for name in tables if not names or name in names] for tables in PAGES.values()]
    every = [name for part in parts for name in part]
    if unknown := sorted(set(names or ()) - set(every)):
        known = [name for tables in PAGES.values() for name in tables]
        raise ValueError(f"no table {', '.join(unknown)}; there are {', '.join(known)}")
    return parts


class Measured(NamedTuple):
    """Tables that one process measured.

    Attributes
    ----------
    rows : by table
    failed : names of tables that are missing, each with the error that it raised
    seconds : all of them took [s]
    """

    rows: dict[str, list[Row]]
    failed: list[str]
    seconds: float


def measured(names: list[str]) -> Measured:
    """Measure some tables; one that fails leaves the others as they are."""
    started = time.monotonic()
    rows: dict[str, list[Row]] = {}
    failed = []
    for name in names:
        try:
            rows[name] = list(measurement(name)())
        except Exception as error:
            traceback.print_exc()
            failed.append(f"{name}: {error!r}")
    return Measured(rows=rows, failed=failed, seconds=time.monotonic() - started)


def write(name: str, rows: list[Row]) -> None:
    """Write a table; one whose recordings are absent stays as it is."""
    if rows:
        save(f"validation/{name}", rows, f"{COMMAND} {name}")
    else:
        print(f"{name}: nothing measured, since the recordings are absent")


def main() -> None:
    """Measure what the command line names."""
    parser = argparse.ArgumentParser(prog=COMMAND, description=__doc__)
    parser.add_argument("names", nargs="*", metavar="TABLE", help="all where none is named")
    run(parser.parse_args().names)


if __name__ == "__main__":
    main()
