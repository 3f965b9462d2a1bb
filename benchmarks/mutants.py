"""Mutation run: how many small wrong changes of the science rooms their own tests notice.

`python -m benchmarks mutants [--rooms morph ...] [--count N] [--seed S] [--work DIR] [--json FILE]`. Each mutant is one
change of one line in a copy of the tree; then the tests of its room run, those nearest to the changed module first,
until one fails. A mutant that no test notices has survived and is named. Takes hours for a hundred: not for CI.

Not taken, as no test could or should tell them: docstrings, texts and f-strings, annotations, what is raised or
asserted, decorators, defaults of parameters and fields, constants of modules (a limit is a choice, its second digit
no law), the `axis` and shape arguments of array functions (they only crash). Of comparisons `<` becomes `>=`, not
`<=`, which differs only where two numbers of a measurement are equal.
"""

from __future__ import annotations

import argparse
import ast
import os
import random
import re
import shutil
import subprocess
import sys
import tempfile
import time
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

from benchmarks.cases import data_folder

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("rigid", "motion", "muscles", "contact", "identify", "morph", "tension", "analysis")
KINDS = ("sign", "comparison", "factor", "off by one", "and/or")
COPIED = ("src", "tests", "benchmarks", "docs", "pyproject.toml", "README.md")

LIMIT, PATIENCE = 4.0, 120.0
"""A mutant whose tests take so many times as long as without it and so many seconds more has been noticed: it hangs."""

OPPOSITE = {
    ast.Lt: ("<", ">="), ast.GtE: (">=", "<"), ast.Gt: (">", "<="), ast.LtE: ("<=", ">"), ast.Eq: ("==", "!="),
    ast.NotEq: ("!=", "=="), ast.Is: ("is", "is not"), ast.IsNot: ("is not", "is"), ast.In: ("in", "not in"),
    ast.NotIn: ("not in", "in"),
}  # fmt: skip
SIGNS = {ast.Add: ("+", "-"), ast.Sub: ("-", "+")}
TEXTS = (ast.JoinedStr, ast.Tuple, ast.List, ast.ListComp)
SHAPING = {"axis", "ndmin", "dtype", "shape"}
SHAPED = {"reshape", "zeros", "ones", "empty", "full", "eye", "swapaxes", "transpose", "moveaxis"}


@dataclass(frozen=True)
class Mutation:
    """One change of a source text.

    Attributes
    ----------
    kind : of `KINDS`
    line : number, from 1
    start, end : offsets in the text's UTF-8 bytes
    new : what stands there instead
    """

    kind: str
    line: int
    start: int
    end: int
    new: str

    def applied(self, text: str) -> str:
        """The changed text."""
        raw = text.encode()
        return (raw[: self.start] + self.new.encode() + raw[self.end :]).decode()

    def compiles(self, text: str) -> bool:
        """Whether the changed text is still Python."""
        try:
            compile(self.applied(text), "mutant", "exec")
        except SyntaxError:
            return False
        return True

    def described(self, text: str) -> str:
        """The changed line, before and after."""
        before = text.splitlines()[self.line - 1].strip()
        after = self.applied(text).splitlines()[self.line - 1].strip()
        return f"{before}  ->  {after}"


