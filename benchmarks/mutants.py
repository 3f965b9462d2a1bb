"""Mutation run: how many small wrong changes their own tests notice, with cosmic-ray.

`python -m benchmarks mutants [--count N] [--seed S] [--rooms bones/morph ...] [--work FOLDER]
[--save]`. A mutant is a change of one line in a copy of the tree. The tests of its room that import
the module run, nearest first, within `--budget` seconds. FOLDER keeps what a stopped run goes on
from. An hour for forty; not for Windows; extra `mutants`. Not drawn: constants, defaults,
annotations, decorators, texts, what is raised or asserted, and `<` to `<=`.
"""

from __future__ import annotations

import argparse
import ast
import json
import os
import random
import resource
import shutil
import sys
import tempfile
from collections.abc import Iterator
from contextlib import chdir
from itertools import pairwise
from pathlib import Path
from typing import Any

import grimp
from cosmic_ray.ast import ast_nodes, get_ast_from_path
from cosmic_ray.mutating import mutate_and_test
from cosmic_ray.plugins import get_operator
from cosmic_ray.testing import run_tests
from cosmic_ray.work_db import WorkDB, use_db
from cosmic_ray.work_item import MutationSpec, TestOutcome, WorkerOutcome, WorkItem, WorkResult

from data_collection import data_folder

ROOT = Path(__file__).resolve().parents[1]
ROOMS = {
    "core/rigid": "rigid",
    "core/motion": "motion",
    "core/muscles": "muscles",
    "core/contact": "contact",
    "core/surfaces": "morph",
    "core/fit": "fit",
    "core/tension": "tension",
    "body/calibrate": "motion",
    "body/sensors": "motion",
    "body/identify": "identify",
    "body/shape": "identify",
    "body/refine": "identify",
    "body/personalize": "tension",
    "body/tension": "tension",
    "bones/morph": "morph",
    "lab/analysis": "analysis",
}
"""Rooms by wing, and the folder of their tests."""
KINDS = {
    "sign": (
        "ReplaceBinaryOperator_Add_Sub",
        "ReplaceBinaryOperator_Sub_Add",
        "ReplaceUnaryOperator_USub_UAdd",
    ),
    "factor": ("ReplaceBinaryOperator_Mul_Div", "ReplaceBinaryOperator_Div_Mul"),
    "comparison": tuple(
        f"ReplaceComparisonOperator_{pair}"
        for pair in (
            "Lt_GtE",
            "GtE_Lt",
            "Gt_LtE",
            "LtE_Gt",
            "Eq_NotEq",
            "NotEq_Eq",
            "Is_IsNot",
            "IsNot_Is",
        )
    ),
    "number": ("NumberReplacer",),
    "and/or": ("ReplaceAndWithOr", "ReplaceOrWithAnd"),
    "loop": ("ZeroIterationForLoop", "ReplaceBreakWithContinue", "ReplaceContinueWithBreak"),
}
PASSED_OVER = {"raise_stmt", "assert_stmt", "fstring", "param", "decorator", "annassign", "lambdef"}
COPIED = (
    "src",
    "tests",
    "benchmarks",
    "docs",
    "docs_build",
    "pyproject.toml",
    "README.md",
    "mkdocs.yml",
)
PATIENCE = 240
"""A mutant whose tests take so much longer than without it, kernels that are compiled anew
included, hangs [s].
"""


def add_options(parser: argparse.ArgumentParser) -> None:
    """Add the options of the command line."""
    parser.add_argument("--rooms", nargs="+", choices=ROOMS, default=list(ROOMS), metavar="ROOM")
    parser.add_argument("--count", type=int, default=40, help="mutants of all rooms together")
    parser.add_argument("--seed", type=int, default=0)
    parser.add_argument(
        "--budget", type=float, default=60.0, help="seconds of tests for a mutant, nearest first"
    )
    parser.add_argument(
        "--work", type=Path, help="folder of the copy and of the session, else one of the seed"
    )


def run(
    rooms: list[str], count: int, seed: int, budget: float, work: Path | None = None
) -> list[dict[str, object]]:
    """One row a mutant, and one for all."""
    work = (work or Path(tempfile.gettempdir(), f"myomorph-mutants-{seed}")).resolve()
    tree = work / "tree"
    (work / "kernels").mkdir(parents=True, exist_ok=True)
    for name in () if tree.exists() else COPIED:
        copy = shutil.copytree if (ROOT / name).is_dir() else shutil.copy2
        tree.mkdir(parents=True, exist_ok=True)
        copy(ROOT / name, tree / name)
    os.environ |= {"PYTHONPATH": f"{tree / 'src'}:{tree}", "MYOMORPH_DATA": str(data_folder())}
    with chdir(tree), use_db(str(work / "session.sqlite"), WorkDB.Mode.create) as session:
        if not session.num_work_items:
            session.add_work_items(sample(rooms, count, seed))
        graph = grimp.build_graph("myomorph", cache_dir=None)
        for item in list(session.pending_work_items):
            session.set_result(item.job_id, noticed(graph, item, budget, work))
            print(
                f"{len(list(session.completed_work_items))} of {count}", file=sys.stderr, flush=True
            )
        rows = [_row(item, result) for item, result in session.completed_work_items]
    killed = sum(row["noticed by"] != "" for row in rows)
    return [
        *rows,
        {"file": "all", "kind": f"{len(rows)} mutants", "noticed by": f"{killed} noticed"},
    ]


