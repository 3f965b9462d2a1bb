"""Tests on a changed tree: which of them run a line, and whether one of them fails.

One process per test file, forked from one that has the libraries loaded. The first run of a file that no change makes
fail is traced: which lines of the rooms each of its tests runs, compiled kernels counted as run, whole, when they or a
kernel that calls them are called. Later runs take the tests that reach the changed line, the fastest first.
"""

from __future__ import annotations

import ast
import contextlib
import json
import multiprocessing
import os
import re
import resource
import shutil
import signal
import sys
import threading
import time
from collections.abc import Iterator
from functools import cache
from pathlib import Path
from types import ModuleType
from typing import Any

from benchmarks.cases import data_folder

ROOT = Path(__file__).resolve().parents[1]
COPIED = ("src", "tests", "benchmarks", "docs", "pyproject.toml", "README.md", "mkdocs.yml")
LIBRARIES = (
    "numpy", "numba", "scipy.optimize", "scipy.spatial.transform", "scipy.interpolate", "scipy.signal", "scipy.stats",
    "scipy.sparse.linalg", "mujoco", "lxml.etree", "trimesh", "igl", "piqp", "clarabel", "pytest", "pydantic",
)  # fmt: skip

LIMIT, PATIENCE = 4.0, 120.0
"""Tests that use so many times the processor time they use without the mutant, and so many seconds more, hang."""
STEP = 10.0
"""A test file one import further away is worth so many seconds."""
SHARED = re.compile(r"\bcache\b|lru_cache|scope=")
"""A test file that shares values among its tests: any of them may notice what the first has made."""