@dataclass(frozen=True)
class Outcome:
    """What became of a mutant; `by` names the test that noticed it, "" where none did."""

    room: str
    path: Path
    mutation: Mutation
    by: str
    seconds: float


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command line."""
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS), metavar="ROOM")
    parser.add_argument("--count", type=int, default=100, help="mutants of all rooms together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--under", default="", help="only files whose path holds this text")
    parser.add_argument(
        "--work", type=Path, help="folder of the copy; kept, with its compiled kernels, for a later run"
    )


def run(
    rooms: list[str] | None = None, count: int = 100, seed: int = 0, under: str = "", work: Path | None = None
) -> list[dict[str, object]]:
    """One row a room, then one row a survivor."""
    rooms = rooms or list(ROOMS)
    outcomes: list[Outcome] = []
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(work or Path(folder))
        for k, room in enumerate(rooms):
            wanted = count // len(rooms) + (k < count % len(rooms))
            for path, mutation in drawn(room, wanted, seed, under):
                outcomes.append(copy.tried(room, path, mutation))
                _tell(len(outcomes), outcomes[-1])
    rows: list[dict[str, object]] = []
    for room in rooms:
        own = [one for one in outcomes if one.room == room]
        seconds = sum(one.seconds for one in own)
        rows.append({"room": room, "mutants": len(own), "killed": sum(bool(one.by) for one in own), "seconds": seconds})
    for one in outcomes:
        if not one.by:
            text = (ROOT / one.path).read_text("utf-8")
            where = f"{one.path.as_posix()}:{one.mutation.line}"
            rows.append({"survived": where, "kind": one.mutation.kind, "change": one.mutation.described(text)})
    return rows


def _tell(number: int, one: Outcome) -> None:
    where = f"{one.path.as_posix()}:{one.mutation.line}"
    print(f"{number}: {where} ({one.mutation.kind}): {one.by or 'SURVIVED'}, {one.seconds:.0f} s", flush=True)


def drawn(room: str, count: int, seed: int, under: str = "") -> list[tuple[Path, Mutation]]:
    """Random mutants of a room, first the kind, then the place; no two on one line."""
    sites: dict[str, list[tuple[Path, Mutation]]] = {kind: [] for kind in KINDS}
    texts: dict[Path, str] = {}
    for file in sorted((ROOT / "src" / "myomorph" / room).rglob("*.py")):
        if under in file.as_posix():
            path = file.relative_to(ROOT)
            texts[path] = file.read_text("utf-8")
            for one in _Sites(texts[path]).found:
                sites[one.kind].append((path, one))
    rng = random.Random(f"{seed} {room}")
    for places in sites.values():
        rng.shuffle(places)
    found: dict[tuple[Path, int], Mutation] = {}
    while len(found) < count and any(sites.values()):
        path, one = sites[rng.choice([kind for kind in KINDS if sites[kind]])].pop()
        if (path, one.line) not in found and one.compiles(texts[path]):
            found[path, one.line] = one
    return [(path, one) for (path, _), one in found.items()]


def mutations(text: str) -> list[Mutation]:
    """All mutants of a source text that still compile."""
    return [one for one in _Sites(text).found if one.compiles(text)]


class _Sites(ast.NodeVisitor):
    """Finds what may be changed inside functions."""

    def __init__(self, text: str):
        self.found: list[Mutation] = []
        self.raw = text.encode()
        lengths = [0, *(len(line) for line in self.raw.splitlines(keepends=True))]
        self.begins = [sum(lengths[: k + 1]) for k in range(len(lengths))]
        self.inside = 0
        self.visit(ast.parse(text))

    def visit_FunctionDef(self, node: ast.FunctionDef) -> None:
        self.inside += 1
        for one in node.body:
            self.visit(one)
        self.inside -= 1

    def generic_visit(self, node: ast.AST) -> None:
        if isinstance(node, ast.Raise | ast.Assert | ast.JoinedStr | ast.Import | ast.ImportFrom):
            return
        if isinstance(node, ast.AnnAssign):
            if node.value is not None:
                self.visit(node.value)
            return
        if self.inside:
            self._sites_of(node)
        for child in ast.iter_child_nodes(node):
            shaping = isinstance(child, ast.keyword) and child.arg in SHAPING
            shaped = isinstance(node, ast.Call) and _name(node.func) in SHAPED and child is not node.func
            if not shaping and not shaped:
                self.visit(child)

    def _sites_of(self, node: ast.AST) -> None:
        if isinstance(node, ast.BinOp) and not any(_is_text(one) for one in (node.left, node.right)):
            if type(node.op) in SIGNS:
                self._swap("sign", node.left, node.right, SIGNS[type(node.op)])
            elif isinstance(node.op, ast.Mult | ast.Div | ast.MatMult):
                start, end = self._span(node)
                whole = self.raw[start:end].decode()
                self.found.append(Mutation("factor", node.lineno, start, end, f"(1.02 * ({whole}))"))
        elif isinstance(node, ast.UnaryOp) and isinstance(node.op, ast.USub):
            start, _ = self._span(node)
            self.found.append(Mutation("sign", node.lineno, start, start + 1, "+"))
        elif isinstance(node, ast.Compare):
            for op, left, right in zip(node.ops, [node.left, *node.comparators], node.comparators, strict=False):
                self._swap("comparison", left, right, OPPOSITE[type(op)])
        elif isinstance(node, ast.BoolOp):
            signs = ("and", "or") if isinstance(node.op, ast.And) else ("or", "and")
            for left, right in zip(node.values, node.values[1:], strict=False):
                self._swap("and/or", left, right, signs)
        elif isinstance(node, ast.Constant) and type(node.value) is int:
            start, end = self._span(node)
            self.found.append(Mutation("off by one", node.lineno, start, end, str(node.value + 1)))

    def _swap(self, kind: str, left: ast.expr, right: ast.expr, signs: tuple[str, str]) -> None:
        """Another sign between two operands."""
        first, last = self._span(left)[1], self._span(right)[0]
        word = r"\b" if signs[0].isalpha() else ""
        sign = re.search(word + re.escape(signs[0]).replace(r"\ ", r"\s+") + word, self.raw[first:last].decode())
        if sign:
            line = self.raw[: first + sign.start()].count(b"\n") + 1
            self.found.append(Mutation(kind, line, first + sign.start(), first + sign.end(), signs[1]))

    def _span(self, node: ast.expr) -> tuple[int, int]:
        assert node.end_lineno is not None
        assert node.end_col_offset is not None
        return self.begins[node.lineno - 1] + node.col_offset, self.begins[node.end_lineno - 1] + node.end_col_offset


def _name(node: ast.expr) -> str:
    return node.attr if isinstance(node, ast.Attribute) else node.id if isinstance(node, ast.Name) else ""


def _is_text(node: ast.expr) -> bool:
    return isinstance(node, TEXTS) or (isinstance(node, ast.Constant) and isinstance(node.value, str))


class Copy:
    """A copy of the tree in which mutants are tried.

    Compiled kernels of the copy stay in a folder of its own; a file is put back with the time it had, so that only the
    kernels of mutants compile anew.

    Attributes
    ----------
    root : folder of the tree
    usual : by test file the seconds that it takes without a mutant [s]
    """

    def __init__(self, folder: Path, original: Path = ROOT):
        self.root = folder / "tree"
        for name in COPIED:
            source, here = original / name, self.root / name
            if source.is_dir():
                shutil.copytree(source, here, dirs_exist_ok=True, ignore=shutil.ignore_patterns("__pycache__"))
            elif source.exists():
                shutil.copy2(source, here)
        kernels = {"NUMBA_CACHE_DIR": str(folder / "kernels"), "PYTHONPATH": str(self.root / "src")}
        self.environment = os.environ | kernels | {"MYOMORPH_DATA": str(data_folder())}
        self.usual: dict[Path, float] = {}
        asked = [sys.executable, "-c", "import myomorph; print(myomorph.__file__)"]
        done = subprocess.run(asked, cwd=self.root, env=self.environment, capture_output=True, text=True, check=True)
        if not Path(done.stdout.strip()).is_relative_to(self.root.resolve()):
            raise SystemExit(f"the copy does not import itself, but {done.stdout.strip()}")

    def tried(self, room: str, path: Path, mutation: Mutation) -> Outcome:
        """Run the room's tests on a mutant, those nearest to it first, until one fails."""
        here, by, seconds = self.root / path, "", 0.0
        text, stat = here.read_text("utf-8"), here.stat()
        for file in tests_of(self.root, room, path):
            limit = LIMIT * self._usual(file) + PATIENCE
            here.write_text(mutation.applied(text), "utf-8", newline="\n")
            start = time.perf_counter()
            try:
                by = self._failed(file, limit)
            finally:
                here.write_text(text, "utf-8", newline="\n")
                os.utime(here, ns=(stat.st_atime_ns, stat.st_mtime_ns))
            seconds += time.perf_counter() - start
            if by:
                break
        return Outcome(room, path, mutation, by, seconds)

    def _usual(self, file: Path) -> float:
        """Seconds that a test file takes without a mutant, with what it compiles then; it must pass."""
        if file not in self.usual:
            start = time.perf_counter()
            failed = self._failed(file, None)
            if failed:
                raise SystemExit(f"{failed} fails without a mutant")
            self.usual[file] = time.perf_counter() - start
        return self.usual[file]

    def _failed(self, file: Path, limit: float | None) -> str:
        """The first test that fails, "too slow" past the limit, "" where all pass."""
        options = ["-x", "-q", "--no-header", "-p", "no:cacheprovider", "--tb=no"]
        command = [sys.executable, "-m", "pytest", *options, file.as_posix()]
        try:
            done = subprocess.run(
                command, cwd=self.root, env=self.environment, capture_output=True, text=True, timeout=limit, check=False
            )
        except subprocess.TimeoutExpired:
            return "too slow"
        if done.returncode in (0, 5):  # 5: no test was collected
            return ""
        told = re.search(r"^(?:FAILED|ERROR) (\S+)", done.stdout, re.MULTILINE)
        return told[1] if told else f"pytest ended with {done.returncode}"