def sample(rooms: list[str], count: int, seed: int) -> Iterator[WorkItem]:
    """Yield random mutants of rooms of the tree in the working folder.

    First the kind is drawn, then the position; no two are on one line.
    """
    sites: dict[str, list[MutationSpec]] = {kind: [] for kind in KINDS}
    for path in sorted(path for room in rooms for path in Path("src/myomorph", room).rglob("*.py")):
        nodes = list(ast_nodes(get_ast_from_path(path)))
        for kind, operators in KINDS.items():
            for name in operators:
                sites[kind] += _specs(path, nodes, f"core/{name}")
    chance = random.Random(seed)
    lines = set()
    for specs in sites.values():
        chance.shuffle(specs)
    while len(lines) < count:
        spec = sites[chance.choice([kind for kind in KINDS if sites[kind]])].pop()
        if (place := (spec.module_path, spec.start_pos[0])) not in lines:
            lines.add(place)
            yield WorkItem.single(f"{len(lines):03d}", spec)


def _specs(path: Path, nodes: list[Any], operator: str) -> Iterator[MutationSpec]:
    """Yield the mutants of a file by one operator."""
    places = (
        (node, *at) for node in nodes for at in get_operator(operator)().mutation_positions(node)
    )
    for occurrence, (node, start, end) in enumerate(places):
        if _is_drawn(node):
            yield MutationSpec(
                module_path=path,
                operator_name=operator,
                occurrence=occurrence,
                start_pos=start,
                end_pos=end,
                operator_args={},
            )


def _is_drawn(node: object) -> bool:
    """Whether a place lies in the body of a function, and not in what is passed over."""
    kinds = []
    while node := node.parent:
        kinds.append(node.type)
    return PASSED_OVER.isdisjoint(kinds) and ("suite", "funcdef") in pairwise(kinds)


def noticed(graph: grimp.ImportGraph, item: WorkItem, budget: float, work: Path) -> WorkResult:
    """Return the result of the first test file that notices a mutant.

    Where none notices it, it is that of the last one that the budget allows.
    """
    result = WorkResult(
        worker_outcome=WorkerOutcome.NO_TEST, output="", test_outcome=TestOutcome.SURVIVED, diff=""
    )
    used = 0.0
    shutil.rmtree(changed := work / "changed", ignore_errors=True)
    for file in nearest_tests(graph, item.mutations[0].module_path):
        seconds = usual_seconds(file, work)
        if seconds is None or used + seconds > budget:
            continue
        used += seconds
        shutil.copytree(work / "kernels", changed, copy_function=_link, dirs_exist_ok=True)
        os.environ["NUMBA_CACHE_DIR"] = str(changed)
        result = mutate_and_test(item.mutations, pytest_of(file), 4.0 * seconds + PATIENCE)
        if result.test_outcome == TestOutcome.KILLED:
            break
    return result


def _link(kernel: str, place: str) -> None:
    if not os.path.exists(place):
        os.link(kernel, place)


def nearest_tests(graph: grimp.ImportGraph, path: Path) -> list[str]:
    """List test files of a module's room that lead to it.

    First come those of its name, then the others by the number of imports between.
    """
    module = ".".join(path.relative_to("src").with_suffix("").parts).removesuffix(".__init__")
    steps = {}
    room = "/".join(path.parts[2:4])
    for file in sorted(Path("tests", ROOMS[room]).rglob("test_*.py")):
        names = _imported(file, graph.modules)
        chains = [graph.find_shortest_chain(name, module) or () for name in names - {module}]
        if counts := [len(chain) for chain in chains if chain] + [1] * (module in names):
            steps[str(file)] = (path.stem not in file.stem, min(counts))
    return sorted(steps, key=steps.get)


def usual_seconds(file: str, work: Path) -> float | None:
    """Return processor seconds of a test file without a change, its kernels compiled.

    The result is None where it fails so.
    """
    store = work / "seconds.json"
    known = json.loads(store.read_text()) if store.exists() else {}
    if file not in known:
        os.environ["NUMBA_CACHE_DIR"] = str(work / "kernels")
        before = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime
        outcome, _ = run_tests(pytest_of(file), 10 * PATIENCE)
        taken = resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime - before
        store.write_text(
            json.dumps(known | {file: taken if outcome == TestOutcome.SURVIVED else None})
        )
        return usual_seconds(file, work)
    return known[file]


def _imported(file: Path, modules: set[str]) -> set[str]:
    """Modules of the package that a test file imports."""
    names = set()
    for node in ast.walk(ast.parse(file.read_text("utf-8"))):
        if isinstance(node, ast.ImportFrom) and node.module:
            names |= {node.module, *(f"{node.module}.{alias.name}" for alias in node.names)}
    return names & modules


def pytest_of(file: str) -> str:
    """Return the command that runs the tests of a file until one fails."""
    return f"{sys.executable} -m pytest -x -q --tb=no -p no:cacheprovider -m 'not long' {file}"


def _row(item: WorkItem, result: object) -> dict[str, object]:
    spec = item.mutations[0]
    lines = [
        line
        for line in result.diff.splitlines()
        if line[:1] in "+-" and line[:3] not in ("---", "+++")
    ]
    failed = [
        line
        for line in result.output.splitlines()
        if line.startswith(("FAILED", "ERROR", "timeout"))
    ]
    killed = result.test_outcome == TestOutcome.KILLED
    return {
        "file": f"{spec.module_path}:{spec.start_pos[0]}",
        "kind": spec.operator_name.removeprefix("core/"),
        "change": "  ->  ".join(line[1:].strip() for line in lines),
        "noticed by": (failed or ["it does not run"])[0].split(" - ")[0].removeprefix("FAILED ")
        if killed
        else "",
    }