class Copy:
    """A copy of the tree in which changes are tried.

    Attributes
    ----------
    root : folder of the tree
    kernels : compiled kernels of the unchanged tree; a changed one works on links to them and leaves them as they are
    times : by name of a test file the seconds that it takes, where known from elsewhere
    reached : by test file: by test, its seconds and the lines it runs, by file; kept on disk beside the tree
    """

    def __init__(self, folder: Path, original: Path = ROOT, times: dict[str, float] | None = None):
        self.times = times or {}
        self.folder, self.root, self.kernels = folder.resolve(), folder.resolve() / "tree", folder.resolve() / "kernels"
        for name in COPIED:
            source, here = original / name, self.root / name
            if source.is_dir():
                shutil.copytree(source, here, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
            elif source.exists():
                shutil.copy2(source, here)
        self.kernels.mkdir(exist_ok=True)
        self.reached: dict[str, dict[str, Any]] = {}
        known = self.folder / "reached.jsonl"
        for line in known.read_text("utf-8").splitlines() if known.exists() else ():
            one = json.loads(line)
            if one["when"] == (self.root / one["file"]).stat().st_mtime_ns:
                self.reached[one["file"]] = one["tests"]
        for name in LIBRARIES:
            __import__(name)

    def tried(self, room: str, path: Path, text: str, lines: range, budget: float, long: bool) -> tuple[str, float]:
        """The room's first test that fails on a changed file, and the seconds it took; "" where none does.

        Parameters
        ----------
        text : of the changed file
        lines : that differ
        budget : tests that take so many seconds without the change are run, those nearest to the file first [s]
        long : run those marked so too
        """
        here, by, start, left = self.root / path, "", time.perf_counter(), budget
        unchanged, stat = here.read_text("utf-8"), here.stat()
        for file in self._in_order(room, path):
            chosen = self._chosen(file, path, lines, long)
            if left <= 0:
                break
            if chosen == []:
                continue
            here.write_text(text, "utf-8", newline="\n")
            try:
                by, used = self._failed(file, chosen, long)
            finally:
                here.write_text(unchanged, "utf-8", newline="\n")
                os.utime(here, ns=(stat.st_atime_ns, stat.st_mtime_ns))
            left -= used
            if by:
                break
        return by, time.perf_counter() - start

    def _in_order(self, room: str, path: Path) -> list[Path]:
        """Test files of a room that import a module: of its name first, then by steps between and by seconds."""

        def far(one: Path) -> tuple[bool, float]:
            known = self.reached.get(one.as_posix())
            seconds = sum(test["seconds"] for test in known.values()) if known else self.times.get(one.stem, 0.0)
            return path.stem not in one.stem, steps[one] + seconds / STEP

        steps = tests_of(self.root, room, path)
        return sorted(steps, key=far)

    def _chosen(self, file: Path, path: Path, lines: range, long: bool) -> list[str] | None:
        """Tests of a file to run, in order; None where what they reach is not known."""
        tests = self.reached.get(file.as_posix())
        if tests is None or (long and any(one["long"] and not one["lines"] for one in tests.values())):
            return None
        wanted = set(lines)
        reaching = [one for one in tests if not wanted.isdisjoint(tests[one]["lines"].get(path.as_posix(), ()))]
        shares = SHARED.search((self.root / file).read_text("utf-8")) is not None
        others = [name for name in tests if name not in reaching] if shares and reaching else []
        by_time = [*sorted(reaching, key=lambda one: tests[one]["seconds"]), *others]
        return [name for name in by_time if long or not tests[name]["long"]]

    def _failed(self, file: Path, names: list[str] | None, long: bool) -> tuple[str, float]:
        """The first of these tests that fails, and the seconds used; a file not known yet is traced."""
        changed = self.folder / "changed_kernels"
        shutil.rmtree(changed, ignore_errors=True)
        shutil.copytree(self.kernels, changed, copy_function=os.link)
        known = self.reached.get(file.as_posix(), {})
        usual = sum(known[name]["seconds"] for name in names) if names else self.times.get(file.stem, PATIENCE)
        plugin = Tracer(self.root, long) if names is None else Chosen(names)
        told = self._forked(file, plugin, changed, LIMIT * usual + PATIENCE)
        used = sum(one["seconds"] for one in told.values())
        failed = [name for name, one in told.items() if one["failed"]]
        if failed:
            return failed[0], used
        if names is not None:
            return ("" if len(told) == len(names) else f"{file.as_posix()}: ended or too slow"), used
        if not told.pop("all", None):
            return f"{file.as_posix()}: ended or too slow", used
        self.reached[file.as_posix()] = told
        row = {"file": file.as_posix(), "when": (self.root / file).stat().st_mtime_ns, "tests": told}
        with (self.folder / "reached.jsonl").open("a", encoding="utf-8") as out:
            out.write(json.dumps(row) + "\n")
        return "", used

    def failing(self, names: list[str]) -> list[str]:
        """Which of these tests fail without any change."""
        failed = []
        for file in dict.fromkeys(name.partition("::")[0] for name in names):
            own = [name for name in names if name.partition("::")[0] == file]
            told = self._forked(Path(file), Chosen(own), self.kernels, None)
            failed += [name for name in own if name not in told or told[name]["failed"]]
        return failed

    def _forked(self, file: Path, plugin: Chosen, kernels: Path, limit: float | None) -> dict[str, Any]:
        """Run tests of a file in a process of their own: by test, what the plugin has written of it."""
        plugin.out = self.folder / "told.jsonl"
        plugin.out.write_text("")
        process = multiprocessing.get_context("fork").Process(
            target=_run_tests, args=(self.root, file, plugin, kernels, limit)
        )
        process.start()
        process.join(None if limit is None else 20 * limit)
        if process.is_alive():
            os.killpg(process.pid or 0, signal.SIGKILL)
            process.join()
        rows = [json.loads(line) for line in plugin.out.read_text("utf-8").splitlines()]
        return {one.pop("name"): one for one in rows}


def _run_tests(root: Path, file: Path, plugin: Chosen, kernels: Path, limit: float | None) -> None:
    """In the forked process: this tree in place of the one that this module comes from, then pytest."""
    import pytest
    from numba import config

    os.setsid()
    os.chdir(root)
    if limit is not None:
        seconds = int(limit + time.process_time())
        resource.setrlimit(resource.RLIMIT_CPU, (seconds, seconds + 5))
    paths = [(root / "src").as_posix(), root.as_posix(), (root / "tests" / file.parent.name).as_posix()]
    config.CACHE_DIR = kernels.as_posix()
    os.environ |= {"NUMBA_CACHE_DIR": kernels.as_posix(), "PYTHONPATH": paths[0], "MYOMORPH_DATA": str(data_folder())}
    for name in [one for one in sys.modules if one.split(".")[0] in ("benchmarks", "myomorph", "tests")]:
        del sys.modules[name]
    sys.path[:0] = paths[:2]
    sys.dont_write_bytecode = limit is not None
    with open(os.devnull, "w") as nothing:
        os.dup2(nothing.fileno(), 1)
        os.dup2(nothing.fileno(), 2)
    options = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "--tb=no"]
    code = pytest.main([*options, file.as_posix()], plugins=[plugin])
    if code not in (0, 1, 5):  # the file does not import
        plugin.tell(file.as_posix(), failed=True, seconds=0.0, long=False, lines={})
    elif isinstance(plugin, Tracer):
        plugin.tell("all", failed=False, seconds=0.0, long=False, lines={})
    os._exit(0)


