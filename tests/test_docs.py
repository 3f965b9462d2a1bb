"""What the README and the documentation tell people to type exists, and links resolve."""

from __future__ import annotations

import re
import shlex
import tomllib
from pathlib import Path

import pytest

from myomorph.lab.cli.app import COMMANDS

ROOT = Path(__file__).resolve().parents[1]
PAGES = [ROOT / "README.md", ROOT / "CONTRIBUTING.md", *sorted((ROOT / "docs").rglob("*.md"))]


def blocks(text):
    """Code in a page: fenced, or indented by four spaces."""
    fenced = re.findall(r"^```\w*\n(.*?)^```", text, re.MULTILINE | re.DOTALL)
    return [*fenced, *re.findall(r"(?:^    .+\n)+", text, re.MULTILINE)]


def command_lines():
    found = []
    for page in PAGES:
        for block in blocks(page.read_text(encoding="utf-8")):
            for line in block.replace("\\\n", " ").splitlines():
                for part in line.split("&&"):
                    if part.strip().startswith("myomorph "):
                        found.append((page.name, part.strip()))
    return [*found, *(("app.py", command.example) for command in COMMANDS.values())]


@pytest.mark.parametrize(("page", "line"), command_lines())
def test_commands_parse(page, line):
    """Every command line is one that the program accepts; nothing is run."""
    from myomorph.lab.cli.app import new_app

    words = shlex.split(line, comments=True)
    assert words[1] in COMMANDS, f"{page}: {line}"
    new_app().parse_args(words[1:], exit_on_error=False, print_error=False)


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_lead_somewhere(page):
    links = re.findall(r"\]\((?!https?:|mailto:)([^)#\s]+)", page.read_text(encoding="utf-8"))
    missing = [link for link in links if not (page.parent / link).exists()]
    assert missing == []


def anchors(page):
    """Names by which links find the headings of a page, as the site makes them."""
    text = re.sub(r"^```.*?^```", "", page.read_text(encoding="utf-8"), flags=re.M | re.S)
    # The site puts a section for each command there.
    found = set(COMMANDS) if page.name == "commands.md" else set()
    for heading in re.findall(r"^#+ (.+)$", text, re.MULTILINE):
        named = re.search(r"\{ #([\w-]+) \}$", heading)
        plain = re.sub(r"\[([^\]]*)\]\([^)]*\)", r"\1", heading)
        words = re.sub(r"[^\w\s-]", "", plain).strip().lower()
        found.add(named[1] if named else re.sub(r"[-\s]+", "-", words))
    return found


@pytest.mark.parametrize("page", [*PAGES, ROOT / "CHANGELOG.md"], ids=lambda page: page.name)
def test_links_lead_to_headings(page):
    links = re.findall(r"\]\((?!https?:|mailto:)([^)#\s]*)#([^)\s]+)\)", page.read_text("utf-8"))
    pages = [(page.parent / path if path else page, anchor) for path, anchor in links]
    missing = [
        f"{target.name}#{anchor}" for target, anchor in pages if anchor not in anchors(target)
    ]
    assert missing == []


def test_quick_start_is_three_commands():
    text = (ROOT / "README.md").read_text(encoding="utf-8")
    start = text.split("## Quick start")[1].split("\n## ")[0]
    lines = [line for block in blocks(start) for line in block.splitlines() if line.strip()]
    commands = [line for line in lines if not line.startswith("#")]
    assert commands == [
        "python -m pip install .",
        "myomorph demo",
        "myomorph analyze walk1.c3d --mass 72.6",
    ]


def test_the_commands_of_the_tests_are_those_that_ci_runs():
    readme = (ROOT / "README.md").read_text(encoding="utf-8")
    install = 'python -m pip install ".[test,oracles]"'
    assert f'{install} && python -m pytest -n 2 --dist loadfile -m "not long"\n' in readme
    contributing = (ROOT / "CONTRIBUTING.md").read_text(encoding="utf-8")
    assert "`python -m pytest -n 2 --dist loadfile -m long`" in contributing


def test_extras_and_program_exist():
    project = tomllib.loads((ROOT / "pyproject.toml").read_text(encoding="utf-8"))["project"]
    assert {"test", "oracles", "lint"} <= set(project["optional-dependencies"])
    assert project["scripts"] == {"myomorph": "myomorph.lab.cli:main"}
    assert (ROOT / "LICENSE").read_text(encoding="utf-8").lstrip().startswith("Apache License")


def test_study_files_in_the_docs_are_valid(tmp_path):
    """Every study file that is printed would be accepted, given its files.

    Those that examples write run with them.
    """
    from docs_build.examples import parts_of

    from myomorph.lab.study.plan.plan import read_plan
    from myomorph.swings.viscosity.study.plan import read_viscosity_plan

    run = {part.text.strip() for page in PAGES for part in parts_of(page) if part.kind == "file"}
    studies = [
        one
        for page in PAGES
        for one in blocks(page.read_text(encoding="utf-8"))
        if "[study]" in one
    ]
    studies = [one for one in studies if one.strip() not in run]
    assert len(studies) >= 2
    names = (
        "generic.osim",
        "detailed.osim",
        "walk1.trc",
        "walk1_grf.xml",
        "tasks.xml",
        "reserves.xml",
        "pairs.csv",
    )
    (tmp_path / "scan").mkdir()
    for name in (*names, "arm.osim", "bare1.trc", "bare1.mot", "full1.trc", "full1.mot"):
        (tmp_path / name).write_text("")
    for text in studies:
        (tmp_path / "study.toml").write_text(text, encoding="utf-8")
        if "[[specimen]]" in text:
            (one,) = read_viscosity_plan(tmp_path / "study.toml").specimens
            assert [swing.loads.name for swing in (*one.without, *one.intact)] == [
                "bare1.mot",
                "full1.mot",
            ]
            continue
        plan = read_plan(tmp_path / "study.toml")
        assert [trial.name for trial in plan.trials] == ["walk1"]


def test_python_for_beginners_runs(tmp_path, monkeypatch):
    from myomorph.show.demo.arm import example_files

    arm = example_files(tmp_path)
    arm.model.rename(tmp_path / "subject.osim")
    arm.markers.rename(tmp_path / "walk1.trc")
    monkeypatch.chdir(tmp_path)
    text = (ROOT / "docs" / "getting-started.md").read_text(encoding="utf-8")
    text = text.split("## From Python")[1]
    program = re.findall(r"```python\n(.*?)```", text, re.DOTALL)[0]
    names: dict[str, object] = {}
    exec(program, names)
    assert len(names["torques"]) == 61


@pytest.mark.parametrize("page", ["references.md", "architecture.md", "adding.md"])
def test_modules_that_a_page_names_exist(page):
    text = (ROOT / "docs" / page).read_text(encoding="utf-8")
    named = set(re.findall(r"`((?:\w+/)+[\w*]+\.py)`", text))
    assert named
    missing = [
        one
        for one in named
        if not list((ROOT / "src" / "myomorph").glob(one)) and not (ROOT / one).is_file()
    ]
    assert missing == []
