"""Run a reader that may hang, crash or eat memory in a process of its own, with a time limit."""

from __future__ import annotations

import os
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import myomorph

GIGABYTE = 1 << 30


@dataclass(frozen=True)
class Outcome:
    """How a guarded run ended, and what it said last."""

    status: Literal["done", "failed", "hung"]
    message: str = ""


def run_guarded(module: str, arguments: Sequence[str], seconds: float) -> Outcome:
    """Run `python -m module arguments` and wait for `seconds` at most.

    The child starts in the folder that holds the package, so paths among `arguments` must be
    absolute. Its last line on standard error is the message of a failure.
    """
    home = Path(myomorph.__file__).resolve().parents[1]
    # The child does no linear algebra: one thread makes its start shorter.
    environment = {**os.environ, "OPENBLAS_NUM_THREADS": "1", "OMP_NUM_THREADS": "1", "PYTHONIOENCODING": "utf-8"}
    try:
        child = subprocess.run(
            [sys.executable, "-m", module, *arguments],
            cwd=home,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            timeout=seconds,
            creationflags=getattr(subprocess, "CREATE_NO_WINDOW", 0),
            check=False,
        )
    except subprocess.TimeoutExpired:
        return Outcome("hung", f"did not end within {seconds:.0f} s")
    except OSError as error:
        return Outcome("failed", f"could not be started ({error})")
    if child.returncode == 0:
        return Outcome("done")
    said = [line.strip() for line in child.stderr.decode("utf-8", errors="replace").splitlines() if line.strip()]
    return Outcome("failed", said[-1] if said else f"ended with status {child.returncode}")


def limit_memory(gigabytes: float) -> None:
    """Let this process take `gigabytes` of address space at most, where the system can do that."""
    try:
        import resource
    except ImportError:
        return
    size = int(gigabytes * GIGABYTE)
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or size < hard:
        resource.setrlimit(resource.RLIMIT_AS, (size, hard))
