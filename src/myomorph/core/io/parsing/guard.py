"""Read in a process of its own what may hang, crash or eat memory.

C3D, MJCF and HDF5 are read by libraries of others.

`python -m myomorph.core.io.parsing.guard MODULE FUNCTION GIGABYTES SECONDS TEXT...` is the child's
side.
"""

from __future__ import annotations

import importlib
import os
import signal
import subprocess
import sys
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Literal

import myomorph

try:
    import resource
except ImportError:  # Windows has no such limits.
    resource = None  # type: ignore[assignment]

GIGABYTE = 1 << 30
BYTES_PER_SECOND = 20e6  # The slowest at which a sound file is read.
LONGEST = 300  # Characters of a message.
# Ends of a process by its processor time: the signals for it, as a parent or a shell sees them.
_OUT_OF_TIME = tuple(
    sign * int(number) + offset
    for name in ("SIGXCPU", "SIGKILL")
    if (number := getattr(signal, name, None)) is not None
    for sign, offset in ((-1, 0), (1, 128))
)


@dataclass(frozen=True)
class Outcome:
    """How a guarded run ended.

    Attributes
    ----------
    status : "done", "failed", or "hung" where its time was over
    message : last line that it wrote, or the error that stopped it
    """

    status: Literal["done", "failed", "hung"]
    message: str = ""


def seconds_for(path: Path) -> float:
    """Return how long a library may take for a file of this size [s].

    Parameters
    ----------
    path : of the file, which must exist
    """
    return 10.0 + path.stat().st_size / BYTES_PER_SECOND


def run_guarded(
    function: str,
    arguments: Sequence[str | os.PathLike[str]],
    seconds: float,
    gigabytes: float = 16.0,
    processor_seconds: float = 0.0,
) -> Outcome:
    """Call a function with texts in a child process, which is stopped when its time is over.

    Its result is dropped, an error is the message of a failure. The child starts in the folder that
    holds the package, so paths among `arguments` must be absolute.

    Parameters
    ----------
    function : as "module:name"
    arguments : texts or absolute paths
    seconds : time allowed [s]
    gigabytes : limit of the child's address space, where the system has such limits [GiB]
    processor_seconds : limit of the child's processor time, of all its threads together, where the
        system has such limits; 0 for none [s]

    Returns
    -------
    "done", "failed" with a message, or "hung" where either time was over
    """
    home = Path(myomorph.__file__).resolve().parents[1]
    # The child does no linear algebra: one thread makes its start shorter.
    environment = {
        **os.environ,
        "OPENBLAS_NUM_THREADS": "1",
        "OMP_NUM_THREADS": "1",
        "PYTHONIOENCODING": "utf-8",
    }
    try:
        child = subprocess.run(
            [
                sys.executable,
                "-m",
                __name__,
                *function.split(":"),
                str(gigabytes),
                str(processor_seconds),
                *(os.fspath(argument) for argument in arguments),
            ],
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
    if processor_seconds and child.returncode in _OUT_OF_TIME:
        return Outcome("hung", f"took more than {processor_seconds:.0f} s of processor time")
    lines = [
        line.strip()
        for line in child.stderr.decode("utf-8", errors="replace").splitlines()
        if line.strip()
    ]
    return Outcome("failed", lines[-1] if lines else f"ended with status {child.returncode}")


def limit_processor_time(seconds: float) -> None:
    """Limit the processor time of this process, where the system can do that.

    Parameters
    ----------
    seconds : of all threads together [s]; 0 for no limit
    """
    if resource is None or seconds <= 0.0:
        return
    whole = max(1, round(seconds))
    _, hard = resource.getrlimit(resource.RLIMIT_CPU)
    # A second after the signal that it may catch, the process is killed.
    if hard == resource.RLIM_INFINITY or whole < hard:
        resource.setrlimit(resource.RLIMIT_CPU, (whole, whole + 1))


def limit_memory(gigabytes: float) -> None:
    """Limit the address space of this process, where the system can do that.

    Parameters
    ----------
    gigabytes : largest address space [GiB]; a lower limit that exists stays
    """
    if resource is None:
        return
    size = int(gigabytes * GIGABYTE)
    _, hard = resource.getrlimit(resource.RLIMIT_AS)
    if hard == resource.RLIM_INFINITY or size < hard:
        resource.setrlimit(resource.RLIMIT_AS, (size, hard))


def _main(module: str, name: str, gigabytes: str, seconds: str, *arguments: str) -> int:
    """Run the child's side: the function's error becomes one line and exit status 1."""
    function = getattr(importlib.import_module(module), name)
    limit_memory(float(gigabytes))
    limit_processor_time(float(seconds))
    try:
        function(*arguments)
    except MemoryError:
        problem = "asked for more memory than such a file can need"
    except Exception as error:
        problem = " ".join(str(error).split())[:LONGEST] or type(error).__name__
    else:
        return 0
    sys.stderr.write(f"{problem}\n")
    return 1


if __name__ == "__main__":
    sys.exit(_main(*sys.argv[1:]))
