"""Every command that a page names is one that its program takes, and runs in its shortest form."""

from __future__ import annotations

import ast
import re
import shlex
from collections.abc import Iterator
from functools import cache
from pathlib import Path

import pytest
from benchmarks.__main__ import COMPARISONS, parsed
from benchmarks.accuracy.sections import PAGES as TABLES
from benchmarks.results import LOG, load
from docs_build.examples import DOCS
from tests.test_result_tables import defined

from myomorph.lab.cli.app import commands, new_app

ROOT = DOCS.parent
# Decisions are records of their date.
PAGES = [
    ROOT / "README.md",
    ROOT / "CONTRIBUTING.md",
    *(page for page in sorted(DOCS.rglob("*.md")) if page.parent.name != "decisions"),
]
EVERYWHERE = {"--help", "--help-all", "--version", "--debug"}
OF_EXAMPLES = {"labels", "power"}
"""Commands of the package that docs/adding.md writes."""
STANDS_FOR = {"NAME": "page", "TABLE": "knee"}
"""Words in capitals of commands, and one of the names that they stand for."""

PROGRAM = new_app()

SHORT = {
    "page": "page",
    "trial_path": "trial_path",
    "sources": "sources",
    "fuzz": "fuzz --inputs 20 --reader TRC",
    "opensim": "opensim --rounds 1",
    "draws": "draws --draws 2",
}
"""The shortest form of comparisons that tests can wait for."""
LONG = {"page", "opensim", "draws"}
NOT_RUN = {
    "a large problem, whose size is what is measured": (
        "size",
        "elastic",
        "forward",
        "identify",
        "morph",
        "registration",
        "matching",
        "masspoints",
        "grid",
        "calibrate",
        "contacts",
        "qp",
        "species",
        "viscosity",
        "study",
        "mujoco",
    ),
    "recordings at their own speed, for minutes": ("live", "live-delay", "live-sensors"),
    "another revision, or an environment of its own": (
        "revision",
        "release",
        "start",
        "view",
        "first_result",
    ),
    "recordings of five movements, which are analyzed first": ("pages",),
    "the tests, over and over": ("mutants",),
    "the index of packages": ("wheels",),
    "all tables of accuracy, hours": ("validation",),
}
"""Comparisons that are only started to their options here, and why."""


def spans(page: Path) -> Iterator[str]:
    """Lines of code blocks, with their continuations, and code within lines."""
    text = page.read_text(encoding="utf-8").replace("\\\n", " ")
    for block in re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL):
        yield from block.splitlines()
    text = re.sub(r"^```\w*\n.*?^```", "", text, flags=re.MULTILINE | re.DOTALL)
    for block in re.findall(r"(?:^    .+\n)+", text, re.MULTILINE):
        yield from (line.strip() for line in block.splitlines())
    yield from (" ".join(span.split()) for span in re.findall(r"`([^`]+)`", text))


def named(program: str) -> list:
    """Command lines of a program that pages name, each with its page."""
    found = {
        (page.relative_to(ROOT).as_posix(), part.strip())
        for page in PAGES
        for line in spans(page)
        for part in line.split("&&")
        if part.strip().startswith(f"{program} ")
    }
    return [pytest.param(line, id=f"{page}: {line}") for page, line in sorted(found)]


def words_of(line: str) -> list[str]:
    """Words of a command line without comments, optional parts taken as they are."""
    return shlex.split(re.sub(r"[\[\]|]|\.\.\.", " ", line), comments=True)


@cache
def options_of(command: str) -> set[str]:
    """Names of all options that a command takes."""
    arguments = PROGRAM[command].assemble_argument_collection()
    return {name for argument in arguments for name in argument.names}


@pytest.mark.parametrize("line", named("myomorph"))
def test_options_of_a_command_exist(line):
    words = words_of(line)
    if words[1].startswith("--") or words[1].isupper():
        return
    command = words[1].rstrip(",.")
    if command in OF_EXAMPLES:
        return
    assert command in commands(), line
    known = EVERYWHERE | options_of(command)
    given = [word.partition("=")[0] for word in words[2:] if word.startswith("--")]
    assert [word for word in given if word not in known] == [], line


def logged() -> list:
    """Commands that pages show below their tables."""
    return [
        pytest.param(row["command"], id=row["command"])
        for row in load(LOG)
        if row["command"].startswith("python -m benchmarks ")
    ]


