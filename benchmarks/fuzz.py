"""Readers of files given wrong ones: inputs tried, and what came out but a clear error.

`python -m benchmarks fuzz [--inputs N] [--reader NAME ...] [--keep FOLDER]`; every reader of
`tests/fuzz` runs in a process of its own, bounded in memory, and an input that takes longer than 20
s counts as a hang. Readers that start a process for each file get fewer inputs, and the endings of
one kind of file share them.
"""

from __future__ import annotations

import argparse
import json
import os
import subprocess
import sys
import tempfile
from collections import Counter
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

FOLDER = Path(__file__).resolve().parents[1] / "tests" / "fuzz"
AT_ONCE = 2
SHARE = 12  # Of inputs, for readers that start a process for each file.
INPUTS = 2500


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument("--inputs", type=int, default=INPUTS, help="for each reader")
    parser.add_argument(
        "--reader", action="append", help="only those whose names begin so; may be repeated"
    )
    parser.add_argument(
        "--keep", type=Path, help="folder for the files that made something be found"
    )


def run(
    inputs: int = INPUTS, reader: list[str] | None = None, keep: Path | None = None
) -> list[dict[str, object]]:
    """Return one row per reader, with so many inputs each."""
    from fuzz_readers import READERS

    chosen = [known for known in READERS if not reader or known.name.startswith(tuple(reader))]
    kinds = Counter(known.read for known in chosen)
    counts = [inputs // SHARE // kinds[known.read] if known.guarded else inputs for known in chosen]
    names = [known.name for known in chosen]
    with tempfile.TemporaryDirectory() as folder, ThreadPoolExecutor(AT_ONCE) as pool:
        folders = [(keep or Path(folder)) / name for name in names]
        return list(pool.map(_tried, names, folders, counts))


def _tried(name: str, folder: Path, inputs: int) -> dict[str, object]:
    """Try a reader; a process that an input ended is followed by another."""
    folder.mkdir(parents=True, exist_ok=True)
    total = {"inputs": 0, "slowest": 0.0, "seconds": 0.0}
    findings: list[str] = []
    for attempt in range(20):
        left = inputs - total["inputs"]
        command = [sys.executable, str(FOLDER / "wrong_files.py"), str(folder), "--reader", name]
        environment = {**os.environ, "PYTHONPATH": os.pathsep.join(sys.path)}
        ended = subprocess.run(
            [*command, "--inputs", str(left), "--start", str(attempt + 1)],
            env=environment,
            cwd=folder,
            capture_output=True,
            encoding="utf-8",
            errors="replace",
            check=False,
        )
        lines = [json.loads(line) for line in ended.stdout.splitlines() if line.startswith("{")]
        last = next(
            (line for line in reversed(lines) if "inputs" in line),
            {"inputs": 0, "slowest": 0.0, "seconds": 0.0},
        )
        total = {
            key: max(value, last[key]) if key == "slowest" else value + last[key]
            for key, value in total.items()
        }
        findings += [line["found"] for line in lines if "found" in line]
        # Who watches for hangs ends the process with 1, as findings do.
        hung = "Timeout" in ended.stderr
        whole = ended.returncode in (0, 1) and not hung
        if not whole:
            findings.append("hang" if hung else f"ended with status {ended.returncode}")
        if whole or total["inputs"] >= inputs:
            break
    return {
        "reader": name,
        "inputs": total["inputs"],
        "seconds": round(total["seconds"]),
        "slowest [s]": round(total["slowest"], 2),
        "found": len(findings),
        "what": ", ".join(dict.fromkeys(findings)),
    }
