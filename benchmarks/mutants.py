"""Mutation run: how many small wrong changes of the science rooms their own tests notice.

`python -m benchmarks mutants [--rooms morph ...] [--count N] [--seed S] [--work DIR] [--json FILE]`. Each mutant is one
change of one line in a copy of the tree; then the tests of its room run, those nearest to the changed module first,
until one fails; `benchmarks/mutant_tests.py` says how they are chosen. A mutant that no test notices has survived and
is named. Takes an hour or more for a hundred, one process on one core: not for CI, and not for Windows.

Not taken, as no test could or should tell them: docstrings, texts and f-strings, annotations, what is raised or
asserted, decorators, defaults of parameters and fields, constants of modules (a limit is a choice, its second digit
no law), the `axis` and shape arguments of array functions (they only crash). Of comparisons `<` becomes `>=`, not
`<=`, which differs only where two numbers of a measurement are equal. No factor on all that `argmax` and the like
compare: it changes nothing.
"""

from __future__ import annotations

import argparse
import ast
import json
import random
import re
import tempfile
import time
from dataclasses import asdict, dataclass
from itertools import accumulate
from pathlib import Path
from xml.etree import ElementTree

from rich.console import Console
from rich.progress import MofNCompleteColumn, Progress

from benchmarks.mutant_tests import Copy

ROOT = Path(__file__).resolve().parents[1]
ROOMS = ("rigid", "motion", "muscles", "contact", "identify", "morph", "tension", "analysis")
KINDS = ("sign", "comparison", "factor", "off by one", "and/or")
RANKING = {"argmax", "argmin", "argsort", "nanargmax", "nanargmin", "sign", "isfinite", "isnan"}
EQUAL = {
    ("src/myomorph/contact/carried.py", "@ x[8:12]"): "x has 11 entries",
    ("src/myomorph/identify/body/center_fit.py", "np.round((1.02 * (turn / (0.5 * np.pi))))"): (
        "near a quarter turn, where it is used, both round alike"
    ),
    ("src/myomorph/muscles/ellipsoid.py", "(1.02 * (v * v)) / b2 >= 1.0:"): "Newton comes to the same root from both",
}
"""Mutants that compute the same, by file and end of the changed line: why. They are counted apart."""
KERNELS = {"kernel", "inner", "in_place"}
MARKS = ("<!-- mutants -->", "<!-- end of mutants -->")

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
    file: str
    line: int
    kind: str
    change: str
    by: str
    seconds: float

    @property
    def equal(self) -> str:
        """Why the mutant computes the same, "" where it does not."""
        return next((why for (file, end), why in EQUAL.items() if file == self.file and self.change.endswith(end)), "")


def add_options(parser: argparse.ArgumentParser) -> None:
    """The options of the command line."""
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS), metavar="ROOM")
    parser.add_argument("--count", type=int, default=100, help="mutants of all rooms together, by lines")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument("--under", default="", help="only files whose path holds this text")
    parser.add_argument("--at", nargs="+", default=[], metavar="FILE:LINE", help="all mutants of these lines instead")
    parser.add_argument(
        "--kept",
        action="store_true",
        help="those of the folder's results whose line still stands, whatever is drawn now",
    )
    parser.add_argument("--again", action="store_true", help="run only those that have survived, once more")
    parser.add_argument("--long", action="store_true", help="run tests marked long too")
    parser.add_argument(
        "--budget", type=float, default=30.0, help="processor seconds of tests for a mutant, nearest first"
    )
    parser.add_argument("--times", type=Path, metavar="XML", help="pytest's --junit-xml of a run, to know quick tests")
    parser.add_argument("--until", metavar="HH:MM", help="begin no mutant after this time of the day")
    parser.add_argument("--table", type=Path, help="write the results as a table into this page")
    parser.add_argument(
        "--work", type=Path, help="folder of the copy, kept with kernels and results: a later run goes on there"
    )


def run(
    rooms: list[str] | None = None,
    count: int = 100,
    seed: int = 0,
    under: str = "",
    at: list[str] | None = None,
    kept: bool = False,
    again: bool = False,
    long: bool = False,
    budget: float = 30.0,
    times: Path | None = None,
    until: str | None = None,
    table: Path | None = None,
    work: Path | None = None,
) -> list[dict[str, object]]:
    """One row a room, then one row a survivor."""
    rooms = rooms or list(ROOMS)
    if kept and work is None:
        raise SystemExit("--kept takes the results of an earlier run: name its folder with --work")
    wanted = places(at) if at else standing(work) if kept and work else sample(rooms, count, seed, under)
    with tempfile.TemporaryDirectory() as folder:
        copy = Copy(work or Path(folder), times=_seconds(times) if times else None)
        outcomes = _tried(copy, wanted, again, long, budget, until)
        failing = copy.failing(sorted({one.by for one in outcomes if "::" in one.by}))
    if failing:
        raise SystemExit(f"fail without a mutant: {', '.join(failing)}")
    if table:
        write_table(table, outcomes, wanted, "drawn earlier" if kept else f"seed {seed}", budget)
    rows: list[dict[str, object]] = []
    for room in dict.fromkeys(room for room, _, _ in wanted):
        own = [one for one in outcomes if one.room == room]
        killed, seconds = sum(bool(one.by) for one in own), sum(one.seconds for one in own)
        rows.append({"room": room, "mutants": len(own), "killed": killed, "seconds": seconds})
    for one in outcomes:
        if not one.by:
            rows.append(
                {"equal" if one.equal else "survived": f"{one.file}:{one.line}", "kind": one.kind, "change": one.change}
            )
    return rows