class Chosen:
    """A plugin of pytest: the tests that run, in their order, and what became of each."""

    out: Path

    def __init__(self, names: list[str]):
        self.names = names

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """Keep the chosen tests, in the order chosen."""
        by_name = {one.nodeid: one for one in items}
        items[:] = [by_name[name] for name in self.names if name in by_name]

    def pytest_runtest_protocol(self, item: Any, nextitem: Any) -> bool:
        """Run a test and write what became of it."""
        from _pytest.runner import runtestprotocol

        start = time.process_time()
        with self.traced() as lines:
            reports = runtestprotocol(item, nextitem=nextitem, log=True)
        long = item.get_closest_marker("long") is not None
        failed = any(one.failed for one in reports)
        self.tell(item.nodeid, failed=failed, seconds=time.process_time() - start, long=long, lines=lines)
        return True

    def tell(self, name: str, **told: Any) -> None:
        """One line for a test."""
        with self.out.open("a", encoding="utf-8") as out:
            out.write(json.dumps({"name": name, **told}, default=sorted) + "\n")

    def traced(self) -> Any:
        """Lines that run meanwhile, by file: none are looked at."""
        return contextlib.nullcontext({})


class Tracer(Chosen):
    """Runs all tests and writes which lines of the rooms each runs."""

    def __init__(self, root: Path, long: bool):
        super().__init__([])
        self.source, self.long = (root / "src").as_posix(), long
        self.root = root.as_posix()

    def pytest_collection_modifyitems(self, items: list[Any]) -> None:
        """All."""

    def pytest_runtest_protocol(self, item: Any, nextitem: Any) -> bool:
        """Long ones only where they are wanted."""
        if item.get_closest_marker("long") is not None and not self.long:
            self.tell(item.nodeid, failed=False, seconds=0.0, long=True, lines={})
            return True
        return super().pytest_runtest_protocol(item, nextitem)

    @contextlib.contextmanager
    def traced(self) -> Iterator[dict[str, set[int]]]:
        """Lines that run meanwhile, by file of the tree."""
        from numba.core.dispatcher import Dispatcher

        lines: dict[str, set[int]] = {}
        seen: set[tuple[str, int]] = set()
        kernels: dict[Any, None] = {}
        own: dict[str, bool] = {}

        def line(frame: Any, event: str, _: Any) -> Any:
            if event == "line":
                seen.add((frame.f_code.co_filename, frame.f_lineno))
            return line

        def called(frame: Any, _: str, __: Any) -> Any:
            name = frame.f_code.co_filename
            if name not in own:
                own[name] = name.startswith(self.source)
            return line if own[name] else None

        def compiled(kernel: Any, *given: Any, **named: Any) -> Any:
            kernels[kernel] = None
            return super(Dispatcher, kernel).__call__(*given, **named)

        Dispatcher.__call__ = compiled
        threading.settrace(called)
        sys.settrace(called)
        try:
            yield lines
        finally:
            sys.settrace(None)
            threading.settrace(None)  # type: ignore[arg-type]
            del Dispatcher.__call__
            for kernel in _with_called(kernels):
                code = kernel.py_func.__code__
                seen |= {(code.co_filename, number) for _, _, number in code.co_lines() if number}
            for name, number in seen:
                if name.startswith(self.source):
                    lines.setdefault(name.removeprefix(self.root + "/"), set()).add(number)


def _with_called(kernels: dict[Any, None]) -> set[Any]:
    """Kernels and all kernels that they call."""
    from numba.core.dispatcher import Dispatcher

    found: set[Any] = set()
    left = list(kernels)
    while left:
        kernel = left.pop()
        if kernel in found:
            continue
        found.add(kernel)
        function = kernel.py_func
        names = function.__code__.co_names
        values = [function.__globals__[one] for one in names if one in function.__globals__]
        values += [
            getattr(one, name) for one in values if isinstance(one, ModuleType) for name in names if hasattr(one, name)
        ]
        values += [one.cell_contents for one in function.__closure__ or ()]
        left += [one for one in values if isinstance(one, Dispatcher)]
    return found


def tests_of(root: Path, room: str, path: Path) -> dict[Path, int]:
    """Test files of a room whose imports lead to a module, with the steps between."""
    files = sorted(one.relative_to(root) for one in (root / "tests" / room).rglob("test_*.py"))
    steps = {one: _steps(root, one, path) for one in files}
    return {one: count for one, count in steps.items() if count is not None}


def _steps(root: Path, start: Path, goal: Path) -> int | None:
    """Imports from one file to another, None where none lead there."""
    layer, seen, count = {start}, {start}, 0
    while layer:
        if goal in layer:
            return count
        layer = set().union(*(_imported(root, one) for one in layer)) - seen
        seen |= layer
        count += 1
    return None


@cache
def _imported(root: Path, path: Path) -> frozenset[Path]:
    """Files of the tree that a file imports, in functions too."""
    found = set()
    for node in ast.walk(ast.parse((root / path).read_text("utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{one.name}" for one in node.names)]
        elif isinstance(node, ast.Import):
            names = [one.name for one in node.names]
        for name in names:
            part = Path(*name.split("."))
            for base in (Path("src"), Path(), Path("tests")):
                both = (base / part.with_suffix(".py"), base / part / "__init__.py")
                found |= {one for one in both if (root / one).is_file()}
    return frozenset(found)