def tests_of(root: Path, room: str, path: Path) -> list[Path]:
    """Test files of a room whose imports lead to a module, those with the fewest steps between first."""
    module = _dotted(path)
    files = sorted(one.relative_to(root) for one in (root / "tests" / room).rglob("test_*.py"))
    known: dict[Path, set[Path]] = {}
    steps = {one: _steps(root, one, path, known) for one in files}
    reached = {one: count for one, count in steps.items() if count is not None}
    return sorted(reached, key=lambda one: (reached[one], module.rsplit(".", 1)[-1] not in one.stem, one))


def _steps(root: Path, start: Path, goal: Path, known: dict[Path, set[Path]]) -> int | None:
    """Imports from one file to another, None where none lead there."""
    layer, seen, count = {start}, {start}, 0
    while layer:
        if goal in layer:
            return count
        for one in layer - set(known):
            known[one] = set(_imported(root, one))
        layer = set().union(*(known[one] for one in layer)) - seen
        seen |= layer
        count += 1
    return None


def _imported(root: Path, path: Path) -> Iterator[Path]:
    """Files of the tree that a file imports, in functions too."""
    for node in ast.walk(ast.parse((root / path).read_text("utf-8"))):
        names: list[str] = []
        if isinstance(node, ast.ImportFrom) and node.module:
            names = [node.module, *(f"{node.module}.{one.name}" for one in node.names)]
        elif isinstance(node, ast.Import):
            names = [one.name for one in node.names]
        for name in names:
            part = Path(*name.split("."))
            for base in (Path("src"), Path(), Path("tests")):
                for file in (base / part.with_suffix(".py"), base / part / "__init__.py"):
                    if (root / file).is_file():
                        yield file


def _dotted(path: Path) -> str:
    return ".".join(path.with_suffix("").parts[1:])
