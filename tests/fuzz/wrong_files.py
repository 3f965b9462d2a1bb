"""Give every reader wrong files, in a process of its own: `python wrong_files.py EXAMPLES FOLDER`.

Prints the reader before it begins with it, and afterwards `reader: what came out` where that is no `MyomorphError`.
The process ends where an input takes longer than 20 s.
"""

from __future__ import annotations

import faulthandler
import random
import shutil
import sys
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path

import psutil
from benchmarks.fuzz_child import LIMIT, MEMORY, is_line
from benchmarks.fuzz_mutations import mutate
from benchmarks.fuzz_readers import READERS, SEEDS, Reader
from hypothesis import HealthCheck, Phase, given, settings
from hypothesis import strategies as st

from myomorph.io.parsing.guard import limit_memory
from myomorph.model.errors import MyomorphError


def wrong(reader: Reader, path: Path, examples: int) -> Callable[[], None]:
    """A property: whatever is done to a file, the reader reads it or says what is wrong with it."""
    seeds = reader.seeds()

    @settings(
        max_examples=examples,
        deadline=None,
        derandomize=True,
        database=None,
        phases=(Phase.generate,),
        suppress_health_check=list(HealthCheck),
    )
    @given(st.integers(0, 2**40))
    def holds(number: int) -> None:
        chance = random.Random(number)
        path.write_bytes(mutate(chance.choice(seeds), seeds, chance))
        faulthandler.dump_traceback_later(LIMIT, exit=True)
        try:
            reader.read(path)
        except MyomorphError as error:
            if not is_line(str(error)):
                raise ValueError(f"the message is no line for a terminal: {str(error)[:200]!r}") from None
        finally:
            faulthandler.cancel_dump_traceback_later()

    return holds


def main() -> int:
    """Try all readers that need no process for each file."""
    examples, folder = int(sys.argv[1]), Path(sys.argv[2]) / "wrong files"
    warnings.simplefilter("ignore")
    shutil.copytree(SEEDS, folder)
    limited = failed = 0
    for reader in READERS:
        if reader.guarded:
            continue
        print(f"begins with {reader.name}", flush=True)
        path = folder / f"zz given{reader.ending}"
        path.write_bytes(reader.seeds()[0])
        reader.read(path)
        if not limited:
            limit_memory(psutil.Process().memory_info().vms / 2**30 + MEMORY)
            limited = 1
        try:
            wrong(reader, path, examples)()
        except Exception as error:
            failed += 1
            own = [one for one in traceback.extract_tb(error.__traceback__) if "myomorph" in one.filename]
            print(
                f"{reader.name}: {type(error).__name__} {error!s:.300} {own[-1:]} {path.read_bytes()[:300]!r}",
                flush=True,
            )
    return int(failed > 0)


if __name__ == "__main__":
    sys.exit(main())