@pytest.mark.parametrize("line", [*named("python -m benchmarks"), *logged()])
def test_options_of_a_comparison_exist(line):
    words = [STANDS_FOR.get(word, word) for word in words_of(line)[3:]]
    if words[0] == "mutants":
        pytest.importorskip("cosmic_ray", reason="needs the extra 'mutants'")
    if words[0] == "opensim":
        pytest.importorskip("opensim", reason="needs the extra 'oracles'")
    request = parsed(words)
    assert request.name == words[0]
    assert callable(request.measure)


@pytest.mark.parametrize("line", named("python -m benchmarks.validation"))
def test_tables_of_accuracy_exist(line):
    names = {table for tables in TABLES.values() for table in tables}
    assert {STANDS_FOR.get(word, word) for word in words_of(line)[3:]} <= names


@pytest.mark.parametrize("line", named("python -m benchmarks.figures"))
def test_figures_exist(line):
    text = (ROOT / "benchmarks" / "figures" / "__main__.py").read_text(encoding="utf-8")
    name = words_of(line)[3]
    assert name == "NAME" or f'"{name}"' in text


def modules_named() -> list[str]:
    """Modules that pages run."""
    text = "\n".join(page.read_text(encoding="utf-8") for page in PAGES)
    return sorted(set(re.findall(r"python -m ((?:docs_build|benchmarks|tests)[\w.]*\w)", text)))


@pytest.mark.parametrize("module", modules_named())
def test_modules_that_pages_run_exist(module):
    place = ROOT / module.replace(".", "/")
    if (place / "__main__.py").is_file():
        return
    assert '__name__ == "__main__"' in place.with_suffix(".py").read_text(encoding="utf-8")


def test_every_comparison_is_run_or_has_a_reason():
    left_out = [name for names in NOT_RUN.values() for name in names]
    assert sorted([*SHORT, *left_out]) == sorted(COMPARISONS)


@pytest.mark.parametrize(
    "name", [pytest.param(one, marks=pytest.mark.long if one in LONG else ()) for one in SHORT]
)
def test_a_comparison_runs_in_its_shortest_form(name, data):
    if name == "opensim":
        pytest.importorskip("opensim", reason="needs the extra 'oracles'")
    if name in ("opensim", "draws"):
        data("rajagopal-walk-emg")
        data("opensim-gait-subject01")
        data("shoulder-bonepin")
    request = parsed(SHORT[name].split())
    assert request.measure(**request.options)


@pytest.mark.parametrize(
    "path",
    sorted([*(ROOT / "benchmarks").rglob("*.py"), *(ROOT / "docs_build").rglob("*.py")]),
    ids=lambda path: path.relative_to(ROOT).as_posix(),
)
def test_what_is_taken_from_a_module_is_there(path):
    """Names behind a module's, as `mm.read_model`; nothing is imported or run for it."""
    tree = ast.parse(path.read_text(encoding="utf-8"))
    places = dict(modules_in(tree))
    stored = {node.id for node in ast.walk(tree) if is_stored(node)}
    missing = [
        f"{node.value.id}.{node.attr}"
        for node in ast.walk(tree)
        if isinstance(node, ast.Attribute)
        and isinstance(node.value, ast.Name)
        and node.value.id in places
        and node.value.id not in stored
        and node.attr not in defined(places[node.value.id])
        and not node.attr.startswith("__")
    ]
    assert missing == []


def is_stored(node: ast.AST) -> bool:
    """Whether a name is given another value."""
    return isinstance(node, ast.Name) and isinstance(node.ctx, ast.Store)


def modules_in(tree: ast.Module) -> Iterator[tuple[str, Path]]:
    """Names under which a file knows modules of this repository, and where these lie."""
    homes = {"myomorph": ROOT / "src", "benchmarks": ROOT, "docs_build": ROOT, "tests": ROOT}
    for node in ast.walk(tree):
        if isinstance(node, ast.Import):
            for alias in node.names:
                home = homes.get(alias.name.partition(".")[0])
                if home is not None and (alias.asname or "." not in alias.name):
                    yield alias.asname or alias.name, home / alias.name.replace(".", "/")
        elif isinstance(node, ast.ImportFrom) and node.module:
            home = homes.get(node.module.partition(".")[0])
            for alias in node.names if home is not None else ():
                place = home / node.module.replace(".", "/") / alias.name
                if place.with_suffix(".py").is_file() or place.is_dir():
                    yield alias.asname or alias.name, place
