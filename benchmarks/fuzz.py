"""Readers of files given wrong ones: inputs tried, and what came out but a clear error.

`python -m benchmarks.fuzz [--seconds S] [--reader NAME ...] [--keep FOLDER]`; every reader runs in a process of its
own, bounded in memory, and an input that takes longer than 20 s counts as a hang.
"""

from __future__ import annotations

import argparse
import json
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Iterator
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

from benchmarks.fuzz_readers import READERS

SECONDS = 30.0
AT_ONCE = 2
NOTHING = {"inputs": 0, "slowest": 0.0, "seconds": 0.0}
CHILD = "benchmarks.fuzz_child"


def run(seconds: float = SECONDS) -> list[dict[str, object]]:
    """One row a reader, for `seconds` each."""
    return list(rows(seconds))


def rows(seconds: float, names: list[str] | None = None, keep: Path | None = None) -> Iterator[dict[str, object]]:
    """Rows of all readers or of some, as they come; `keep` is a folder for what was found."""
    chosen = [one.name for one in READERS if not names or one.name in names]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE) as pool:
        root = keep or Path(folder)
        yield from pool.map(lambda name: _tried(name, root / name.replace(" ", "_"), seconds), chosen)


def _tried(name: str, folder: Path, seconds: float) -> dict[str, object]:
    """Try a reader; a process that an input ended is followed by another."""
    folder.mkdir(parents=True, exist_ok=True)
    inputs, slowest, runs, spent = 0, 0.0, 0, 0.0
    while (left := seconds - spent) > 0.5:
        runs += 1
        (folder / "state.json").unlink(missing_ok=True)
        with (folder / f"said-{runs}.txt").open("w") as said:
            command = [sys.executable, "-m", CHILD, name, str(folder), str(max(left, 1.0)), str(runs)]
            ended = subprocess.run(command, stdout=said, stderr=said, check=False)
        state = folder / "state.json"
        told = json.loads(state.read_text(encoding="utf-8")) if state.is_file() else NOTHING
        inputs, slowest = inputs + told["inputs"], max(slowest, told["slowest"])
        spent += told["seconds"]
        if ended.returncode == 0:
            break
        _keep_last(folder, runs, ended.returncode)
        if not told["inputs"] and runs > 3:
            break
    found = [json.loads(one.read_text(encoding="utf-8")) for one in sorted(folder.glob("found-*.json"))]
    return {
        "reader": name,
        "inputs": inputs,
        "seconds": round(spent),
        "slowest [s]": round(slowest, 2),
        "found": len(found),
        "what": ", ".join(f"{one['kind']}: {one['said']}" for one in found),
    }


def _keep_last(folder: Path, runs: int, status: int) -> None:
    """Keep the input that ended a process."""
    stacks = (folder / "stacks.txt").read_text(encoding="utf-8", errors="replace") if runs else ""
    kind = "hang" if stacks.strip() else f"ended with status {status}"
    for one in (folder / "input").glob("zz given*"):
        shutil.copy(one, folder / f"found-ended-{runs}.input")
    told = {"kind": kind, "said": stacks.strip()[:400], "message": "", "trace": stacks}
    (folder / f"found-ended-{runs}.json").write_text(json.dumps(told), encoding="utf-8")


def main() -> None:
    """Try what the command line names, and print the rows."""
    parser = argparse.ArgumentParser(prog="python -m benchmarks.fuzz", description=__doc__)
    parser.add_argument("--seconds", type=float, default=SECONDS, help="for each reader")
    parser.add_argument("--reader", action="append", choices=[one.name for one in READERS])
    parser.add_argument("--keep", type=Path, help="folder for what was found, and for the inputs that reach new code")
    given = parser.parse_args()
    for row in rows(given.seconds, given.reader, given.keep):
        print("; ".join(f"{key}: {value}" for key, value in row.items()), flush=True)


if __name__ == "__main__":
    main()
