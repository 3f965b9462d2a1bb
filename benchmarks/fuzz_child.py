"""One reader under test in a process of its own: `python -m benchmarks.fuzz_child READER FOLDER SECONDS SEED`.

Inputs are made by `fuzz_mutations`; where the package atheris is there, it keeps those that reach new code and goes on
from them. Whatever comes out but a `MyomorphError` is written to FOLDER with the input. An input that takes longer than
`LIMIT`, or that ends the process, is left in FOLDER/input, where the parent finds it.
"""

from __future__ import annotations

import faulthandler
import hashlib
import json
import os
import random
import shutil
import sys
import time
import traceback
import warnings
from collections.abc import Callable
from pathlib import Path
from types import FunctionType

LIMIT = 20.0
"""Most seconds that an input may take."""

MEMORY = 1.5
"""Most memory that an input may take beyond what the program has at the start [GiB]."""

LONGEST_MESSAGE = 21_000
"""Letters of an error."""

INSTRUMENTED = (
    "io.",
    *(f"study.{one}" for one in ("plan", "study_file", "subject_", "measures", "group", "contact_file")),
)
INSTRUMENTED += tuple(f"study.{one}" for one in ("sound_plan", "stairs_file", "viscosity_plan", "species_table", "ct"))
INSTRUMENTED += tuple(f"study.{one}" for one in ("body_points", "results", "inputs", "inspect"))
INSTRUMENTED = tuple(f"myomorph.{one}" for one in INSTRUMENTED)
"""Modules, by the beginning of their names, in which atheris looks what code is reached."""


def is_line(text: str) -> bool:
    """Whether a text is a line that a terminal can show."""
    return len(text) < LONGEST_MESSAGE and len(text.splitlines()) == 1 and "\0" not in text and "\x1b" not in text


class Trial:
    """Inputs tried on one reader, and what came of them."""

    def __init__(self, name: str, folder: Path, seconds: float):
        from benchmarks.fuzz_readers import SEEDS, reader

        self.reader, self.folder = reader(name), folder
        self.inputs, self.slowest, self.start = 0, 0.0, time.monotonic()
        self.end = self.start + seconds
        self._told = 0.0
        self._state = folder / "state.json"
        self._known = {one.stem for one in folder.glob("found-*")}
        self._room = folder / "input"
        shutil.rmtree(self._room, ignore_errors=True)
        shutil.copytree(SEEDS, self._room)
        self._path = self._room / f"zz given{self.reader.ending}"
        self._stacks = (folder / "stacks.txt").open("w")

    def __call__(self, data: bytes) -> None:
        """Try one input."""
        from myomorph.model.errors import MyomorphError

        self._path.write_bytes(data)
        faulthandler.dump_traceback_later(LIMIT, exit=True, file=self._stacks)
        start = time.monotonic()
        try:
            self.reader.read(self._path)
        except MyomorphError as error:
            if not is_line(str(error)):
                self._keep(data, error, "message")
        except KeyboardInterrupt:
            raise
        except BaseException as error:
            self._keep(data, error, "memory" if isinstance(error, MemoryError) else "crash")
        finally:
            faulthandler.cancel_dump_traceback_later()
        self.inputs += 1
        self.slowest = max(self.slowest, time.monotonic() - start)
        if time.monotonic() > self._told + 0.2:
            self.tell()

    def tell(self) -> None:
        """Write how far it is."""
        self._told = time.monotonic()
        state = {"inputs": self.inputs, "slowest": self.slowest, "seconds": self._told - self.start}
        self._state.write_text(json.dumps(state), encoding="utf-8")

    def _keep(self, data: bytes, error: BaseException, kind: str) -> None:
        own = [one for one in traceback.extract_tb(error.__traceback__) if "myomorph" in one.filename]
        where = f"{Path(own[-1].filename).name}:{own[-1].lineno} {own[-1].name}" if own else ""
        said = f"{type(error).__name__} {where}"
        name = "found-" + hashlib.sha256(said.encode()).hexdigest()[:12]
        if name in self._known:
            return
        self._known.add(name)
        (self.folder / f"{name}.input").write_bytes(data)
        told = {"kind": kind, "said": said, "message": str(error)[:300], "trace": traceback.format_exc()[-3000:]}
        (self.folder / f"{name}.json").write_text(json.dumps(told), encoding="utf-8")


def main() -> None:
    """Try inputs until the time is over."""
    name, folder, seconds, seed = sys.argv[1], Path(sys.argv[2]), float(sys.argv[3]), int(sys.argv[4])
    warnings.simplefilter("ignore")
    guide = _guide()
    trial = Trial(name, folder, seconds)
    from benchmarks.fuzz_mutations import mutate
    from benchmarks.fuzz_readers import recordings

    seeds = trial.reader.seeds(recordings())
    trial(seeds[0])
    _limit_memory()
    for one in seeds:
        trial(one)
    if guide is None or trial.reader.guarded:
        chance = random.Random(seed)
        while time.monotonic() < trial.end:
            trial(mutate(chance.choice(seeds), seeds, chance))
        trial.tell()
    else:
        guide(trial, seeds, seed)


def _guide() -> Callable[[Trial, list[bytes], int], None] | None:
    """How atheris tries inputs, None where it is not installed."""
    try:
        import atheris
    except ImportError:
        return None
    import benchmarks.fuzz_readers  # noqa: F401

    # Instrumented while they are imported, modules would keep Numba from finding what it compiled before.
    for function in _functions():
        atheris.instrument_func(function)

    def guided(trial: Trial, seeds: list[bytes], seed: int) -> None:
        from benchmarks.fuzz_mutations import mutate

        corpus = trial.folder / "corpus"
        corpus.mkdir(exist_ok=True)
        for one in seeds:
            (corpus / hashlib.sha256(one).hexdigest()[:16]).write_bytes(one)

        def changed(data: bytes, most: int, seed: int) -> bytes:
            chance = random.Random(seed)
            if chance.random() < 0.3:
                return atheris.Mutate(data, most)
            return mutate(data, seeds, chance)[:most]

        left = max(int(trial.end - time.monotonic()), 1)
        options = [f"-max_total_time={left}", "-timeout=3600", "-rss_limit_mb=0", "-max_len=131072", "-detect_leaks=0"]
        options += [
            f"-artifact_prefix={trial.folder}/",
            f"-seed={seed}",
            "-print_final_stats=0",
            "-verbosity=0",
            "-reload=0",
            "-len_control=0",
        ]
        atheris.Setup(["fuzz", *options, str(corpus)], trial, custom_mutator=changed)
        atheris.Fuzz()

    return guided


def _functions() -> list[FunctionType]:
    """Functions and methods of the modules that are looked at."""
    modules = [module for name, module in list(sys.modules.items()) if name.startswith(INSTRUMENTED)]
    found: dict[int, FunctionType] = {}
    for module in modules:
        owners = [module, *(one for one in vars(module).values() if isinstance(one, type))]
        for owner in owners:
            for one in vars(owner).values():
                for part in (one, *(getattr(one, name, None) for name in ("__func__", "fget", "func"))):
                    if isinstance(part, FunctionType) and part.__module__ == module.__name__:
                        found[id(part)] = part
    return list(found.values())


def _limit_memory() -> None:
    """Let this process grow by `MEMORY` at most, where the system can do that."""
    import psutil

    from myomorph.io.parsing.guard import limit_memory

    if os.name == "posix":
        limit_memory(psutil.Process().memory_info().vms / 2**30 + MEMORY)


if __name__ == "__main__":
    main()
