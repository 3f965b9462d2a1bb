"""Give readers wrong files, in a process of its own.

    python wrong_files.py FOLDER (--examples N | --inputs N)

With `--examples` every reader that needs no process for each file gets so many, the same ones every
time; with `--inputs` one `--reader` gets so many, guided by the code that they reach where the
package atheris is installed. Printed are `begins with READER`, the number of files and
the slowest now and then, and each finding once: whatever came out but a `MyomorphError` of one
line. The process ends where a file takes longer than `LIMIT`.
"""

from __future__ import annotations

import argparse
import faulthandler
import json
import shutil
import sys
import time
import traceback
import warnings
from collections.abc import Sequence
from pathlib import Path
from types import FunctionType

import psutil
from fuzz_readers import READERS, SEEDS, Reader, recordings
from wrong_bytes import MAX_CHOICES, Choices, ProvidedChoices, RandomChoices, wrong_file

from myomorph.core.io.parsing.guard import limit_memory
from myomorph.core.model.errors import MyomorphError

LIMIT = 20.0
"""Most seconds that a file may take."""
MEMORY = 1.5
"""Most memory that reading may take beyond what the program has at the start [GiB]."""
LONGEST_MESSAGE = 21_000
"""Characters of an error."""
WATCHED = 1.0
"""The watch for files that take too long begins anew after so long, not with each file [s]."""


class Attempts:
    """Files that a reader was given, and what came of them."""

    def __init__(self, reader: Reader, folder: Path):
        self.reader = reader
        self.files = 0
        self.slowest = 0.0
        self.begun = time.monotonic()
        self.path = folder / reader.file_name
        self.findings: set[str] = set()
        self.told = self.begun
        self.watched = -WATCHED

    def __call__(self, data: bytes) -> None:
        """Read one file."""
        self.path.write_bytes(data)
        start = time.monotonic()
        if start > self.watched + WATCHED:
            faulthandler.dump_traceback_later(LIMIT + WATCHED, exit=True)
            self.watched = start
        try:
            self.reader.read(self.path)
        except MyomorphError as error:
            text = str(error)
            if (
                len(text) > LONGEST_MESSAGE
                or len(text.splitlines()) != 1
                or {"\0", "\x1b"} & set(text)
            ):
                self._found("message", error, data)
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._found("memory" if isinstance(error, MemoryError) else "crash", error, data)
        now = time.monotonic()
        self.files, self.slowest = self.files + 1, max(self.slowest, now - start)
        if now > self.told + 0.2:
            self.tell()

    def wrong(self, choices: Choices, files: Sequence[bytes]) -> None:
        """Read a file that is one of some made wrong."""
        self(wrong_file(choices, files))

    def tell(self) -> None:
        """Print how far it is."""
        self.told = time.monotonic()
        _print({"inputs": self.files, "slowest": self.slowest, "seconds": self.told - self.begun})

    def _found(self, kind: str, error: BaseException, data: bytes) -> None:
        frames = [
            frame
            for frame in traceback.extract_tb(error.__traceback__)
            if "myomorph" in frame.filename
        ]
        place = (
            f"{Path(frames[-1].filename).name}:{frames[-1].lineno} {frames[-1].name}"
            if frames
            else ""
        )
        what = f"{kind}: {type(error).__name__} {place}"
        if what not in self.findings:
            self.findings.add(what)
            kept = (
                self.path.parent.parent
                / f"found {self.reader.name} {len(self.findings)}{self.reader.ending}"
            )
            kept.write_bytes(data)
            _print(
                {
                    "reader": self.reader.name,
                    "found": what,
                    "message": str(error)[:300],
                    "file": kept.name,
                }
            )


def _print(facts: dict[str, object]) -> None:
    print(json.dumps(facts), flush=True)


def some(attempts: Attempts, examples: int) -> None:
    """Read the first files of a reader, the same every time."""
    choices = RandomChoices(0)
    files = attempts.reader.seeds()
    for _ in range(examples):
        attempts.wrong(choices, files)


def many(attempts: Attempts, inputs: int, start: int) -> None:
    """Read whole files and wrong ones, other ones for each `start`."""
    files = attempts.reader.seeds(recordings())
    for data in files:
        attempts(data)
    if not attempts.reader.guarded and _guided(attempts, files, inputs, start):
        return
    choices = RandomChoices(start)
    for _ in range(inputs):
        attempts.wrong(choices, files)


def _guided(attempts: Attempts, files: Sequence[bytes], inputs: int, start: int) -> bool:
    """Let atheris choose; False where it is not installed."""
    try:
        import atheris
    except ImportError:
        return False
    # Instrumented while they are imported, modules would keep Numba from finding what it compiled
    # before.
    for module in [
        module
        for name, module in sys.modules.items()
        if name.startswith(("myomorph.core.io", "myomorph.lab.study"))
    ]:
        for owner in (
            module,
            *(value for value in vars(module).values() if isinstance(value, type)),
        ):
            for function in vars(owner).values():
                if isinstance(function, FunctionType) and function.__module__ == module.__name__:
                    atheris.instrument_func(function)
    last = attempts.files + inputs

    def read(data: bytes) -> None:
        attempts.wrong(ProvidedChoices(data), files)
        if attempts.files >= last:
            # The fuzzer ends the process.
            attempts.tell()

    limits = [
        f"-runs={inputs}",
        f"-seed={start}",
        "-len_control=0",
        "-timeout=3600",
        "-rss_limit_mb=0",
    ]
    atheris.Setup(
        ["fuzz", *limits, f"-max_len={MAX_CHOICES}", "-verbosity=0"],
        read,
    )
    atheris.Fuzz()
    return True


def main() -> int:
    """Try the readers that the command line names; 1 where something was found."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("folder", type=Path)
    parser.add_argument("--examples", type=int)
    parser.add_argument("--inputs", type=int)
    parser.add_argument("--start", type=int, default=0)
    parser.add_argument("--reader", choices=[reader.name for reader in READERS])
    options = parser.parse_args()
    warnings.simplefilter("ignore")
    folder = options.folder / "wrong files"
    shutil.rmtree(folder, ignore_errors=True)
    shutil.copytree(SEEDS, folder)
    findings = 0
    chosen = [
        reader
        for reader in READERS
        if reader.name == options.reader or not (options.reader or reader.guarded)
    ]
    for number, reader in enumerate(chosen):
        print(f"begins with {reader.name}", flush=True)
        attempts = Attempts(reader, folder)
        attempts(reader.seeds()[0])
        if number == 0:
            limit_memory(psutil.Process().memory_info().vms / 2**30 + MEMORY)
        if options.examples:
            some(attempts, options.examples)
        else:
            many(attempts, options.inputs, options.start)
        attempts.tell()
        findings += len(attempts.findings)
    return int(findings > 0)


if __name__ == "__main__":
    sys.exit(main())