def _seconds(report: Path) -> dict[str, float]:
    """By the last part of its name, the seconds of a test file in a report of pytest."""
    found: dict[str, float] = {}
    for one in ElementTree.parse(report).iter("testcase"):
        name = next((part for part in one.get("classname", "").split(".") if part.startswith("test_")), "")
        found[name] = found.get(name, 0.0) + float(one.get("time", 0.0))
    return found


def _tried(
    copy: Copy, wanted: list[tuple[str, Path, Mutation]], again: bool, long: bool, budget: float, until: str | None
) -> list[Outcome]:
    """What became of the mutants, kept in `outcomes.jsonl`; those with an outcome do not run again."""
    store = copy.folder / "outcomes.jsonl"
    known = {(one.file, one.change): one for one in recorded(copy.folder)}
    outcomes = []
    columns = (*Progress.get_default_columns(), MofNCompleteColumn())
    with Progress(*columns, console=Console(stderr=True)) as bar:
        task = bar.add_task("mutants", total=len(wanted))
        for room, path, mutation in wanted:
            text = (copy.root / path).read_text("utf-8")
            change = mutation.described(text)
            one = known.get((path.as_posix(), change))
            due = again and not one.by and not one.equal if one else not again
            if due and (until is None or time.strftime("%H:%M") < until):
                lines = statement(text, mutation.line)
                by, seconds = copy.tried(room, path, mutation.applied(text), lines, budget, long, newest=again)
                one = Outcome(room, path.as_posix(), mutation.line, mutation.kind, change, by, seconds)
                with store.open("a", encoding="utf-8") as out:
                    out.write(json.dumps(asdict(one)) + "\n")
                where = f"{one.file}:{one.line} ({one.kind}): {one.change}"
                bar.console.print(f"{where}: {by or 'SURVIVED'}, {seconds:.0f} s", markup=False, highlight=False)
            outcomes += [one] if one else []
            bar.advance(task)
    return outcomes


def write_table(
    page: Path, outcomes: list[Outcome], wanted: list[tuple[str, Path, Mutation]], origin: str, budget: float
) -> None:
    """Results between the two marks of a page; `origin` says where the mutants come from."""
    counted, left = [one for one in outcomes if not one.equal], len(wanted) - len(outcomes)
    killed = sum(bool(one.by) for one in counted)
    run_of = f"{origin}, {len(outcomes)} of {len(wanted)} run" if left else origin
    lines = [
        f"{killed} of {len(counted)} mutants killed ({run_of}, {budget:g} s of tests each).",
        "",
        "| room | drawn | run | killed |",
        "|---|---|---|---|",
    ]
    for room in ROOMS:
        own = [one for one in counted if one.room == room]
        drawn_here = sum(one == room for one, _, _ in wanted)
        lines.append(f"| `{room}` | {drawn_here} | {len(own)} | {sum(bool(one.by) for one in own)} |")
    survived = [one for one in outcomes if not one.by]
    if survived:
        lines += ["", "| survived | kind | change | |", "|---|---|---|---|"]
    for one in survived:
        change, why = one.change.replace("|", "\\|"), f"computes the same: {one.equal}" if one.equal else ""
        lines.append(f"| `{one.file.removeprefix('src/myomorph/')}:{one.line}` | {one.kind} | `{change}` | {why} |")
    before, rest = page.read_text("utf-8").split(MARKS[0])
    after = rest.split(MARKS[1])[1]
    page.write_text("\n".join([before + MARKS[0], "", *lines, "", MARKS[1] + after]), "utf-8", newline="\n")


def sample(rooms: list[str], count: int, seed: int, under: str = "") -> list[tuple[str, Path, Mutation]]:
    """Random mutants of rooms, in each so many as its share of the lines.

    The rooms are mixed, so that a part is a sample too; but compiled kernels, which cost the most, come last.
    """
    sizes = [sum(len(one.read_text("utf-8").splitlines()) for one in _files(room)) for room in rooms]
    shares = [count * one / sum(sizes) for one in sizes]
    counts = [int(one) for one in shares]
    for k in sorted(range(len(rooms)), key=lambda k: counts[k] - shares[k])[: count - sum(counts)]:
        counts[k] += 1
    placed = []
    for room, wanted in zip(rooms, counts, strict=True):
        for k, (path, mutation) in enumerate(drawn(room, wanted, seed, under)):
            compiled = in_kernel((ROOT / path).read_text("utf-8"), mutation.line)
            placed.append((compiled, (k + 0.5) / wanted, room, path, mutation))
    return [one[2:] for one in sorted(placed, key=lambda one: one[:3])]


def in_kernel(text: str, line: int) -> bool:
    """Whether a line lies in a compiled function."""
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.FunctionDef) and node.lineno <= line <= (node.end_lineno or 0):
            named = [_name(one.func if isinstance(one, ast.Call) else one) for one in node.decorator_list]
            if not KERNELS.isdisjoint(named):
                return True
    return False


def recorded(folder: Path) -> list[Outcome]:
    """The results in a folder, in the order of their runs."""
    store = folder / "outcomes.jsonl"
    lines = store.read_text("utf-8").splitlines() if store.exists() else []
    return [Outcome(**json.loads(line)) for line in lines]


def standing(folder: Path) -> list[tuple[str, Path, Mutation]]:
    """Mutants of a folder's results whose line the source still has: a sample changes with every line of a room."""
    found = []
    for file, change, room in dict.fromkeys((one.file, one.change, one.room) for one in recorded(folder)):
        text = (ROOT / file).read_text("utf-8") if (ROOT / file).exists() else ""
        before = change.partition("  ->  ")[0]
        if any(line.strip() == before for line in text.splitlines()):
            found += [(room, Path(file), one) for one in mutations(text) if one.described(text) == change][:1]
    return found


def places(at: list[str]) -> list[tuple[str, Path, Mutation]]:
    """All mutants of the lines named, as `src/myomorph/motion/ties.py:235`."""
    found = []
    for name in at:
        path, number = Path(name.rpartition(":")[0]), int(name.rpartition(":")[2])
        for one in mutations((ROOT / path).read_text("utf-8")):
            if one.line == number:
                found.append((path.parts[2], path, one))
    return found


def _files(room: str) -> list[Path]:
    return sorted((ROOT / "src" / "myomorph" / room).rglob("*.py"))


def drawn(room: str, count: int, seed: int, under: str = "") -> list[tuple[Path, Mutation]]:
    """Random mutants of a room, first the kind, then the place; no two on one line."""
    sites: dict[str, list[tuple[Path, Mutation]]] = {kind: [] for kind in KINDS}
    sources: dict[Path, tuple[str, _Sites]] = {}
    for file in _files(room):
        if under in file.as_posix():
            path, text = file.relative_to(ROOT), file.read_text("utf-8")
            sources[path] = text, _Sites(text)
            for one in sources[path][1].found:
                sites[one.kind].append((path, one))
    rng = random.Random(f"{seed} {room}")
    for sites_of_kind in sites.values():
        rng.shuffle(sites_of_kind)
    found: dict[tuple[Path, int], Mutation] = {}
    while len(found) < count and any(sites.values()):
        path, one = sites[rng.choice([kind for kind in KINDS if sites[kind]])].pop()
        text, known = sources[path]
        if one.compiles(text) and (one.start, one.end) not in known.ranked:
            found.setdefault((path, one.line), one)
    return [(path, one) for (path, _), one in found.items()]


def statement(text: str, line: int) -> range:
    """Lines of the innermost statement that holds a line; of one with a body, those before the body."""
    spans = []
    for node in ast.walk(ast.parse(text)):
        if isinstance(node, ast.stmt) and node.lineno <= line <= (node.end_lineno or 0):
            body = getattr(node, "body", None)
            end = body[0].lineno - 1 if body and line < body[0].lineno else node.end_lineno or 0
            spans.append(range(node.lineno, max(end, node.lineno) + 1))
    return min(spans, key=len)


def mutations(text: str) -> list[Mutation]:
    """All mutants of a source text that still compile."""
    sites = _Sites(text)
    return [one for one in sites.found if one.compiles(text) and (one.start, one.end) not in sites.ranked]


class _Sites(ast.NodeVisitor):
    """Finds what may be changed inside functions; `ranked` are factors of what is only compared with itself."""

    def __init__(self, text: str):
        self.found: list[Mutation] = []
        self.raw = text.encode()
        self.begins = [0, *accumulate(len(line) for line in self.raw.splitlines(keepends=True))]
        self.ranked: set[tuple[int, int]] = set()
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
        if isinstance(node, ast.Call) and _name(node.func) in RANKING:
            self.ranked |= {self._span(one) for one in node.args if isinstance(one, ast.BinOp)}
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
